import math
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from runout.hazard.figures import member_figures
from runout.hazard.reach import Reach, representative, representative_of
from runout.report.figures import released_energy
from runout.report.tables import energy_residual, mass_error

EASTING, NORTHING = np.arange(5.0, 100.0, 10.0), np.arange(190.0, 0.0, -20.0)  # cells of 10 m by 20 m
PLANE = np.broadcast_to(NORTHING[:, None], (10, 10))  # falls 45 degrees to the south


def runout(reached, released):
    return Reach.on(released, EASTING, NORTHING, PLANE).runout(reached)


def cells(*where):
    mask = np.zeros((10, 10), bool)
    for row, column in where:
        mask[row, column] = True
    return mask


def test_runout_is_measured_in_metres_on_cells_that_are_not_square():
    distance, _ = runout(cells((0, 0), (0, 3)), cells((0, 0)))
    assert distance == pytest.approx(30.0)
    distance, _ = runout(cells((0, 0), (3, 0)), cells((0, 0)))
    assert distance == pytest.approx(60.0)


def test_angle_of_reach_is_the_slope_from_the_highest_released_cell_to_the_farthest_cell():
    released = cells((0, 4), (1, 4))
    distance, angle = runout(released | cells((5, 4)), released)
    assert distance == pytest.approx(80.0)  # beyond the lower end of the release
    assert angle == pytest.approx(math.atan2(100.0, 100.0))


def test_a_flow_that_stays_in_its_release_has_no_runout_and_no_angle():
    distance, angle = runout(cells((2, 2)), cells((2, 2), (2, 3)))
    assert distance == 0.0
    assert math.isnan(angle)


def test_mass_of_an_inflow_releases_its_own_potential_energy():
    ledger = {
        "potential_energy": np.array([0.0, 70.0, 80.0]), "entered_energy": np.array([0.0, 80.0, 100.0]),
        "entrained_energy": np.array([0.0, 0.0, 5.0]), "numerical_dissipation": np.array([0.0, 1.0, 5.0]),
    }  # fmt: skip
    assert released_energy(ledger).tolist() == [0.0, 10.0, 25.0]
    assert energy_residual(ledger) == pytest.approx(0.2)


def test_the_volume_of_an_inflow_is_released_and_leaves_the_site_with_the_rest():
    maps = {"max_flow_thickness": 1.0, "max_speed": 2.0, "deposit_thickness": 0.9, "eroded_depth": 0.4, "elevation_change": 0.5}
    member = SimpleNamespace(held=lambda: list(maps), within=lambda name, part: np.full((10, 10), maps[name])[part])
    reach = Reach.on(cells((2, 2)), EASTING, NORTHING, PLANE)
    ledger = {"mass": np.array([0.0, 60.0]), "escaped_mass": np.array([0.0, 20.0]), "time": np.array([0.0, 9.0])}
    figures = member_figures(member, ledger, reach, least=0.1, inflow=1000.0)
    assert figures["eroded_volume"] == pytest.approx(0.4 * 20_000.0)
    assert figures["escaped_fraction"] == pytest.approx(25.0)
    assert figures["released_volume"] == pytest.approx(1000.0)
    assert figures["left_volume"] == pytest.approx(0.25 * (1000.0 + 8000.0))


def test_a_member_in_which_no_mass_has_started_has_figures():
    """Its inflow comes after the end of the run: nothing is reached, and nothing has left the site."""
    maps = {"max_flow_thickness": 0.0, "max_speed": 0.0, "deposit_thickness": 0.0, "eroded_depth": 0.0, "elevation_change": 0.0}
    member = SimpleNamespace(held=lambda: list(maps), within=lambda name, part: np.full((10, 10), maps[name])[part])
    ledger = {"mass": np.zeros(2), "escaped_mass": np.zeros(2), "time": np.array([0.0, 9.0])}
    figures = member_figures(member, ledger, Reach.on(cells((2, 2)), EASTING, NORTHING, PLANE), least=0.1)
    assert math.isnan(figures.pop("reach_angle_deg"))
    assert {name: value for name, value in figures.items() if value} == {"end_time": 9.0}
    assert mass_error(ledger) == 0.0


def test_the_run_out_is_that_to_the_farthest_cell_of_the_threshold():
    """A higher lowest threshold shortens the run-out of a member that thins out."""
    thins = np.broadcast_to(np.linspace(10.0, 1.0, 10)[:, None], (10, 10))
    member = SimpleNamespace(held=tuple, within=lambda name, part: thins[part])
    reach = Reach.on(cells((0, 4)), EASTING, NORTHING, PLANE)
    ledger = {"mass": np.ones(2), "escaped_mass": np.zeros(2), "time": np.array([0.0, 9.0])}
    far, near = (member_figures(member, ledger, reach, least)["runout_distance"] for least in (1.0, 8.0))
    assert far == pytest.approx(math.hypot(180.0, 50.0))
    assert near == pytest.approx(math.hypot(40.0, 50.0))


def test_the_representative_member_has_the_median_runout():
    table = pd.DataFrame({"runout_distance": [500.0, 100.0, np.nan, 300.0]}, index=[0, 1, 2, 3])
    assert representative(table) == 3


def test_a_film_thinner_than_the_lowest_threshold_does_not_make_a_member_the_median():
    released = np.array([[True, False, False, False]])
    reach = Reach.on(released, np.arange(4) * 10.0, np.zeros(2), np.zeros((1, 4)))
    thickness = {0: [1.0, 1.0, 0.01, 0.01], 1: [1.0, 1.0, 1.0, 0.0], 2: [1.0, 1.0, 1.0, 1.0]}
    maps = [(number, SimpleNamespace(within=lambda name, part, h=h: np.array([h])[part])) for number, h in thickness.items()]
    weights = pd.Series(1.0, index=range(3))
    assert representative_of(maps, weights, reach, least=0.1) == 1
    assert representative_of(maps, weights, reach, least=0.001) == 0
