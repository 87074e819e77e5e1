"""Numbers of the blocks in the order of their keys, where each block is, and its neighbours."""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.groups import BlockGroup, KeyGroup, StatusGroup
from runout.backends.hash.index import _slot
from runout.backends.hash.layout import BLOCKS, ORDERED, lane_count, own_block, own_lane
from runout.physics.blocks import block_key, key_x, key_y, key_z, mixed
from runout.physics.tensors import i64

sum_before: Any = None  # sums over the lanes before a lane, and over all; the binding puts it in its place

GAP = 8  # blocks between the domains of two members, north to south


def _number_block(blocks: BlockGroup, keys: KeyGroup, key: Any, b: int, rows: int, many: int):
    """Give a key its number, and store coordinates and scene of the block; a scene has ``rows`` blocks from south to north."""
    mask = keys.table.shape[0] - 1
    place = int(mixed(key)) & mask
    while keys.table[place] != wp.uint64(key + i64(1)):
        place = (place + 1) & mask
    keys.slots[place] = b
    blocks.coordinates[b, 0] = int(key_x(key))
    blocks.coordinates[b, 1] = int(key_y(key))
    blocks.coordinates[b, 2] = int(key_z(key))
    blocks.member[b] = wp.clamp((int(key_y(key)) + GAP // 2) // rows, 0, many - 1)


def number_blocks(status: StatusGroup, blocks: BlockGroup, keys: KeyGroup, rows: int, many: int):
    """Number the blocks of sorted keys."""
    b = wp.tid()
    blocks.up[b, 0] = -1
    if b < status.tally[BLOCKS]:
        _number_block(blocks, keys, keys.members[b], b, rows, many)


def rank_blocks(status: StatusGroup, blocks: BlockGroup, keys: KeyGroup, rows: int, many: int):
    """Number the blocks of unsorted keys: the number of a block is how many keys are smaller. A warp counts for each block."""
    m, lane = wp.tid()
    m, lane = own_block(m), own_lane(lane)
    blocks.up[m, 0] = -1
    if m >= status.tally[BLOCKS]:
        return
    key = keys.members[m]
    smaller = int(0)
    for other in range(lane, status.tally[BLOCKS], lane_count()):
        smaller += wp.where(keys.members[other] < key, 1, 0)
    b = sum_before(smaller)[1]
    if lane == 0:
        _number_block(blocks, keys, key, b, rows, many)


def link_blocks(status: StatusGroup, blocks: BlockGroup, keys: KeyGroup):
    """Look up the 27 blocks around each."""
    b, q = wp.tid()
    if b >= status.tally[BLOCKS]:
        return
    i = blocks.coordinates[b, 0]
    j = blocks.coordinates[b, 1]
    k = blocks.coordinates[b, 2]
    blocks.around[b, q] = _slot(keys, block_key(i + q // 9 - 1, j + (q // 3) % 3 - 1, k + q % 3 - 1))


def note_up(status: StatusGroup, blocks: BlockGroup):
    """The eight blocks upwards of each and, for sums in fixed order, the eight downwards; they are among the 27."""
    b = wp.tid()
    if b >= status.tally[BLOCKS]:
        return
    complete = int(1)
    for q in range(8):
        step = (q >> 2) * 9 + ((q >> 1) & 1) * 3 + (q & 1)
        s = blocks.around[b, 13 + step]
        blocks.up[b, q] = s
        if s < 0:
            complete = int(0)
        if ORDERED:
            blocks.down[b, q] = blocks.around[b, 13 - step]
    if complete == 0:
        blocks.up[b, 0] = -1
