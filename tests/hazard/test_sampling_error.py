"""The stated sampling error against the true one, over many scrambled nets of ensembles that are known by formula."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from synthetic_ensemble import peaks_of, write_part

from runout.ensemble.design import member_table, sobol_points
from runout.hazard.exceedance import aggregate
from runout.hazard.sampling import BLOCKS, SAFETY, Estimator, Strata, evenness, independent, no_net, rms
from runout.model.terrain import Terrain

SIDE, NETS, TRUTH = 24, 200, 2**15
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


FLOWS = {tongue: 3, fan: 4, pit: 4, front: 4, reach: 1, classes: 2}


def members_of(flow, points, seed):
    """Wet cells of members at points, which their seeds shift a little."""
    shift = SEEDS * np.random.default_rng(seed).standard_normal(points.shape)
    return flow(np.clip(points + shift, 0.0, 1.0))


def probability(flow):
    """Probability (rows, columns) over very many members."""
    points = sobol_points(TRUTH, FLOWS[flow], 10_000)
    parts = [members_of(flow, points[i : i + 1024], i) for i in range(0, TRUTH, 1024)]
    return np.mean([part.mean(axis=0) for part in parts], axis=0)


def errors_of(wet):
    """Probability and both standard errors of a net (members, rows, columns), in all cells one after another."""
    members = len(wet)
    cells = wet.reshape(members, -1).astype(np.float32)
    numbers, net = np.arange(members), Estimator(BLOCKS)
    spread = net.spread(cells.T, numbers, members, np.array([0.5], np.float32)) * evenness(
        net.deviations(cells.T, numbers, members)
    )
    p = cells.mean(axis=0, dtype=np.float64)
    return p[None], spread[:1], independent(p[None], np.full(members, 1 / members))


def ratios(flow, members):
    """Predicted over true root mean square error, of blocks and of independent members, over many scrambled nets."""
    truth, squares = probability(flow).reshape(1, -1), []
    for seed in range(NETS):
        p, spread, alone = errors_of(members_of(flow, sobol_points(members, FLOWS[flow], seed), seed))
        squares.append([np.mean((p - truth)[p > 0] ** 2), rms(spread, p) ** 2, rms(alone, p) ** 2])
    true, blocks, formula = np.mean(squares, axis=0)
    return np.sqrt(blocks / true), np.sqrt(formula / true)


@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.parametrize("members", [16, 32, 64, 128])
@pytest.mark.parametrize("noise", [SEEDS, 0.0])
def test_the_stated_error_is_the_true_one_within_0_8_and_1_5(flow, members, noise, monkeypatch):
    monkeypatch.setattr("test_sampling_error.SEEDS", noise)
    blocks, formula = ratios(flow, members)
    assert 0.8 < blocks < 1.5
    assert formula > 1.5
    assert formula > 1.3 * blocks


def test_evenness_is_one_for_independent_members_and_less_for_even_nets_by_hand():
    assert evenness(np.array([1.0, 3.0])) == pytest.approx(SAFETY)  # x = 2
    assert evenness(np.array([1.0, 4.0])) == pytest.approx(SAFETY * np.sqrt(3 / 8))  # x = 3
    assert evenness(np.array([1.0, 9.0])) == evenness(np.array([0.0, 9.0])) == pytest.approx(SAFETY * np.sqrt(3 / 15))  # x = 4
    assert evenness(np.array([2.0, 3.0])) == pytest.approx(SAFETY)  # never more than of independent members
    assert evenness(np.zeros(2)) == 1.0


def test_deviations_of_halves_and_quarters_by_hand_and_over_parts_of_a_map():
    values = np.array([[1.0, 0, 0, 0], [1.0, 1.0, 0, 0], [1.0, 0, 1.0, 0]])
    net, numbers = Estimator(BLOCKS), np.arange(4)
    # means 1/4, 1/2, 1/2; halves 1/2 0, 1 0, 1/2 1/2; quarters are the members
    assert net.deviations(values, numbers, 4).tolist() == [1 / 16 + 1 / 4 + 0, 3 / 16 + 1 / 4 + 1 / 4]
    parts = net.deviations(values[:1], numbers, 4) + net.deviations(values[1:], numbers, 4)
    np.testing.assert_allclose(parts, net.deviations(values, numbers, 4))
    assert net.deviations(np.array([[1.0]]), np.array([2]), 4).tolist() == [1 / 16, 3 / 16]  # others have 0
    assert Estimator().deviations(values, numbers, 4).tolist() == [0, 0]


@pytest.mark.parametrize("members", [32, 128])
def test_members_of_random_points_have_the_error_of_independent_ones(members, monkeypatch):
    rng = np.random.default_rng(3)
    monkeypatch.setattr("test_sampling_error.sobol_points", lambda n, d, seed: rng.random((n, d)))
    blocks, formula = ratios(fan, members)
    assert 0.9 < formula < 1.1
    assert 0.85 < blocks < 1.2


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
    halves = reached.reshape(2, -1, *reached.shape[1:]).mean(axis=1)
    return spread * evenness([((parts - reached.mean(axis=0)) ** 2).mean(axis=0).sum() for parts in (halves, of_block)])


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
    """Predicted over true root mean square error of scenarios with a net each, with and without the evenness of the nets."""
    truth = sum(share * probability(flow) for share, flow in zip(shares, flows, strict=True)).reshape(1, -1)
    places = tuple(np.arange(members) + k * members for k in range(len(flows)))
    weights = np.repeat(np.array(shares) / members, members)
    strata, squares = Strata(tuple(map(str, range(len(flows)))), places, weights, (BLOCKS,) * len(flows)), []
    for seed in range(NETS):
        parts = [members_of(flow, sobol_points(members, FLOWS[flow], seed + 100 * k), seed) for k, flow in enumerate(flows)]
        cells, numbers = np.concatenate(parts).reshape(len(weights), -1).astype(np.float32), np.arange(len(weights))
        p, spread = (weights @ cells)[None], strata.spread(cells.T, numbers, len(weights), np.array([0.5], np.float32))
        whole = spread * evenness(strata.deviations(cells.T, numbers, len(weights)))
        squares.append([np.mean((p - truth)[p > 0] ** 2), rms(whole, p) ** 2, rms(spread, p) ** 2])
    true, stated, alone = np.mean(squares, axis=0)
    return np.sqrt(stated / true), np.sqrt(alone / true)


@pytest.mark.parametrize("members", [16, 32])
@pytest.mark.parametrize("shares", [(0.5, 0.5), (0.9, 0.1)])
def test_the_stated_error_of_scenarios_is_the_true_one_within_0_8_and_1_5(members, shares):
    stated, alone = ratio_of_scenarios(list(FLOWS)[:2], shares, members)
    assert 0.8 < stated < 1.5
    assert alone > stated


def test_deviations_of_scenarios_add_with_the_squares_of_their_shares_by_hand():
    strata = Strata(("a", "b"), (np.arange(4), np.arange(4, 8)), np.repeat([0.1, 0.15], 4), (BLOCKS, BLOCKS))
    values = np.array([[1.0, 0, 0, 0, 1.0, 1.0, 0, 0]])
    # halves of a: 1/2 and 0 about 1/4; of b: 1 and 0 about 1/2; quarters are the members
    by_hand = [0.16 / 16 + 0.36 / 4, 0.16 * 3 / 16 + 0.36 / 4]
    np.testing.assert_allclose(strata.deviations(values, np.arange(8), 8), by_hand)
    assert Strata(("a", "b"), strata.places, strata.weights, (BLOCKS, 0)).deviations(values, np.arange(8), 8).tolist() == [0, 0]
