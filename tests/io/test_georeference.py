"""Which georeferences can be used in computations, and which files a coordinate system may name."""

import math

import pytest

from runout.errors import DemError
from runout.io.georeference import file_named_by, require_own_grids, require_usable


def refusal(*transform: float) -> str:
    with pytest.raises(DemError) as refused:
        require_usable(transform, "dem.tif", DemError)
    return str(refused.value)


@pytest.mark.parametrize(
    "transform",
    [
        (30.0, 0.0, 500_000.0, 0.0, -30.0, 4_000_000.0),
        (1e-7, 0.0, 0.0, 0.0, -1e-7, 0.0),  # a centimetre in degrees
        (1e6, 0.0, -1e9, 0.0, -1e6, 1e9),
        (3.0, 4.0, 0.0, 4.0, -3.0, 0.0),  # rotated
        (0.01, 0.0, 1e9 * 0.01, 0.0, -0.01, -1e9 * 0.01),
    ],
)
def test_cells_and_places_as_maps_have_them_are_accepted_and_not_with_a_number_that_is_none(transform):
    require_usable(transform, "dem.tif", DemError)
    for place in range(6):
        assert "its georeference holds nan" in refusal(*transform[:place], math.nan, *transform[place + 1 :])


def test_numbers_that_are_not_finite_are_named_with_the_command_that_mends_the_file():
    said = refusal(30.0, 0.0, math.nan, 0.0, -30.0, math.inf)
    assert said.startswith("dem.tif: its georeference holds nan, inf, which")
    assert said.endswith("`gdal_edit.py -a_ullr WEST NORTH EAST SOUTH dem.tif`")


@pytest.mark.parametrize("cell", [0.9e-7, 1.1e6])
def test_cells_smaller_than_a_centimetre_or_larger_than_a_map_are_refused(cell):
    assert f"cells of {cell:g} x 30" in refusal(cell, 0.0, 0.0, 0.0, -30.0, 0.0)
    assert f"cells of 30 x {cell:g}" in refusal(30.0, 0.0, 0.0, 0.0, -cell, 0.0)
    assert "cells of 30 x 0" in refusal(30.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("corner", [(1.1e9, 0.0), (0.0, -1.1e9)])
def test_corners_farther_from_the_origin_than_a_map_reaches_are_refused(corner):
    west, north = corner
    assert f"corner lies at {west:g}, {north:g}" in refusal(30.0, 0.0, west, 0.0, -30.0, north)


def test_corners_are_refused_at_which_double_precision_does_not_resolve_a_cell():
    farthest = 2.0**44 * 1e-5
    require_usable((1e-5, 0.0, farthest, 0.0, -30.0, 0.0), "dem.tif", DemError)
    assert "farther from the origin" in refusal(1e-5, 0.0, 1.1 * farthest, 0.0, -30.0, 0.0)


@pytest.mark.parametrize(
    ("system", "named"),
    [
        ("+proj=utm +zone=32 +nadgrids=BETA2007.gsb", None),
        ("+proj=utm +zone=32 +nadgrids=BETA2007.gsb,@/tmp/other.gsb", "@/tmp/other.gsb"),
        ("+proj=longlat +geoidgrids=https://example.org/g.tif", "https://example.org/g.tif"),
        ("+init=\\\\server\\epsg:32632", "\\\\server\\epsg:32632"),
        ('PARAMETERFILE["NTv2", "../grid.gsb"]', "../grid.gsb"),
    ],
)
def test_files_that_a_coordinate_system_names_are_found_and_refused(system, named):
    assert file_named_by(system) == named
    if named is None:
        return require_own_grids(system, "dem.tif", DemError)
    with pytest.raises(DemError, match=r"names the grid file .* which is not read; write a code"):
        require_own_grids(system, "dem.tif", DemError)
