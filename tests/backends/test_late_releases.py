"""Releases that start later, with a velocity, or when the flow of another arrives, on every backend."""

import logging
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import runout
from runout import Arrival, Bed, DruckerPrager, PorePressure, RammsErosion, Release, ReleaseError, StartVelocity, Terrain
from runout.backends.protocol import BACKENDS
from runout.model.numerics import Numerics
from runout.simulation.batch import simulate_batch
from runout.simulation.scenario import build_scene
from runout.simulation.waiting_release import WaitingRelease, lift

EACH = pytest.mark.parametrize("backend", BACKENDS)
ROWS, COLUMNS, CELL, SLOPE = 24, 48, 2.5, 0.5
X = (np.arange(COLUMNS) + 0.5) * CELL
TERRAIN = Terrain.from_array(np.tile(100.0 - SLOPE * X, (ROWS, 1)), (CELL, CELL))
SOIL = DruckerPrager(density=2000.0, friction_angle=32.0, youngs_modulus=2e6)
LATE = 3.0  # [s]


def mass(name="upper", columns=(4, 10), rows=(9, 15), thickness=2.0, terrain=TERRAIN, placement="on_surface", **start):
    """A slab."""
    cells = np.zeros(terrain.shape)
    cells[slice(*rows), slice(*columns)] = thickness
    return Release.from_array(cells, terrain, placement=placement, name=name, **start)


def run(releases, backend="scan", terrain=TERRAIN, material=SOIL, **choices):
    choices = {"end_time": 6.0, "cell_size": CELL, "precision": "float64", "basal_friction_angle": 20.0, "stop": False, **choices}
    device = {"device": "cpu"} if backend == "hash" else {}
    return runout.simulate(terrain, releases, material, backend=backend, threads=1, **device, **choices)


@cache
def at_once(backend, placement, wet=False):
    """A run whose release starts at once."""
    return run(mass(placement=placement, pore_pressure=WET if wet else None), backend, snapshot_times=(1.0, 2.0))


WET = PorePressure(ratio=0.5, decay_time=1.5)


def budget(result):
    """Largest relative error of mass and largest energy without an account over that of the fall."""
    s = result.series
    whole = s["mass"] + s["escaped_mass"] - s["entered_mass"]
    released = s["mass"] + s["escaped_mass"] + s["waiting_mass"]
    spent = s["basal_dissipation"][-1] + s["plastic_dissipation"][-1] + s["kinetic_energy"][-1]
    scale = released.max()
    of_mass, of_all = (np.abs(sums - sums[0]).max() / scale for sums in (whole, released))
    return of_mass, of_all, s["numerical_dissipation"][-1] / spent


@EACH
@pytest.mark.parametrize(("placement", "wet"), [("on_surface", True), ("excavated", False)])
def test_a_release_that_starts_later_is_the_same_run_shifted(backend, placement, wet):
    """Stress, pore pressure and ground are those of a start at time zero; so are all steps, to rounding."""
    expected = at_once(backend, placement, wet)
    release = mass(placement=placement, pore_pressure=WET if wet else None, start_time=LATE)
    late = run(release, backend, snapshot_times=(LATE + 1.0, LATE + 2.0))
    for (_, depth, speed), (_, late_depth, late_speed) in zip(expected.snapshots, late.snapshots, strict=True):
        np.testing.assert_allclose(late_depth, depth, rtol=0, atol=1e-9)
        np.testing.assert_allclose(late_speed, speed, rtol=0, atol=1e-9)
    inside = mass().thickness >= 1.0
    np.testing.assert_array_equal(late.fields["arrival_time"][inside], LATE)
    soon = expected.fields["arrival_time"] < 2.0
    np.testing.assert_allclose(late.fields["arrival_time"][soon], LATE + expected.fields["arrival_time"][soon], rtol=0, atol=1e-6)
    assert late.series["entered_mass"][-1] == pytest.approx(expected.series["mass"][0], rel=1e-12)
    assert late.n_particles == expected.n_particles
    assert late.start["late_source_start_time"] == [LATE]


