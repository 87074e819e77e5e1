"""Distances of a modelled boundary from the parts of an outline: by hand, signed, and free of how the outline is written."""

import numpy as np
import pytest
import shapely
from test_observed_scalars import RELEASED, TERRAIN, flow

from runout.calibration.observed_scalars import PARTS, Measure, OutlineParts, observed_scalars
from runout.hazard.reach import Reach
from runout.model.terrain import Terrain
from runout.scores.grid import Grid, outline_shares
from runout.scores.observations import Observations

CELL, ROWS, COLUMNS = 10.0, 40, 80
LARGE = Terrain.from_array(np.zeros((ROWS, COLUMNS)), CELL)
START = np.zeros((ROWS, COLUMNS), bool)
START[18:22, 5:8] = True
REACH = Reach.on(START, LARGE.easting, LARGE.northing, LARGE.elevation)
LENGTH, WIDTH = 400.0, 200.0
BOX = shapely.box(100.0, 100.0, 100.0 + LENGTH, 100.0 + WIDTH)


def shares(outline):
    return outline_shares(outline, Grid.of(LARGE))


def parts(outline=BOX):
    return OutlineParts.of(outline, shares(outline), REACH)


def test_an_equal_boundary_has_no_distance():
    np.testing.assert_allclose(parts().distances(shares(BOX)), 0.0, atol=1e-12)


def test_distances_times_lengths_are_the_difference_of_the_areas():
    own = parts()
    assert own.length == pytest.approx(2.0 * (LENGTH + WIDTH) / PARTS)
    for moved in (BOX.buffer(30.0), BOX.buffer(-30.0), shapely.affinity.translate(BOX, 50.0, 20.0)):
        assert own.distances(shares(moved)).sum() * own.length == pytest.approx(moved.area - BOX.area, abs=1e-6)


def test_a_longer_flow_lies_beyond_the_front_only_and_a_shorter_one_short_of_it():
    """The first part is 150 m in the middle of the front of 200 m; what is nearer to the corners is missing."""
    own = parts()
    longer = own.distances(shares(shapely.box(100.0, 100.0, 200.0 + LENGTH, 100.0 + WIDTH)))
    assert longer[0] == pytest.approx(100.0, abs=5.0)
    assert longer[3:6] == pytest.approx(0.0, abs=1e-9)  # at the release
    shorter = own.distances(shares(shapely.box(100.0, 100.0, LENGTH, 100.0 + WIDTH)))
    assert shorter[0] == shorter.min() < -20.0


def test_parts_do_not_depend_on_where_the_ring_begins():
    """Nor on its direction; the points along the ring are 2.3 m apart, so that up to three cells change their part."""
    outline = shapely.Polygon([(100, 100), (500, 100), (600, 210), (500, 300), (100, 300)])
    turned = shapely.Polygon([(600, 210), (500, 100), (100, 100), (100, 300), (500, 300)])
    wider = shares(outline.buffer(25.0))
    np.testing.assert_allclose(parts(outline).distances(wider), parts(turned).distances(wider), atol=2.5)


def test_an_outline_of_two_areas_shares_the_parts():
    both = shapely.union(BOX, shapely.box(600.0, 100.0, 700.0, 200.0))
    own = parts(both)
    assert own.length == pytest.approx((1200.0 + 400.0) / PARTS)
    assert set(np.unique(own.nearest)) == set(range(PARTS))
    np.testing.assert_allclose(own.distances(shares(both)), 0.0, atol=1e-12)


def test_boundary_takes_the_place_of_the_area_and_keeps_the_run_out():
    outline = shapely.box(10.0, 20.0, 100.0, 30.0)
    event = Measure.of(Observations(Grid.of(TERRAIN), outline=outline), TERRAIN, RELEASED, 0.5, boundary=True)
    scalars = event.of_event()
    assert list(scalars) == [*(f"outline.position.{k}" for k in range(1, PARTS + 1)), "outline.runout"]
    assert scalars["outline.runout"] == pytest.approx(80.0)
    assert all(scalars[f"outline.position.{k}"] == pytest.approx(0.0, abs=1e-12) for k in range(1, PARTS + 1))
    nothing = event.of_member(flow(np.zeros_like(RELEASED)), RELEASED)
    total = sum(nothing[f"outline.position.{k}"] for k in range(1, PARTS + 1)) * outline.length / PARTS
    assert total == pytest.approx(-900.0)
    assert {one.error for one in observed_scalars(scalars, 10.0)} == {10.0}
