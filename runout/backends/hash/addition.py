"""Particles that join a batch between two steps.

    memory   | particles of the last sort, and those that have gone since | join | free |     the sort that follows orders all
    joining  | place of the first, number | first node, release, 64 scene of each |

Only these particles are brought to the device: two copies, and a launch that puts them behind the others. Where they are strained,
a second one packs their stress for the time step of their scene. The sort that follows gives them their cells; nobody waits for it.
Places are made at load for those that are expected. Where they are too few, the arrays by particle grow by an eighth or more, and
those by block are made anew.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from runout.backends.hash.account import Account
from runout.backends.hash.groups import filled
from runout.backends.hash.layout import NODE, RELEASE, SCENE, STAMPS, run
from runout.backends.hash.limits import largest_particles, require_particles
from runout.backends.hash.parts import Parts
from runout.backends.hash.scenes import reach_of
from runout.backends.hash.state import rows_of
from runout.backends.loading import require_movable
from runout.model.particles import Particles, require_index_range

FEWEST_MORE = 2**12  # places that are made at once


def require_joinable(parts: Parts, more: Sequence[tuple[int, Particles]], waiting: int) -> None:
    """Raise StabilityError or CapacityError for particles that cannot join scenes, where others are ``waiting`` to join."""
    for scene, p in more:
        require_movable(p)
        require_index_range(p.node, parts.scenes.scenes[scene].spacing, np.zeros(3, np.int64))
    total = max(parts.store.n, parts.store.loaded) + waiting + sum(len(p) for _, p in more)
    require_particles(total, parts.scenes.scenes[0].dtype().itemsize)


def lacks_places(parts: Parts, many: int) -> bool:
    """Whether so many particles find no place, or no number."""
    store = parts.store
    return store.n + many > store.size or store.loaded + many > len(store.forces)


def put(parts: Parts, accounts: Sequence[Account], more: Sequence[tuple[int, Particles]], made: np.ndarray) -> None:
    """Put particles of scenes that have made some steps (scenes,) behind the others, where they find places.

    A sort that takes up what joins follows (:func:`runout.backends.hash.sort.enqueue_again`).
    """
    scenes, store, k = parts.scenes, parts.store, parts.k
    many, loaded = sum(len(p) for _, p in more), store.loaded
    numbers = np.concatenate([_numbers_of(parts, scene, p) for scene, p in more], axis=1)
    reals = np.concatenate([_reals_of(parts, scene, p, int(made[scene])) for scene, p in more], axis=1)
    for _, p in more:
        _reach_farther(parts, float(p.radius.astype(scenes.scenes[0].dtype).max()))
    if store.note_joining(numbers):
        parts.index.generation += 1
    places = slice(store.n, store.n + many)
    store.join(np.concatenate([p.identity for _, p in more]), set(np.unique(numbers[RELEASE]).tolist()))
    run(k.take_joining, many, store.group, parts.nodes.pore_group, store.joining, wp.array(reals, dtype=scenes.number), loaded)
    if any(p.strain.any() for _, p in more):
        _pack(parts, accounts, places)
    if scenes.constants.only != store.only:
        scenes.constants.only = store.only
        parts.index.generation += 1


def _pack(parts: Parts, accounts: Sequence[Account], places: slice) -> None:
    """Pack the stress of particles that lie at some places for the time steps of their scenes; without strain there is none."""
    scenes, store, many = parts.scenes, parts.store, places.stop - places.start
    rows = {"rec": store.rec[:, places], "release": store.release[places], "key": store.joining[SCENE][1 : many + 1]}
    view = filled(store.struct, store, **rows)
    longer = wp.array(np.array([a.packed_dt for a in accounts]), dtype=scenes.number)
    by_scene = filled(parts.k.groups.BlockGroup, parts.index, member=scenes.numbers)
    run(parts.k.change_step, many, view, by_scene, scenes.constants, scenes.materials, longer)


def _numbers_of(parts: Parts, scene: int, p: Particles) -> np.ndarray:
    """First node in the range of the scene, release among those of all scenes, and 64 times the scene (5, n) int32."""
    numbers = np.empty((SCENE + 1, len(p)), np.int32)
    numbers[NODE : NODE + 3] = p.node.T
    numbers[NODE + 1] += np.int32(parts.scenes.shifts[scene])
    numbers[RELEASE], numbers[SCENE] = p.release + parts.scenes.first_release[scene], 64 * scene
    return numbers


def _reals_of(parts: Parts, scene: int, p: Particles, steps: int) -> np.ndarray:
    """Record without stress, radius, pore pressure at the start and what remains of it, stamp and force of the ground (31, n)."""
    a_scene = parts.scenes.scenes[scene]
    stamp = np.where(p.ground_force.any(), steps & STAMPS, 0) * np.ones(len(p))
    others = [p.pore_excess, p.pore_left, stamp, *p.ground_force.T]
    return np.concatenate([rows_of(p, a_scene.spacing, a_scene.dtype), np.array(others).astype(a_scene.dtype)])


def grow(parts: Parts, many: int) -> None:
    """Make places for so many particles and some more, behind a sort; arrays by block, which depend on them, are made anew."""
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
