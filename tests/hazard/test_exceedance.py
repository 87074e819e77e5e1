import json
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_ensemble import MARKER, SHAPE, make_table, make_terrain, member_maps, write_member

from runout.errors import StorageError
from runout.hazard.exceedance import aggregate, effective_sample_size, normalised, weighted_percentiles
from runout.hazard.members import Ensemble, members_file
from runout.io import netcdf
from runout.io.member_maps import MemberMaps
from runout.model.joint_conditions import ATTRIBUTE, meets, to_record
from runout.model.terrain import Terrain
from runout.quantities import MET, QUANTITIES
from runout.quantities.thickness_and_speed import at_one_time

THRESHOLDS = {"thickness": [0.1, 1.0, 2.0], "speed": [1.0, 5.0], "pressure": [3e3, 3e4]}
THRESHOLDS |= {"momentum_flux": [1.0, 10.0, 50.0], "deposit": [0.5, 1.0]}
JOINT = [{"thickness": 2.0, "speed": 3.0}, {"deposit": 0.7, "momentum_flux": 20.0, "pressure": 3e4}]
PERCENTILES = [5, 50, 95]
NAMES = {name: quantity.member_map for name, quantity in QUANTITIES.items()}
FORMULAS = {name: quantity for name, quantity in QUANTITIES.items() if quantity.formula}
DIFFERENT = pytest.mark.parametrize("weights", [[1, 1, 1, 1], [0.4, 0.3, 0.2, 0.1]])


@pytest.fixture
def members(tmp_path: Path) -> list[Path]:
    """Files of members 0 to 3."""
    return [write_member(tmp_path, number, make_terrain()) for number in range(4)]


def stack(name: str) -> np.ndarray:
    """One map of the four members, (4, rows, columns)."""
    return np.stack([member_maps(number)[name].astype(np.float32) for number in range(4)])


@DIFFERENT
def test_exceedance_is_the_summed_weight_of_the_members_that_reach_the_threshold(members: list[Path], weights: list[float]) -> None:
    maps = aggregate(members, weights, THRESHOLDS, PERCENTILES)
    w = np.array(weights) / np.sum(weights)
    for quantity, limits in THRESHOLDS.items():
        for k, limit in enumerate(limits):
            p = np.tensordot(w, stack(NAMES[quantity]) >= limit, axes=1)
            np.testing.assert_allclose(maps[f"{quantity}_exceedance_probability"][k], p, atol=1e-7)
            error = np.sqrt(np.clip(p * (1 - p), 0, None) * np.sum(w**2))
            np.testing.assert_allclose(maps[f"{quantity}_exceedance_standard_error"][k], error, atol=1e-6)
    np.testing.assert_array_equal(maps["inundation_probability"], maps["thickness_exceedance_probability"][0])
    assert float(maps["effective_sample_size"]) == pytest.approx(1 / np.sum(w**2))


def test_a_value_at_the_threshold_reaches_it(members: list[Path]) -> None:
    maps = aggregate(members, [1, 1, 1, 1], THRESHOLDS, PERCENTILES)
    # in row 3, column 6 the four members are 1, 2, 3 and 4 m thick
    np.testing.assert_allclose(maps["thickness_exceedance_probability"][:, 3, 6], [1.0, 1.0, 0.75])


@DIFFERENT
def test_percentiles_agree_with_numpy_everywhere(members: list[Path], weights: list[float]) -> None:
    maps = aggregate(members, weights, THRESHOLDS, PERCENTILES)
    names = {quantity.stem: quantity.member_map for quantity in QUANTITIES.values()}
    for product, name in names.items():
        w = np.broadcast_to(np.reshape(weights, (4, 1, 1)), (4, *SHAPE))
        expected = np.quantile(stack(name), np.array(PERCENTILES) / 100, axis=0, weights=w, method="inverted_cdf")
        np.testing.assert_array_equal(maps[f"{product}_percentile"], expected)


@given(
    values=st.lists(st.floats(0, 100, width=32), min_size=1, max_size=12),
    heaviness=st.lists(st.integers(1, 20), min_size=12, max_size=12),
    percentile=st.floats(0, 100),
)
@settings(max_examples=200, deadline=None)
def test_a_weighted_percentile_splits_the_weight(values: list[float], heaviness: list[int], percentile: float) -> None:
    v, w = np.array(values), np.array(heaviness[: len(values)], float)
    w /= w.sum()
    (found,) = weighted_percentiles(v[:, None], w, [percentile])[:, 0:1].ravel()
    assert found in v
    assert w[v <= found].sum() >= percentile / 100 - 1e-9
    assert w[v < found].sum() <= percentile / 100 + 1e-9


