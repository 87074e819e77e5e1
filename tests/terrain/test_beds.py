"""Depth of an erodible bed from polygons and rasters: shares of cut cells, attributes, overlaps, and what is refused."""

import numpy as np
import pytest
import shapely

from runout import Bed, RammsErosion, Terrain
from runout.errors import InputError

WEST, SOUTH = 500000.0, 5000000.0
CELLS = 0.2 * (1 + np.arange(6))[:, None] + 0.01 * np.arange(8)  # [m], another value in every cell


@pytest.fixture
def ground():
    """Level ground of 6 x 8 cells of 10 m."""
    return Terrain.from_array(np.full((6, 8), 100.0), 10.0, crs="EPSG:32632", origin=(WEST, SOUTH))


@pytest.fixture
def polygons(tmp_path):
    """Writer of a file of boxes (west, south, east, north) in metres from the south-west corner, with attributes."""
    import geopandas

    def write(*boxes, layer="bed", name="bed.gpkg", **attributes):
        shapes = [shapely.box(WEST + w, SOUTH + s, WEST + e, SOUTH + n) for w, s, e, n in boxes]
        geopandas.GeoDataFrame(attributes, geometry=shapes, crs="EPSG:32632").to_file(tmp_path / name, layer=layer)
        return tmp_path / name

    return write


def test_a_cell_that_an_outline_cuts_has_its_share_of_the_depth(ground, polygons):
    path = polygons((20, 10, 45, 20))
    bed = Bed.from_vector(path, ground, 2.0)
    depth = np.zeros((6, 8))
    depth[4, 2:4], depth[4, 4] = 2.0, 1.0  # the second row from the south; half of its fifth cell
    np.testing.assert_allclose(bed.depth, depth)
    assert (bed.erosion, bed.density, bed.source) == (RammsErosion(), None, str(path))


def test_an_attribute_states_the_depth_of_each_polygon_and_one_of_two_layers_is_named(ground, polygons):
    path = polygons((0, 0, 10, 10), (30, 30, 50, 40), dug=[0.5, 3.0])
    polygons((70, 50, 80, 60), layer="other", dug=[9.0])
    bed = Bed.from_vector(path, ground, "dug", layer="bed", erosion=RammsErosion(rate=0.2), density=1500.0)
    depth = np.zeros((6, 8))
    depth[5, 0], depth[2, 3:5] = 0.5, 3.0
    np.testing.assert_allclose(bed.depth, depth)
    assert (bed.erosion, bed.density) == (RammsErosion(rate=0.2), 1500.0)
    assert Bed.from_vector(path, ground, "dug", layer="other").depth[0, 7] == 9.0


def test_polygons_beyond_the_terrain_and_depths_that_are_none_are_refused(ground, polygons):
    far = polygons((500, 500, 520, 520), dug=[-1.0])
    with pytest.raises(InputError, match=r"bed.gpkg: no polygon of the bed lies on the terrain array; check the coordinate system"):
        Bed.from_vector(far, ground, 1.0)
    with pytest.raises(InputError, match="dug"):
        Bed.from_vector(far, ground, "dug")
    with pytest.raises(InputError, match="gone"):
        Bed.from_vector(far, ground, "gone")


def test_polygons_that_overlap_are_told(ground, polygons, caplog):
    bed = Bed.from_vector(polygons((0, 0, 20, 10), (10, 0, 30, 10), dug=[1.0, 1.0]), ground, "dug")
    np.testing.assert_allclose(bed.depth[5], [1, 1, 1, 0, 0, 0, 0, 0])
    assert "overlap" in caplog.text


def write_raster(path, values, west=WEST, north=SOUTH + 60.0):
    import rasterio

    shape = {"height": values.shape[0], "width": values.shape[1], "count": 1, "dtype": "float64", "crs": "EPSG:32632"}
    with rasterio.open(
        path, "w", driver="GTiff", transform=rasterio.Affine(10, 0, west, 0, -10, north), nodata=-1, **shape
    ) as file:
        file.write(values, 1)
    return path


def test_a_raster_has_its_depth_at_the_centres_of_cells_north_west_corner_first(ground, tmp_path):
    bed = Bed.from_raster(write_raster(tmp_path / "bed.tif", CELLS), ground, erosion=RammsErosion(rate=0.2), density=1500.0)
    np.testing.assert_allclose(bed.depth, CELLS)
    assert (bed.erosion, bed.density, bed.source) == (RammsErosion(rate=0.2), 1500.0, str(tmp_path / "bed.tif"))
    holes = CELLS.copy()
    holes[2, 5] = -1.0
    found = Bed.from_raster(write_raster(tmp_path / "holes.tif", holes), ground)
    np.testing.assert_allclose(found.depth, np.where(holes < 0, 0.0, holes))
    assert found.erosion == RammsErosion()


@pytest.mark.parametrize(("values", "said"), [(0.0 * CELLS, "depth of the bed is 0 on all cells"), (CELLS * 1e4, "depth")])
def test_rasters_without_a_depth_or_with_an_impossible_one_are_refused(ground, tmp_path, values, said):
    with pytest.raises(InputError, match=f"bed.tif: .*{said}"):
        Bed.from_raster(write_raster(tmp_path / "bed.tif", values), ground)
