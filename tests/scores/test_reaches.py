"""Volumes by reach and agreement within one cell against numbers that are counted by hand."""

import numpy as np
import pytest

from runout import scores
from runout.errors import ObservationError
from runout.scores.assessment import Setting, against_observations
from runout.scores.flow import Flow
from runout.scores.observations import Observations

GRID = scores.Grid(0.0, 0.0, (10.0, 10.0), (3, 6))
LINE = scores.Thalweg(np.array([[0.0, 15.0], [60.0, 15.0]]))  # along the middle row


def reaches(stated, line=LINE, grid=GRID):
    return scores.Reaches.of(line, stated, grid)


def area(*rows):
    """Map (rows, columns) of 0 and 1."""
    return np.array([[float(cell == "#") for cell in row] for row in rows])


# --- agreement within one cell ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("modelled", "observed", "csi", "agreement"),
    [
        (area("##....", "##....", "......"), area("##....", "##....", "......"), 1.0, 1.0),
        (area("##....", "......", "......"), area(".##...", "......", "......"), 1 / 3, 1.0),  # one beside each other
        (area("#.....", "......", "......"), area("......", ".#....", "......"), 0.0, 1.0),  # a corner
        (area("#.....", "......", "......"), area("..#...", "......", "......"), 0.0, 0.0),  # two columns apart
        (area("####..", "......", "......"), area("#.....", "......", "......"), 0.25, 0.5),  # the second of four, not the others
        (area("#....#", "......", "......"), area("......", "......", "......"), 0.0, 0.0),
    ],
)
def test_cells_beside_the_other_area_agree_and_those_farther_away_do_not(modelled, observed, csi, agreement):
    for one, other in ((modelled, observed), (observed, modelled)):
        table = scores.contingency(one, other, 100.0)
        assert table.critical_success_index == pytest.approx(csi)
        assert table.agreement_within_one_cell == pytest.approx(agreement)


def test_a_neighbour_on_an_unknown_cell_does_not_count():
    modelled, observed = area("#....."), area(".#....")
    assert scores.contingency(modelled, observed).agreement_within_one_cell == 1.0
    modelled[0, 1] = np.nan
    assert scores.contingency(modelled, observed).agreement_within_one_cell == 0.0


def test_the_rest_of_a_cell_that_an_outline_cuts_agrees():
    table = scores.contingency(np.array([[1.0, 0.0, 0.0]]), np.array([[0.25, 0.0, 0.0]]), 100.0)
    assert (table.hits, table.false_alarms, table.near) == (25.0, 75.0, 75.0)


def test_the_area_of_a_change_counts_either_sign():
    modelled, observed = np.array([[-1.0, 2.0, 0.1, 0.0, 0.0]]), np.array([[-2.0, -1.0, 0.0, 0.0, 3.0]])
    found = scores.change_errors(modelled, observed, 1.0, 0.5).changed_area
    assert found.critical_success_index == pytest.approx(2 / 3)
    assert found.agreement_within_one_cell == pytest.approx(2 / 3)


# --- reaches ---------------------------------------------------------------------------------------------------------------


def test_reaches_are_the_cells_nearest_to_their_part_of_the_line():
    assert reaches(3).number.tolist() == [[0, 0, 1, 1, 2, 2]] * 3
    assert reaches([10.0, 20.0, 50.0]).number.tolist() == [[-1, 0, 1, 1, 1, -1]] * 3
    half = scores.Thalweg(np.array([[20.0, 15.0], [40.0, 15.0]]))
    assert reaches(2, half).number.tolist() == [[0, 0, 0, 1, 1, 1]] * 3, "beyond the ends the ends are nearest"
    bent = scores.Thalweg(np.array([[5.0, 25.0], [5.0, 4.0], [60.0, 4.0]]))
    assert reaches([0.0, 21.0, 76.0], bent).number.tolist() == [[0, 0, 0, 1, 1, 1], [0, 0, 1, 1, 1, 1], [0, 1, 1, 1, 1, 1]]


def test_the_error_is_the_sum_of_the_absolute_differences_of_the_volumes():
    """100 m2 a cell. Reaches of two columns: modelled -200, +100, +300 and observed -300, 0, +100 m3 where both are known."""
    modelled, observed = np.zeros((2, 3, 6))
    modelled[0, 0], modelled[2, 3], modelled[1, 4], modelled[1, 5] = -2.0, 1.0, 3.0, 9.0
    observed[1, 1], observed[0, 4], observed[1, 5] = -3.0, 1.0, np.nan
    found = scores.reach_errors(modelled, observed, reaches(3))
    assert found.modelled.tolist() == [-200.0, 100.0, 300.0]
    assert found.observed.tolist() == [-300.0, 0.0, 100.0]
    assert found.error == 100.0 + 100.0 + 200.0
    assert found.stored()["ends_m"] == [0.0, 20.0, 40.0, 60.0]


def test_a_dem_of_difference_is_scored_by_reach_above_its_detection_limit():
    modelled, observed = np.zeros((2, 3, 6))
    modelled[1], observed[1] = [-4.0, 0.1, 0.0, 0.0, 2.0, 0.0], [-3.0, -0.2, 0.0, 0.0, 1.0, 1.0]
    of_site = Observations(GRID, change=observed, detection_limit=0.5, thalweg=LINE, reaches=reaches(2))
    found = against_observations(Flow(GRID, {}), of_site, Setting([0.5]), modelled)
    values = {score.name: (score.value, score.units) for score in found.scores}
    assert values["reach_error"] == (100.0 + 0.0, "m3")
    assert found.stored()["reaches"] == {
        "ends_m": [0.0, 30.0, 60.0],
        "modelled_m3": [-400.0, 200.0],
        "observed_m3": [-300.0, 200.0],
    }
    assert "thalweg of 60 m in 2 reaches" in of_site.statement()


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ([0.0], r"\[0.0\] are no lengths in ascending order; state two or more"),
        ([10.0, 10.0], "no lengths in ascending order"),
        ([0.0, 61.0], "61 m is not on the thalweg, which is 60 m long"),
        ([-1.0, 60.0], "-1 m is not on the thalweg"),
    ],
)
def test_ends_that_are_not_on_the_line_are_refused(stated, said):
    with pytest.raises(ObservationError, match=said):
        reaches(stated)