@DIFFERENT
def test_a_joint_condition_counts_members_that_reach_its_thresholds_together(members: list[Path], weights: list[float]) -> None:
    maps = aggregate(members, weights, THRESHOLDS, PERCENTILES, joint=JOINT)
    w = np.array(weights) / np.sum(weights)
    words = "flow thickness >= 2 m and flow speed >= 3 m s-1 at one time; only bounded"
    assert maps["joint_condition"].values[0].startswith(words)
    for k, condition in enumerate(JOINT):
        met = np.all([stack(NAMES[name]) >= limit for name, limit in at_one_time(condition).items()], axis=0)
        p = np.tensordot(w, met, axes=1)
        assert len(np.unique(p)) > 2
        np.testing.assert_allclose(maps["joint_exceedance_probability"][k], p, atol=1e-7)
        error = np.sqrt(np.clip(p * (1 - p), 0, None) * np.sum(w**2))
        np.testing.assert_allclose(maps["joint_exceedance_standard_error"][k], error, atol=1e-6)
        mean = np.sqrt(np.mean(error[p > 0] ** 2))
        assert float(maps["joint_exceedance_rms_error"][k]) == pytest.approx(mean, rel=1e-5)
        for name, limit in condition.items():
            assert float(maps[f"joint_{name}_threshold"][k]) == limit
    assert np.isnan(maps["joint_thickness_threshold"].values[1])


@pytest.mark.parametrize("condition", [{"speed": 1.0}, {"speed": 1.0, "colour": 2.0}, {"speed": 1.0, "thickness": 0.0}])
def test_joint_conditions_without_a_meaning_are_refused(members: list[Path], condition: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="joint condition"):
        aggregate(members, [1] * 4, THRESHOLDS, PERCENTILES, joint=[condition])


@DIFFERENT
def test_percentiles_of_the_arrival_count_members_that_never_arrive_as_infinity(members: list[Path], weights: list[float]) -> None:
    maps = aggregate(members, weights, THRESHOLDS, [5, 25, 50, 75, 90, 100])
    times = np.where(np.isnan(stack("arrival_time")), np.inf, stack("arrival_time"))
    w = np.broadcast_to(np.reshape(weights, (4, 1, 1)), (4, *SHAPE))
    shares = maps["percentile"].values / 100
    expected = np.quantile(times, shares, axis=0, weights=w, method="inverted_cdf")
    np.testing.assert_array_equal(maps["arrival_time_percentile"], np.where(np.isinf(expected), np.nan, expected))
    arrived = (np.isfinite(times) * w).sum(0) / np.sum(weights)
    for share, found in zip(shares, maps["arrival_time_percentile"].values, strict=True):
        np.testing.assert_array_equal(np.isfinite(found), (arrived >= share - 1e-9) & (arrived > 0))


def test_extremes_first_arrival_and_counts(members: list[Path]) -> None:
    maps = aggregate(members, [1, 1, 1, 1], THRESHOLDS, PERCENTILES)
    np.testing.assert_array_equal(maps["peak_flow_thickness"], stack("max_flow_thickness").max(0))
    np.testing.assert_array_equal(maps["peak_pressure"], stack("max_pressure").max(0))
    np.testing.assert_allclose(maps["mean_deposit_thickness"], stack("deposit_thickness").mean(0), rtol=1e-6)
    np.testing.assert_array_equal(maps["first_arrival_time"], np.fmin.reduce(stack("arrival_time")))
    np.testing.assert_array_equal(maps["members_reached"], (stack("max_flow_thickness") >= 0.1).sum(0))
    assert np.isnan(maps["first_arrival_time"].values[-1, -1])
    np.testing.assert_array_equal(maps["peak_momentum_flux"], stack("max_momentum_flux").max(0))
    assert maps["peak_flow_thickness"].values[0, 0] == MARKER


def test_a_heavier_member_counts_for_more(members: list[Path]) -> None:
    light = aggregate(members, [1, 1, 1, 0.001], THRESHOLDS, PERCENTILES)
    row, column = 16, 6  # only member 3 gets there
    assert float(light["inundation_probability"][row, column]) == pytest.approx(0.001 / 3.001, rel=1e-5)
    assert light["members_reached"].values[row, column] == 1


