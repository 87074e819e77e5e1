"""Particles that join a running backend, and a ground that is lowered meanwhile."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scenes import SAND, assert_close_states, box, engine_of, plane, scene

from runout import PorePressure
from runout.backends.protocol import BACKENDS, get_backend
from runout.backends.scan.groups import Ground
from runout.errors import CapacityError, StabilityError
from runout.model.particles import Particles

SPACING = (1.0, 1.0, 1.0)
EACH = pytest.mark.parametrize("name", BACKENDS)
OTHERS = pytest.mark.parametrize("name", [name for name in BACKENDS if name != "reference"])
DT = 2e-3


def sloped(**choices):
    """A slope whose ground may be lowered."""
    a_scene = scene(plane(-0.3), materials=(SAND,), **choices)
    return replace(a_scene, surface=a_scene.ground.with_room((0, 0), (80, 80)))


def mass(corner=(20.0, 30.0, 0.0), size=(5.0, 6.0, 2.0), first=0, speed=0.0):
    """A box on the slope; its numbers begin with ``first``."""
    p = box(corner, size, SPACING, SAND.density, surface=plane(-0.3))
    p.identity += first
    p.velocity[:] = (speed, 0.0, -0.3 * speed)
    return p


def in_motion(p, seed=7):
    """The same with numbers in all arrays."""
    rng = np.random.default_rng(seed)
    for name, scale in {"velocity": 0.3, "affine": 0.1, "strain": 1e-5, "ground_force": 10.0}.items():
        getattr(p, name)[:] += rng.normal(0.0, scale, getattr(p, name).shape)
    return p


def running(engine, a_scene, particles, steps, substeps=1, dt=DT):
    """The engine after some steps."""
    engine.load(a_scene, particles)
    return go_on(engine, steps, substeps, dt)


def go_on(engine, steps, substeps=1, dt=DT):
    for _ in range(steps):
        engine.step(dt, substeps)
    return engine


@EACH
def test_others_keep_every_bit_and_sums_go_on(name):
    engine, more = engine_of(name), in_motion(mass((24.0, 33.0, 1.5), (4.0, 4.0, 1.0), 10_000))
    running(engine, sloped(), mass(speed=2.0), 20)
    before, row, counters = engine.particles(), engine.ledger(), vars(engine.counters).copy()
    engine.add(more)
    after, now = engine.particles(), engine.ledger()
    assert after.identity.tolist() == [*before.identity, *more.identity]
    old, new = slice(0, len(before)), slice(len(before), None)
    for field, values in vars(before).items():
        np.testing.assert_array_equal(getattr(after, field)[old], values, err_msg=field)
    for field, values in vars(more).items():
        np.testing.assert_allclose(getattr(after, field)[new], values, rtol=1e-12, atol=1e-12, err_msg=field)
    assert now.mass == pytest.approx(row.mass + more.mass.sum(), rel=1e-14)
    for field in ("escaped_mass", "basal_dissipation", "plastic_dissipation", "escaped_energy", "contact_particles"):
        assert getattr(now, field) == pytest.approx(getattr(row, field), rel=1e-14), field
    np.testing.assert_allclose(now.basal_impulse, row.basal_impulse, rtol=1e-14)
    assert row.basal_dissipation > 0.0
    assert engine.max_speed == pytest.approx(np.linalg.norm(after.velocity, axis=1).max(), rel=1e-6)
    for field in ("steps", "transfers", "particle_steps"):
        assert getattr(engine.counters, field) == counters[field], field
    columns = engine.columns()
    assert columns.mass.sum() == pytest.approx(now.mass, rel=1e-12)


def wall():
    """A wall north of the slope's mass."""
    from runout.backends.scan.warm_up import side_wall

    return replace(side_wall(), origin=(16.0, 26.0, -16.0))


CASES = {
    "plain": {},
    "wet": {"pore_pressure": (PorePressure(ratio=0.5, decay_time=1.0),)},
    "two materials": {"materials": (SAND, replace(SAND, density=2100.0, friction_angle=35.0)), "friction": (0.5, 0.3)},
    "substeps": {"substeps": 3},
    "structures": {"structures": wall()},
}


