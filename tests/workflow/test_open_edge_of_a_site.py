"""A site whose raster is cut off by a catchment: mass leaves over the cut, and no product has a value beyond it."""

import netCDF4
import numpy as np
import pytest
import rasterio
from ramp_site import SITE, ramp, write_site

from runout.report import tables
from runout.report.study import read_study
from runout.workflow import hazard_map

TWO_MEMBERS = SITE.replace("members: 4", "members: 2")
WHERE_REACHED = (  # maps without a value where the flow does not arrive, or everywhere but near its boundary
    *("arrival_time", "first_arrival_time", "arrival_time_percentile"),
    *("boundary_distance_mean", "boundary_distance_deviation"),
)
WITHOUT_VALUE = ("terrain.nc", "release.nc", "hazard.nc", "members.nc", "members/*.nc")


def clipped():
    elevation = ramp()
    elevation[:, 22:] = np.nan
    elevation[12, 14] = np.nan
    return elevation


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = write_site(tmp_path_factory.mktemp("open") / "ramp", TWO_MEMBERS, np.nan_to_num(clipped(), nan=-9999.0))
    assert hazard_map.run(folder, workers=1).exit_code == 0
    return folder / "results"


@pytest.mark.parametrize("name", WITHOUT_VALUE)
def test_no_map_of_a_file_has_a_value_on_unknown_ground_and_each_has_one_beside_it(results, name):
    unknown = np.isnan(clipped())[:, :22]  # the rim without any elevation is cut off
    with netCDF4.Dataset(next(results.glob(name))) as file:
        maps = {n: v for n, v in file.variables.items() if v.dimensions[-2:] == ("y", "x")}
        assert maps
        for label, variable in maps.items():
            values = np.ma.masked_invalid(variable[:])
            assert np.ma.getmaskarray(values)[..., unknown].all(), label
            if label not in WHERE_REACHED:
                assert not np.ma.getmaskarray(values)[..., ~unknown].any(), label


def test_rasters_for_a_gis_are_nodata_there(results):
    paths = sorted((results / "maps").rglob("*.tif"))
    assert paths
    for path in paths:
        with rasterio.open(path) as raster:
            assert not raster.read_masks(1)[12, 14], path.name


def test_statistics_count_no_unknown_cell_and_the_report_says_how_much_left(results):
    study = read_study(results)
    (line,) = [w for w in tables.warnings(study, study.run["configuration"]) if "left the elevation raster" in w]
    assert "into its 1 cells without elevation" in line
    escaped = study.members["escaped_fraction"]
    assert 50 < escaped.max() <= 100
    for ledger in study.ledgers.values():
        assert tables.mass_error(ledger) < 1e-6
    assert np.isfinite(study.members[["runout_distance", "reached_area", "deposit_volume", "highest_speed"]].values).all()