@EACH
def test_two_releases_that_do_not_meet_are_two_runs(backend):
    """Side by side, with another start: maps are the sums of those of single runs, but for places of particles and steps."""
    one, other = mass(rows=(2, 8)), mass("second", rows=(16, 22), start_time=LATE)
    both = run([one, other], backend)
    single, later = run(one, backend), run(other, backend)
    for name in ("max_flow_thickness", "deposit_thickness"):
        expected = single.fields[name] + later.fields[name]
        assert np.abs(both.fields[name] - expected).sum() < 0.05 * expected.sum(), name
    assert both.state.release.tolist() == sorted(both.state.release.tolist())
    of_mass, of_all, of_energy = budget(both)
    assert max(of_mass, of_all) < 1e-12
    assert abs(of_energy) < 0.15


@EACH
@pytest.mark.parametrize(
    ("velocity", "along"),
    [(5.0, (1.0, 0.0)), (StartVelocity(5.0, azimuth_deg=45.0), (math.sqrt(0.5), math.sqrt(0.5))), ((3.0, 4.0, -1.5), None)],
)
def test_a_block_with_a_velocity_follows_the_closed_form(backend, velocity, along):
    """Straight down the slope: v = v0 + g (sin - mu cos) t. The momentum at the start is that of the mass, to rounding."""
    hard = DruckerPrager(density=2000.0, friction_angle=50.0, cohesion=1e6, youngs_modulus=2e6)
    release = mass(velocity=velocity)
    result = run(release, backend, material=hard, end_time=1.0)
    s = result.series
    start = np.array([s[f"momentum_{axis}"][0] for axis in "xyz"]) / s["mass"][0]
    if along is None:
        np.testing.assert_allclose(start, velocity, rtol=1e-12)
        return
    rise = -SLOPE * along[0]
    np.testing.assert_allclose(start, 5.0 * np.array([*along, rise]) / math.hypot(1.0, rise), rtol=1e-9)
    assert s["kinetic_energy"][0] == pytest.approx(12.5 * s["mass"][0], rel=1e-9)
    if along == (1.0, 0.0):
        slope, mu = math.atan(SLOPE), math.tan(math.radians(20.0))
        speed = np.hypot(s["momentum_x"], s["momentum_z"]) / s["mass"]
        expected = 5.0 + 9.81 * (math.sin(slope) - mu * math.cos(slope)) * s["time"]
        np.testing.assert_allclose(speed, expected, rtol=0.02)


@EACH
def test_a_release_starts_when_the_flow_of_another_arrives(backend):
    """The start is the arrival of the flow at the outline, to the time between two looks; chains start one by one."""
    lower = mass("lower", (14, 20), starts_when=Arrival("upper", 0.2))
    last = mass("last", (21, 25), starts_when=Arrival("lower", 0.2))
    result = run([mass(), lower, last], backend)
    alone = run(mass(), backend)
    expected = np.nanmin(alone.fields["arrival_time"][lower.thickness > 0])
    first, second = result.start["late_source_start_time"]
    assert expected <= first <= expected + 0.3
    assert first < second < 6.0
    assert result.never_started == []
    of_mass, of_all, of_energy = budget(result)
    assert max(of_mass, of_all) < 1e-12
    assert abs(of_energy) < 0.15


def test_the_arrival_is_found_on_a_raster_finer_than_the_grid():
    """Maps are kept on the lattice of the grid there."""
    x = np.arange(100) + 0.5
    fine = Terrain.from_array(np.tile(60.0 - SLOPE * x, (40, 1)), (1.0, 1.0))
    upper, lower = (mass(name, columns, (12, 28), terrain=fine) for name, columns in (("upper", (8, 24)), ("lower", (32, 44))))
    choices = {"terrain": fine, "cell_size": 4.0, "end_time": 5.0}
    result = run([upper, replace(lower, starts_when=Arrival("upper"))], **choices)
    alone = run(upper, **choices)
    (started,) = result.start["late_source_start_time"]
    expected = np.nanmin(alone.fields["arrival_time"][lower.thickness > 0])
    assert abs(started - expected) < 0.6


@EACH
def test_mass_is_booked_to_rounding_in_single_precision(backend):
    """What enters is the mass of the particles as the backend has them; the skipped time before counts in no step."""
    late = [mass(start_time=1.0, velocity=3.0), mass("second", rows=(17, 23), start_time=1.5)]
    result = run(late, backend, precision="float32", end_time=2.5)
    assert result.series["mass"][0] == 0.0
    assert budget(result)[0] < 1e-12
    assert np.diff(result.series["time"]).max() == 1.0
    alone = run([replace(late[0], start_time=0.0)], backend, precision="float32", end_time=1.5)
    viscosity, expected = (r.depth_resolution.numerical_viscosity for r in (result, alone))
    assert viscosity == pytest.approx(expected, rel=0.2)


