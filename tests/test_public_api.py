"""The lines that README.md and the landing page print for Python work as they stand."""

import re
from pathlib import Path

import geopandas
import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin
from shapely.geometry import box

import runout
from runout.quantities import member_map_names

ROOT = Path(__file__).parents[1]
UTM = "EPSG:32632"


@pytest.fixture
def inputs(tmp_path, monkeypatch):
    """dem.tif, a slope of 27 degrees, and release.gpkg, a square on it, in the working folder."""
    elevation = np.tile(1000.0 - 5.0 * np.arange(60), (40, 1)).astype(np.float32)
    profile = {"driver": "GTiff", "height": 40, "width": 60, "count": 1, "dtype": "float32", "crs": UTM, "nodata": -9999}
    with rasterio.open(tmp_path / "dem.tif", "w", transform=from_origin(500000, 5000400, 10, 10), **profile) as raster:
        raster.write(elevation, 1)
    square = geopandas.GeoDataFrame(geometry=[box(500080, 5000180, 500120, 5000220)], crs=UTM)
    square.to_file(tmp_path / "release.gpkg")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def printed(page: str) -> dict:
    """Names that the Python lines of a page leave."""
    code = re.search(r"```python\n(import runout\n.*?)```", (ROOT / page).read_text(), re.S).group(1)
    names: dict = {}
    exec(compile(code, page, "exec"), names)
    return names


def test_python_lines_of_the_landing_page_work_as_printed(inputs):
    assert printed("docs/index.md")["result"].maps.max_flow_thickness.max() > 1.0


def test_python_lines_of_the_readme_work_as_printed(inputs):
    names = printed("README.md")
    result, release = names["result"], names["release"]
    assert release.volume == pytest.approx(40 * 40 * 20)
    peaks = {"max_flow_thickness", "max_speed", "max_pressure", "max_momentum_flux"}
    assert set(result.maps) - {"crs"} == set(member_map_names()) >= peaks | {"arrival_time", "deposit_thickness"}
    deposit = float(result.maps.deposit_thickness.sum()) * 100 * 2000
    assert deposit + float(result.ledger.escaped_mass[-1]) == pytest.approx(release.volume * 2000, rel=1e-6)
    assert {"mass", "kinetic_energy", "potential_energy", "dissipation", "active_blocks", "dt"} <= set(result.ledger)
    assert isinstance(result.steps, int)
    assert result.n_particles > 100
    assert result.timing["total"] > 0
    assert (inputs / "run.nc").stat().st_size > 0


def test_every_public_name_is_there():
    for name in runout.__all__:
        assert getattr(runout, name) is not None
