import math

import numpy as np
import pandas as pd
import pytest

from runout.hazard.reach import Reach, representative

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


def test_the_representative_member_has_the_median_runout():
    table = pd.DataFrame({"runout_distance": [500.0, 100.0, np.nan, 300.0]}, index=[0, 1, 2, 3])
    assert representative(table) == 3