@EACH
def test_a_release_that_is_never_reached_stays_out_and_is_said(backend, caplog):
    beside = mass("beside", rows=(19, 22), starts_when=Arrival("upper"))
    with caplog.at_level(logging.WARNING):
        result = run([mass(rows=(2, 8)), beside], backend, end_time=2.0)
    assert result.never_started == ["beside"]
    assert "release beside never started" in caplog.text
    assert result.series["waiting_mass"][-1] == pytest.approx(beside.volume * SOIL.density, rel=1e-12)
    assert result.series["entered_mass"][-1] == 0.0
    assert "beside never started" in repr(result)
    assert set(result.state.release) == {0}


def test_ground_that_never_failed_has_not_changed():
    """With a bed: the change of elevation is the deposit less what was released, not what waits, and less what was eroded."""
    one, beside = mass(rows=(2, 8)), mass("beside", rows=(19, 22), starts_when=Arrival("upper"), placement="excavated")
    result = run([one, beside], end_time=2.0, bed=Bed(0.5, RammsErosion(rate=0.05, critical_stress=0.0)))
    fields = result.fields
    expected = fields["deposit_thickness"] - one.thickness - fields["eroded_depth"]
    np.testing.assert_allclose(fields["elevation_change"], expected, rtol=0, atol=1e-12)
    assert result.never_started == ["beside"]


def test_a_flow_of_a_third_release_does_not_start_one():
    """The trigger names a release: mass of another may lie inside the outline."""
    lower = mass("lower", (14, 20), starts_when=Arrival("aside"))
    result = run([mass(), mass("aside", rows=(19, 22), columns=(40, 44)), lower])
    assert result.never_started == ["lower"]
    assert result.fields["max_flow_thickness"][12, 16] > 0.3


@EACH
def test_a_run_does_not_end_at_rest_while_a_release_waits_for_its_time(backend):
    """A small mass that starts beside a large deposit moves on; the run ends after both."""
    level = Terrain.from_array(np.where(X < 60.0, 0.0, 0.6 * (X - 60.0)) * np.ones((ROWS, 1)), (CELL, CELL))
    resting = mass("resting", (2, 10), thickness=3.0, terrain=level)
    late = mass("late", (40, 44), thickness=1.0, terrain=level, start_time=4.0)
    result = run([resting, late], backend, level, end_time=20.0, stop=True)
    assert result.stop_reason == "at rest"
    assert 6.0 < result.series["time"][-1] < 20.0
    assert result.series["entered_mass"][-1] == pytest.approx(late.volume * SOIL.density, rel=1e-12)
    moved = result.state.position(np.array([CELL] * 3))[result.state.release == 1, 0]
    assert moved.mean() < 40 * CELL


@EACH
def test_a_mass_on_the_surface_is_put_on_what_lies_there(backend):
    """The second surge at the same place, at rest on level ground: nothing enters in the place of other mass."""
    level = Terrain.from_array(np.zeros((ROWS, COLUMNS)), (CELL, CELL))
    first = mass("first", terrain=level, columns=(10, 30), rows=(4, 20))
    second = mass("second", terrain=level, columns=(16, 24), rows=(8, 16), start_time=0.5)
    result = run([first, second], backend, level, basal_friction_angle=40.0, end_time=0.55)
    place = result.state.position(np.array([CELL] * 3))
    above, below = place[result.state.release == 1], place[result.state.release == 0]
    under = np.abs(below[:, :2] - (20 * CELL, 12 * CELL)).max(axis=1) < 3 * CELL
    assert above[:, 2].min() > below[under, 2].max()
    assert budget(result)[0] < 1e-12


def test_particles_are_lifted_by_the_height_of_what_is_there_column_by_column():
    waiting = []
    releases = [mass(start_time=1.0), mass("there", (8, 20))]
    numerics = Numerics(cell_size=CELL, particles_per_cell=(2, 2, 4))
    scene, present = build_scene(TERRAIN, releases, SOIL, 20.0, numerics, waiting=waiting)
    own = waiting[0].particles
    particles = next(own.chunks())
    before, spacing = particles.position(np.array(scene.spacing)), np.array(scene.spacing)
    lift(particles, present, scene, (CELL / 2, CELL / 2))
    risen = particles.position(spacing) - before
    np.testing.assert_array_equal(risen[:, :2], 0.0)
    over = before[:, 0] > 8 * CELL
    assert (risen[over & (before[:, 0] > 8.5 * CELL), 2] > 1.8).all()
    np.testing.assert_array_equal(risen[before[:, 0] < 7 * CELL, 2], 0.0)
    assert ((particles.offset >= 0.5) & (particles.offset < 1.5)).all()


