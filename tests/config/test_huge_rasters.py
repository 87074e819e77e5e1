"""Rasters far larger than the scene: read in the part that a site needs, with bounded memory."""

import json
import resource
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import shapely

from runout import Terrain, read_site
from runout.config import extent as extents
from runout.errors import DemError, ReleaseError
from runout.workflow.check import inspect

SIDE, CELL, WEST, NORTH = 200_000, 10.0, -1_000_000.0, 6_000_000.0  # 4e10 cells
ROW, COLUMN, PATCH = 100_000, 150_000, 512  # where the ground is known
DEGREE = 1.0 / 7200  # half an arc-second: 2 592 000 x 1 296 000 cells are the globe
SITE = """\
name: huge
terrain:
  dem: inputs/{dem}
release:
  - name: scar
    {release}
material: {{density: 2000, youngs_modulus: 5.0e6, friction_angle_deg: 30}}
basal_friction_angle_deg: 25
simulation: {{cell_size: 10, end_time: 30}}
"""


def hill() -> np.ndarray:
    """A ramp of 22 degrees, 1.5 km long, that ends on level ground in the east."""
    x = (np.arange(PATCH) + 0.5) * CELL
    return np.tile(np.maximum(0.4 * (2500.0 - x), 0.0) + 300.0, (PATCH, 1)).astype("float32")


def sparse(path: Path, patch: np.ndarray, side=SIDE, transform=None, crs="EPSG:32632", place=(ROW, COLUMN), **more) -> Path:
    """A sparse tiled GeoTIFF: small on disk, known in one patch."""
    import rasterio
    from rasterio.windows import Window

    affine = rasterio.Affine(*(transform or (CELL, 0.0, WEST, 0.0, -CELL, NORTH)))
    shape = {"width": side, "height": side, "count": 1, "dtype": "float32", "crs": crs, "transform": affine, "nodata": -9999.0}
    tiles = {"tiled": True, "blockxsize": 1024, "blockysize": 1024, "sparse_ok": True, "bigtiff": "yes", "compress": "deflate"}
    with rasterio.open(path, "w", driver="GTiff", **shape, **{**tiles, **more}) as file:
        file.write(patch, 1, window=Window(place[1], place[0], patch.shape[1], patch.shape[0]))
    return path


def write_release(folder: Path, west: float, south: float, width: float, height: float, crs="EPSG:32632") -> None:
    import geopandas

    shape = shapely.box(west, south, west + width, south + height)
    geopandas.GeoDataFrame(geometry=[shape], crs=crs).to_file(folder / "release.gpkg", engine="pyogrio")


def write_site(folder: Path, dem: str, release: str = "{polygons: inputs/release.gpkg, thickness: 5}") -> Path:
    (folder / "inputs").mkdir(parents=True, exist_ok=True)
    text = SITE.format(dem=dem, release="").replace("  - name: scar\n    \n", f"  - {release}\n")
    (folder / "site.yaml").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def huge(tmp_path_factory) -> Path:
    """A site on a sparse raster of 4e10 cells."""
    folder = write_site(tmp_path_factory.mktemp("huge"), "dem.tif")
    dem = sparse(folder / "inputs" / "dem.tif", hill())
    assert dem.stat().st_size < 5e6
    write_release(folder / "inputs", WEST + (COLUMN + 100) * CELL, NORTH - (ROW + 260) * CELL, 80.0, 80.0)
    return folder


def test_a_huge_sparse_raster_is_read_where_the_masses_get_and_no_edge_is_reached(huge):
    found = inspect(huge)
    assert found.problems == []
    terrain, release = found.terrain, found.releases[0]
    assert release.volume == pytest.approx(32_000.0)
    assert terrain.elevation.size < PATCH**2
    assert np.isfinite(terrain.elevation).all()
    column = round((terrain.west - WEST) / CELL) - COLUMN
    np.testing.assert_allclose(terrain.elevation[0], hill()[0, column : column + terrain.shape[1]])
    assert not [w for w in found.warnings if "may leave" in w]
    assert any("derived from the releases and the energy line" in note for note in found.notes)
    extent = read_site(huge).computed()["terrain"]["extent"]
    assert extent == pytest.approx(terrain.extent, abs=2 * CELL)


MEASURED = """
    import json, resource, sys
    from pathlib import Path
    import geopandas, rasterio, scipy.ndimage, scipy.sparse.csgraph, pyproj, shapely, xarray
    from runout import read_site
    from runout.workflow.check import inspect
    def peak(): return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    before = peak()
    data = read_site(Path(sys.argv[1])).data()
    print(json.dumps([peak() - before, data.terrain.elevation.size, data.releases[0].volume]))
"""


