"""Scalars of an event and of a member are defined alike, and hand-calculated."""

import numpy as np
import pytest
import shapely

from runout.calibration.observed_scalars import KINDS, Measure, observed_scalars, with_errors
from runout.errors import ConfigError
from runout.model.terrain import Terrain
from runout.scores.flow import Flow
from runout.scores.grid import Grid
from runout.scores.observations import Observations
from runout.scores.points import Gauges
from runout.scores.thalweg import Thalweg

CELL, ROWS, COLUMNS = 10.0, 5, 20
TERRAIN = Terrain.from_array(np.tile(np.linspace(100.0, 5.0, COLUMNS), (ROWS, 1)), CELL)
RELEASED = np.zeros((ROWS, COLUMNS))
RELEASED[2, 1] = 4.0


def strip(first, end, thickness=1.0):
    """Thickness (rows, columns) [m] in a strip of columns of the middle row."""
    values = np.zeros((ROWS, COLUMNS))
    values[2, first:end] = thickness
    return values


def flow(thickness, deposit=None):
    arrival = np.where(thickness > 0, 2.0 * np.arange(COLUMNS), np.inf)
    maps = {
        "thickness": thickness,
        "deposit": thickness if deposit is None else deposit,
        "speed": 3.0 * thickness,
        "arrival": arrival,
    }
    return Flow(Grid.of(TERRAIN), maps)


def measure(**parts):
    return Measure.of(Observations(Grid.of(TERRAIN), **parts), TERRAIN, RELEASED, 0.5)


def test_area_and_run_out_of_an_outline():
    """Columns 1 to 9 of the middle row: 900 m2, and 80 m from the released cell in column 1."""
    event = measure(outline=shapely.box(10.0, 20.0, 100.0, 30.0))
    assert event.of_event() == pytest.approx({"outline.area": 900.0, "outline.runout": 80.0})
    assert event.of_member(flow(strip(1, 10)), RELEASED) == pytest.approx(event.of_event())
    assert event.of_member(flow(strip(1, 10, 0.4)), RELEASED) == {"outline.area": 0.0, "outline.runout": 0.0}


def test_run_out_is_a_place_along_the_thalweg_where_there_is_one():
    event = measure(outline=shapely.box(10.0, 20.0, 100.0, 30.0), thalweg=Thalweg(np.array([[5.0, 25.0], [195.0, 25.0]])))
    assert event.of_event()["outline.runout"] == pytest.approx(90.0)
    assert event.of_member(flow(strip(0, 0)), RELEASED)["outline.runout"] == pytest.approx(10.0)  # the released cell


def test_volume_and_mean_distance_of_a_deposit_in_known_cells():
    known = strip(5, 9, 2.0)
    known[:, 12:] = np.nan
    event = measure(deposit=known)
    assert event.of_event() == pytest.approx({"deposit.volume": 800.0, "deposit.distance": 55.0})
    member = event.of_member(flow(strip(1, 20), strip(10, 15, 3.0)), RELEASED)
    assert member == pytest.approx({"deposit.volume": 600.0, "deposit.distance": 95.0})  # columns 10 and 11 are known


def test_volumes_of_a_dem_of_difference_leave_out_what_it_cannot_detect():
    event = measure(change=strip(5, 9, 1.0) + strip(1, 2, -2.0) + strip(15, 18, 0.1), detection_limit=0.2)
    expected = {"difference.erosion": 200.0, "difference.deposition": 400.0, "difference.distance": 55.0}
    assert event.of_event() == pytest.approx(expected)
    assert event.of_member(flow(strip(1, 9)), strip(5, 9, 1.0) - strip(1, 2, 2.0)) == pytest.approx(expected)


def test_gauges_without_a_value_do_not_count_and_arrival_is_a_rate():
    values = {"arrival_time": np.array([10.0, np.nan, 20.0]), "speed": np.array([3.0, 3.0, np.nan])}
    event = measure(gauges=Gauges(np.array([55.0, 105.0, 155.0]), np.full(3, 25.0), values))
    observed = {"gauges.arrival_rate.1": 0.1, "gauges.arrival_rate.3": 0.05, "gauges.speed.1": 3.0, "gauges.speed.2": 3.0}
    assert event.of_event() == pytest.approx(observed)
    member = event.of_member(flow(strip(1, 12)), RELEASED)
    assert member == pytest.approx(observed | {"gauges.arrival_rate.3": 0.0})  # it does not get there


def test_a_gauge_beside_the_terrain_has_no_scalar_of_a_member():
    event = measure(gauges=Gauges(np.array([55.0, 900.0]), np.full(2, 25.0), {"speed": np.array([3.0, 3.0])}))
    assert set(event.of_event()) == {"gauges.speed.1", "gauges.speed.2"}
    assert set(event.of_member(flow(strip(1, 12)), RELEASED)) == {"gauges.speed.1"}


SCALARS = observed_scalars({"outline.area": 900.0, "outline.runout": 80.0, "gauges.speed.1": 3.0, "gauges.speed.2": 4.0}, CELL)


def test_default_errors_are_shares_or_a_cell():
    assert [one.error for one in SCALARS] == pytest.approx([90.0, CELL, 0.6, 0.8])
    assert {one.group for one in SCALARS} == {"outline", "gauges"}
    assert all(kind.relative >= 0 for kind in KINDS.values())


def test_stated_errors_replace_them_and_observations_are_left_out():
    stated = {one.name: one.error for one in with_errors(SCALARS, ["gauges.speed=10%", "outline.runout=25"], ["outline.area"])}
    assert stated == pytest.approx({"outline.runout": 25.0, "gauges.speed.1": 0.3, "gauges.speed.2": 0.4})


@pytest.mark.parametrize(
    ("errors", "without", "said"),
    [
        (
            ["outlin=5"],
            [],
            "--error outlin=5: no observation has this name; the site has outline.area, outline.runout, gauges.speed.1",
        ),
        (["outline.area=-5"], [], "--error outline.area=-5: this is no standard error above 0; write NAME=5% or NAME=30, in m2"),
        (["outline.area"], [], "no standard error above 0"),
        ([], ["gauge"], "--without gauge: no observation has this name"),
        ([], ["outline", "gauges"], "--without leaves no observation"),
    ],
)
def test_wrong_options_are_refused_with_the_names_of_the_site(errors, without, said):
    with pytest.raises(ConfigError) as refusal:
        with_errors(SCALARS, errors, without)
    assert said in str(refusal.value)


def test_an_observed_zero_needs_a_stated_error():
    with pytest.raises(ConfigError, match=r"--error difference\.erosion=NUMBER"):
        with_errors(observed_scalars({"difference.erosion": 0.0}, CELL), [], [])