def scene_of(case):
    """Scene of a case, and how many substeps its transfers have."""
    choices = CASES[case]
    a_scene = scene(plane(-0.3), **{"materials": (SAND,), **choices})
    return replace(a_scene, surface=a_scene.ground.with_room((0, 0), (80, 80))), choices.get("substeps", 1)


def both_of(case):
    """Mass of the start, and mass that joins."""
    early, late = mass(speed=1.0), in_motion(mass((23.0, 32.0, 2.0), (4.0, 4.0, 1.0), 10_000, 2.0))
    for p, ratio in ((early, 0.5), (late, 0.8)):
        if case == "wet":
            p.pore_excess[:], p.pore_left[:] = ratio, 1.0
    if case == "two materials":
        late.release[:] = 1
        late.mass[:] *= 2100.0 / SAND.density
    late.radius[:] *= 1.2
    return early, late


def state_of(engine):
    return engine.particles(), engine.ledger(), engine.structure_impulses()


def assert_near(expected, found, tolerance):
    """States and rows after the same steps."""
    (p, row, impulses), (q, other, pushes) = expected, found
    np.testing.assert_array_equal(q.identity, p.identity)
    assert_close_states(p, q, tolerance, SPACING)
    np.testing.assert_allclose(q.pore_left, p.pore_left, rtol=0, atol=1e-9)
    for field in ("mass", "kinetic_energy", "basal_dissipation", "plastic_dissipation", "structure_dissipation"):
        x = getattr(row, field)
        assert getattr(other, field) == pytest.approx(x, rel=1e-6, abs=1e-6 * row.kinetic_energy), field
    np.testing.assert_allclose(pushes, impulses, rtol=1e-6, atol=1e-6)


@EACH
@pytest.mark.parametrize("case", CASES)
def test_particles_that_join_at_the_start_are_as_good_as_loaded(name, case):
    (a_scene, substeps), (early, late) = scene_of(case), both_of(case)
    whole, joined = engine_of(name), engine_of(name)
    running(whole, a_scene, early.joined(late), 12, substeps)
    joined.load(a_scene, early)
    joined.add(late)
    go_on(joined, 12, substeps)
    if case == "structures":
        assert np.abs(whole.structure_impulses()).max() > 0.0
    assert_near(state_of(whole), state_of(joined), 1e-9)


@OTHERS
@pytest.mark.parametrize("case", CASES)
def test_particles_that_join_later_move_as_on_the_reference(name, case):
    expected, found = (in_turn(engine_of(each), case, [0, 9, 18]) for each in ("reference", name))
    assert_near(expected, found, 1e-8)


@pytest.mark.parametrize("case", CASES)
def test_the_memory_of_scan_is_counted_anew_where_arrays_are(case):
    (a_scene, substeps), (early, late) = scene_of(case), both_of(case)
    engine, counted = engine_of("scan"), []
    engine.load(a_scene, early)
    for turn in range(3):
        engine.add(late.take(slice(turn, None, 3)))
        for _ in range(9):
            go_on(engine, 1, substeps)
            counted.append(engine.memory_bytes())
            assert counted[-1] == sum(engine.memory().values())
    assert counted[-1] > counted[0]


def in_turn(engine, case, times):
    """State after mass has joined and the ground has been lowered after some numbers of steps."""
    (a_scene, substeps), (early, late) = scene_of(case), both_of(case)
    engine.load(a_scene, early)
    for turn, _ in enumerate(times):
        part = late.take(slice(turn, None, len(times)))
        engine.lower((21 + turn, 30), np.full((3, 4), 0.05))
        engine.add(part)
        go_on(engine, 9, substeps)
    return state_of(engine)


@EACH
def test_particles_join_an_empty_run(name):
    (a_scene, _), (early, _) = scene_of("plain"), both_of("plain")
    engine, whole = engine_of(name), engine_of(name)
    engine.load(a_scene, Particles.zeros(0))
    engine.step(DT)
    engine.add(early)
    go_on(engine, 8)
    running(whole, a_scene, early, 8)
    assert_near(state_of(whole), state_of(engine), 1e-9)
    assert engine.counters.transfers == 9


