"""Scenarios that share launches give what each gives in its own run; what goes wrong with one is its own."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import HASH_DEVICE, assert_same_arrays

from runout import Bed, ConfigError, DruckerPrager, RammsErosion, Release, Terrain, simulate
from runout.errors import CapacityError, MaterialError
from runout.simulation.batch import _Together, simulate_batch

TERRAIN = Terrain(np.tile(40.0 - 2.0 * np.arange(20), (14, 1)), (5.0, 5.0))
THICKNESS = np.zeros(TERRAIN.shape)
THICKNESS[5:9, 2:6] = 5.0


def scenario(friction=15.0, end_time=1.0, **choices):
    return {
        "terrain": TERRAIN,
        "release": Release(THICKNESS * choices.pop("factor", 1.0), TERRAIN, placement="on_surface"),
        "material": DruckerPrager(density=2000.0, youngs_modulus=2e6, friction_angle=30.0),
        "basal_friction_angle": friction,
        "cell_size": 5.0,
        "end_time": end_time,
        "precision": "float64",
        **choices,
    }


SCENARIOS = (
    scenario(),
    scenario(25.0, 0.6, snapshot_times=(0.2, 0.4), snapshot_particles=20),
    scenario(5.0, 1.2, seed=3, factor=0.7, cfl=0.3, material=DruckerPrager(density=2000.0, friction_angle=30.0)),
)  # the stiffness of the last is chosen: each scene of a launch has its own


OF_THE_LAUNCH = ("active_blocks", "active_nodes", "sparsity", "memory")  # margins of the others make the index larger


def assert_alike(found, alone):
    assert (found.steps, found.n_particles, found.stop_reason) == (alone.steps, alone.n_particles, alone.stop_reason)
    assert_same_arrays(alone.fields, found.fields)
    assert_same_arrays(vars(alone.state), vars(found.state))
    for name, values in alone.series.items():
        if name not in OF_THE_LAUNCH:
            np.testing.assert_allclose(found.series[name], values, rtol=1e-9, atol=1e-3, err_msg=name)
    assert [t for t, _, _ in found.snapshots] == [t for t, _, _ in alone.snapshots]
    assert_same_arrays(dict(enumerate(alone.particle_frames)), dict(enumerate(found.particle_frames)))
    assert len(found.particle_frames) == len(alone.particle_frames)


WAYS = {"one substep": {}, "substeps": {"substeps": 4}}


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_each_scenario_of_a_launch_ends_as_in_its_own_run(way):
    told, scenarios = [], [arguments | way for arguments in SCENARIOS]
    found = dict(simulate_batch(scenarios, device=HASH_DEVICE, progress=lambda number, fraction: told.append((number, fraction))))
    assert sorted(found) == [0, 1, 2]
    for number, arguments in enumerate(scenarios):
        assert_alike(found[number], simulate(**arguments, backend="hash", device=HASH_DEVICE))
        fractions = [fraction for particle_index, fraction in told if particle_index == number]
        assert fractions == sorted(fractions)
        assert (fractions[0], fractions[-1]) == (0.0, 1.0)


def test_scenarios_with_a_bed_share_launches():
    """Births of all scenes join at once; each scene takes up what it takes up alone, on a ground of its own."""
    bed = Bed(1.0, RammsErosion(rate=1.0, critical_stress=0.0))
    scenarios = [scenario(end_time=1.5, bed=bed), scenario(8.0, 1.2, bed=bed, factor=0.7), scenario(25.0, 0.6)]
    found = dict(simulate_batch(scenarios, device=HASH_DEVICE))
    for number, arguments in enumerate(scenarios):
        alone = simulate(**arguments, backend="hash", device=HASH_DEVICE)
        assert found[number].steps == alone.steps
        for name, values in alone.fields.items():
            np.testing.assert_allclose(found[number].fields[name], values, rtol=1e-6, atol=1e-6, err_msg=name)
        assert ("eroded_depth" in alone.fields) == ("bed" in arguments)
        if "bed" in arguments:
            taken, expected = (r.series["entrained_mass"][-1] for r in (found[number], alone))
            assert taken == pytest.approx(expected, rel=1e-12)
            assert taken > 0.02 * alone.series["mass"][0]
            assert len(found[number].state) == len(alone.state) > found[number].n_particles


def test_a_launch_with_a_bed_that_is_divided_for_memory_begins_anew(monkeypatch):
    """Memory ends when the bed is already lowered: the runs of the second launch find it whole."""
    bed = Bed(1.0, RammsErosion(rate=1.0, critical_stress=0.0))
    scenarios = [scenario(end_time=0.8, bed=bed), scenario(8.0, 0.6, bed=bed)]
    expected = dict(simulate_batch(scenarios, device=HASH_DEVICE))
    launch, launches = _Together.outcomes, []

    def until_memory_ends(together):
        launches.append(len(together.jobs))
        outcomes = list(launch(together))
        if len(launches) == 1:
            raise CapacityError("cpu has no memory left")
        yield from outcomes

    monkeypatch.setattr(_Together, "outcomes", until_memory_ends)
    found = dict(simulate_batch(scenarios, device=HASH_DEVICE))
    assert launches == [2, 1, 1]
    for number, result in expected.items():
        assert result.series["entrained_mass"][-1] > 0.0
        assert found[number].series["entrained_mass"][-1] == pytest.approx(result.series["entrained_mass"][-1], rel=1e-12)
        for name, values in result.fields.items():
            np.testing.assert_allclose(found[number].fields[name], values, rtol=1e-6, atol=1e-6, err_msg=name)


def test_a_flow_that_speeds_up_between_the_stops_of_another_ends_as_in_its_own_run():
    """The other stops more often. The first goes on with a step that was admissible when it was chosen, at a lower speed."""
    soft = scenario(0.0, 60.0, stop=True, material=DruckerPrager(density=2000.0, youngs_modulus=4e5, friction_angle=30.0))
    stiff = scenario(25.0, 6.0, material=DruckerPrager(density=2000.0, youngs_modulus=4e7, friction_angle=30.0))
    found = dict(simulate_batch([soft, stiff], device=HASH_DEVICE))[0]
    alone = simulate(**soft, backend="hash", device=HASH_DEVICE)
    assert (found.steps, found.stop_reason) == (alone.steps, alone.stop_reason)
    for name, values in alone.fields.items():  # particles are sorted at other times
        np.testing.assert_allclose(found.fields[name], values, rtol=0, atol=1e-6 * np.nanmax(values), err_msg=name)


def test_a_scenario_that_cannot_be_is_an_error_in_its_place_and_the_others_run():
    bad = scenario(material=DruckerPrager(density=2000.0, youngs_modulus=1e3, friction_angle=30.0))
    found = dict(simulate_batch([SCENARIOS[1], bad], device=HASH_DEVICE))
    assert isinstance(found[1], MaterialError)
    assert "youngs_modulus is 1000 Pa" in str(found[1])
    assert found[0].stop_reason == "end time"


def test_launches_take_as_many_scenarios_as_memory_holds(monkeypatch):
    sizes = []
    build = __import__("runout.simulation.batch", fromlist=["get_batch"]).get_batch

    def counted(scenes, device, more):
        sizes.append(len(scenes))
        if len(scenes) > 2:
            raise CapacityError("cpu has no memory left")
        return build(scenes, device, more)

    monkeypatch.setattr("runout.simulation.batch.get_batch", counted)
    short = [scenario(friction, 0.2) for friction in (5.0, 10.0, 15.0, 20.0)]
    assert sorted(number for number, _ in simulate_batch(short, device=HASH_DEVICE)) == [0, 1, 2, 3]
    assert sizes == [4, 2, 2]
    sizes.clear()
    monkeypatch.setattr("runout.simulation.batch._free", lambda place: 1.0)
    (refused,) = simulate_batch(short[:1], device=HASH_DEVICE)
    assert isinstance(refused[1], CapacityError)
    assert f"the free memory of {HASH_DEVICE}" in str(refused[1])
    assert sizes == []


def test_scenarios_that_together_cannot_be_addressed_run_in_several_launches(monkeypatch):
    sizes = []
    build = __import__("runout.simulation.batch", fromlist=["get_batch"]).get_batch

    def counted(scenes, device, more):
        sizes.append([len(particles) for _, particles in scenes])
        return build(scenes, device, more)

    monkeypatch.setattr("runout.simulation.batch.get_batch", counted)
    short = [scenario(friction, 0.2) | {"substeps": 1} for friction in (5.0, 10.0, 15.0, 20.0)]
    particles = simulate(**short[0], backend="hash", device=HASH_DEVICE).n_particles
    limits = __import__("runout.backends.hash.limits", fromlist=["LARGEST_INDEX"])
    monkeypatch.setattr(limits, "LARGEST_INDEX", 8 * 2 * particles)
    monkeypatch.setattr(limits, "largest_blocks", lambda *of: 2**20)
    monkeypatch.setattr(limits, "SLOT", 1)
    monkeypatch.setattr("runout.backends.hash.columns.require_index", lambda count, what: None)
    found = dict(simulate_batch(short, device=HASH_DEVICE))
    assert sizes == [[particles] * 4, [particles] * 2, [particles] * 2]
    assert all(result.n_particles == particles for result in found.values())
    monkeypatch.setattr(limits, "LARGEST_INDEX", 8 * particles - 1)
    (refused,) = simulate_batch(short[:1], device=HASH_DEVICE)
    assert f"{particles} particles has more than the {particles - 1} that hash can address" in str(refused[1])


def test_a_launch_ends_where_its_particles_keep_the_device_busy_and_the_next_is_prepared_meanwhile(monkeypatch):
    sizes, prepared = [], []
    module = __import__("runout.simulation.batch", fromlist=["get_batch"])
    build, make = module.get_batch, module._PreparedJobs.make

    def counted(scenes, device, more):
        sizes.append(len(scenes))
        return build(scenes, device, more)

    def noted(ahead, count):
        make(ahead, count)
        prepared.append((count, len(ahead.waiting)))

    short = [scenario(friction, 0.2) for friction in (5.0, 10.0, 15.0, 20.0, 25.0)]
    alone = simulate(**short[4], backend="hash", device=HASH_DEVICE)
    monkeypatch.setattr(module, "get_batch", counted)
    monkeypatch.setattr(module._PreparedJobs, "make", noted)
    monkeypatch.setattr(module, "AHEAD", 1)
    monkeypatch.setattr(module, "ENOUGH", 2 * alone.n_particles)
    found = dict(simulate_batch(short, device=HASH_DEVICE, particles=False))
    assert sizes == [2, 2, 1]
    assert (2, 2) in prepared  # while the first launch of two runs
    assert sorted(found) == [0, 1, 2, 3, 4]
    assert len(found[4].state) == 0
    assert_same_arrays({"max_speed": alone.fields["max_speed"]}, found[4].fields)


def test_a_launch_that_keeps_the_device_busy_does_not_wait_for_a_scenario_that_is_not_ready(monkeypatch):
    module = __import__("runout.simulation.batch", fromlist=["get_batch"])
    build, prepare, sizes, started = module.get_batch, module._Job.of, [], threading.Event()

    def counted(scenes, device, more):
        started.set()
        sizes.append(len(scenes))
        return build(scenes, device, more)

    def late(number, arguments, progress):
        assert number < 2 or started.wait(60.0)
        return prepare(number, arguments, progress)

    short = [scenario(friction, 0.2) for friction in (5.0, 10.0, 15.0, 20.0)]
    monkeypatch.setattr(module, "get_batch", counted)
    monkeypatch.setattr(module._Job, "of", late)
    monkeypatch.setattr(module, "BUSY", 1)
    assert sorted(number for number, _ in simulate_batch(short, device=HASH_DEVICE)) == [0, 1, 2, 3]
    assert sizes[0] <= 2
    assert sum(sizes) == 4


@pytest.mark.parametrize(
    ("todo", "particles", "steps"),
    [((3, 17, 30, 30) * 6, 400_000, 30), ((32, *(2,) * 20), 1000, 2), ((20, 20, 20), 1000, 20)],
    ids=["many particles: the others wait", "few particles: a step costs as much for one run as for all", "equal runs"],
)
def test_runs_of_a_launch_wait_for_each_other_where_a_step_costs_what_moves(todo, particles, steps):
    jobs = [SimpleNamespace(particles=range(particles))] * len(todo)
    together = SimpleNamespace(todo=list(todo), jobs=jobs)
    assert _Together._stretch(together, list(range(len(todo)))) == steps


def test_scenarios_that_differ_in_what_they_must_share_are_refused():
    with pytest.raises(ConfigError, match="spacing"):
        list(simulate_batch([scenario(), scenario(cell_size=4.0)], device=HASH_DEVICE))