def test_memory_is_that_of_the_part_and_not_of_the_raster(huge):
    gigabyte = 2**30

    def bounded() -> None:
        resource.setrlimit(resource.RLIMIT_DATA, (3 * gigabyte, 3 * gigabyte))

    command = [sys.executable, "-c", textwrap.dedent(MEASURED), str(huge)]
    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=bounded, check=True)
    megabytes, cells, volume = json.loads(done.stdout.splitlines()[-1])
    assert megabytes < 250  # of the raster, 160 GB are stated
    assert cells < PATCH**2
    assert volume == pytest.approx(32_000.0)


def test_a_stated_extent_is_read_whatever_the_masses_reach(huge, tmp_path):
    edges = WEST + (COLUMN + 60) * CELL, NORTH - (ROW + 300) * CELL, WEST + (COLUMN + 160) * CELL, NORTH - (ROW + 200) * CELL
    terrain = Terrain.from_raster(huge / "inputs" / "dem.tif", extent=edges)
    assert terrain.shape == (100, 100)
    assert terrain.extent == pytest.approx(edges)
    site = write_site(tmp_path / "stated", "dem.tif").joinpath("site.yaml")
    stated = f"dem.tif\n  extent: [{', '.join(map(str, edges))}]"
    text = site.read_text().replace("inputs/", f"{huge}/inputs/")
    site.write_text(text.replace("dem.tif", stated))
    found = inspect(site)
    assert found.problems == []
    assert found.terrain.shape == (100, 100)
    assert [w for w in found.warnings if "may leave the DEM" in w]


@pytest.mark.parametrize(
    ("extent", "said"),
    [
        ((0.0, 5e6, 100.0, 5e6 + 100.0), "none of the 100 cells has an elevation"),
        ((9e6, 0.0, 9.1e6, 100.0), r"covers 0 x 0 cells of the raster, which spans \[-1000000, 4000000, 1000000, 6000000\]"),
        ((5.0, 5.0, 1.0, 9.0), "west < east"),
        ((5.0, 5.0, np.nan, 9.0), "west < east|finite|number"),
        ((5.0, 5.0), "west, south, east and north"),
        (None, "state the part under study, terrain.extent"),
    ],
    ids=str,
)
def test_extents_that_cannot_be_read_are_named(huge, extent, said):
    with pytest.raises(DemError, match=said):
        Terrain.from_raster(huge / "inputs" / "dem.tif", extent=extent)


def test_an_extent_in_the_wrong_order_is_named_with_its_key(huge, tmp_path):
    site = write_site(tmp_path, "dem.tif") / "site.yaml"
    site.write_text(site.read_text().replace("dem.tif", "dem.tif\n  extent: [5, 5, 1, 9]"))
    assert any("terrain.extent" in problem and "put the edges in this order" in problem for problem in inspect(site).problems)


def test_too_large_a_part_and_one_that_cannot_be_found_say_what_to_state(huge, tmp_path, monkeypatch):
    monkeypatch.setattr(extents, "LARGEST_DERIVED", 15_000)
    with pytest.raises(DemError, match=r"may reach \d+ x \d+ cells or more, about .* GB .*; state terrain.extent: \[west, south"):
        read_site(huge).terrain()
    site = write_site(tmp_path / "raster", "dem.tif", "{raster: inputs/dem.tif}")
    text = (site / "site.yaml").read_text().replace("inputs/dem.tif", f"{huge}/inputs/dem.tif")
    (site / "site.yaml").write_text(text)
    with pytest.raises(ReleaseError, match=r"too many to look for the release in; state terrain.extent"):
        read_site(site).terrain()


def test_masses_that_reach_the_end_of_known_ground_do_not_ask_for_more(huge, tmp_path):
    site = write_site(tmp_path, "dem.tif") / "site.yaml"
    text = site.read_text().replace("angle_deg: 25", "angle_deg: 8").replace("inputs/", f"{huge}/inputs/")
    site.write_text(text)
    found = inspect(site)
    assert found.problems == []
    assert found.terrain.shape[1] > 300
    west, _, east, north = found.terrain.extent
    assert west >= WEST + COLUMN * CELL
    assert (east, north) <= (WEST + (COLUMN + PATCH) * CELL, NORTH - ROW * CELL)


def test_a_new_site_on_a_huge_raster_takes_its_cells(huge, tmp_path):
    from runout.config.scaffold import new_site

    site = read_site(new_site(tmp_path / "new", huge / "inputs" / "dem.tif", huge / "inputs" / "release.gpkg"))
    assert site.settings.simulation.cell_size == CELL