@EACH
def test_ground_that_is_lowered_is_as_good_as_one_that_was_low(name):
    """The gap of every particle grows by what the ground falls."""
    low, fallen = sloped(), sloped()
    low.ground.lower((20, 30), np.full((8, 9), 0.2))
    expected = running(engine_of(name), low, mass(), 30)
    engine = engine_of(name)
    engine.load(fallen, mass())
    engine.lower((20, 30), np.full((5, 9), 0.2))
    engine.lower((25, 30), np.full((3, 9), 0.2))
    go_on(engine, 30)
    np.testing.assert_allclose(fallen.ground.change, low.ground.change, atol=1e-15)
    assert_near(state_of(expected), state_of(engine), 1e-10)
    assert engine.ledger().contact_particles == expected.ledger().contact_particles


def test_blocks_that_stay_have_the_tiles_that_a_new_cut_gives():
    """After some indices, mass that joined and ground that was lowered before a step and before a new index."""
    engine = engine_of("scan")
    running(engine, sloped(), mass(speed=20.0), 10, dt=4e-3)
    for turn in range(3):
        engine.lower((20 + 2 * turn, 30), np.full((6, 4), 0.02))
        engine.add(mass((22.5, 31.0, 0.5), (3.0, 3.0, 0.5), 1000 * (turn + 1), 3.0))
        go_on(engine, 60, 1, 4e-3)
    assert engine.counters.rebuilds > 6
    anew = Ground(*(np.full_like(values, np.nan) for values in engine.workspace.ground))
    engine._cut_tiles(engine.index.blocks, anew)
    for expected, found in zip(anew, engine.workspace.ground, strict=True):
        np.testing.assert_array_equal(found, expected)


@EACH
def test_run_that_gained_particles_resumes_to_the_same_bits(name):
    """A checkpoint behind births, with particles that left before and between, and with the ground lowered."""

    def born(engine, turn):
        late = mass((22.5, 31.0, 0.5), (3.0, 3.0, 0.5), 1000 * (turn + 1), 3.0)
        engine.lower((25, 30), np.full((4, 4), 0.02))
        engine.add(late)

    def edge(engine, turns):
        for turn in turns:
            born(engine, turn)
            go_on(engine, 6, 1, 4e-3)

    a_scene, again = (replace(sloped(unknown=hole()), precision="float32") for _ in range(2))
    engine, resumed = engine_of(name), engine_of(name)
    running(engine, a_scene, mass((20.8, 30.0, 0.0), speed=6.0), 10, dt=4e-3)
    edge(engine, range(3))
    kept = {key: np.array(values) for key, values in engine.checkpoint().items()}
    again.ground.lower(a_scene.ground.first, -a_scene.ground.change)
    resumed.restore(again, kept)
    edge(engine, range(3, 6)), edge(resumed, range(3, 6))
    assert engine.ledger().escaped_mass > 0.0
    for expected, found in zip(state_of(engine)[:2], state_of(resumed)[:2], strict=True):
        for field, values in vars(expected).items():
            np.testing.assert_array_equal(getattr(found, field), values, err_msg=field)
    given = len(mass()) + 6 * len(mass(size=(3.0, 3.0, 0.5)))
    assert engine.ledger().mass + engine.ledger().escaped_mass == pytest.approx(given * 0.125 * SAND.density, rel=1e-6)


def hole():
    """Cells without elevation a little down the slope."""
    unknown = np.zeros((40, 30), np.bool_)
    unknown[13:, :] = True
    return unknown


