"""A bed that is eroded, on every backend: closed forms, exact sums, and the same bits after an interruption."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import HARD, box, engine_of, plane, scene

from runout import Bed, DruckerPrager, EnergyErosion, FrictionZones, GrowthErosion, JumpErosion, PorePressure, RammsErosion, Terrain
from runout.backends import bed_loops
from runout.backends.protocol import BACKENDS, NodeSums, Sinking
from runout.errors import ConfigError
from runout.model.erosion_laws import EROSIONS
from runout.model.friction_laws import FRICTIONS, numbers_of
from runout.model.surface import Surface
from runout.physics.bed import chance_at, sunk
from runout.release.arrangement import PLASTIC
from runout.simulation import erosion
from runout.simulation.checkpoint import Checkpoint
from runout.simulation.erosion import ErodingBed, loops
from runout.simulation.plan_nodes import Columns, plan_loops
from runout.simulation.run import Run, RunControl
from runout.studies.verification_cases.eroded_layer import eroded_layer, grown_volume, left_of_a_bed

BLOCK = replace(HARD, poisson_ratio=0.0, youngs_modulus=4e6)  # vibrates little while it slides
CELLS, PER_CELL = (30, 40), (2, 2, 2)
SOIL = DruckerPrager(density=2000.0, friction_angle=32.0)
EACH = pytest.mark.parametrize("name", BACKENDS)
SLOPE = math.radians(30.0)
MU = math.tan(math.radians(20.0))
STEEP, LEVEL = (9.81 * math.sin(math.radians(31.0)), 0.0, -9.81 * math.cos(math.radians(31.0))), (0.0, 0.0, -9.81)
DOWN = (9.81 * math.sin(SLOPE), 0.0, -9.81 * math.cos(SLOPE))
FIXED = RammsErosion(rate=0.05, critical_stress=0.0, depth_per_stress=1.0)  # at this rate wherever gravity drives the flow


def run_over(engine, bed, time, *, friction=MU, speed=0.0, size=(10.0, 8.0, 1.0), gravity=DOWN, keep=None, **choices):
    """A finished run of a layer that slides over a bed on level ground under inclined gravity, and the bed."""
    a_scene = scene(plane(), materials=(BLOCK,), friction=(friction,), gravity=gravity, **choices)
    terrain = Terrain.from_array(np.zeros(CELLS), (2.0, 2.5))
    p = box((8.0, 20.0, 0.0), size, (1.0, 1.0, 1.0), BLOCK.density, surface=a_scene.surface)
    p.strain[:, 2] = 2.0 * BLOCK.density * gravity[2] * (size[2] - p.position(np.ones(3))[:, 2]) / BLOCK.youngs_modulus
    p.velocity[:, 0] = speed
    if a_scene.is_wet:
        p.pore_excess[:], p.pore_left[:] = a_scene.pore_pressure[0].ratio, 1.0
    eroding = ErodingBed(bed, a_scene, terrain, [], PER_CELL)
    run = Run(engine, eroding.scene, RunControl(time, stop=False), None, keep, None, eroding)
    run.start(p)
    run.go()
    return run, eroding


def series(run):
    """Rows of the ledger, arrays over time by name."""
    return {"time": np.array(run.ledger.time), **run.ledger.series()}


@EACH
def test_layer_over_a_bed_follows_the_closed_form(name):
    """m v of the middle of a layer that takes up mass at rest at a fixed rate; its mass is booked to rounding."""
    results = eroded_layer(1.0, 24.0, 0.7, name)
    assert all(r.holds for r in results), results


@EACH
def test_volume_grows_exponentially_with_the_path(name):
    """V = V_0 exp(E_s s)."""
    assert grown_volume(1.0, 0.7, backend=name) == pytest.approx(0.0, abs=0.01)


@EACH
def test_bed_is_used_up_to_one_particle(name):
    """A patch of a bed in the way of a layer is taken up whole, and no more than it holds."""
    assert -1e-6 <= left_of_a_bed(1.0, name) <= 1.0


def test_momentum_stays_without_gravity(backend):
    """Mass that joins at rest takes momentum from the flow: m v changes by the impulse of the ground alone."""
    run, _ = run_over(backend, Bed(2.0, GrowthErosion(growth_rate=0.05)), 1.5, friction=0.0, speed=4.0, gravity=(0.0, 0.0, 0.0))
    ledger, pushed = series(run), np.array([row.basal_impulse[0] for row in run.ledger.rows])
    assert ledger["entrained_mass"][-1] > 0.05 * ledger["mass"][0]
    momentum = ledger["momentum_x"] - pushed
    assert np.ptp(momentum) <= 1e-12 * momentum[0]
    assert np.ptp(ledger["momentum_x"]) < 0.02 * momentum[0]
    speed = ledger["momentum_x"] / ledger["mass"]
    assert speed[-1] < 0.9 * speed[0]


def test_no_node_is_lowered_below_its_bed(backend):
    """Particles may be born early, but from what there is; maps hold what the flow took up, cell by cell."""
    depth = np.zeros(CELLS)
    depth[19:22, 6:9] = (0.25, 0.05, 0.1)
    run, eroding = run_over(backend, Bed(depth, RammsErosion(rate=0.5, critical_stress=0.0, depth_per_stress=1.0)), 1.0)
    there = eroding.depth.on_nodes(eroding.first, eroding.eroded.shape, (1.0, 1.0, 1.0))
    assert (eroding.eroded <= there + 1e-9).all()
    assert (eroding.eroded - eroding.owed <= there + 1e-9).all()
    deposit = np.ones(CELLS)
    maps = eroding.maps(deposit)
    entrained = run.ledger.series()["entrained_mass"][-1]
    assert maps["eroded_depth"].sum() * 5.0 * BLOCK.density == pytest.approx(entrained, rel=1e-12)
    assert entrained > 0.0
    np.testing.assert_array_equal(maps["elevation_change"], deposit - maps["eroded_depth"])


def test_share_of_the_bed_integrates_to_the_entrained_mass(backend):
    """Mass of the bed over mass lies on the cells of the deposit, from 0 to 1, and is booked to rounding."""
    run, eroding = run_over(backend, Bed(2.0, FIXED), 1.5)
    ledger, mass = series(run), eroding.deposit_mass(run.engine.particles())
    assert ledger["escaped_mass"][-1] == 0.0
    assert mass.of_bed.sum() == pytest.approx(ledger["entrained_mass"][-1], rel=1e-12)
    assert mass.total.sum() == pytest.approx(ledger["mass"][-1], rel=1e-12)
    deposit = run.peaks.maps()["deposit_thickness"]
    np.testing.assert_allclose(mass.total / (5.0 * BLOCK.density), deposit, atol=1e-6 * deposit.max())
    share = mass.share
    np.testing.assert_array_equal(np.isnan(share), mass.total == 0.0)
    assert 0.0 <= np.nanmin(share) < 0.05 < np.nanmax(share) <= 1.0
    assert np.nansum(share * mass.total) == pytest.approx(ledger["entrained_mass"][-1], rel=1e-12)


def test_share_counts_births_among_other_identities():
    """Particles of the bed are known whatever other particles enter between their births."""
    a_scene = scene(plane(), materials=(BLOCK,), friction=(MU,), gravity=DOWN)
    eroding = ErodingBed(Bed(1.0, FIXED), a_scene, Terrain.from_array(np.zeros(CELLS), (2.0, 2.5)), [], PER_CELL)
    p = box((8.0, 20.0, 0.0), (4.0, 4.0, 1.0), (1.0, 1.0, 1.0), BLOCK.density, surface=a_scene.surface)
    assert not eroding.is_of_bed(p).any()
    for identities in (np.arange(5, 9), np.arange(9, 12), np.arange(20, 22)):
        eroding._note_births(identities)
    np.testing.assert_array_equal(eroding.spans, [[5, 12], [20, 22]])
    np.testing.assert_array_equal(np.flatnonzero(eroding.is_of_bed(p)), [*range(5, 12), 20, 21])
    mass = eroding.deposit_mass(p)
    assert mass.of_bed.sum() == pytest.approx(9 * p.mass[0], rel=1e-12)
    assert np.isnan(eroding.deposit_mass(p.take(np.zeros(0, int))).share).all()


def test_energy_of_the_bed_is_booked(backend):
    """Energy that is not accounted for is as small a part as without a bed."""
    run, _ = run_over(backend, Bed(2.0, FIXED), 2.0)
    ledger = series(run)
    assert ledger["entrained_energy"][-1] != 0.0
    worked = ledger["basal_dissipation"][-1] + ledger["kinetic_energy"][-1]
    assert abs(ledger["numerical_dissipation"][-1]) < 0.06 * worked


def test_interrupted_run_with_births_gives_the_same_bits(backend, tmp_path):
    """A checkpoint holds the bed: what is eroded and owed, the lowered ground, the sums before a backend was loaded anew."""
    whole, _ = run_over(backend, Bed(2.0, FIXED), 1.5)
    again = engine_of(type(backend).__module__.split(".")[2])

    class Stop(Exception):
        pass

    class StoppedCheckpoint(Checkpoint):
        def write(self, state):
            super().write(state)
            if float(state["run.time"]) > 0.8:
                raise Stop

    with pytest.raises(Stop):
        run_over(again, Bed(2.0, FIXED), 1.5, keep=StoppedCheckpoint(tmp_path / "c.npz", "key", 0.0))
    resumed, eroding = run_over(again, Bed(2.0, FIXED), 1.5, keep=Checkpoint(tmp_path / "c.npz", "key", 0.0))
    assert eroding.born > 0
    np.testing.assert_array_equal(eroding.spans, [[eroding.particles, eroding.particles + eroding.born]])
    expected, found = whole.engine.particles(), resumed.engine.particles()
    for name, values in vars(expected).items():
        np.testing.assert_array_equal(getattr(found, name), values, err_msg=name)
    for name, values in whole.ledger.series().items():
        if name != "memory":
            np.testing.assert_array_equal(resumed.ledger.series()[name], values, err_msg=name)
    assert resumed.counters.steps == whole.counters.steps


@pytest.mark.parametrize("shape", [(1, 1), (1, 4), (4, 1), (2, 2), (2, 5), (3, 5), (5, 3)])
def test_columns_in_a_row_cover_what_each_of_them_covers_alone(shape):
    mass = np.random.default_rng(3).uniform(0.1, 2.0, shape)
    for a, b in np.ndindex(shape):
        for n in range(1, shape[1] - b + 1):
            covered = np.zeros(n)
            bed_loops._note_covered(mass, a, b, covered)
            around = [mass[max(a - 1, 0) : a + 2, max(b + k - 1, 0) : b + k + 2] for k in range(n)]
            shares = [min(1.0, 2.0 * mass[a, b + k] * part.sum() / (part**2).sum()) for k, part in enumerate(around)]
            np.testing.assert_allclose(covered, shares, rtol=1e-14)


@pytest.mark.parametrize("change_first", [(0, 0), (-1, -2), (1, 2), (-9, 0), (0, 9)])
def test_ground_of_a_row_has_changed_where_there_is_a_table_of_changes(change_first):
    rng = np.random.default_rng(4)
    coefficients, change = rng.uniform(size=(6, 7)), rng.uniform(size=(3, 4))  # of nodes from (-1, -1) and from change_first on
    whole = np.zeros((40, 40))
    whole[10 + change_first[0] : 13 + change_first[0], 10 + change_first[1] : 14 + change_first[1]] = change
    begin = np.array([0, 0, 0, 0, -change_first[0], -change_first[1], 0])
    ground = bed_loops.Ground(coefficients, change, np.ones(3), np.ones(3))
    for i, j in np.ndindex(6, 7):
        level = np.zeros(7 - j)
        bed_loops._levels(ground, i - 1, j, begin, level)
        np.testing.assert_array_equal(level, coefficients[i, j:] + whole[9 + i, 9 + j : 16])


@pytest.mark.parametrize("law", [law.name for law in EROSIONS.of_runout()])
def test_compiled_rate_is_that_of_plain_python(law):
    """The kernel passes thickness, stresses and depth normal to the ground, and the parameters in SI units."""
    from runout.physics import bed
    from runout.physics.heightfield import upward_normal

    erosion = EROSIONS.find(law)
    friction, _ = numbers_of(0.3)
    record = SimpleNamespace(**erosion.example.numbers(), density=1800.0, pore_ratio=0.2)
    bed_record, basal = np.zeros(1, [(n, float) for n in erosion.fields]), np.zeros(1, [("friction", float)])
    for name, value in vars(record).items():
        bed_record[name] = value
    basal["friction"] = 0.9
    gravity, of_friction = np.array([0.0, 0.0, -9.81]), int(erosion.declaration.of_friction)
    i, j = np.arange(3.0)[:, None] - 1.0, np.arange(3.0)[None, :] - 1.0
    ground = 0.5 * 2.0 * i - 0.2 * 2.5 * j  # nodes 2 m and 2.5 m apart; half of it is a change
    sums = np.array([10.0, 60e3, 0.0, 0.0, 20e3]).reshape(5, 1, 1)  # 2 m thick over 5 m2, at 3 m/s
    there, eroded, owed = np.full((1, 1), 9.0), np.full((1, 1), 0.1), np.zeros((1, 1))
    fastest, reached, nothing = np.zeros(1), np.zeros((1, 2), np.int64), np.zeros((0, 0))
    flow, base = bed_loops.Flow(sums, nothing, np.array([0, 0, 0, 0, 1, 1, 1])), np.empty((1, 6, 1))
    plan_loops().note_bases(flow, bed_loops.Ground(0.5 * ground, 0.5 * ground, np.array([2.0, 2.5, 2.0]), gravity), base)
    loops(erosion, friction).erode_nodes(
        flow, base,
        bed_loops.Laws(basal, np.zeros((0, 0), np.int64), bed_record, of_friction),
        bed_loops.Depths(there, eroded, owed), 0.25, bed_loops.Reached(fastest, reached),
    )  # fmt: skip
    n = 1.0 / math.sqrt(1.29)
    sigma, sine = 2000.0 * 2.0 * n * 9.81 * n, math.sqrt(1.0 - n * n)
    tau = 0.9 * sigma if of_friction else 2000.0 * 2.0 * n * 9.81 * sine
    assert sigma == pytest.approx(bed.normal_stress(2000.0, 2.0 * n, gravity, upward_normal(0.5, -0.2)))
    expected = erosion.rate(2.0 * n, 3.0, sigma, tau, 0.0, 0.1 * n, record)
    assert expected > 0.0
    assert fastest[0] * n == pytest.approx(expected, rel=1e-12)
    assert owed[0, 0] == pytest.approx(0.25 * fastest[0], rel=1e-12)
    assert eroded[0, 0] - 0.1 == pytest.approx(owed[0, 0], rel=1e-12)
    assert reached.tolist() == [[0, 1]]
    assert FRICTIONS.find("coulomb") is friction


def test_rates_of_the_laws_by_hand():
    """Each law against its formula."""
    from types import SimpleNamespace as Record

    rates = {law.name: law.rate for law in EROSIONS.of_runout()}
    ramms = Record(rate=0.025, critical_stress=1e3, depth_per_stress=1e-4)
    assert rates["ramms"](1.0, 2.0, 0.0, 6e3, 0.0, 0.49, ramms) == 0.025  # 0.5 m under 5 kPa beyond the critical stress
    assert rates["ramms"](1.0, 2.0, 0.0, 6e3, 0.0, 0.5, ramms) == 0.0
    assert rates["ramms"](1.0, 2.0, 0.0, 900.0, 0.0, 0.0, ramms) == 0.0
    assert rates["growth"](1.5, 4.0, 0.0, 0.0, 0.0, 0.0, Record(growth_rate=1e-3)) == pytest.approx(6e-3)
    assert rates["energy"](1.0, 5.0, 0.0, 2e3, 0.0, 0.0, Record(specific_energy=5e3, density=2e3)) == pytest.approx(1e-3)
    wet = Record(most=0.05, friction_angle=math.radians(30.0), cohesion=100.0, pore_ratio=0.5, speed_ratio=0.5, density=2e3)
    strength = math.tan(math.radians(30.0)) * 0.5 * 1e4 + 100.0
    assert rates["jump"](1.0, 10.0, 1e4, strength + 200.0, 0.0, 0.0, wet) == pytest.approx(200.0 / (2e3 * 0.5 * 10.0))
    assert rates["jump"](1.0, 10.0, 1e4, strength - 1.0, 0.0, 0.0, wet) == 0.0
    assert rates["jump"](1.0, 0.0, 1e4, strength + 200.0, 0.0, 0.0, wet) == 0.05


@EACH
def test_wet_bed_feeds_the_flow_and_a_dry_one_slows_it(name):
    """The finding of Iverson et al. (2011): momentum over that without a bed, at a fixed rate, by the pore pressure of the bed."""
    pore = PorePressure(ratio=0.5, decay_time=1e6)

    def momentum(ratio):
        bed = Bed(0.12 if ratio is not None else 1e-9, FIXED, pore_pressure_ratio=ratio)
        choices = {"friction": math.tan(math.radians(35.0)), "pore_pressure": (pore,), "gravity": STEEP}
        run, eroding = run_over(engine_of(name), bed, 1.0, speed=1.0, size=(8.0, 6.0, 1.0), **choices)
        return float(run.ledger.series()["momentum_x"][-1]), eroding, run.engine.particles()

    def expected(ratio):
        """m v over that without a bed: the share 1 - exp(-e / c) of the touching layer c = 0.5 m is of the bed after a depth e."""
        moments = np.zeros(2)
        for t in (np.arange(1000) + 0.5) / 1000:
            depth = FIXED.rate * t
            own = 0.5 + (ratio - 0.5) * (1.0 - math.exp(-depth / 0.5))
            for k, (mass, pore) in enumerate(((1.0, 0.5), (1.0 + depth, own))):
                moments[k] += mass * (STEEP[0] + math.tan(math.radians(35.0)) * (1.0 - pore) * STEEP[2]) / 1000
        return (1.0 + moments[1]) / (1.0 + moments[0])

    (without, _, _), (dry, _, _), (wet, eroding, p) = momentum(None), momentum(0.0), momentum(0.95)
    assert dry < 0.99 * without
    assert wet > 1.01 * without
    assert dry / without == pytest.approx(expected(0.0), abs=0.025)
    assert wet / without == pytest.approx(expected(0.95), abs=0.025)
    born = p.identity >= eroding.particles
    assert born.sum() == eroding.born > 15
    np.testing.assert_allclose(p.pore_excess[born] * p.pore_left[born], 0.95, rtol=1e-4)
    np.testing.assert_allclose(p.pore_excess[~born] * p.pore_left[~born], 0.5, rtol=1e-4)


def test_friction_of_a_wet_flow_erodes_less():
    """Laws that take the friction of the flow take it at effective stress: half of the pressure, half of the rate."""
    energy, time = Bed(0.5, EnergyErosion(specific_energy=2e3)), 0.25
    taken = {}
    for ratio in (0.0, 0.5):
        pore = PorePressure(ratio=ratio, decay_time=1e6)
        _, eroding = run_over(engine_of("scan"), energy, time, speed=4.0, gravity=LEVEL, pore_pressure=(pore,))
        taken[ratio] = float(eroding.eroded.sum())
    assert taken[0.5] == pytest.approx(0.5 * taken[0.0], rel=0.12)  # the wet flow keeps more of its speed
    assert taken[0.0] > 0.0


def test_jump_of_stress_on_a_wet_bed_gains_momentum():
    """With a stated ceiling."""

    def momentum(ratio):
        bed = Bed(0.5, JumpErosion(most=0.05, friction_angle=22.0), pore_pressure_ratio=ratio)
        run, eroding = run_over(engine_of("scan"), bed, 2.0, speed=3.0)
        return run.ledger.series()["momentum_x"][-1], eroding.born

    (dry, few), (wet, many) = momentum(0.0), momentum(0.9)
    assert many > 20
    assert few == 0  # friction of the flow, at 20 deg, does not reach the strength of a dry bed of 22 deg
    assert wet > dry


def test_simulate_takes_a_bed_and_gives_its_maps_and_sums():
    """On one and two threads the same bits; snapshots follow the particles of the start; the result states what was taken up."""
    import runout

    x = (np.arange(40) + 0.5) * 5.0
    terrain = Terrain.from_array(np.repeat((200.0 - x)[None, :] * math.tan(math.radians(25.0)), 20, 0), 5.0)
    thickness = np.zeros(terrain.shape)
    thickness[7:13, 3:9] = 4.0
    release = runout.Release.from_array(thickness, terrain, placement="on_surface")
    choices = {"basal_friction_angle": 15.0, "cell_size": 5.0, "end_time": 6.0, "snapshot_times": (3.0,), "snapshot_particles": 50}
    one, two = (
        runout.simulate(terrain, release, SOIL, **choices, bed=Bed(1.0, RammsErosion(rate=0.1)), bulking=0.8, threads=threads)
        for threads in (1, 2)
    )
    assert set(one.maps) >= {"eroded_depth", "elevation_change", "bed_share"}
    for name in one.maps:
        np.testing.assert_array_equal(one.maps[name], two.maps[name], err_msg=name)
    entrained = float(one.ledger["entrained_mass"][-1])
    assert float(one.maps["eroded_depth"].sum()) * 25.0 * SOIL.density == pytest.approx(entrained, rel=1e-6)
    eroded = one.maps["eroded_depth"].values
    assert eroded.min() == 0.0
    assert eroded[eroded > 0.0].min() > 1e-6, "no rounding beyond the flow"
    held = float(one.ledger["mass"][-1]) / SOIL.density
    assert float(one.maps["deposit_thickness"].sum()) * 25.0 == pytest.approx(0.8 * held, rel=1e-5)
    assert len(one.state) > one.n_particles
    assert len(one.particle_frames[0]) <= 50
    assert "of the bed" in repr(one)
    share, thickness = one.maps["bed_share"].values, one.maps["deposit_thickness"].values
    np.testing.assert_array_equal(np.isnan(share), thickness == 0.0)
    of_bed = one.maps.attrs["bed_mass_at_end"]
    assert of_bed == pytest.approx(entrained, rel=1e-6)
    assert np.nansum(share * thickness) * 25.0 / 0.8 * SOIL.density == pytest.approx(of_bed, rel=1e-5)
    dry = runout.simulate(terrain, release, SOIL, **choices)
    assert "eroded_depth" not in dry.maps
    assert "entrained_mass" not in dry.ledger


def test_bed_that_needs_more_memory_than_there_is_is_refused():
    """The forecast counts what the bed can give."""
    import runout
    from runout.errors import CapacityError

    terrain = Terrain.from_array(np.zeros((40, 40)), 5.0)
    thickness = np.zeros(terrain.shape)
    thickness[18:22, 18:22] = 40.0
    release = runout.Release.from_array(thickness, terrain, placement="on_surface")
    choices = {"basal_friction_angle": 10.0, "cell_size": 0.5, "end_time": 1.0}
    with pytest.raises(CapacityError, match="the run needs about"):
        runout.simulate(terrain, release, SOIL, **choices, bed=Bed(500.0), memory_gb=2.0)


def test_bad_beds_are_refused():
    """One message with the value and the remedy."""
    for arguments, words in (
        ((-1.0,), "bed: depth is -1 m; it must be above 0"),
        ((np.zeros((3, 3)),), "depth is 0 everywhere"),
        ((1.0, "ramms"), "give a law of erosion"),
        ((1.0, RammsErosion(), 0.5), "density is 0.5 kg/m3"),
    ):
        with pytest.raises(ConfigError, match=words):
            Bed(*arguments)
    with pytest.raises(TypeError, match="most"):
        JumpErosion()
    with pytest.raises(ConfigError, match="rate is -1"):
        RammsErosion(rate=-1.0)
    with pytest.raises(ConfigError, match="specific_energy is 0"):
        EnergyErosion(specific_energy=0.0)
    with pytest.raises(ConfigError, match="depth has"):
        Bed(np.ones((3, 3))).depth_on(Terrain.from_array(np.zeros((4, 4)), 1.0), [])


def interrupted(start, path):
    """A whole run, and one that was interrupted and resumed; ``start(keep)`` gives run and bed."""

    class Stop(Exception):
        pass

    class StoppedCheckpoint(Checkpoint):
        def write(self, state):
            super().write(state)
            if float(state["bed.born"]) > 30:
                raise Stop

    whole, _ = start(None)
    whole.go()
    stopped, _ = start(StoppedCheckpoint(path, "key", 0.0))
    with pytest.raises(Stop):
        stopped.go()
    resumed, eroding = start(Checkpoint(path, "key", 0.0))
    assert 30 < eroding.born < 1000
    resumed.go()
    return whole, resumed, eroding


KINDS = {
    "structures": {"structures": True},
    "two materials, zones, substeps": {
        "materials": (BLOCK, replace(BLOCK, density=2300.0)), "friction": (MU, 1.2 * MU), "substeps": 3,
    },
    "wet, friction of the flow": {"pore_pressure": (PorePressure(ratio=0.4, decay_time=3.0),)},
}  # fmt: skip


@EACH
@pytest.mark.parametrize("kind", KINDS)
def test_bed_of_any_scene_is_booked_and_resumes_to_the_same_bits(name, kind, tmp_path):
    """Beside a wall, with several materials, friction zones and substeps, with pore pressure: sums go on through births."""
    choices = {"materials": (BLOCK,), "friction": (MU,), "gravity": DOWN, **KINDS[kind]}
    if choices.pop("structures", False):
        choices["structures"] = wall_beside()
    if len(choices["materials"]) > 1:
        choices["friction_zones"] = FrictionZones(np.full((40, 30), 0.8), np.zeros((40, 30)), (2.0, 2.5))
    energy = EnergyErosion(specific_energy=40.0) if "pore_pressure" in choices else replace(FIXED, rate=0.3)
    a_scene, terrain = scene(plane(), **choices), Terrain.from_array(np.zeros(CELLS), (2.0, 2.5))

    def start(keep):
        eroding = ErodingBed(Bed(2.0, energy, pore_pressure_ratio=0.6 if a_scene.is_wet else None), a_scene, terrain, [], PER_CELL)
        p = box((8.0, 20.0, 0.0), (8.0, 6.0, 1.0), (1.0, 1.0, 1.0), BLOCK.density, surface=a_scene.surface)
        p.velocity[:, 0] = 4.0
        if a_scene.is_wet:
            p.pore_excess[:], p.pore_left[:] = 0.4, 1.0
        if len(a_scene.materials) > 1:
            upper = p.position(np.ones(3))[:, 0] > 12.0
            p.release[upper] = 1
            p.mass[upper] *= 2300.0 / BLOCK.density
        run = Run(engine_of(name), eroding.scene, RunControl(0.6, stop=False), None, keep, None, eroding)
        run.start(p)
        return run, eroding

    whole, resumed, eroding = interrupted(start, tmp_path / "c.npz")
    for expected, found in (
        (whole.engine.particles(), resumed.engine.particles()),
        (whole.engine.ledger(), resumed.engine.ledger()),
    ):
        for field, values in vars(expected).items():
            np.testing.assert_array_equal(getattr(found, field), values, err_msg=field)
    impulses = whole.engine.structure_impulses()
    np.testing.assert_array_equal(resumed.engine.structure_impulses(), impulses)
    assert (np.abs(impulses).max(initial=0.0) > 0.0) == ("structures" in choices)
    p, ledger = resumed.engine.particles(), series(resumed)
    born = p.identity >= eroding.particles
    assert born.sum() == eroding.born > 40
    assert set(p.release[born]) == set(p.release[~born])
    assert ledger["mass"][-1] == pytest.approx(ledger["mass"][0] + ledger["entrained_mass"][-1], rel=1e-13)
    assert (np.diff(ledger["basal_dissipation"]) >= 0.0).all()


def wall_beside():
    """A wall along the north side of the layer, which spreads against it."""
    from runout.backends.scan.warm_up import side_wall

    return replace(side_wall(), origin=(6.0, 16.05, -4.0))


def births(loops, owed, left, nearest):
    """Particles of 0.1 m that are born at nodes, and the depth that these give for them; a depth of ``left`` is not eroded."""
    after, born = owed.copy(), np.zeros(owed.shape, np.int64)
    there, releases = np.full(owed.shape, left + 2.0), np.zeros(owed.shape, np.int32)
    pools = bed_loops.Pools(there, np.full(owed.shape, 2.0), after, releases, np.array([0.1]), born)
    loops.round_pools(pools, np.zeros((2, 2), np.int64), np.array(PLASTIC[:2]), nearest, 2)
    return born, owed - after


def test_pools_owe_nothing_in_the_mean_after_births():
    """Of pools that owe any part of a particle, numbers are rounded up as often as down: pools that the flow leaves are even."""
    owed = np.zeros((400, 400))
    owed[::2, ::2] = 0.1 * np.random.default_rng(7).random((200, 200)) + 0.3
    _, depth = births(plan_loops(), owed, 1.0, True)
    assert abs((owed - depth)[::2, ::2].mean() / 0.1) < 0.01


@pytest.mark.parametrize("lasting", [0.1, 2.0, 50.0])
def test_depth_that_the_stress_allows_is_not_passed_in_a_long_update(lasting):
    """Law `ramms`: the rate counts until its limit is reached, however long the time between two updates is, to an eighth of it."""
    law, friction = EROSIONS.find("ramms"), numbers_of(0.3)[0]
    record = np.zeros(1, [(n, float) for n in law.fields])
    record["rate"], record["depth_per_stress"], rate, limit = 0.05, 1e-5, 0.05, 0.1
    slope = math.tan(math.asin(limit / 1e-5 / (2000.0 * 9.81 * 2.0)))
    across = math.sqrt(1.0 + slope**2)
    ground = 2.0 * slope * (np.arange(3.0)[:, None] - 1.0) + np.zeros((3, 3))
    sums = np.array([2.0 * across * 4.0, 48e3 * across, 0.0, 0.0, 16e3 * across]).reshape(5, 1, 1)  # 2 m thick over 4 m2, at 3 m/s
    eroded, owed, nothing = np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((0, 0))
    flow, base = bed_loops.Flow(sums, nothing, np.array([0, 0, 0, 0, 1, 1, 1])), np.empty((1, 6, 1))
    gravity = np.array([0.0, 0.0, -9.81])
    plan_loops().note_bases(flow, bed_loops.Ground(ground, 0.0 * ground, np.array([2.0, 2.0, 2.0]), gravity), base)
    loops(law, friction).erode_nodes(
        flow, base,
        bed_loops.Laws(np.zeros(1, [("friction", float)]), np.zeros((0, 0), np.int64), record, 0),
        bed_loops.Depths(np.full((1, 1), 9.0), eroded, owed), lasting,
        bed_loops.Reached(np.zeros(1), np.zeros((1, 2), np.int64)),
    )  # fmt: skip
    found, expected = eroded[0, 0] / across, min(rate * lasting, limit)
    assert expected - 1e-12 <= found <= expected + (rate * lasting / bed_loops.PARTS if rate * lasting > limit else 1e-12)
    np.testing.assert_array_equal(owed, eroded)


def test_flow_does_not_depend_on_how_often_particles_are_born(monkeypatch):
    """In the made valley, with births five times as often: mass taken up and deposit as with another seed."""
    import runout
    from tests.benchmarks import bed_valley

    terrain, release = bed_valley.valley()
    choices = {"basal_friction_angle": bed_valley.FRICTION, "cell_size": bed_valley.CELL, "end_time": 40.0, "threads": 1}
    taken, deposit = [], []
    for late in (0.25, 0.05):
        monkeypatch.setattr(erosion, "LATE", late)
        result = runout.simulate(terrain, release, bed_valley.SOIL, bed=Bed(bed_valley.BED), **choices)
        taken.append(float(result.ledger["entrained_mass"][-1]))
        deposit.append(result.maps["deposit_thickness"].values)
    assert taken[0] == pytest.approx(taken[1], rel=0.02)
    assert np.abs(deposit[0] - deposit[1]).sum() < 0.12 * deposit[1].sum()


def test_flow_sinks_with_its_ground(backend):
    """Where the ground falls, particles on it sink but for the part whose place eroded mass takes; all others stay."""
    a_scene = scene(plane(), materials=(BLOCK,), friction=(MU,), gravity=DOWN)
    a_scene = replace(a_scene, surface=a_scene.ground.with_room((0, 0), (50, 50)))
    p = box((8.0, 20.0, 0.0), (10.0, 8.0, 3.0), (1.0, 1.0, 1.0), BLOCK.density, surface=a_scene.surface)
    p.velocity[:] = (3.0, -1.0, 0.5)
    p.affine[:] = np.random.default_rng(5).normal(size=p.affine.shape)
    backend.load(a_scene, p)
    for _ in range(3):
        backend.step(1e-3)
    before, row, nodes = backend.particles(), backend.ledger(), a_scene.ground.surface.on_nodes((1.0, 1.0), (7, 17), (11, 9))
    x, y, z = before.position(np.ones(3)).T
    (ground, east, north), depth = a_scene.ground.evaluate(x, y), np.random.default_rng(3).random((7, 5)) * 0.2
    backend.lower((9, 19), depth, Sinking((7, 17), np.stack([np.pad(depth, 2), nodes.coefficients]), 0.3))
    p, fall = backend.particles(), ground - a_scene.ground.evaluate(x, y)[0]
    touching = before.radius * np.sqrt(1.0 + east**2 + north**2)
    places = zip(z - ground, fall, touching, x, y, strict=True)
    way = [sunk(height, by, least, chance_at(a, b, 0.3)) for height, by, least, a, b in places]
    way = np.minimum(way, before.offset[:, 2] - 0.5)  # of its cell
    lowest = (z - ground < 1.5 * touching) & (fall > 1e-3)
    assert lowest.sum() > 50
    assert 1.0 - (way[lowest] > 0.0).mean() == pytest.approx((fall / (2.0 * touching))[lowest].mean(), abs=0.1)
    np.testing.assert_allclose(p.position(np.ones(3)), np.column_stack([x, y, z - way]), rtol=0, atol=1e-6)
    np.testing.assert_allclose(p.velocity, before.velocity, rtol=0, atol=1e-5)
    for name in ("mass", "volume", "strain", "affine", "ground_force", "identity"):
        np.testing.assert_allclose(getattr(p, name), getattr(before, name), rtol=1e-6, atol=1e-6, err_msg=name)
    lowered = backend.ledger()
    lost = float(before.mass @ way) * 9.81 * math.cos(SLOPE)
    assert row.potential_energy - lowered.potential_energy == pytest.approx(lost, rel=1e-3)
    assert lowered.kinetic_energy == pytest.approx(row.kinetic_energy, rel=1e-6)


@EACH
def test_flow_on_a_bed_is_as_high_as_its_volume(name):
    """Eroded mass takes up its place below the flow: twice the mean height is the thickness by volume."""
    run, eroding = run_over(engine_of(name), Bed(0.5, replace(FIXED, rate=0.2)), 1.0, size=(10.0, 8.0, 1.0), speed=1.0)
    p = run.engine.particles()
    x, y, z = p.position(np.ones(3)).T
    height = z - eroding.ground.evaluate(x, y)[0]
    inner = (np.abs(y - y.mean()) < 2.0) & (np.abs(x - x.mean()) < 3.0)
    thickness = p.volume[inner].sum() / (4.0 * 6.0)
    assert thickness > 1.1
    assert 2.0 * np.average(height[inner], weights=p.volume[inner]) == pytest.approx(thickness, rel=0.08)


@pytest.mark.parametrize(("nearest", "left", "born"), [(False, 1.0, 3), (True, 1.0, 4), (True, 0.0, 3)])
def test_a_pool_gives_whole_particles_where_it_owes_most_and_rounds_up_only_what_it_has(nearest, left, born):
    """Of 2 x 2 nodes the first four owe 3.5 particles, the others 0.7; the rounding adds 0.5 + 0.35 to the first."""
    owed = np.array([[0.05, 0.2], [0.1, 0.0], [0.09, 0.0], [-0.02, 0.0]])
    count, depth = births(plan_loops(), owed, left, nearest)
    assert count[0, 1] == born
    np.testing.assert_allclose(depth[:2], owed[:2] / 0.35 * born * 0.1, rtol=0, atol=1e-15)
    for one, other in zip(births(bed_loops, owed, left, nearest), (count, depth), strict=True):
        np.testing.assert_array_equal(one, other)
    if not nearest:
        assert count.sum() == 3


def rough_bed(depth=2.0):
    """A bed on rough ground, of which nothing is eroded yet."""
    heights = np.random.default_rng(1).normal(size=(60, 60)).cumsum(axis=0)
    surface = Surface.through(heights, (2.0, 2.5), (-10.0, -12.5))
    a_scene = scene(surface, materials=(BLOCK,), friction=(MU,))
    return ErodingBed(Bed(depth, FIXED), a_scene, Terrain.from_array(np.zeros(CELLS), (2.0, 2.5)), [], PER_CELL)


def test_ground_under_a_bed_is_that_of_contact_bit_by_bit():
    """Its coefficients are made by a compiled loop, in tiles where mass is; particles are born on it as it is lowered."""
    bed, rng = rough_bed(), np.random.default_rng(2)
    mass = np.zeros(bed.shape)
    mass[3:40, 5:60] = rng.random((37, 55)) > 0.9
    bed.coefficients.make(mass, bed.first)
    made, first = bed.coefficients.values, bed.coefficients.first
    known = np.isfinite(made)
    assert 0.2 < known.mean() < 0.9
    expected = bed.ground.surface.on_nodes(bed.ground.spacing, first, made.shape).coefficients
    np.testing.assert_array_equal(made[known], expected[known])
    bed.ground.lower(bed.first, rng.random(bed.shape))
    born = 2 * (mass > 0.0).astype(np.int64)
    nothing = Columns(np.zeros((5, 1, 1)), (0, 0), bed.first, (1, 1))
    newborn = bed._brought_forth(born, np.array([(0, 0), bed.first]), np.array([2000.0 * bed.volume]), nothing)
    x, y, z = newborn.position(np.ones(3)).T
    i, j = (np.repeat(index, 2) + start for index, start in zip(np.nonzero(mass), bed.first, strict=True))
    assert max(np.abs(x - i).max(), np.abs(y - j).max()) <= 0.5 + 1e-9
    elevation, east, north = bed.ground.evaluate(x, y)
    np.testing.assert_allclose(z, elevation + bed.radius * np.sqrt(1.0 + east**2 + north**2), rtol=0, atol=1e-11)


def test_births_lie_on_the_ground_where_no_mass_has_come_since_the_run_was_resumed():
    """The mass that eroded a node has left it, and what it owes is born when nothing is eroded any more."""
    bed, born = rough_bed(), []
    bed.eroded[50, 60] = bed.owed[50, 60] = 1.0
    sums = np.zeros((5, *bed.shape))
    sums[::4, 2, 2] = 1.0, 2000.0  # at rest
    known = {"node_columns": lambda: NodeSums(bed.first, sums), "lower": bed.ground.lower, "add": born.append, "max_speed": 0.0}
    bed.update(SimpleNamespace(**known, flow_columns=list, lattice_columns=list, plan_masses=list), 1.0)
    x, y, z = born[0].position(np.ones(3)).T
    elevation, east, north = bed.ground.evaluate(x, y)
    assert len(x) == 8
    np.testing.assert_allclose(z - elevation, bed.radius * np.sqrt(1.0 + east**2 + north**2), rtol=0, atol=1e-9)