def test_an_excavated_release_that_waits_is_ground_until_it_starts():
    """The ground in its place is that of the terrain; at its start it falls to that of a run whose releases start at once."""
    dug = {"placement": "excavated"}
    releases, waiting = [mass(**dug), mass("lower", (14, 20), start_time=LATE, **dug)], []
    numerics = Numerics(cell_size=CELL, particles_per_cell=(2, 2, 4))
    scene, particles = build_scene(TERRAIN, releases, SOIL, 20.0, numerics, waiting=waiting)
    whole, all_particles = build_scene(TERRAIN, [releases[0], replace(releases[1], start_time=0.0)], SOIL, 20.0, numerics)
    x, y = X[14:20], np.full(6, 12 * CELL)
    np.testing.assert_allclose(scene.ground.elevation(x, y), 100.0 - SLOPE * x, atol=0.02)
    assert (whole.ground.elevation(x[1:-1], y[1:-1]) < 100.0 - SLOPE * x[1:-1] - 1.8).all()
    assert len(particles) + waiting[0].reserved == len(all_particles)
    scene.ground.lower(waiting[0].closing.first, waiting[0].closing.height)
    places = np.meshgrid(np.linspace(1.0, 118.0, 90), np.linspace(1.0, 58.0, 50), indexing="ij")
    np.testing.assert_allclose(scene.ground.elevation(*places), whole.ground.elevation(*places), rtol=0, atol=1e-9)


def test_a_larger_release_than_its_scar_is_ground_too():
    """What a sampled volume puts above the surface stands there from the start."""
    waiting = []
    numerics = Numerics(cell_size=CELL, particles_per_cell=(2, 2, 4))
    release = mass("lower", (14, 20), start_time=LATE, placement="excavated").scaled(1.5)
    scene, _ = build_scene(TERRAIN, [mass(), release], SOIL, 20.0, numerics, waiting=waiting)
    x, y = X[16:18], np.full(2, 12 * CELL)
    np.testing.assert_allclose(scene.ground.elevation(x, y), 101.0 - SLOPE * x, atol=0.05)


@EACH
def test_an_interrupted_run_gives_the_same_bits(backend, tmp_path):
    """With a bed, a release that starts at a time and one that is triggered; killed before, between and after the starts."""
    trigger = Arrival("upper", 0.2)
    releases = [
        mass(),
        mass("second", rows=(17, 23), start_time=1.0),
        mass("lower", (14, 20), starts_when=trigger, placement="excavated"),
    ]
    choices = {"end_time": 4.0, "bed": Bed(0.5, RammsErosion(rate=0.05, critical_stress=0.0)), "substeps": 2}
    expected = run(releases, backend, **choices)

    class Stop(Exception):
        pass

    for share in (0.1, 0.4, 0.85):

        def stop(done, share=share):
            if done > share:
                raise Stop

        with pytest.raises(Stop):
            run(releases, backend, **choices, checkpoint=tmp_path / "c.npz", checkpoint_every=0.0, progress=stop)
    result = run(releases, backend, **choices, checkpoint=tmp_path / "c.npz")
    assert len(expected.start["late_source_start_time"]) == 2
    assert not np.isnan(expected.start["late_source_start_time"]).any()
    for name, values in vars(expected.state).items():
        np.testing.assert_array_equal(getattr(result.state, name), values, err_msg=name)
    for name, values in expected.fields.items():
        np.testing.assert_array_equal(result.fields[name], values, err_msg=name)
    for name, values in expected.series.items():
        if name != "memory":
            np.testing.assert_array_equal(result.series[name], values, err_msg=name)
    assert result.start["late_source_start_time"] == expected.start["late_source_start_time"]
    s = expected.series
    whole = s["mass"] + s["escaped_mass"] - s["entered_mass"] - s["entrained_mass"]
    np.testing.assert_allclose(whole, whole[0], rtol=1e-12)
    assert len(np.unique(expected.state.identity)) == len(expected.state.identity)


