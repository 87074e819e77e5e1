"""Threads get equal shares, and every node is summed once, when nothing that it needs is missing."""

from itertools import pairwise

import numpy as np
import pytest
from scenes import SAND, box, plane, scene

from runout.backends.scan.backend import ScanBackend
from runout.backends.scan.schedule import STRIP, Schedule


def wedge():
    """A slope that is covered in its southern half alone, deeper in the west than in the east."""
    ground = plane(slope_x=-0.3, height=30.0)
    p = box((8.0, 8.0, 0.0), (60.0, 28.0, 9.0), (1.0, 1.0, 1.0), SAND.density, surface=ground)
    x = p.position(np.ones(3))
    above = x[:, 2] - (30.0 - 0.3 * x[:, 0])
    return scene(ground, materials=(SAND,), precision="float32"), p.take(np.flatnonzero(above < 9.0 - 0.12 * x[:, 0]))


@pytest.fixture(scope="module")
def loaded():
    engine = ScanBackend()
    engine.load(*wedge())
    return engine.index.blocks


@pytest.mark.parametrize("threads", [2, 4])
def test_every_thread_gets_its_part_of_the_particles(loaded, threads):
    cuts = Schedule.of(loaded, threads).cuts
    shares = [loaded.held[a:b].sum() for a, b in pairwise(cuts)]
    halves = [part.sum() for part in np.array_split(loaded.held[: loaded.nown], threads)]
    assert max(shares) * threads / loaded.held.sum() < 1.15
    assert max(shares) < max(halves)


def strips_and_threads(index, schedule):
    """Strip and thread of each owner."""
    owner = np.arange(index.nown)
    return owner // STRIP, np.searchsorted(schedule.cuts, owner, side="right") - 1


@pytest.mark.parametrize("threads", [1, 2, 3, 4])
def test_nodes_are_due_behind_all_that_reach_them_and_wait_where_threads_share_them(loaded, threads):
    schedule = Schedule.of(loaded, threads)
    strip, thread = strips_and_threads(loaded, schedule)
    assert sorted(schedule.nodes) == list(range(loaded.nall))
    behind = np.searchsorted(schedule.due, np.arange(loaded.nall), side="right") - 1
    for n, s in zip(schedule.nodes, behind, strict=True):
        reaching = loaded.down[n][loaded.down[n] >= 0]
        if s < len(schedule.due) - 1:
            assert s == strip[reaching].max()
            assert len(set(thread[reaching])) == 1
        else:
            assert len(set(thread[reaching])) > 1
    assert schedule.waits == (threads > 1)
    assert schedule.late_due[0] == schedule.due[-1]
    assert schedule.late_due[-1] == loaded.nall


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_an_arena_is_free_when_all_nodes_are_summed_that_it_reaches(loaded, threads):
    schedule = Schedule.of(loaded, threads)
    due = np.empty(loaded.nall, int)
    due[schedule.nodes] = np.searchsorted(schedule.due, np.arange(loaded.nall), side="right") - 1
    freed = np.searchsorted(schedule.over, np.arange(loaded.nown), side="right") - 1
    assert sorted(schedule.owners) == list(range(loaded.nown))
    assert (due[loaded.up[schedule.owners]].max(axis=1) == freed).all()


def test_no_node_is_due_early_where_something_is_added_to_all_arenas_first(loaded):
    schedule = Schedule.of(loaded, 1, at_once=False)
    assert schedule.due[-1] == 0
    assert schedule.over[-1] == 0
    assert schedule.most_arenas(loaded.held) == np.count_nonzero(loaded.held)


def test_fewer_arenas_are_needed_than_blocks_that_fill_one(loaded):
    assert Schedule.of(loaded, 1).most_arenas(loaded.held) < 0.7 * np.count_nonzero(loaded.held)


@pytest.mark.parametrize("room", [1, 3])
def test_a_step_that_lacks_arenas_makes_them_and_changes_no_bit(room):
    found = []
    for short in (False, True):
        engine = ScanBackend(threads=1)
        engine.load(*wedge())
        for _ in range(5):
            if short:
                arenas = engine.workspace.arenas
                values = arenas.values[: room + 1].copy()
                values[-1] = 0.0
                engine.workspace.arenas = arenas._replace(values=values, free=np.zeros((1, room), np.int32))
            engine.step(engine.stable_step())
        q = engine.particles()
        found.append((q.node.tobytes(), q.offset.tobytes(), q.velocity.tobytes(), q.strain.tobytes()))
        assert not engine.workspace.arenas.values[-1].any()
    assert found[0] == found[1]


def test_summing_late_changes_no_bit(monkeypatch):
    found, whole = [], Schedule.of
    for at_once in (True, False):
        monkeypatch.setattr(Schedule, "of", lambda blocks, threads, at_once=at_once: whole(blocks, threads, at_once))
        engine = ScanBackend(threads=1)
        engine.load(*wedge())
        for _ in range(40):
            engine.step(engine.stable_step())
        assert engine.workspace.schedule.waits != at_once
        q = engine.particles()
        found.append((q.node.tobytes(), q.offset.tobytes(), q.velocity.tobytes(), q.strain.tobytes()))
    assert found[0] == found[1]
