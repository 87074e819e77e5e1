"""Slots for particles that join a run between two steps.

    block with room      | held | joins |  free  |                     the free slots of its range
    block without room   |   hole   |  ...  | held | joins |  free  |  a range behind all others; its particles move there
    no block yet                       ...  | joins |  free  |

Particles keep their numbers. The lists by cell of the blocks that gain some are made anew; the others stay as they are. The index
is not linked then: :meth:`Index.rebuilt` follows.
"""

import numpy as np

from runout.backends.scan.groups import Blocks
from runout.backends.scan.index import Index, require_box, require_held
from runout.backends.scan.slots import CELLS, _spacious
from runout.backends.scan.state import Store, capacity, ranges
from runout.physics.blocks import block_of, local_index


def placed(store: Store, blocks: Blocks, node: np.ndarray, most: int) -> tuple[Index, np.ndarray]:
    """Blocks that hold more particles, with first nodes (m, 3) counted from the corner, and the slot (m,) int32 of each.

    Raises CapacityError if a block would hold more than ``most``, or the box around all blocks is too large; nothing has changed
    then.
    """
    index, own = _with_blocks(blocks, block_of(node))
    b, gains = index.blocks, np.bincount(own, minlength=index.blocks.nown)
    gaining = np.flatnonzero(gains)
    held = b.held[gaining]
    require_held(held + gains[gaining], most)
    listed = store.particles.order[ranges(b.first[gaining], held)]
    listed = _make_room(store, b, gaining, gains[gaining], listed)
    of_gaining = np.searchsorted(gaining, own)
    joining = _free_slots(b, gaining, listed, of_gaining)
    store.particles.cell[joining] = local_index(*node.T)
    owners = np.concatenate([np.repeat(np.arange(len(held)), held), of_gaining])
    _list_anew(store, b, gaining, np.concatenate([listed, joining]), owners)
    return index, joining


def _with_blocks(old: Blocks, wanted: np.ndarray) -> tuple[Index, np.ndarray]:
    """The blocks that hold particles and, behind them, the ``wanted`` others (m, 3); and the number (m,) of each wanted one."""
    there = np.flatnonzero(old.held)
    n = len(there)
    both = np.concatenate([old.bxyz[there], wanted]).astype(np.int64)
    low = both.min(axis=0)
    require_box(low, both.max(axis=0))
    keys = np.ravel_multi_index(tuple((both - low).T), tuple(np.ptp(both, axis=0) + 1))
    _, first, which = np.unique(keys, return_index=True, return_inverse=True)
    new = first >= n
    number = np.where(new, n + np.cumsum(new) - 1, first)
    index = Index.of_size(n + int(new.sum()), n + int(new.sum()))
    b = index.blocks
    b.bxyz[:n], b.bxyz[n:] = old.bxyz[there], both[first[new]]
    for name in ("starts", "held", "first", "capacity"):
        getattr(b, name)[:n] = getattr(old, name)[there]
    return index, number[which[n:]]


def _make_room(store: Store, b: Blocks, gaining: np.ndarray, gains: np.ndarray, listed: np.ndarray) -> np.ndarray:
    """Move the particles of blocks whose range is too short for so many more to ranges at the end; returns where all lie then."""
    held, short = b.held[gaining], b.held[gaining] + gains > b.capacity[gaining]
    moving, size = gaining[short], _spacious(held[short] + gains[short] + (held[short] >> 4) + 16)
    begin, end = store.end + np.cumsum(size) - size, store.end + int(size.sum())
    if end > store.slots:
        store.grow(capacity(end))
    for first, slots in zip(b.first[moving].tolist(), b.capacity[moving].tolist(), strict=True):
        store.leave_hole(first, slots)
    b.first[moving], b.capacity[moving], store.end = begin, size, end
    there, listed = np.repeat(short, held), listed.copy()
    source, target = listed[there], ranges(begin, held[short]).astype(np.int32)
    store.move(source, target)
    listed[there] = target
    return listed


def _free_slots(b: Blocks, gaining: np.ndarray, listed: np.ndarray, own: np.ndarray) -> np.ndarray:
    """A free slot (m,) for each particle that joins a block ``own`` (m,) of those ``gaining``; ``listed`` slots are taken."""
    first, room, held = b.first[gaining], b.capacity[gaining], b.held[gaining]
    place = np.cumsum(room) - room
    free = np.ones(int(room.sum()), np.bool_)
    free[np.repeat(place - first, held) + listed] = False
    order = np.argsort(own, kind="stable")
    joins = np.bincount(own, minlength=len(gaining))
    rank = np.empty(len(own), np.int64)
    rank[order] = np.arange(len(own)) - np.repeat(np.cumsum(joins) - joins, joins)
    before = place - (np.cumsum(held) - held)  # free places of the blocks before
    return (np.flatnonzero(free)[before[own] + rank] + (first - place)[own]).astype(np.int32)


def _list_anew(store: Store, b: Blocks, gaining: np.ndarray, slots: np.ndarray, own: np.ndarray) -> None:
    """List the ``slots`` of the blocks that gain particles by cell."""
    keys = own * CELLS + store.particles.cell[slots]
    count = np.bincount(keys, minlength=CELLS * len(gaining)).reshape(-1, CELLS)
    b.starts[gaining, 1:] = count.cumsum(axis=1)
    b.held[gaining] = held = count.sum(axis=1)
    store.particles.order[ranges(b.first[gaining], held)] = slots[np.argsort(keys, kind="stable")]
