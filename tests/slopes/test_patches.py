"""Release proposals: what they hold, that a site takes them as they are, and why there may be none."""

import json
import math
import re

import geopandas
import numpy as np
import pytest
import rasterio
import shapely
from rasterio.transform import from_origin

from runout import Release, Terrain, cli
from runout.errors import ExitCode
from runout.io.polygon_coverage import covered_part
from runout.workflow.check import inspect

CELL, WEST, NORTH = 5.0, 500_000.0, 5_000_000.0
WEAK = ("--cohesion", "0", "500", "--friction-angle", "32", "38", "--saturation", "0.2", "0.6")


def facets(steep_deg=42.0):
    """Elevation (60, 80) [m]: 15 degrees to the south, with a steep band of 14 cells and a steep step of one."""
    tangents = np.full(60, math.tan(math.radians(15.0)))
    tangents[[*range(20, 34), 45]] = math.tan(math.radians(steep_deg))
    return 500.0 - CELL * np.repeat(np.cumsum(tangents)[:, None], 80, axis=1)


def write_dem(path, elevation):
    rows, columns = elevation.shape
    profile = {"driver": "GTiff", "height": rows, "width": columns, "count": 1, "dtype": "float32", "crs": "EPSG:32632"}
    with rasterio.open(path, "w", transform=from_origin(WEST, NORTH, CELL, CELL), **profile) as file:
        file.write(elevation.astype(np.float32), 1)
    return path


@pytest.fixture(scope="module")
def proposed(tmp_path_factory):
    """DEM and folder of the results of one call."""
    folder = tmp_path_factory.mktemp("slopes")
    dem = write_dem(folder / "dem.tif", facets())
    assert cli.main(["-q", "--out", str(folder), "suggest-release", str(dem), *WEAK]) == ExitCode.OK
    return dem, folder / "slopes"


def test_steep_band_becomes_a_release_with_thickness_and_volume(proposed):
    _, folder = proposed
    release = geopandas.read_file(folder / "release.gpkg")
    assert release.crs.to_epsg() == 32632
    assert release["rank"].tolist() == list(range(1, len(release) + 1))
    assert len(release) == 1
    first = release.iloc[0]
    west, south, east, north = first.geometry.bounds
    assert (west, east) == (pytest.approx(WEST, abs=10), pytest.approx(WEST + 400, abs=10))
    assert (NORTH - north, NORTH - south) == (pytest.approx(100, abs=10), pytest.approx(170, abs=10))
    assert 0.5 < first.thickness_m < 1.5
    assert 0.5 < first.probability <= 1.0
    assert first.slope_deg == pytest.approx(42.0, abs=2.0)
    assert first.factor_of_safety < 1.0
    assert first.volume_m3 == pytest.approx(first.thickness_m * first.geometry.area, rel=1e-9)


def test_volume_weighs_cells_by_covered_area(proposed):
    _, folder = proposed
    first = geopandas.read_file(folder / "release.gpkg").iloc[0]
    with rasterio.open(folder / "failure_thickness.tif") as file:
        thickness = file.read(1).astype(float)
    place, area = covered_part(first.geometry, Terrain.from_array(facets(), CELL, origin=(WEST, NORTH - 300.0)))
    fails = thickness[place] > 0
    mean = (thickness[place] * area)[fails].sum() / area[fails].sum()
    assert first.volume_m3 == pytest.approx(mean * first.geometry.area, rel=1e-5)
    assert area.sum() == pytest.approx(first.geometry.area, rel=1e-9)


def test_a_triangle_loses_no_area_on_coarse_cells():
    terrain = Terrain.from_array(np.zeros((40, 50)), CELL, origin=(WEST, NORTH))
    triangle = shapely.Polygon([(WEST + 31, NORTH + 22), (WEST + 131, NORTH + 22), (WEST + 77, NORTH + 122)])
    _, area = covered_part(triangle, terrain)
    assert triangle.area == 5000.0
    assert area.sum() == pytest.approx(5000.0, rel=1e-12)


def test_maps_page_and_record_belong_together(proposed):
    from runout.io import netcdf

    _, folder = proposed
    maps = netcdf.read(folder / "slopes.nc")
    for name in ("sink_depth", "drainage_area", "ground_slope", "factor_of_safety", "failure_probability", "failure_thickness"):
        with rasterio.open(folder / f"{name}.tif") as file:
            assert np.array_equal(file.read(1), maps[name].values)
        assert (folder / f"{name}.qml").is_file()
    record = json.loads((folder / "slopes.json").read_text())
    assert record["stability"]["saturation"] == {"distribution": "uniform", "low": 0.2, "high": 0.6}
    assert "soil_density" in record["stability"]["defaults"]
    assert "cohesion" not in record["stability"]["defaults"]
    assert len(record["releases"]) == len(geopandas.read_file(folder / "release.gpkg"))
    assert not (folder / "terrain.gpkg").exists()  # no sink, and no path of 200 cells
    assert "Factor of safety" in (folder / "slopes.html").read_text()