def test_a_huge_raster_in_degrees_is_projected_in_the_part_that_is_needed(tmp_path):
    folder = write_site(tmp_path, "dem.tif")
    row, column = 308_000, 1_379_000  # near 47.2 N, 11.5 E
    place = (DEGREE, 0.0, -180.0, 0.0, -DEGREE, 90.0)
    ramp = np.tile(np.linspace(1500.0, 300.0, 300, dtype="float32"), (300, 1))
    sparse(folder / "inputs" / "dem.tif", ramp, 1_400_000, place, "EPSG:4326", (row, column))
    west, south = -180.0 + (column + 90) * DEGREE, 90.0 - (row + 150) * DEGREE
    write_release(folder / "inputs", west, south, 10 * DEGREE, 8 * DEGREE, "EPSG:4326")
    found = inspect(folder)
    assert found.problems == []
    assert found.terrain.elevation.size < 90_000
    assert "EPSG:32632" in " ".join(found.terrain.changes)
    assert found.terrain.cell_size[0] == found.terrain.cell_size[1]
    assert not [w for w in found.warnings if "may leave" in w]


def test_a_huge_thickness_raster_is_read_on_the_terrain_alone(huge, tmp_path):
    deep = np.zeros((PATCH, PATCH), "float32")
    deep[240:250, 100:110] = 3.0
    deep[:2, -2:] = 9.0  # elsewhere
    thickness = sparse(tmp_path / "thickness.tif", deep)
    edges = WEST + (COLUMN + 60) * CELL, NORTH - (ROW + 300) * CELL, WEST + (COLUMN + 160) * CELL, NORTH - (ROW + 200) * CELL
    terrain = Terrain.from_raster(huge / "inputs" / "dem.tif", extent=edges)
    from runout import Release

    release = Release.from_raster(thickness, terrain)
    assert release.volume == pytest.approx(3.0 * 100 * CELL**2)
    assert any("releases elsewhere are left out" in change for change in release.changes)
    cut = Terrain.from_raster(huge / "inputs" / "dem.tif", extent=(edges[0] + 450.0, *edges[1:]))
    with pytest.raises(ReleaseError, match="lies outside the terrain"):
        Release.from_raster(thickness, cut)


def test_a_virtual_raster_of_a_nation_is_read_by_window(tmp_path):
    folder = write_site(tmp_path, "nation.vrt")
    sparse(folder / "inputs" / "tile.tif", hill(), 2048, (CELL, 0, 0, 0, -CELL, 0), place=(0, 0))
    west, north = WEST + COLUMN * CELL, NORTH - ROW * CELL
    text = (
        f'<VRTDataset rasterXSize="{SIDE}" rasterYSize="{SIDE}"><SRS>EPSG:32632</SRS>'
        f"<GeoTransform>{WEST}, {CELL}, 0, {NORTH}, 0, -{CELL}</GeoTransform>"
        '<VRTRasterBand dataType="Float32" band="1"><NoDataValue>-9999</NoDataValue><SimpleSource>'
        '<SourceFilename relativeToVRT="1">tile.tif</SourceFilename><SourceBand>1</SourceBand>'
        f'<SrcRect xOff="0" yOff="0" xSize="{PATCH}" ySize="{PATCH}"/>'
        f'<DstRect xOff="{COLUMN}" yOff="{ROW}" xSize="{PATCH}" ySize="{PATCH}"/></SimpleSource></VRTRasterBand></VRTDataset>'
    )
    (folder / "inputs" / "nation.vrt").write_text(text)
    write_release(folder / "inputs", west + 1000.0, north - 2600.0, 80.0, 80.0)
    found = inspect(folder)
    assert found.problems == []
    assert np.isfinite(found.terrain.elevation).all()
    assert found.terrain.elevation.size < PATCH**2


def test_a_part_of_a_netcdf_file_is_read(tmp_path):
    import xarray as xr

    x, y = 5e5 + 10.0 * np.arange(60), 5e6 + 10.0 * np.arange(50)
    z = 500.0 + np.arange(50)[:, None] - 0.5 * np.arange(60)
    attributes = {"crs_wkt": __import__("pyproj").CRS("EPSG:32632").to_wkt()}
    xr.Dataset({"elevation": (("y", "x"), z, {"grid_mapping": "crs"}), "crs": ((), 0, attributes)}, {"x": x, "y": y}).to_netcdf(
        tmp_path / "dem.nc", engine="netcdf4"
    )
    terrain = Terrain.from_raster(tmp_path / "dem.nc", extent=(5e5 + 95.0, 5e6 + 195.0, 5e5 + 295.0, 5e6 + 395.0))
    assert terrain.shape == (20, 20)
    np.testing.assert_allclose(terrain.elevation, z[20:40, 10:30][::-1])
