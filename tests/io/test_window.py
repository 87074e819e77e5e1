"""The part of a raster that covers an extent."""

import pytest

from runout.errors import DemError
from runout.io.window import part_of

TALL = (2.0, 0.0, 1000.0, 0.0, -5.0, 3000.0)  # cells of 2 m x 5 m; 100 rows and 20 columns: 1000 to 1040 m, 2500 to 3000 m


def part(*extent: float):
    return part_of(TALL, (100, 20), extent, "dem.tif", DemError)


def test_a_part_holds_the_whole_cells_that_an_extent_touches():
    found = part(1005.0, 2600.0, 1020.0, 2751.0)
    assert (found.row, found.rows) == (49, 31)
    assert (found.column, found.columns) == (2, 8)


def test_an_extent_larger_than_the_raster_takes_all_of_it():
    found = part(0.0, 0.0, 5000.0, 5000.0)
    assert (found.row, found.rows, found.column, found.columns) == (0, 100, 0, 20)


@pytest.mark.parametrize(
    "extent", [(1004.5, 2600.0, 1007.0, 2751.0), (1005.0, 2600.0, 1020.0, 2610.0), (0.0, 2600.0, 900.0, 2700.0)]
)
def test_an_extent_of_less_than_three_cells_along_a_side_is_refused(extent):
    with pytest.raises(DemError, match=r"covers \d+ x \d+ cells of the raster, which spans \[1000, 2500, 1040, 3000\]"):
        part(*extent)
