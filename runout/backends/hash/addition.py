"""Particles that join a batch between two steps.

    memory   | particles of the last sort, and those that have gone since | join | free |     the sort that follows orders all

Only these particles are brought to the device. Where places are too few, the arrays by particle grow by an eighth or more, and
those by block are made anew.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from runout.backends.hash import sort
from runout.backends.hash.account import Account
from runout.backends.hash.groups import filled
from runout.backends.hash.layout import run
from runout.backends.hash.limits import largest_particles, require_particles
from runout.backends.hash.parts import Parts
from runout.backends.hash.readback import Report
from runout.backends.hash.scenes import reach_of
from runout.backends.hash.state import Store
from runout.backends.loading import require_movable
from runout.model.particles import Particles, require_index_range

FEWEST_MORE = 2**12  # places that are made at once


def require_joinable(parts: Parts, more: Sequence[tuple[int, Particles]]) -> None:
    """Raise StabilityError or CapacityError for particles that cannot join scenes."""
    for scene, p in more:
        require_movable(p)
        require_index_range(p.node, parts.scenes.scenes[scene].spacing, np.zeros(3, np.int64))
    total = max(parts.store.n, parts.store.loaded) + sum(len(p) for _, p in more)
    require_particles(total, parts.scenes.scenes[0].dtype().itemsize)


def join(
    parts: Parts, report: Report, accounts: Sequence[Account], more: Sequence[tuple[int, Particles]], made: np.ndarray
) -> dict[str, np.ndarray]:
    """Add particles to scenes that have made some steps (scenes,), and sort all; no sort is under way.

    The host waits once, for the device status behind the sort, which is returned.
    """
    sort.keep(parts, report)
    store, many = parts.store, sum(len(p) for _, p in more)
    if store.n + many > store.size or store.loaded + many > len(store.forces):
        _grow(parts, many)
    nodes, first = [], store.n
    for scene, p in more:
        store.join(_packed(parts, accounts, scene, p, int(made[scene])))
        _reach_farther(parts, float(p.radius.astype(parts.scenes.scenes[0].dtype).max()))
        nodes.append(np.add(p.node, (0, int(parts.scenes.shifts[scene]), 0)))
    if parts.scenes.constants.only != store.only:
        parts.scenes.constants.only = store.only
        parts.index.generation += 1
    works = _works(parts, wp.array(np.concatenate(nodes).astype(np.int32), dtype=wp.int32), first)
    sort.enqueue(parts, *works)
    store.turn_over()
    return sort.settle(parts, lambda: works)


def _works(parts: Parts, node: wp.array, first: int) -> sort.Works:
    """How to enter the blocks of all particles and to number their cells; those from place ``first`` on have given first nodes."""
    enter, number = sort.present(parts)
    i, k, status, many = parts.index, parts.k, parts.status.group, len(node)

    def enter_all() -> None:
        enter()
        run(k.enter_given, many, status, i.key_group, node)

    def number_all() -> None:
        number()
        store = parts.store
        joining = filled(store.struct, store, key=store.key[first : first + many])
        run(k.number_given, many, status, joining, i.block_group, i.key_group, node)

    return enter_all, number_all


def _packed(parts: Parts, accounts: Sequence[Account], scene: int, p: Particles, stamp: int) -> Store:
    """The particles on the device, packed for the time step of their scene, which has made ``stamp`` steps."""
    scenes, k = parts.scenes, parts.k
    s = scenes.scenes[scene]
    fresh = Store(np.zeros(len(p), np.int64), scenes.number, wet=scenes.wet)
    fresh.put(slice(0, len(p)), p, int(scenes.first_release[scene]), s.spacing, s.dtype, stamp)
    fresh.key.zero_()
    longer = wp.array(np.array([a.packed_dt for a in accounts]), dtype=scenes.number)
    alone = filled(k.groups.BlockGroup, parts.index, member=wp.array(np.array([scene], np.int32), dtype=wp.int32))
    run(k.change_step, len(p), fresh.group, alone, scenes.constants, scenes.materials, longer)
    return fresh


def _grow(parts: Parts, many: int) -> None:
    """Make places for so many particles and some more; the arrays by block, which depend on them, are made anew."""
    store, nodes, structures = parts.store, parts.nodes, parts.structures
    needed, largest = store.n + many, largest_particles(parts.scenes.scenes[0].dtype().itemsize)
    store.grow(store.size if needed <= store.size else min(needed + max(needed // 8, FEWEST_MORE), largest))
    parts.index.fit_pieces(store.size)
    rooms = (nodes.places, nodes.slots), (structures.places, structures.slots) if structures else (0, 0)
    if structures:
        structures.grow(len(store.forces))
    parts.make_nodes()
    if parts.index.capacity:
        parts.nodes.make_room(*rooms[0], exactly=True)
        if structures:
            structures.make_room(*rooms[1], exactly=True)


def _reach_farther(parts: Parts, radius: float) -> None:
    """Let contact reach as far as particles of a ``radius`` [m] do."""
    scenes = parts.scenes
    if radius <= scenes.constants.largest:
        return
    scenes.constants.largest = radius
    reach = reach_of(scenes, radius)
    if parts.ground is not None:
        parts.ground.reach = reach
    if parts.structures is not None:
        parts.structures.reach_farther(scenes, reach)
    parts.index.generation += 1
