"""Position of the boundary of the flow in metres: closed forms of bands and discs."""

import numpy as np
import pytest
from synthetic_ensemble import CELL, SHAPE, make_terrain, member_maps, write_member, write_part

from runout.hazard.boundary import DEVIATION, MEAN, BoundaryMaps, signed_distance, width_statement
from runout.hazard.exceedance import aggregate
from runout.io.member_maps import MemberMaps


def test_the_edge_of_a_mask_lies_between_its_cells():
    inside = np.zeros((5, 8), bool)
    inside[:, 3:] = True
    distance = signed_distance(inside[:, :], (10.0, 10.0))
    assert distance[2].tolist() == [-25.0, -15.0, -5.0, 5.0, 15.0, 25.0, 15.0, 5.0]  # beyond the array is outside


def fronts(tmp_path, rows, weights):
    """Maps of members that fill the raster from its northern edge down to a row each."""
    paths = []
    for number, row in enumerate(rows):
        maps = {name: np.zeros(SHAPE) for name in member_maps(0)}
        maps["max_flow_thickness"][:row] = 1.0
        maps["arrival_time"][:] = np.where(maps["max_flow_thickness"] > 0, 1.0, np.nan)
        write = write_part if number % 2 else None
        paths.append(write(tmp_path, number, make_terrain(), maps) if write else whole(tmp_path, number, maps))
    boundary = BoundaryMaps(np.asarray(weights) / np.sum(weights), 0.5)

    def each(number, member):
        boundary.take(number, member)

    hazard = aggregate(paths, weights, {"thickness": [0.5]}, [50.0], each=each)
    boundary.add_to(hazard)
    return hazard


def whole(folder, number, maps):
    """File of a member with the whole raster."""
    from runout.io import netcdf

    dataset = netcdf.map_dataset(make_terrain(), maps, title=f"member {number}")
    return netcdf.write(dataset, folder / f"{number:04d}.nc")


def test_a_front_that_moves_has_the_mean_and_the_deviation_of_its_places(tmp_path):
    """Fronts at rows 10, 14 and 20 with weights 1, 2, 1: mean 14.5 rows and deviation 3.57 rows of 12 m, by hand."""
    hazard = fronts(tmp_path, (10, 14, 20), (1.0, 2.0, 1.0))
    middle = SHAPE[1] // 2
    row = np.arange(SHAPE[0])
    half = 0.5 * (CELL[1] - 0.5 * (CELL[0] + CELL[1]))  # edges lie half a mean cell size beside the centres
    expected = 12.0 * (14.5 - (row + 0.5))
    between = (row >= 10) & (row < 20)
    mean, deviation = hazard[MEAN].values[:, middle], hazard[DEVIATION].values[:, middle]
    assert np.isfinite(mean).tolist() == between.tolist()
    assert mean[between] == pytest.approx(expected[between], abs=abs(2 * half))
    spread = 12.0 * np.sqrt((4.5**2 + 2 * 0.5**2 + 5.5**2) / 4)
    assert deviation[between] == pytest.approx(np.full(10, spread), abs=abs(2 * half))


def test_members_that_agree_have_no_band(tmp_path):
    assert MEAN not in fronts(tmp_path, (12, 12), (1.0, 1.0))


def test_the_band_of_discs_is_as_wide_as_their_radii_differ():
    """Radii of 100 to 200 m, equally likely: 5 % reach beyond 195 m and 95 % beyond 105 m."""
    y, x = np.indices((121, 121)) * 5.0 - 300.0
    radii = np.linspace(100.0, 200.0, 201)
    probability = np.mean([np.hypot(x, y) <= radius for radius in radii], axis=0)
    text = width_statement(probability, (5.0, 5.0))
    assert float(text.split(" are ")[1].split(" m ")[0]) == pytest.approx(90.0, abs=7.5)


def test_the_open_file_of_a_member_gives_the_same_cells_whole_and_cut(tmp_path):
    paths = [write_member(tmp_path / "whole", 1, make_terrain()), write_part(tmp_path, 1, make_terrain(), member_maps(1))]
    kept = []
    for path in paths:
        boundary = BoundaryMaps([1.0], 0.1)
        with MemberMaps(path) as member:
            boundary.take(0, member)
        kept.append(boundary.reached[0])
    assert kept[0][1] == kept[1][1]
    assert (kept[0][2] == kept[1][2]).all()
