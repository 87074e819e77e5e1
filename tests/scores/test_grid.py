"""Maps brought to another grid by area, in the same and in another coordinate system."""

import numpy as np
import pyproj
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from runout import scores
from runout.errors import ObservationError

UTM = pyproj.CRS("EPSG:32632").to_wkt()
FINE = scores.Grid(500_000.0, 5_000_000.0, (5.0, 5.0), (60, 80), UTM, "fine")


def hill(grid):
    x, y = np.meshgrid(grid.easting, grid.northing)
    return np.exp(-((x - 500_180.0) ** 2 + (y - 5_000_140.0) ** 2) / 60.0**2)


@given(st.floats(3.0, 40.0), st.floats(3.0, 40.0), st.floats(-30.0, 0.0), st.floats(-30.0, 0.0))
def test_volume_is_kept_on_every_grid_that_covers_the_map(dx, dy, west, south):
    target = scores.Grid(500_000.0 + west, 5_000_000.0 + south, (dx, dy), (int(340 / dy) + 2, int(440 / dx) + 2), UTM)
    values = scores.resampled(np.pad(hill(FINE)[10:-10, 10:-10], 10), FINE, target.covering([FINE.extent]))
    assert np.nansum(values) * dx * dy == pytest.approx(hill(FINE)[10:-10, 10:-10].sum() * 25.0, rel=1e-9)


def test_cells_known_by_less_than_half_are_unknown_and_others_keep_their_mean():
    values = np.full((4, 4), 3.0)
    values[:, 1] = np.nan
    values[2:, 0] = np.nan
    small = scores.Grid(0.0, 0.0, (1.0, 1.0), (4, 4))
    found = scores.resampled(values, small, scores.Grid(0.0, 0.0, (2.0, 2.0), (3, 3)))
    nothing = [np.nan] * 3
    assert np.array_equal(found, [nothing, [3.0, 3.0, np.nan], [np.nan, 3.0, np.nan]], equal_nan=True)


def test_the_same_cells_keep_their_values_to_the_bit():
    values = hill(FINE)
    near = scores.Grid(FINE.west + 1e-7, FINE.south, FINE.cell_size, FINE.shape, UTM)
    assert np.array_equal(scores.resampled(values, FINE, near), values)


def test_an_ensemble_of_resampled_outlines_keeps_its_scores():
    coarse = scores.Grid(FINE.west, FINE.south, (10.0, 10.0), (30, 40), UTM)
    one, other = (scores.outline_shares(shapely.box(x, 5_000_040.0, x + 160.0, 5_000_200.0), FINE) for x in (500_040.0, 500_080.0))
    fine = scores.contingency(one, other, FINE.cell_area)
    same = scores.contingency(*(scores.resampled(v, FINE, coarse) for v in (one, other)), coarse.cell_area)
    assert same.critical_success_index == pytest.approx(fine.critical_success_index)
    assert fine.critical_success_index == pytest.approx(120 / 200)
    assert same.hits == pytest.approx(fine.hits)


def test_outlines_cover_the_exact_part_of_their_cells_without_holes():
    hole = shapely.box(500_022.0, 5_000_016.0, 500_030.0, 5_000_020.0)
    outline = shapely.box(500_012.0, 5_000_012.0, 500_052.0, 5_000_032.0) - hole
    shares = scores.outline_shares(outline, FINE)
    assert shares.sum() * FINE.cell_area == pytest.approx(outline.area)
    assert shares[-4, 3] == pytest.approx(1.0)
    assert shares[-3, 2] == pytest.approx(0.6 * 0.6)


def test_a_map_in_another_system_comes_to_its_place():
    lambert = scores.Grid(3_990_000.0, 2_400_000.0, (20.0, 20.0), (40, 50), pyproj.CRS("EPSG:3035").to_wkt(), "laea")
    there = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:3035", always_xy=True).transform(500_180.0, 5_000_140.0)
    moved = scores.Grid(there[0] - 500.0, there[1] - 400.0, (20.0, 20.0), (40, 50), lambert.crs, "laea")
    found = scores.resampled(hill(FINE), FINE, moved)
    row, column = np.unravel_index(np.nanargmax(found), found.shape)
    assert abs(moved.easting[column] - there[0]) <= 20.0
    assert abs(moved.northing[row] - there[1]) <= 20.0
    assert np.nansum(found) * 400.0 == pytest.approx(hill(FINE).sum() * 25.0, rel=0.02)
    assert np.isnan(found[0, 0])


def test_cells_beyond_the_rim_of_a_map_in_another_system_are_unknown():
    there = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:3035", always_xy=True).transform(500_200.0, 5_000_150.0)
    target = scores.Grid(
        there[0] - 300.0, there[1] - 300.0, (5.0, 5.0), (120, 120), pyproj.CRS("EPSG:3035").to_wkt()
    )  # of equal area
    values = scores.resampled(np.ones(FINE.shape), FINE, target)
    assert set(values[np.isfinite(values)]) == {1.0}
    assert np.isfinite(values).sum() * target.cell_area == pytest.approx(300.0 * 400.0, rel=0.01)  # a row more: 0.0167


def test_systems_without_a_known_transformation_are_refused_in_one_line():
    nameless = pyproj.CRS("+proj=utm +zone=32 +ellps=intl").to_wkt()
    odd = scores.Grid(0.0, 0.0, (5.0, 5.0), (10, 10), nameless, "odd.tif")
    with pytest.raises(ObservationError, match=r"odd.tif is in .* names no datum") as error:
        scores.resampled(np.zeros((10, 10)), odd, FINE)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("size", "shape"), [((5.0, 0.0), (3, 3)), ((-5.0, 5.0), (3, 3)), ((5.0, 5.0), (2, 9)), ((np.inf, 5.0), (3, 3))]
)
def test_a_grid_has_three_cells_each_way_of_a_positive_finite_size(size, shape):
    assert scores.Grid(0.0, 0.0, (5.0, 0.1), (3, 3)).cell_area == pytest.approx(0.5)
    with pytest.raises(ObservationError, match="3 x 3 of a positive size are needed"):
        scores.Grid(0.0, 0.0, size, shape)


def test_a_grid_grows_by_whole_cells_to_cover_others():
    grown = FINE.covering([(499_991.0, 5_000_010.0, 500_020.0, 5_000_301.0)])
    assert grown.extent == (499_990.0, 5_000_000.0, 500_400.0, 5_000_305.0)
    assert FINE.covering([FINE.extent]) == FINE