def test_snapshots_follow_particles_that_enter_later():
    """A particle of a release that waits is missing before its start."""
    both = [mass(rows=(2, 8)), mass("second", rows=(16, 22), start_time=1.0)]
    result = run(both, end_time=2.0, snapshot_times=(0.5, 1.5), snapshot_particles=50)
    before, after = result.particle_frames
    assert np.isnan(before[:, 0]).any()
    assert not np.isnan(after[:, 0]).any()
    assert after[np.isnan(before[:, 0]), 1].mean() < after[~np.isnan(before[:, 0]), 1].mean()


def test_no_transfer_before_a_start_is_short():
    """Contacts begin from the force of the transfer before: the last ones before a start are equal."""
    lengths = []
    from runout.simulation.run import Run

    class Watched(Run):
        def arrive(self, count):
            lengths.extend([self.length] * count)
            super().arrive(count)

    import runout.simulation.single as single

    original, single.Run = single.Run, Watched
    try:
        run([mass(rows=(2, 8)), mass("second", rows=(16, 22), start_time=1.2345678)], end_time=2.0)
    finally:
        single.Run = original
    ratio = np.array(lengths[1:]) / np.array(lengths[:-1])
    assert ratio.min() > 0.5


@pytest.mark.parametrize(
    ("starts", "message"),
    [
        ([{}, {"start_time": 6.0}], "second: starts at 6 s, the run ends at 6 s; start it earlier"),
        ([{}, {"starts_when": Arrival("second")}], "second: waits for its own flow; name another release"),
        ([{}, {"starts_when": Arrival("third")}], "second: waits for 'third', which is no release; name another release"),
        (
            [{"starts_when": Arrival("second")}, {"starts_when": Arrival("upper")}],
            "upper: waits for second, which never starts before it.*second: waits for upper, which never starts before it",
        ),
    ],
)
def test_releases_that_cannot_start_are_refused_together(starts, message):
    one, other = mass(rows=(2, 8), **starts[0]), mass("second", rows=(16, 22), **starts[1])
    with pytest.raises(ReleaseError, match=message):
        run([one, other])


def test_values_of_a_start_have_their_limits():
    velocities = [{"velocity": value} for value in (-3.0, (1.0, 2.0), "fast", (300.0, 0.0, 0.0))]
    for start in ({"start_time": -1.0}, {"start_time": math.nan}, *velocities):
        with pytest.raises(ReleaseError):
            mass(**start)
    with pytest.raises(ReleaseError, match="start_time and starts_when are both given"):
        mass(start_time=1.0, starts_when=Arrival("other"))
    with pytest.raises(ReleaseError, match=r"give runout\.Arrival"):
        mass(starts_when="upper")
    for wrong in ({"azimuth_deg": 361.0}, {"azimuth_deg": -1.0}):
        with pytest.raises(ReleaseError, match="azimuth_deg"):
            StartVelocity(1.0, **wrong)
    with pytest.raises(ReleaseError, match="thickness"):
        Arrival("upper", 0.0)
    assert mass(velocity=0.0).velocity is None


def test_a_speed_down_level_ground_needs_a_direction():
    level = Terrain.from_array(np.zeros((ROWS, COLUMNS)), (CELL, CELL))
    with pytest.raises(ReleaseError, match=r"release upper: velocity states no azimuth, and the ground below .* add azimuth_deg"):
        run(mass(terrain=level, velocity=4.0), terrain=level)


def test_overlap_is_refused_at_the_same_time_and_of_two_scars():
    dug = {"placement": "excavated"}
    for one, other in (({"start_time": 1.0}, {"start_time": 1.0}), (dug, {**dug, "start_time": 1.0})):
        with pytest.raises(ReleaseError, match="overlap by"):
            run([mass(**one), mass("second", **other)], end_time=2.0)


