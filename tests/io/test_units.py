import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

import runout
from runout.errors import ObservationError, ReleaseError
from runout.scores.read import read_map

GRID = from_origin(500_000, 5_000_040, 10, 10)
STORED = np.array([[0, 0, 0, 0], [0, 3, 5, 0], [0, 2, 4, 0], [0, 0, 0, 0]])


def write(path, stored=STORED, unit="", scale=1.0, **profile):
    profile = {"driver": "GTiff", "height": 4, "width": 4, "count": 1, "dtype": "int16", "crs": "EPSG:32632", **profile}
    with rasterio.open(path, "w", transform=GRID, **profile) as file:
        file.write(stored.astype(profile["dtype"]), 1)
        file.set_band_unit(1, unit)
        file.scales = (scale,)
    return path


@pytest.mark.parametrize(("unit", "scale", "metres"), [("ft", 1.0, 0.3048), ("cm", 10.0, 0.1), ("", 0.5, 0.5), ("m", 1.0, 1.0)])
def test_thickness_counts_in_the_unit_and_packing_that_its_raster_states(tmp_path, unit, scale, metres):
    path = write(tmp_path / "thickness.tif", unit=unit, scale=scale)
    terrain = runout.Terrain.from_array(np.full((4, 4), 100.0), 10.0, "EPSG:32632", (500_000, 5_000_000))
    release = runout.Release.from_raster(path, terrain, placement="on_surface")
    assert release.thickness == pytest.approx(STORED * metres)
    values, _, said = read_map(path)
    assert values == pytest.approx(STORED * metres)
    assert len(said) == (unit not in ("", "m")) + (scale != 1.0) == len(release.changes)


def test_undeclared_mark_of_a_scaled_raster_is_the_stored_number(tmp_path):
    terrain = runout.Terrain.from_array(np.full((4, 4), 100.0), 10.0, "EPSG:32632", (500_000, 5_000_000))
    with pytest.raises(ReleaseError, match="a_nodata 32000"):
        runout.Release.from_raster(write(tmp_path / "t.tif", np.where(STORED, STORED, 32000), scale=0.1), terrain)


def test_pressure_in_kpa_and_speed_in_km_h_become_si_and_another_unit_is_refused(tmp_path):
    path = write(tmp_path / "map.tif", unit="kPa")
    assert read_map(path, quantity="pressure")[0].max() == 5000.0
    with pytest.raises(ObservationError, match=r"kPa.*gdal_edit\.py -units"):
        read_map(path, quantity="speed")
    assert read_map(write(tmp_path / "map.tif", unit="km/h"), quantity="speed")[0].max() == pytest.approx(5 / 3.6)