def test_a_cell_that_a_member_leaves_undefined_is_undefined(tmp_path: Path) -> None:
    terrain = make_terrain()
    holed = {**member_maps(1), "max_speed": np.where(np.indices(SHAPE)[0] == 4, np.nan, member_maps(1)["max_speed"])}
    paths = [
        write_member(tmp_path, 0, terrain),
        netcdf.write(netcdf.map_dataset(terrain, holed, title="t"), tmp_path / "0001.nc"),
    ]
    maps = aggregate(paths, [1, 1], THRESHOLDS, PERCENTILES, joint=JOINT)
    assert np.isnan(maps["joint_exceedance_probability"].values[0, 4]).all(), "it holds the speed"
    assert np.isfinite(maps["joint_exceedance_probability"].values[1]).all(), "it does not"
    for name in ("speed_exceedance_probability", "speed_exceedance_standard_error", "speed_percentile", "peak_speed"):
        assert np.isnan(maps[name].values[..., 4, :]).all()
        assert np.isfinite(maps[name].values[..., 5, :]).all()
    assert np.isfinite(maps["inundation_probability"]).all()


def test_a_probability_never_passes_one(tmp_path: Path) -> None:
    paths = [write_member(tmp_path, 1, make_terrain())] * 7
    maps = aggregate(paths, [0.1, 0.7, 0.3, 0.9, 0.2, 0.6, 0.1], THRESHOLDS, PERCENTILES)
    assert maps["inundation_probability"].max() == 1.0
    assert maps["thickness_exceedance_standard_error"].max() < 1e-7


def test_members_on_another_raster_are_refused(members: list[Path], tmp_path: Path) -> None:
    terrain = make_terrain()
    moved = Terrain(terrain.elevation, terrain.cell_size, terrain.west + 1.0, terrain.south, terrain.crs)
    other = write_member(tmp_path / "other", 9, moved)
    with pytest.raises(StorageError, match=r"0009\.nc: its grid.*is not that of 0000\.nc.*run the ensemble again"):
        aggregate([*members, other], [1] * 5, THRESHOLDS, PERCENTILES)


@pytest.mark.parametrize("weights", [[], [1, 1, 1], [1, 1, 1, -1], [0, 0, 0, 0], [1, 1, 1, np.nan]])
def test_weights_that_do_not_fit_are_refused(members: list[Path], weights: list[float]) -> None:
    with pytest.raises(ValueError, match="weights"):
        aggregate(members, weights, THRESHOLDS, PERCENTILES)


def test_inundation_needs_a_threshold(members: list[Path]) -> None:
    with pytest.raises(ValueError, match="no threshold of the flow thickness"):
        aggregate(members, [1] * 4, {**THRESHOLDS, "thickness": []}, PERCENTILES)


def test_equal_weights_count_as_many_members() -> None:
    assert effective_sample_size(normalised([2.0] * 8, 8)) == pytest.approx(8.0)
    assert effective_sample_size(normalised([1.0, 0.0], 2)) == pytest.approx(1.0)


def recorded_members(folder: Path, recorded: list[list[dict]]) -> list[Path]:
    """Members 0, 1, ... that record conditions: the first of each is met where the thickness is 2 m, and the others nowhere."""
    files = []
    for number, conditions in enumerate(recorded):
        maps = member_maps(number)
        maps |= {MET: 1.0 * (maps["max_flow_thickness"] >= 2.0)} if conditions else {}
        attributes = {ATTRIBUTE: json.dumps(conditions)} if conditions else {}
        dataset = netcdf.map_dataset(make_terrain(), maps, title="m", attrs=attributes)
        files.append(netcdf.write(dataset, folder / f"{number:04d}.nc"))
    return files