def test_bits_do_not_depend_on_threads(monkeypatch):
    monkeypatch.setattr("runout.backends.scan.workers.PARTICLES_PER_THREAD", 100)
    states = []
    for threads in (1, 2):
        engine = get_backend("scan", threads=threads)
        running(engine, sloped(precision="float32"), mass(speed=2.0), 10)
        for turn in range(3):
            engine.add(mass((24.0, 31.0, 1.0), (4.0, 4.0, 0.5), 5000 * (turn + 1), 1.0))
            go_on(engine, 5)
        assert engine.threads == threads
        states.append(state_of(engine))
    for expected, found in zip(states[0][:2], states[1][:2], strict=True):
        for field, values in vars(expected).items():
            np.testing.assert_array_equal(getattr(found, field), values, err_msg=field)


@EACH
def test_many_small_births_lose_no_particle(name):
    """Blocks overflow, slots are handed on, arrays grow, particles leave: mass is booked to rounding."""
    rng = np.random.default_rng(3)
    engine, given, first = engine_of(name), mass(speed=5.0), 5000
    total = given.mass.sum()
    running(engine, sloped(unknown=hole()), given, 3, dt=4e-3)
    for _ in range(25):
        x = rng.uniform((18.0, 30.0), (25.5, 36.0), (40, 2))
        p = Particles.at(np.column_stack([x, -0.3 * x[:, 0] + 0.3]), np.ones(3))
        p.mass[:], p.volume[:], p.radius[:], p.identity[:] = 0.125 * SAND.density, 0.125, 0.25, first + np.arange(40)
        p.velocity[:, 0] = 4.0
        total, first = total + p.mass.sum(), first + 40
        engine.add(p)
        go_on(engine, 2, 1, 4e-3)
    row, there = engine.ledger(), engine.particles()
    assert row.mass + row.escaped_mass == pytest.approx(total, rel=1e-13)
    assert row.escaped_mass > 0.0
    assert len(np.unique(there.identity)) == len(there) == round(row.mass / (0.125 * SAND.density))


@EACH
def test_what_no_step_can_move_is_refused_before_anything_changes(name):
    engine, p = running(engine_of(name), sloped(), mass(), 2), mass(first=5000)
    p.mass[3] = 0.0
    with pytest.raises(StabilityError, match="no mass"):
        engine.add(p)
    far = mass(first=5000)
    far.node[:, 0] += 2**23
    with pytest.raises(CapacityError, match="index range"):
        engine.add(far)
    assert len(engine.particles()) == len(mass())
    go_on(engine, 2)


def test_scenes_of_a_batch_gain_particles_on_their_own():
    """Each as in a run of its own; forces are limited in a scene whose step becomes longer alone."""
    from runout.backends.protocol import get_batch

    def starting():
        return [(sloped(), mass(speed=speed, size=(4.0, 4.0, 2.0))) for speed in (0.5, 2.0)]

    late, dt = mass((24.0, 32.0, 1.0), (3.0, 3.0, 0.5), 5000), [(2e-3, 1e-3), (1e-3, 2.5e-3), (2e-3, 2e-3)]
    batch = get_batch(starting(), "cpu")
    for turn, lengths in enumerate(dt):
        if turn:
            batch.lower_of(turn % 2, (24, 32), np.full((3, 3), 0.1))
            batch.join([(turn % 2, late), (turn % 2, late.take(slice(0, 0)))])
        batch.advance(lengths, (4, 4))
    for s, (a_scene, p) in enumerate(starting()):
        engine = engine_of("hash")
        engine.load(a_scene, p)
        for turn, lengths in enumerate(dt):
            if turn and turn % 2 == s:
                engine.lower((24, 32), np.full((3, 3), 0.1))
                engine.add(late)
            go_on(engine, 4, dt=lengths[s])
        expected, found = engine.particles(), batch.particles_of(s)
        assert len(found) == len(p) + len(late)
        np.testing.assert_array_equal(found.identity, expected.identity)
        assert_close_states(expected, found, 1e-12, SPACING)
        assert batch.ledgers()[s].mass == pytest.approx(expected.mass.sum(), rel=1e-13)