def test_a_new_site_takes_the_release_as_it_is_and_its_check_finds_no_problem(proposed, tmp_path):
    dem, folder = proposed
    site, release = tmp_path / "site", folder / "release.gpkg"
    assert cli.main(["-q", "new", str(site), "--dem", str(dem), "--release", str(release)]) == ExitCode.OK
    assert "thickness: thickness_m" in (site / "site.yaml").read_text()
    found = inspect(site)
    assert found.problems == []
    read = Release.from_vector(release, Terrain.from_raster(dem), thickness="thickness_m")
    assert read.volume == pytest.approx(geopandas.read_file(release)["volume_m3"].sum(), rel=1e-6)


def test_proposals_name_the_grid_that_they_need_and_check_knows_their_error_on_it(proposed, tmp_path, capsys):
    dem, folder = proposed
    first = geopandas.read_file(folder / "release.gpkg").iloc[0]
    assert 0.8 * first.thickness_m < first.cell_size_m <= first.thickness_m
    assert first.particles == pytest.approx(16 * first.volume_m3 / first.cell_size_m**3)
    lines = json.loads((folder / "slopes.json").read_text())["lines"]
    (grid,) = [line for line in lines if line.startswith("grid: ")]
    assert "a new site starts with cells of 5 m; 1 of the 1 releases are thinner than 0.7 of them" in grid
    site = tmp_path / "site"
    assert cli.main(["-q", "new", str(site), "--dem", str(dem), "--release", str(folder / "release.gpkg")]) == ExitCode.OK
    text = (site / "site.yaml").read_text()
    (site / "site.yaml").write_text(re.sub(r"cell_size: [\d.]+", f"cell_size: {first.cell_size_m:.2g}", text))
    capsys.readouterr()
    assert cli.main(["check", str(site)]) == ExitCode.OK
    assert "expected numerical error ±" in " ".join(capsys.readouterr().out.split())
    assert cli.main(["suggest-release", str(site), *WEAK]) == ExitCode.OK
    assert "grid: " not in capsys.readouterr().out


def test_releases_that_the_memory_cannot_hold_are_not_proposed(proposed, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("runout.forecast.memory.available_bytes", lambda: 1e8)
    assert cli.main(["-q", "--out", str(tmp_path), "suggest-release", str(proposed[0]), *WEAK]) == ExitCode.OK
    assert "no release is proposed: 1 releases need more memory than is free" in capsys.readouterr().out
    assert not (tmp_path / "slopes" / "release.gpkg").exists()


def test_no_proposal_lies_on_cells_without_elevation_and_several_say_that_they_start_together(tmp_path, capsys):
    elevation = facets()
    for corner in range(5):  # steps along which an outline is smoothed
        elevation[20 + 2 * corner : 40, 40 + 2 * corner] = np.nan
        elevation[20 + 2 * corner : 40, 41 + 2 * corner] = np.nan
    elevation[:, 40] = np.nan
    dem = write_dem(tmp_path / "dem.tif", elevation)
    assert cli.main(["-q", "--out", str(tmp_path), "suggest-release", str(dem), *WEAK]) == ExitCode.OK
    assert "start: the polygons of one file start together" in capsys.readouterr().out
    read = Release.from_vector(tmp_path / "slopes" / "release.gpkg", Terrain.from_raster(dem), thickness="thickness_m")
    assert read.volume > 0


def test_nothing_found_says_why_in_one_line_and_leaves_no_release(tmp_path, capsys):
    dem = write_dem(tmp_path / "dem.tif", facets(20.0))
    (tmp_path / "slopes").mkdir()
    (tmp_path / "slopes" / "release.gpkg").write_bytes(b"of an earlier call")
    assert cli.main(["-q", "--out", str(tmp_path), "suggest-release", str(dem), *WEAK]) == ExitCode.OK
    told = [line for line in capsys.readouterr().out.splitlines() if line.startswith("no release is proposed")]
    assert len(told) == 1
    assert "no cell has a probability of failure of 0.5 or more; steepest slope" in told[0]
    assert "largest probability 0;" in told[0]
    assert not (tmp_path / "slopes" / "release.gpkg").exists()


def test_terrain_only_writes_no_stability(tmp_path, capsys):
    dem = write_dem(tmp_path / "dem.tif", facets())
    assert cli.main(["-q", "--out", str(tmp_path), "suggest-release", str(dem), "--terrain-only"]) == ExitCode.OK
    assert "factor of safety" not in capsys.readouterr().out
    assert not (tmp_path / "slopes" / "factor_of_safety.tif").exists()
    assert (tmp_path / "slopes" / "drainage_area.tif").is_file()
