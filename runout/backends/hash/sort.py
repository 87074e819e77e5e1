"""A new index with the particles in its order: launches without a wait, and what follows once the host has seen their outcome.

A sort finds the blocks, cuts the ground, numbers the cells and moves the particles. Where table or arrays have no room it halts
before any particle has changed, and steps behind it do nothing; the host makes room and sorts again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from runout.backends.hash import readback
from runout.backends.hash.layout import ENTERED, GROUNDED, GROW, HALT, LEFT, NEAR, NEXT, OWNERS, run

if TYPE_CHECKING:
    from runout.backends.hash.batch import Batch


def given(batch: Batch, nodes: np.ndarray) -> tuple[Callable[[], None], Callable[[], None]]:
    """How to enter the blocks of particles whose first nodes (n, 3) are given, and to number their cells."""
    i, s, k = batch.index, batch.store, batch.k
    node = wp.array(np.ascontiguousarray(nodes, np.int32), dtype=wp.int32)
    return (
        lambda: run(k.enter_given, s.size, node, i.table, i.members, i.entered),
        lambda: run(k.number_given, s.size, batch.flags, node, i.table, i.slots, s.key, i.ends),
    )


def present(batch: Batch) -> tuple[Callable[[], None], Callable[[], None]]:
    """The same for particles where they are; they name the blocks of the former index."""
    i, s, k = batch.index, batch.store, batch.k

    def enter() -> None:
        marks = i.touching  # holds nothing that is needed between two steps
        marks.zero_()
        run(k.mark_around, s.size, s.rec, s.key, i.former, marks, i.table, i.members, i.entered)
        run(k.enter_marked, (i.capacity, 27), i.former, marks, i.table, i.members, i.entered)

    return (
        enter,
        lambda: run(k.number_present, s.size, batch.flags, s.rec, i.former, i.table, i.slots, s.key, i.ends),
    )


def enqueue(batch: Batch, enter: Callable[[], None], number: Callable[[], None]) -> None:
    """Launches of a sort."""
    batch.flags.zero_()
    batch.index.find_blocks(enter)
    if batch.ground is not None:
        batch.ground.cut(batch.k, batch.index, batch.nodes, batch.shift, batch.h)
    number()
    batch.store.sort(batch.k, batch.index, batch.nodes, batch.deterministic)


def enqueue_again(batch: Batch) -> None:
    """Launches of a sort of the particles where they are; what has been booked by block is kept by scene."""
    readback.keep(batch)
    batch.index.keep_former()
    enqueue(batch, *present(batch))


def settle(batch: Batch, again: Callable[[], tuple[Callable[[], None], Callable[[], None]]]) -> dict[str, np.ndarray]:
    """The device status after a sort that has been launched; the sort is made again with larger arrays until they suffice."""
    device_status = batch.device_status.read()
    while device_status["flags"][HALT] == GROW:
        _make_room(batch, device_status["counts"])
        batch.store.turn_over()  # nothing has moved
        enqueue(batch, *again())
        batch.store.turn_over()
        device_status = batch.device_status.read()
    counts, index = device_status["counts"], batch.index
    index.nown, index.nall, batch.store.n = int(counts[OWNERS]), int(counts[ENTERED]), int(counts[LEFT])
    index.fit_launches(int(device_status["tally"][NEXT]))
    return device_status


def _make_room(batch: Batch, counts: np.ndarray) -> None:
    """Larger arrays for what a sort has counted; where the index grows, the ground under it as much."""
    index, nodes = batch.index, batch.nodes
    capacity, entries = index.capacity, index.table.shape[0]
    index.grow(counts)
    if index.capacity != capacity:
        batch.nodes = batch.node_arrays()
        if capacity:
            batch.nodes.make_room(nodes.places * index.capacity // capacity, nodes.slots * index.capacity // capacity)
    elif index.table.shape[0] == entries:
        nodes.make_room(int(counts[NEAR]), int(counts[GROUNDED]))
