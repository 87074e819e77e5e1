"""Dams and basins: ground that is raised by area, in the right cells, and refused where it cannot be."""

import time

import geopandas
import numpy as np
import pytest
import shapely

from runout import Terrain
from runout.errors import DemError
from runout.io.polygon_coverage import within_extent
from runout.terrain.obstacles import build

WEST, SOUTH, CELL = 600_000.0, 5_200_000.0, 10.0


@pytest.fixture
def flat():
    return Terrain.from_array(np.full((20, 30), 100.0), CELL, "EPSG:32632", (WEST, SOUTH))


@pytest.fixture
def drawn(tmp_path):
    """Writes boxes (west, south, east, north) in local metres with their attributes; returns the path."""

    def write(*boxes, crs="EPSG:32632", **attributes):
        shapes = [shapely.box(WEST + a, SOUTH + b, WEST + c, SOUTH + d) for a, b, c, d in boxes]
        frame = geopandas.GeoDataFrame(attributes, geometry=shapes, crs=crs)
        frame.to_file(tmp_path / "dams.gpkg", engine="pyogrio")
        return tmp_path / "dams.gpkg"

    return write


def test_a_dam_keeps_its_volume_and_stands_where_it_was_drawn(flat, drawn):
    dam = flat.with_obstacles(drawn((104.0, 20.0, 120.0, 60.0)), height=8.0)
    rows, columns = np.nonzero(dam.elevation != 100.0)
    assert set(columns) == {10, 11}
    assert set(rows) == {14, 15, 16, 17}  # from the north: 20 to 60 m north of the southern edge
    np.testing.assert_allclose(dam.elevation[15, [10, 11]], [104.8, 108.0], rtol=1e-12)
    assert (dam.elevation - 100.0).sum() * CELL**2 == pytest.approx(16.0 * 40.0 * 8.0)
    assert "obstacles on 640 m2 change the ground by 8 to 8 m" in dam.changes[-1]
    assert (flat.elevation == 100.0).all()


def test_an_attribute_raises_one_and_lowers_the_other(flat, drawn):
    path = drawn((100.0, 20.0, 120.0, 60.0), (200.0, 100.0, 250.0, 150.0), up=[5.0, -3.0])
    ground = flat.with_obstacles(path, height="up")
    assert (ground.elevation.max(), ground.elevation.min()) == pytest.approx((105.0, 97.0))
    assert "by -3 to 5 m" in ground.changes[-1]
    assert build(flat, path, "up")[1].narrowest == pytest.approx(2 * 20.0 * 40.0 / 120.0)


def test_what_cannot_be_an_obstacle_is_refused(flat, drawn):
    with pytest.raises(DemError, match=r"dams.gpkg: height is 900 m; it must be at least -300 and at most 300 m"):
        flat.with_obstacles(drawn((100.0, 20.0, 120.0, 60.0)), height=900.0)
    with pytest.raises(DemError, match="no attribute 'heigth' for the height; did you mean 'height'"):
        flat.with_obstacles(drawn((100.0, 20.0, 120.0, 60.0), height=[3.0]), height="heigth")
    with pytest.raises(DemError, match="no obstacle lies on the terrain"):
        flat.with_obstacles(drawn((-100.0, 20.0, -20.0, 60.0)), height=3.0)
    with pytest.raises(DemError, match=r"1 \(3 m\) and 2 \(4 m\) overlap by 200 m2.* one height"):
        flat.with_obstacles(drawn((100.0, 20.0, 120.0, 40.0), (110.0, 20.0, 130.0, 40.0), up=[3.0, 4.0]), height="up")


def test_slivers_of_an_overlay_change_nothing_and_are_no_narrow_obstacle(flat, drawn):
    path = drawn((100.0, 20.0, 120.0, 60.0), (130.0, 20.0, 130.001, 60.0), up=[3.0, 0.0])
    dam = flat.with_obstacles(path, "up")
    assert (dam.elevation - 100.0).sum() * CELL**2 == pytest.approx(800.0 * 3.0)
    assert any("1 slivers below 0.001 cells of the terrain are left out, 0.04 m2 in all" in change for change in dam.changes)
    assert build(flat, path, "up")[1].narrowest == pytest.approx(2 * 20.0 * 40.0 / 120.0)


def test_an_obstacle_that_leaves_the_terrain_is_built_in_the_part_on_it(flat, tmp_path):
    comb = shapely.union_all([shapely.box(WEST - 50, SOUTH + y, WEST + 40, SOUTH + y + 5) for y in (10, 30, 50)])
    comb = comb.union(shapely.box(WEST - 50, SOUTH + 10, WEST - 45, SOUTH + 55))
    geopandas.GeoDataFrame(geometry=[comb], crs="EPSG:32632").to_file(tmp_path / "comb.gpkg", engine="pyogrio")
    dam = flat.with_obstacles(tmp_path / "comb.gpkg", 2.0)
    assert (dam.elevation - 100.0).sum() * CELL**2 == pytest.approx(3 * 40.0 * 5.0 * 2.0)


def test_a_jagged_outline_of_many_points_is_cut_at_the_terrain_in_no_time():
    angle = np.linspace(0.0, 2.0 * np.pi, 40_000, endpoint=False)
    radius = 60.0 + 5.0 * np.random.default_rng(1).uniform(-1.0, 1.0, len(angle))
    shape = shapely.Polygon(np.column_stack((WEST + radius * np.cos(angle), SOUTH + 100.0 + radius * np.sin(angle))))
    extent = WEST, SOUTH, WEST + 300.0, SOUTH + 200.0
    started = time.perf_counter()
    whole, half = within_extent(np.array([shapely.affinity.translate(shape, 100.0), shape]), extent)
    fast = time.perf_counter() - started
    assert whole.area == pytest.approx(shape.area)
    exact = shapely.intersection(shape, shapely.box(*extent))
    assert half.is_valid
    assert half.area == pytest.approx(exact.area, rel=1e-12)
    assert fast < 0.5 * (time.perf_counter() - started)


@pytest.mark.parametrize("seed", range(5))
def test_parts_inside_a_rectangle_are_valid_and_those_of_an_intersection(seed):
    random = np.random.default_rng(seed)
    star = [(np.cos(a) * r, np.sin(a) * r) for a, r in zip(np.linspace(0, 6.2, 60), random.uniform(0.2, 3.0, 60), strict=True)]
    shapes = np.array([shapely.Polygon(star), shapely.box(-1, -1, 1, 1), shapely.box(-2, -1, 2, 1), shapely.box(1, -1, 2, 1)])
    parts, exact = within_extent(shapes, (-1.0, -1.0, 1.0, 1.0)), shapely.intersection(shapes, shapely.box(-1, -1, 1, 1))
    assert shapely.is_valid(parts).all()
    np.testing.assert_allclose(shapely.area(parts), shapely.area(exact), rtol=1e-12)
