"""Sort: a new index, and the particles moved in memory into the order of its blocks.

    before   memory rows 0 ... 23 record | row 24 radius       particles in the order of the last sort
    sort     blocks -> ground -> key of every particle -> order -> each row is gathered into the row beside it
    after    memory row 0 radius | rows 1 ... 24 record        particles block by block, cell by cell; the next sort goes back

The launches do not wait for the host. If the table or an array is too small, the sort stops before it moves a particle, and the
steps behind it do nothing. The host then makes room and sorts again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import warp as wp

from runout.backends.hash.device_status import Snapshot
from runout.backends.hash.layout import BESIDE, ENTERED, GROUNDED, GROW, HALT, LEFT, NEAR, NEXT, OWNERS, REACHED, run
from runout.backends.hash.limits import largest_in_contact
from runout.backends.hash.parts import Parts
from runout.backends.hash.readback import Report

Works: TypeAlias = tuple[Callable[[], None], Callable[[], None]]


def given(parts: Parts, node: wp.array) -> Works:
    """How to enter the blocks of particles whose first nodes (n, 3) are given, and to number their cells."""
    i, s, k, status = parts.index, parts.store, parts.k, parts.status.group
    return (
        lambda: run(k.enter_given, len(node), status, i.key_group, node),
        lambda: run(k.number_given, len(node), status, s.group, i.block_group, i.key_group, node),
    )


def present(parts: Parts) -> Works:
    """The same for particles where they are, which name the blocks of the former index, and for those that join."""
    i, s, k, status = parts.index, parts.store, parts.k, parts.status.group
    table = s.joining.shape[1]

    def enter() -> None:
        marks = parts.nodes.touching  # holds nothing that is needed between two steps, and is cleared
        run(k.mark_around, s.size, status, s.group, i.block_group, i.key_group, marks)
        run(k.enter_marked, (i.capacity, 27), status, i.block_group, i.key_group, marks)
        run(k.enter_joining, table, status, i.key_group, s.joining)

    def number() -> None:
        run(k.number_present, s.size, status, s.group, i.block_group, i.key_group)
        run(k.number_joining, table, status, s.group, i.block_group, i.key_group, s.joining)

    return enter, number


def enqueue(parts: Parts, enter: Callable[[], None], number: Callable[[], None], keeps: bool = False) -> None:
    """Launches of a sort; if the particles name the blocks of the present index, it ``keeps`` where these are."""
    parts.index.clear(parts.nodes, keeps)
    parts.index.find_blocks(enter)
    if parts.ground is not None:
        parts.ground.cut(parts.k, parts.index, parts.nodes, parts.scenes)
    if parts.structures is not None:
        parts.structures.note_beside(parts.k, parts.index, parts.scenes)
    number()
    parts.store.sort(parts.k, parts.index, parts.nodes)


def keep(parts: Parts, report: Report) -> None:
    """Launches that keep what has been booked by block before a sort."""
    report.keep(parts)
    if parts.structures is not None:
        run(parts.k.carry_sums, len(parts.structures.upper), parts.structures.group)


def enqueue_again(parts: Parts, report: Report) -> None:
    """Launches of a sort of the particles where they are, and of those that join; what is booked by block is kept by scene."""
    keep(parts, report)
    enqueue(parts, *present(parts), keeps=True)


def settle(parts: Parts, again: Callable[[], Works], found: Snapshot | None = None) -> dict[str, np.ndarray]:
    """The device status after a sort that has been launched, or as it was ``found`` behind the sort.

    The sort is made again with larger arrays until they suffice.
    """
    status = (found or parts.status.snapshot()).arrived()
    while status["flags"][HALT] == GROW:
        _make_room(parts, status["counts"])
        parts.store.turn_over()  # nothing has moved
        enqueue(parts, *again())
        parts.store.turn_over()
        status = parts.status.read()
    counts, index = status["counts"], parts.index
    index.nown, index.nall, parts.store.n = int(counts[OWNERS]), int(counts[ENTERED]), int(counts[LEFT])
    index.fit_launches(int(status["tally"][NEXT]))
    return status


def _make_room(parts: Parts, counts: np.ndarray) -> None:
    """Larger arrays for what a sort has counted; where the index grows, the ground under it as much."""
    index, nodes, structures = parts.index, parts.nodes, parts.structures
    beside = (structures.places, structures.slots) if structures else (0, 0)
    capacity, entries = index.capacity, index.table.shape[0]
    index.grow(counts)
    if index.capacity != capacity:
        parts.make_nodes()
        if capacity:
            parts.nodes.make_room(*_grown(nodes.places, nodes.slots, index.capacity, capacity))
            if structures:
                structures.make_room(*_grown(*beside, index.capacity, capacity))
    elif index.table.shape[0] == entries:
        nodes.make_room(int(counts[NEAR]), int(counts[GROUNDED]))
        if structures:
            structures.make_room(int(counts[BESIDE]), int(counts[REACHED]))


def _grown(places: int, slots: int, blocks: int, before: int) -> tuple[int, int]:
    """Room for blocks of two kinds that grows with that for all blocks, as far as it can be addressed."""
    return places * blocks // before, min(slots * blocks // before, largest_in_contact())
