"""The stated sampling error against the true one, over many scrambled nets of ensembles that are known by formula."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from synthetic_ensemble import peaks_of, write_part

from runout.ensemble.design import NetPoints, member_table, nets_of, sobol_points
from runout.hazard.exceedance import aggregate
from runout.hazard.net_error import _deviance, error_of_net
from runout.hazard.sampling import BLOCKS, SAFETY, Estimator, Strata, no_net, rms
from runout.model.terrain import Terrain

SIDE, NETS, STATED, TRUTH = 24, 200, 4, 2**15  # nets of the true error, and of the stated one
X, Y = np.meshgrid(np.linspace(0, 1, SIDE), np.linspace(0, 1, SIDE))
SEEDS = 0.05  # part of the spread that no net covers, as that of the particle sampling


def tongue(u):
    """Wet cells (members, rows, columns) of a tongue whose length, width and bend are sampled."""
    length, width, bend = 0.2 + 0.7 * u[:, 0], 0.05 + 0.2 * u[:, 1], 0.3 * (u[:, 2] - 0.5)
    across = Y - 0.5 - bend[:, None, None] * X
    return (length[:, None, None] > X) & (np.abs(across) < width[:, None, None])


def fan(u):
    """A fan whose radius depends most on the first of four parameters."""
    radius = 0.15 + 0.5 * (0.65 * (1 - u[:, 0]) + 0.2 * u[:, 1] + 0.1 * u[:, 2] + 0.05 * u[:, 3])
    return (radius**2)[:, None, None] > X**2 + (Y - 0.5) ** 2


def pit(u):
    """A fifth of the members stay near the release."""
    stays = u[:, 0] + 0.5 * u[:, 1] < 0.5
    radius = np.where(stays, 0.12 + 0.05 * u[:, 2], 0.3 + 0.6 * u[:, 0] * (1 - 0.3 * u[:, 3]))
    return radius[:, None, None] > X + 0.3 * (Y - 0.5) ** 2


def front(u):
    """All four parameters count alike."""
    return (0.375 * u.sum(axis=1))[:, None, None] > X + 0.5 * Y


def reach(u):
    """One parameter alone."""
    return (0.2 + 0.6 * u[:, 0])[:, None, None] > X + 0.3 * (Y - 0.5) ** 2


def classes(u):
    """One parameter, and one of three values, as the volume of an ensemble."""
    volume = np.array([0.5, 0.8, 1.2])[np.searchsorted([0.5, 0.8], u[:, 1])]
    return (0.1 + 0.5 * (0.7 * (1 - u[:, 0]) + 0.3 * volume))[:, None, None] > X + 0.3 * (Y - 0.5) ** 2


def depth(u):
    """Thickness of a fan."""
    radius = 0.15 + 0.5 * (0.65 * (1 - u[:, 0]) + 0.2 * u[:, 1] + 0.1 * u[:, 2] + 0.05 * u[:, 3])
    return 9.0 * np.sqrt(np.maximum((radius**2)[:, None, None] - X**2 - (Y - 0.5) ** 2, 0.0))


def deposit(u):
    """Deposit whose place and width are sampled: smooth."""
    return np.exp(-(((X - (0.2 + 0.6 * (1 - u[:, 0]))[:, None, None]) / (0.08 + 0.1 * u[:, 1])[:, None, None]) ** 2))


FLOWS = {tongue: 3, fan: 4, pit: 4, front: 4, reach: 1, classes: 2, depth: 4, deposit: 2}


def members_of(flow, points, seed):
    """Wet cells of members at points, which their seeds shift a little."""
    shift = SEEDS * np.random.default_rng(seed).standard_normal(points.shape)
    return flow(np.clip(points + shift, 0.0, 1.0))


def probability(flow):
    """Probability (rows, columns) over very many members."""
    points = sobol_points(TRUTH, FLOWS[flow], 10_000)
    parts = [members_of(flow, points[i : i + 1024], i) for i in range(0, TRUTH, 1024)]
    return np.mean([part.mean(axis=0) for part in parts], axis=0)


def volume(points):
    """The net of the points, and one that stands for the volume of their cube."""
    return NetPoints(points, sobol_points(1024, points.shape[1], 20_000))


def stated_of(values, points):
    """Stated error of the mean over a net of values (members, rows, columns), in all cells one after another."""
    cells, numbers, net = (
        values.reshape(len(values), -1).astype(np.float32).T,
        np.arange(len(values)),
        Estimator(BLOCKS, "", volume(points)),
    )
    return net.of_mean(cells, numbers, len(values)) * net.factor(net.scatter(cells, numbers, len(values)))


def ratios(flow, members):
    """Stated over true root mean square error, of the net and of independent members; the true one over many scrambled nets."""
    truth, squares, stated = probability(flow).ravel(), [], []
    for seed in range(NETS):
        points = sobol_points(members, FLOWS[flow], seed)
        values = members_of(flow, points, seed).astype(np.float64)
        reached = values.max(axis=0).ravel() > 0
        error, variance = values.mean(axis=0).ravel() - truth, values.var(axis=0).ravel() / members
        squares.append([np.mean(error[reached] ** 2), np.mean(variance[reached])])
        if seed < STATED:
            stated.append(np.mean(stated_of(values, points)[reached] ** 2))
    true, formula = np.mean(squares, axis=0)
    return np.sqrt(np.mean(stated) / true), np.sqrt(formula / true)


@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.parametrize("members", [16, 32, 64, 128])
def test_the_stated_error_is_the_true_one_within_0_8_and_1_5(flow, members):
    stated, formula = ratios(flow, members)
    assert 0.8 < stated < 1.5
    assert formula > 1.5
    assert formula > 1.2 * stated


def test_values_without_a_trend_have_the_error_of_independent_members():
    points, values = volume(sobol_points(32, 2, 5)), np.random.default_rng(2).standard_normal((32, 4000))
    deviation = values - values.mean(axis=0)
    assert error_of_net(deviation @ deviation.T, points) == pytest.approx(4000 / 32, rel=0.05)


def test_points_that_are_their_own_volume_leave_the_noise_alone():
    """The net is all there is: smooth values have no error, and noise has its own."""
    points = sobol_points(64, 2, 5)
    smooth = np.exp(-points @ np.array([[1.0, 2.0], [0.5, 0.1]]))
    noise = 0.01 * np.random.default_rng(3).standard_normal((64, 400))
    for values, expected in ((smooth, 0.0), (np.hstack([smooth, smooth[:, :1] + noise]), 400 * 1e-4 / 64)):
        deviation = values - values.mean(axis=0)
        of_own = error_of_net(deviation @ deviation.T, NetPoints(points, points))
        assert of_own == pytest.approx(expected, rel=0.3, abs=1e-6)
        assert error_of_net(deviation @ deviation.T, volume(points)) > of_own


def test_the_gradient_of_the_deviance_is_that_of_differences():
    points = sobol_points(16, 2, 1)
    values = np.sin(4 * points) + (points[:, :1] > 0.4)
    deviation = values - values.mean(axis=0)
    at, products = np.array([-0.5, 0.3, -1.0, -3.0]), deviation @ deviation.T
    steps = 1e-5 * np.eye(4)
    slopes = [(_deviance(at + step, products, points)[0] - _deviance(at - step, products, points)[0]) / 2e-5 for step in steps]
    np.testing.assert_allclose(_deviance(at, products, points)[1], slopes, rtol=1e-5)


def test_scatter_by_hand_and_over_parts_of_a_map():
    values = np.array([[1.0, 0, 0, 0], [1.0, 1.0, 0, 0], [np.nan, 0, 1.0, 0]])
    net, numbers = Estimator(BLOCKS, "", volume(sobol_points(4, 1, 0))), np.arange(4)
    whole = net.scatter(values, numbers, 4)
    # deviations 3/4 -1/4 -1/4 -1/4 and 1/2 1/2 -1/2 -1/2; s^2 = 3/4 / 12 and 1 / 12; the third cell has no value of one member
    assert sum(whole.spreads) == pytest.approx((0.75 + 1.0) / 12)
    assert whole.products[0][0].tolist() == [9 / 16 + 1 / 4, -3 / 16 + 1 / 4, -3 / 16 - 1 / 4, -3 / 16 - 1 / 4]
    parts = net.scatter(values[:1], numbers, 4) + net.scatter(values[1:], numbers, 4)
    assert parts.spreads == pytest.approx(whole.spreads)
    np.testing.assert_allclose(parts.products[0], whole.products[0])
    assert net.scatter(np.array([[1.0]]), np.array([2]), 4).products[0][2].tolist() == [
        -3 / 16,
        -3 / 16,
        9 / 16,
        -3 / 16,
    ]  # others: 0
    alone = Estimator(BLOCKS)
    assert alone.factor(alone.scatter(values, numbers, 4)) == 1.0


def test_points_of_a_discrete_parameter_are_in_the_middle_of_the_interval_of_their_value():
    volumes = SimpleNamespace(distribution="discrete", values=[3.0, 1.0, 2.0], frequencies=[5, 3, 2])
    ensemble = SimpleNamespace(members=16, seed=1, parameters={"release_volume_factor": volumes, **UNIFORM})
    points, table = nets_of(ensemble)[""], member_table(ensemble)
    for net in (points.members, points.volume):
        assert set(net[:, 1].round(9)) == {0.25, 0.65, 0.9}
    np.testing.assert_allclose(10.0 + 10.0 * points.members[:, 0], table["basal_friction_angle_deg"])
    middle_of = {3.0: 0.25, 1.0: 0.65, 2.0: 0.9}
    np.testing.assert_allclose(points.members[:, 1], table["release_volume_factor"].map(middle_of))
    assert np.mean(points.volume[:, 1] < 0.5) == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("members", [32, 128])
def test_members_of_random_points_have_the_error_of_independent_ones(members, monkeypatch):
    rng = np.random.default_rng(3)
    monkeypatch.setattr("test_sampling_error.sobol_points", lambda n, d, seed: rng.random((n, d)))
    stated, formula = ratios(fan, members)
    assert 0.9 < formula < 1.1
    assert 0.8 < stated < 1.5


def scene(shape=(70, 90)):
    """Flat ground with a hole, by default larger than a tile in both directions."""
    elevation = np.zeros(shape)
    elevation[4, 5] = np.nan
    return Terrain(elevation, (5.0, 5.0), 0.0, 0.0, None, source="flat")


def net_of(folder: Path, members: int, terrain: Terrain) -> list[Path]:
    """Files of members with irregular maps; the last one holds nothing."""
    paths = []
    for number in range(members):
        rng = np.random.default_rng(number)
        wet = (np.indices(terrain.shape)[0] < 20 + 3 * number) & (rng.random(terrain.shape) < 0.7) & (number < members - 1)
        h = np.where(wet, rng.uniform(0, 3, terrain.shape), 0.0)
        maps = {**peaks_of(h, 2 * h), "arrival_time": np.where(h > 0, 1.0, np.nan), "deposit_thickness": h / 2}
        paths.append(write_part(folder, number, terrain, maps))
    return paths


def expected(paths: list[Path], limit: float) -> np.ndarray:
    """Standard error of each cell from the maps of the members."""
    from runout.io.member_maps import read_maps

    reached = np.stack([read_maps(path)["max_flow_thickness"].values >= np.float32(limit) for path in paths])
    of_block = reached.reshape(BLOCKS, -1, *reached.shape[1:]).mean(axis=1)
    spread = np.sqrt(((of_block - reached.mean(axis=0)) ** 2).sum(axis=0) / (BLOCKS * (BLOCKS - 1)))
    return spread


@pytest.mark.parametrize(("memory_bytes", "shape"), [(1, (26, 12)), (2**26, (70, 90))])  # tiles of 1 x 1 and of 32 x 32 cells
def test_maps_of_a_net_carry_the_spread_over_its_blocks_and_say_so(tmp_path, memory_bytes, shape):
    terrain, limits = scene(shape), {"thickness": [0.5, 2.0], "speed": [], "pressure": [250.0]}
    paths = net_of(tmp_path, 16, terrain)
    maps = aggregate(paths, [1.0] * 16, limits, [50], estimator=Estimator(BLOCKS), memory_bytes=memory_bytes)
    known = np.isfinite(terrain.elevation)
    for k, limit in enumerate(limits["thickness"]):
        found = maps["thickness_exceedance_standard_error"].values[k]
        np.testing.assert_allclose(found[known], expected(paths, limit)[known], atol=1e-7)
        assert np.isnan(found[~known]).all()
        wet = maps["thickness_exceedance_probability"].values[k] > 0
        mean = np.sqrt(np.mean(found[wet].astype(np.float64) ** 2))
        assert float(maps["thickness_exceedance_rms_error"][k]) == pytest.approx(mean, rel=1e-9)
    for name in ("thickness_exceedance_standard_error", "thickness_exceedance_rms_error", "pressure_exceedance_standard_error"):
        assert "4 consecutive blocks of 4 members of one Sobol net" in maps[name].attrs["estimator"]
    assert "speed_exceedance_rms_error" not in maps


@pytest.mark.parametrize("limits", [(1.0, 4.5), (0.2, 5.0)])
def test_a_joint_condition_of_a_net_carries_the_spread_over_its_blocks(tmp_path, limits):
    """Speed is twice the thickness in these members: together they reach the larger of the limits."""
    joint, thickness = [dict(zip(("thickness", "speed"), limits, strict=True))], max(limits[0], limits[1] / 2)
    paths = net_of(tmp_path, 16, scene())
    maps = aggregate(paths, [1.0] * 16, {"thickness": [thickness]}, [50], joint=joint, estimator=Estimator(BLOCKS))
    known = np.isfinite(scene().elevation)
    for kind in ("probability", "standard_error", "rms_error"):
        one, other = (maps[f"{name}_exceedance_{kind}"].values for name in ("joint", "thickness"))
        np.testing.assert_array_equal(one, other)
    found = maps["joint_exceedance_standard_error"].values[0]
    np.testing.assert_allclose(found[known], expected(paths, thickness)[known], atol=1e-7)
    assert "4 consecutive blocks of 4 members" in maps["joint_exceedance_rms_error"].attrs["estimator"]


def test_without_an_estimator_members_count_as_independent_and_the_map_says_so(tmp_path):
    maps = aggregate(net_of(tmp_path, 3, scene()), [1.0] * 3, {"thickness": [0.5]}, [50])
    assert maps["thickness_exceedance_standard_error"].attrs["estimator"] == (
        "sqrt(P (1 - P) / effective_sample_size), as for independent members: the members are not known to be a Sobol net"
    )


UNIFORM = {"basal_friction_angle_deg": SimpleNamespace(distribution="uniform", low=10.0, high=20.0)}


def table_of(members: int, parameters=UNIFORM) -> pd.DataFrame:
    return member_table(SimpleNamespace(members=members, seed=1, parameters=parameters))


def test_a_whole_net_of_a_power_of_two_is_known_as_such():
    for members in (16, 32, 1024):
        assert Estimator.of(table_of(members), range(members)).blocks == BLOCKS


@pytest.mark.parametrize(
    ("table", "valid", "reason"),
    [
        (table_of(8), range(8), "8 members are fewer than 16"),
        (table_of(48), range(48), "48 members are not a power of two"),
        (table_of(16), [*range(3), *range(4, 16)], "15 of 16 members are valid"),
        (table_of(16, {}), range(16), "not known to be a Sobol net"),
        (table_of(16).iloc[::-1], range(16), "not in the order of the net"),
        (table_of(16).assign(weight=np.arange(16) + 1.0), range(16), "different weights"),
        (pd.DataFrame({"weight": [1.0] * 16}), range(16), "not known to be a Sobol net"),
    ],
)
def test_other_ensembles_have_the_error_of_independent_members_with_the_reason(table, valid, reason):
    found = Estimator.of(table, list(valid))
    assert found.blocks == 0
    assert reason in found.statement(16)


def test_cells_that_no_member_reaches_do_not_count_in_the_mean_error():
    assert rms(np.zeros((2, 4)), np.zeros((2, 4))) == 0.0
    assert rms(np.array([[0.3, 0.4], [0.0, np.nan]]), np.array([[0.5, 0.5], [0.0, np.nan]])) == pytest.approx(np.sqrt(0.125))
    assert no_net(table_of(16), range(16)) == ""


def ratio_of_scenarios(flows, shares, members):
    """Stated over true root mean square error of scenarios with a net each, with and without the evenness of the nets."""
    truth = sum(share * probability(flow) for share, flow in zip(shares, flows, strict=True)).ravel()
    places = tuple(np.arange(members) + k * members for k in range(len(flows)))
    weights, names, true, stated = np.repeat(np.array(shares) / members, members), tuple(map(str, range(len(flows)))), [], []
    for seed in range(NETS):
        nets = [sobol_points(members, FLOWS[flow], seed + 100 * k) for k, flow in enumerate(flows)]
        cells = np.concatenate([members_of(flow, net, seed) for flow, net in zip(flows, nets, strict=True)])
        cells, numbers = cells.reshape(len(weights), -1).astype(np.float32), np.arange(len(weights))
        wet = cells.max(axis=0) > 0
        true.append(np.mean((weights @ cells - truth)[wet] ** 2))
        if seed < STATED:
            strata = Strata(names, places, weights, (BLOCKS,) * len(flows), tuple(map(volume, nets)))
            alone = np.mean(strata.of_mean(cells.T, numbers, len(weights))[wet] ** 2)
            stated.append([alone * strata.factor(strata.scatter(cells.T, numbers, len(weights))) ** 2, alone])
    return np.sqrt(np.mean(stated, axis=0) / np.mean(true))


@pytest.mark.parametrize("members", [16, 32])
@pytest.mark.parametrize("shares", [(0.5, 0.5), (0.9, 0.1)])
def test_the_stated_error_of_scenarios_is_the_true_one_within_0_8_and_1_5(members, shares):
    stated, alone = ratio_of_scenarios(list(FLOWS)[:2], shares, members)
    assert 0.8 < stated < 1.5
    assert alone > stated


def test_scatter_of_scenarios_adds_with_the_squares_of_their_shares_by_hand():
    points = volume(sobol_points(4, 1, 0))
    strata = Strata(("a", "b"), (np.arange(4), np.arange(4, 8)), np.repeat([0.1, 0.15], 4), (BLOCKS, BLOCKS), (points, points))
    scatter = strata.scatter(np.array([[1.0, 0, 0, 0, 1.0, 1.0, 0, 0]]), np.arange(8), 8)
    assert sum(scatter.spreads) == pytest.approx(0.16 * 0.75 / 12 + 0.36 * 1.0 / 12)
    np.testing.assert_allclose([of[0, 0] for of in scatter.products], [0.16 * 9 / 16, 0.36 / 4])
    squares = [error_of_net(of, points) for of in scatter.products]
    assert strata.factor(scatter) == pytest.approx(SAFETY * np.sqrt(sum(squares) / sum(scatter.spreads)))
    without = Strata(("a", "b"), strata.places, strata.weights, (BLOCKS, 0))
    assert without.factor(without.scatter(np.zeros((1, 8)), np.arange(8), 8)) == 1.0


def test_a_map_that_only_late_members_reach_keeps_the_spread_over_the_blocks():
    points = NetPoints(sobol_points(512, 2, 1), sobol_points(256, 2, 2))
    values = np.zeros((3, 512))
    values[1, 300] = 1.0
    estimator = Estimator(4, "", points)
    assert estimator.factor(estimator.scatter(values, np.arange(512), 512)) == 1.0


def test_a_scenario_in_which_all_members_are_alike_adds_no_error():
    points = NetPoints(sobol_points(16, 2, 1), sobol_points(256, 2, 2))
    values = np.hstack([np.ones((3, 16)), np.arange(16) * np.ones((3, 1))])
    strata = Strata(("small", "large"), (np.arange(16), np.arange(16, 32)), np.full(32, 1 / 32), (4, 4), (points, points))
    scatter = strata.scatter(values, np.arange(32), 32)
    alone = Estimator(4, "", points)
    assert strata.factor(scatter) == pytest.approx(alone.factor(alone.scatter(values[:, 16:], np.arange(16), 16)))