@EACH
@pytest.mark.parametrize("case", ["wet", "two materials"])
def test_masses_around_nodes_are_those_of_the_particles(name, case):
    """By release and nearest node of the plan, with the pore pressure ratio; what lies beyond the window does not count."""
    engine = engine_of(name)
    a_scene, substeps = scene_of(case)
    early, late = both_of(case)
    running(engine, a_scene, early.joined(late), 5, substeps)
    first, shape, p = (22, 31), (6, 4), engine.particles()
    found = engine.plan_masses(first, shape)
    place = np.floor(p.position(np.ones(3))[:, :2] + 0.5).astype(int) - first
    ratio = p.pore_excess * p.pore_left if case == "wet" else np.zeros(len(p))
    expected = np.zeros((len(a_scene.materials), 2, *shape))
    for (i, j), release, mass, one in zip(place, p.release, p.mass, ratio, strict=True):
        if 0 <= i < shape[0] and 0 <= j < shape[1]:
            expected[release, :, i, j] += mass, mass * one
    assert 0.0 < expected[:, 0].sum() < p.mass.sum()
    assert (expected[0, 1] > 0.0).any() == (case == "wet")
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@EACH
def test_columns_around_nodes_take_boxes_of_a_cell(name):
    """Half a cell to either side; two materials; what reaches beyond the raster counts at its edge."""
    a_scene, substeps = scene_of("two materials")
    early, late = mass((20.0, 0.1, 0.0), speed=1.0), both_of("two materials")[1]
    engine = running(engine_of(name), a_scene, early.joined(late), 5, substeps)
    found, p = engine.node_columns(), engine.particles()
    x = p.position(np.ones(3))
    expected, volume = np.zeros_like(found.sums), p.mass / a_scene.densities[p.release]
    values = np.stack([volume, *(p.mass * p.velocity.T), p.mass])
    for one, place in zip(values.T, x, strict=True):
        for i in (0, 1):
            for j in (0, 1):
                a, b = int(np.floor(place[0])) + i, int(np.floor(place[1])) + j
                share = (1.0 - abs(place[0] - a)) * (1.0 - abs(place[1] - b))
                expected[:, abs(a) - found.first[0], abs(b) - found.first[1]] += share * one
    assert x[:, 1].min() < 0.5
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(found.sums / scale, expected / scale, rtol=0, atol=1e-12)


def counted(monkeypatch, action):
    """What an action of the hash backend launches, copies and reads."""
    import warp as wp

    counts = Counter()

    def counting(method, name):
        def call(*arguments, **more):
            counts[name] += 1
            return method(*arguments, **more)

        return call

    with monkeypatch.context() as patch:
        for owner, names in ((wp, ("launch", "launch_tiled", "copy")), (wp.array, ("numpy", "assign"))):
            for name in names:
                patch.setattr(owner, name, counting(getattr(owner, name), name))
        action()
    return counts


@pytest.mark.parametrize("strained", [False, True])
@pytest.mark.parametrize("more", [1000, 0])
def test_birth_costs_hash_one_launch_and_no_wait(monkeypatch, more, strained):
    """Beside the sort that ground which falls needs anyway, whatever is there. Two births are taken up at once."""
    costs = []
    for size in ((5.0, 6.0, 2.0), (10.0, 12.0, 2.0)):
        engine, counts = engine_of("hash"), []
        engine.load(sloped(), mass(size=size, speed=2.0), more)
        engine.graphs.enabled = False  # on a GPU all launches of a sort would be one
        go_on(engine, 3)
        engine.add(mass((24.0, 33.0, 1.5), (1.0, 1.0, 0.5), 20_000))  # makes places for more, where there are none
        go_on(engine, 2)
        for births in (0, 1, 2):
            engine.lower((25, 33), np.full((3, 3), 0.01))
            late = [mass((24.0, 33.0, 2.0), (1.0, 1.0, 0.5), 30_000 + 100 * births + 10 * k) for k in range(births)]
            for p in late:
                p.strain[:] = 1e-6 * strained
            waiting = counted(monkeypatch, lambda late=late, engine=engine: [engine.add(p) for p in late])
            assert not waiting
            counts.append(counted(monkeypatch, lambda engine=engine: go_on(engine, 1)))
        without, one, two = counts
        assert one == two
        costs.append({name: one[name] - without[name] for name in one})
        assert len(engine.particles()) == len(mass(size=size)) + 4 * 4
    assert costs[0] == costs[1]
    assert costs[0]["numpy"] == 0
    assert costs[0]["launch"] + costs[0]["launch_tiled"] == 1 + strained  # put behind the others; stress is packed if there is any
    assert costs[0]["copy"] + costs[0]["assign"] <= 4  # one of them brings the table of first nodes


