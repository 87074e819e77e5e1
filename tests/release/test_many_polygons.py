"""Thousands of polygons, and numbers that no run can have: in bounded time one volume, or one message."""

import numpy as np
import pytest
import shapely

from runout import simulate
from runout.errors import CapacityError, ConfigError, ReleaseError
from runout.io import polygon_overlap as overlap
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