def test_conditions_that_all_members_record_are_exact_and_others_bounded(tmp_path: Path) -> None:
    """Two files record the condition as their first, one as its second: then its bit is not the same, and bounds hold."""
    pair, other = {"thickness": 0.7, "speed": 3.0}, {"thickness": 0.3, "speed": 2.0}
    known = np.isfinite(make_terrain().elevation)
    exact = recorded_members(tmp_path / "exact", [[pair], [pair, other], [pair]])
    maps = aggregate(exact, [1.0] * 3, {"thickness": [0.1]}, [50.0], joint=[pair])
    p = np.mean([member_maps(k)["max_flow_thickness"] >= 2.0 for k in range(3)], axis=0)
    np.testing.assert_allclose(maps["joint_exceedance_probability"].values[0][known], p[known], atol=1e-6)
    assert maps["joint_condition"].values[0] == "flow thickness >= 0.7 m and flow speed >= 3 m s-1 at one time"
    for k, recorded in enumerate(([[pair], [other, pair], [pair]], [[pair], [], [pair]])):
        bounded = recorded_members(tmp_path / f"bounded {k}", recorded)
        maps = aggregate(bounded, [1.0] * 3, {"thickness": [0.1]}, [50.0], joint=[pair])
        met = [np.all([member_maps(n)[NAMES[q]] >= v for q, v in at_one_time(pair).items()], axis=0) for n in range(3)]
        np.testing.assert_allclose(maps["joint_exceedance_probability"].values[0][known], np.mean(met, axis=0)[known], atol=1e-6)
        assert maps["joint_condition"].values[0].endswith("members do not record it")


def test_members_nc_has_the_record_of_members_with_the_same_conditions(tmp_path: Path) -> None:
    pair, other = {"thickness": 0.7, "speed": 3.0}, {"thickness": 0.3, "speed": 2.0}
    files = recorded_members(tmp_path, [[pair], [pair, other], [pair], []])
    path = tmp_path / "members.nc"
    ensemble = Ensemble(make_table(), dict(enumerate(files)), {4: "the time step"})
    with ExitStack() as stack:
        members = stack.enter_context(members_file(ensemble, path, make_terrain(), {}))
        for number, file in enumerate(files):
            members.copy(number, stack.enter_context(MemberMaps(file)))
    stacked, known = netcdf.read(path), np.isfinite(make_terrain().elevation)
    assert json.loads(stacked.attrs[ATTRIBUTE]) == [pair]
    for number in range(4):
        expected = (member_maps(number)["max_flow_thickness"] >= 2.0) * (number in (0, 2))
        np.testing.assert_array_equal(stacked[MET].values[number][known], expected[known])
    assert stacked[MET].values[0].any()


def test_a_condition_with_a_deposit_counts_its_flow_at_one_time_and_the_deposit_at_the_end() -> None:
    condition = {"thickness": 1.0, "deposit": 0.5, "speed": 2.0}
    values = {MET: np.array([0.0, 1.0, 1.0]), "deposit": np.array([9.0, 0.4, 0.5]), "thickness": np.full(3, 9.0)}
    assert meets(condition, values, {(("speed", 2.0), ("thickness", 1.0)): 0}).tolist() == [False, False, True]


def test_conditions_of_equal_thickness_and_speed_or_of_one_quantity_need_no_record() -> None:
    exact = [{"thickness": 1.0, "speed": 1.0}, {"thickness": 1.0, "deposit": 2.0}]
    assert to_record(exact) == []
    assert to_record([*exact, {"speed": 2.0, "thickness": 1.0}, {"thickness": 1.0, "speed": 2.0, "deposit": 1.0}]) == [
        {"speed": 2.0, "thickness": 1.0}
    ]


@given(
    flows=st.lists(st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 20.0)), min_size=1, max_size=6),
    limits=st.tuples(st.floats(0.1, 3.0), st.floats(0.1, 10.0)),
)
def test_bounds_at_one_time_lie_between_the_truth_and_the_maxima_of_different_times(flows, limits):
    a, b = (np.float32(limit) for limit in limits)
    h, v = np.array(flows, np.float32).T
    maps = {name: max(float(q.formula(x, y, 2000.0)) for x, y in zip(h, v, strict=True)) for name, q in FORMULAS.items()}
    together = bool(((h >= a) & (v >= b)).any())
    bounds = at_one_time({"thickness": float(a), "speed": float(b)})
    bounded = all(maps[name] >= limit for name, limit in bounds.items())
    apart = h.max() >= a and v.max() >= b
    assert together <= bounded <= apart
    if a == b:
        assert bounded == together


def test_other_thresholds_of_a_joint_condition_stay():
    assert at_one_time({"thickness": 1.0, "deposit": 2.0}) == {"thickness": 1.0, "deposit": 2.0}
    assert at_one_time({"thickness": 1.0, "speed": 1.0, "pressure": 3e4}) == {"thickness_and_speed": 1.0, "pressure": 3e4}
    assert at_one_time({"thickness": 2.0, "speed": 3.0, "momentum_flux": 50.0})["momentum_flux"] == 50.0
