"""Thousands of polygons, slivers, and numbers that no run can have: in bounded time one volume, or one message."""

import numpy as np
import pytest
import shapely

from runout import FrictionZones, Structures, StructureSource, ZoneError, simulate
from runout.errors import CapacityError, ConfigError, DemError, ReleaseError, StructureError
from runout.io import polygons as overlap
from runout.io.polygons import read_polygons
from runout.model.release import Release


@pytest.fixture
def crowd():
    """2,000 squares that together cover a rectangle of 200 m by 150 m, in 1.2 million pairs."""
    random = np.random.default_rng(1)
    corners = np.column_stack([random.uniform(0, 120, 2000), random.uniform(0, 70, 2000)])
    corners[:4] = [(0, 0), (120, 0), (0, 70), (120, 70)]
    return [shapely.box(20 + x, 20 + y, 100 + x, 100 + y) for x, y in corners]


def test_two_thousand_polygons_on_top_of_each_other_count_once(write_polygons, terrain, crowd):
    release = Release.from_vector(write_polygons(crowd), terrain, thickness=2.0)
    assert release.volume == pytest.approx(2.0 * shapely.union_all(crowd).area, rel=1e-9)
    assert "more than" in release.changes[0]


def test_of_two_thousand_polygons_two_of_different_thickness_are_named(write_polygons, terrain, crowd):
    depths = np.ones(len(crowd))
    depths[1234] = 2.0
    path = write_polygons(crowd, depth=depths)
    with pytest.raises(ReleaseError, match=r"polygons \d+ \(1 m\) and 1235 \(2 m\)|polygons 1235 \(2 m\) and \d+ \(1 m\)"):
        Release.from_vector(path, terrain, thickness="depth")


def test_uniting_and_cutting_give_the_same_ground(monkeypatch, crowd):
    few = np.array(crowd[:60], dtype=object)
    one_by_one = overlap.cut(few, None, overlap.overlaps_of(few, None))
    monkeypatch.setattr(overlap, "MOST_PAIRS", 10)
    found = overlap.overlaps_of(few, None)
    assert not found.complete
    united = overlap.cut(few, None, found)
    assert shapely.area(united).sum() == pytest.approx(shapely.area(one_by_one).sum(), rel=1e-12)
    assert shapely.area(united).sum() == pytest.approx(shapely.union_all(few).area, rel=1e-12)


@pytest.mark.parametrize("seed", [-1, 1.5, "x", None])
def test_a_seed_that_is_no_whole_number_from_zero_is_refused(terrain, material, seed):
    release = Release.from_array(np.full(terrain.shape, 4.0), terrain)
    with pytest.raises(ConfigError, match="seed is"):
        simulate(terrain, release, material, cell_size=20.0, end_time=1.0, seed=seed)


def test_cells_too_small_to_be_counted_are_refused_before_they_are(terrain, material):
    release = Release.from_array(np.full(terrain.shape, 4.0), terrain)
    with pytest.raises(CapacityError, match=r"use a larger cell_size|index|memory"):
        simulate(terrain, release, material, cell_size=1e-4, particles_per_cell=1, end_time=1.0)


def sliver(area, west=20.0, south=40.0, height=10.0):
    """A triangle as a GIS overlay leaves it, far longer than wide."""
    return shapely.Polygon([(west, south), (west + 2 * area / height, south), (west, south + height)])


def test_slivers_of_an_overlay_are_left_out_with_a_word(write_polygons, terrain):
    boxes = [shapely.box(50, 50, 80, 80), shapely.box(100, 50, 130, 80)]
    shapes = [boxes[0], sliver(1e-4), shapely.MultiPolygon([boxes[1], sliver(1e-3)])]
    release = Release.from_vector(write_polygons(shapes, depth=[2.0, np.nan, 3.0]), terrain, thickness="depth")
    assert release.volume == pytest.approx(900.0 * 5.0, rel=1e-12)
    assert shapely.get_num_geometries(release.outline) == 2
    assert any("2 slivers below 0.001 cells of the terrain are left out, 0.0011 m2 in all" in change for change in release.changes)


def test_a_sliver_that_crosses_itself_is_left_out_and_a_larger_one_is_refused(write_polygons, terrain):
    def bow_tie(size):
        return shapely.Polygon([(20, 20), (20 + size, 20 + size), (20 + size, 20), (20, 20 + size)])

    box = shapely.box(50, 50, 80, 80)
    assert Release.from_vector(write_polygons([bow_tie(0.1), box]), terrain, thickness=2.0).volume == pytest.approx(1800.0)
    with pytest.raises(ReleaseError, match="polygon 1 is not valid"):
        Release.from_vector(write_polygons([bow_tie(1.0), box]), terrain, thickness=2.0)


def test_messages_count_the_polygons_of_the_file_with_its_slivers(write_polygons, terrain):
    shapes = [sliver(1e-4), shapely.box(50, 50, 80, 80), shapely.box(70, 50, 90, 80)]
    with pytest.raises(ReleaseError, match=r"polygons 2 \(2 m\) and 3 \(3 m\) overlap by 300 m2"):
        Release.from_vector(write_polygons(shapes, depth=[1.0, 2.0, 3.0]), terrain, thickness="depth")
    with pytest.raises(ReleaseError, match="attribute 'depth' of polygon 3 is empty"):
        Release.from_vector(write_polygons(shapes, depth=[1.0, 2.0, np.nan]), terrain, thickness="depth")


@pytest.mark.parametrize(("width", "refused"), [(5e-4, False), (5e-3, True)])
def test_an_overlap_below_a_thousandth_of_a_cell_is_left_to_the_first_polygon(write_polygons, terrain, width, refused):
    shapes = [shapely.box(50, 50, 80, 80), shapely.box(80 - width, 50, 110, 80)]
    path = write_polygons(shapes, depth=[2.0, 3.0])
    if refused:
        with pytest.raises(ReleaseError, match=r"overlap by 0\.15 m2"):
            Release.from_vector(path, terrain, thickness="depth", edge="vertical")
        return
    release = Release.from_vector(path, terrain, thickness="depth", edge="vertical")
    assert release.volume == pytest.approx(900.0 * 5.0, abs=1e-6)
    assert any("1 overlaps of polygons below 0.001 cells" in change and "0.015 m2 in all" in change for change in release.changes)


def test_a_layer_of_slivers_alone_is_read_as_it_was_drawn(write_polygons, terrain):
    layer = read_polygons(write_polygons([sliver(1e-3)]), terrain)
    assert (len(layer.polygons), layer.changes) == (1, ())


@pytest.mark.parametrize("far", [1e300, 1e12, -1e10])
def test_a_coordinate_that_no_map_reaches_names_the_feature(write_polygons, terrain, far):
    shapes = [shapely.box(50, 50, 80, 80), shapely.Polygon([(10, 10), (20, 10), (far, 20)])]
    path = write_polygons(shapes)
    with pytest.raises(ReleaseError, match="feature 2 of 2 has the coordinate"):
        Release.from_vector(path, terrain, thickness=2.0)
    with pytest.raises(DemError, match="feature 2 of 2 has the coordinate"):
        terrain.with_obstacles(path, 3.0)
    with pytest.raises(ZoneError, match="feature 2 of 2 has the coordinate"):
        FrictionZones.from_vector(path, terrain, factor=2.0)
    with pytest.raises(StructureError, match="feature 2 of 2 has the coordinate"):
        Structures.from_sources([StructureSource(path, height=4.0)], terrain, 2.0)