def test_scenarios_that_share_launches_have_late_releases_as_runs_of_their_own():
    """One starts at once, one later, one is triggered, one has a bed below: each is the run alone, but for the order of sums."""
    lower = mass("lower", (14, 20), starts_when=Arrival("upper", 0.2), placement="excavated")
    bed = {"bed": Bed(0.5, RammsErosion(rate=0.05, critical_stress=0.0))}
    masses = [mass()], [mass(start_time=1.0)], [mass(), lower], [mass(), mass("second", rows=(17, 23), start_time=1.5)]
    choices = {"cell_size": CELL, "end_time": 4.0, "precision": "float64", "basal_friction_angle": 20.0, "stop": False}
    shared = {"terrain": TERRAIN, "material": SOIL, **choices}
    scenarios = [{**shared, "release": releases, **(bed if k == 3 else {})} for k, releases in enumerate(masses)]
    for k, result in simulate_batch(scenarios, device="cpu"):
        assert isinstance(result, runout.Result), result
        alone = run(masses[k], "hash", **choices, **(bed if k == 3 else {}))
        starts, expected = (r.start.get("late_source_start_time", []) for r in (result, alone))
        np.testing.assert_allclose(starts, expected, rtol=1e-12)
        assert result.n_particles == alone.n_particles
        for name, values in alone.fields.items():
            np.testing.assert_allclose(result.fields[name], values, rtol=0, atol=1e-9 * np.nanmax(values), err_msg=f"{name} of {k}")
        np.testing.assert_array_equal(result.state.identity, alone.state.identity)
        assert result.series["mass"][-1] == pytest.approx(alone.series["mass"][-1], rel=1e-12)


def test_a_scenario_of_a_batch_that_cannot_start_is_its_own_error():
    scenario = {"terrain": TERRAIN, "release": mass(start_time=2.0), "material": SOIL, "cell_size": CELL, "end_time": 2.0}
    ((_, error),) = list(simulate_batch([scenario], device="cpu"))
    assert isinstance(error, ReleaseError)
    assert "starts at 2 s, the run ends at 2 s" in str(error)


def test_a_start_speed_raises_the_modulus_and_the_speed_that_is_expected():
    from runout.terrain.energy_line import largest_speed

    slow, fast = (largest_speed([mass(velocity=v)], [math.radians(20.0)]) for v in (None, 10.0))
    assert fast == pytest.approx(math.hypot(slow, 10.0), rel=1e-9)


def test_the_key_of_a_run_tells_starts_apart():
    from runout.simulation.checkpoint import run_key
    from runout.simulation.entering import Entering

    keys = set()
    starts = ({}, {"start_time": 1.0}, {"start_time": 1.5}, {"velocity": 2.0}, {"velocity": (2.0, 0.0, -1.0)})
    for start in (*starts, {"starts_when": Arrival("first", 0.1)}, {"starts_when": Arrival("first", 0.2)}):
        waiting: list[WaitingRelease] = []
        releases = [mass("first", rows=(2, 8)), mass("second", rows=(16, 22), **start)]
        numerics = Numerics(cell_size=CELL, particles_per_cell=(2, 2, 4))
        scene, particles = build_scene(TERRAIN, releases, SOIL, 20.0, numerics, in_chunks=True, waiting=waiting)
        keys.add(run_key(scene, particles, more=[Entering(waiting)] if waiting else ()))
    assert len(keys) == 7


@EACH
def test_a_deposit_on_a_bed_is_taken_along_by_a_later_wet_release(backend):
    """Erode, deposit, erode again: a slab erodes a bed and stops; a wet one behind it starts later. Mass closes to rounding."""
    level = np.maximum(100.0 - SLOPE * X, 100.0 - SLOPE * X[20] - 0.1 * (X - X[20]))
    terrain = Terrain.from_array(np.tile(level, (ROWS, 1)), (CELL, CELL))
    bed = Bed(0.5, RammsErosion(rate=0.1, critical_stress=0.0, depth_per_stress=1e-4), pore_pressure_ratio=0.2)
    first = mass("first", (8, 14), terrain=terrain, pore_pressure=PorePressure(ratio=0.0, decay_time=1.0))
    second = mass(
        "second", (4, 10), terrain=terrain, thickness=3.0, start_time=16.0, pore_pressure=PorePressure(ratio=0.8, decay_time=60.0)
    )
    choices = {"terrain": terrain, "bed": bed, "basal_friction_angle": 25.0, "end_time": 22.0}
    both, alone = run([first, second], backend, **choices), run([first], backend, **choices)
    series = both.series
    whole = series["mass"] + series["escaped_mass"] - series["entered_mass"] - series["entrained_mass"]
    assert np.abs(whole - whole[0]).max() <= 1e-12 * series["mass"].max()
    before = series["time"] < 15.9
    assert 0.0 < series["entrained_mass"][before][-1] < series["entrained_mass"][-1]
    assert series["kinetic_energy"][before][-1] < 1e-2 * series["kinetic_energy"].max()  # the first is a deposit

    def front(result):
        return X[np.flatnonzero((np.nan_to_num(result.fields["deposit_thickness"]) > 0.2).any(axis=0)).max()]

    assert front(both) > front(alone) + CELL