def test_places_that_are_expected_are_made_at_load():
    """Then the arrays stay as they are when particles join; without them, they grow."""
    for more, grows in ((500, False), (0, True)):
        engine = engine_of("hash")
        engine.load(sloped(), mass(), more)
        memory = engine.parts.store.memory
        assert memory.shape[1] == len(mass()) + more
        engine.add(mass((24.0, 33.0, 1.5), (2.0, 2.0, 0.5), 20_000))
        go_on(engine, 2)
        assert (engine.parts.store.memory is not memory) == grows


def test_ground_that_falls_takes_one_copy(monkeypatch):
    engine = running(engine_of("hash"), sloped(), mass(), 3)
    assert counted(monkeypatch, lambda: engine.lower((25, 33), np.full((3, 3), 0.01))) == {"assign": 1, "copy": 1}


def test_sums_around_nodes_wait_once_where_the_window_of_the_mass_is_known(monkeypatch):
    """They are the same, and have the same nodes, as those over a window that is found first."""
    engine = running(engine_of("hash"), sloped(), mass(speed=3.0), 3)
    engine.node_columns()
    go_on(engine, 4)
    engine.add(mass((24.0, 33.0, 1.5), (2.0, 2.0, 0.5), 20_000))
    found = []
    assert counted(monkeypatch, lambda: go_on(engine, 1))["numpy"] > 0
    assert counted(monkeypatch, lambda: found.append(engine.node_columns()))["numpy"] == 1
    engine.looks.travelled[:] = np.inf
    found.append(engine.node_columns())
    assert found[0].first == found[1].first
    np.testing.assert_array_equal(found[0].sums, found[1].sums)


def columns_in_turn(engine, asks):
    """Sums around nodes after each of three series that announce them, by what each call launched."""
    running(engine, sloped(), mass(speed=3.0), 3)
    engine.node_columns()  # the window is known from here on
    found = []
    for _ in range(3):
        engine.steps(DT, 2)
        assert not engine.around.launched
        engine.steps(DT, 2, nodes=True)
        found.append(asks(engine.node_columns))
    return found


def test_sums_around_nodes_that_are_announced_come_with_the_series(monkeypatch):
    """Nothing is launched for them then; they are those that are launched when they are asked for."""
    engine = engine_of("hash")

    def without_launch(ask):
        found = []
        counts = counted(monkeypatch, lambda: found.append(ask()))
        assert counts["launch"] == counts["copy"] == 0
        known, columns = engine.looks.window(0), found[0].sums.copy()
        engine.around.launch(engine.parts, engine.accounts, 0, known)
        assert engine.around.take(engine.parts, 0)[0].first == found[0].first
        return found[0].first, columns

    with_series = columns_in_turn(engine, without_launch)
    other = engine_of("hash")

    def anew(ask):
        other.around.launched.clear()
        found = ask()
        return found.first, found.sums.copy()

    for (first, sums), (other_first, expected) in zip(with_series, columns_in_turn(other, anew), strict=True):
        assert first == other_first
        np.testing.assert_array_equal(sums, expected)


def test_sums_around_nodes_of_a_series_are_dropped_when_particles_join():
    engine = running(engine_of("hash"), sloped(), mass(speed=3.0), 3)
    before = engine.node_columns().sums[4].sum()
    engine.steps(DT, 2, nodes=True)
    assert engine.around.launched
    more = mass((24.0, 33.0, 1.5), (2.0, 2.0, 0.5), 20_000)
    engine.add(more)
    assert not engine.around.launched
    assert engine.node_columns().sums[4].sum() == pytest.approx(before + more.mass.sum(), rel=1e-12)
