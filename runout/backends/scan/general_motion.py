"""Grid to particles with velocity gradients that were taken before (:mod:`runout.backends.scan.gradients`).

Like :mod:`runout.backends.scan.motion`, for every choice of transfer and F-bar: what a scene does not use is multiplied by zero.
"""

import numpy as np
from numba import get_thread_id, prange

from runout.backends.lanes import (
    lane_bits,
    lane_largest,
    lane_sum,
    largest,
    load16,
    local_array,
    lowest_bit,
    record_vectors,
    row_vectors,
)
from runout.backends.scan.motion import (
    ALIVE,
    CODE,
    LARGE,
    LOST,
    MOVE,
    REFUSED,
    SPEED,
    TILE,
    _about_particles,
    _gather_block,
    _load_tile,
    _move,
    _note_moves,
    _pack,
    _store_tile,
    _strain,
    halves,
)
from runout.backends.scan.stencil import _load_nodes, local_nodes, zeros
from runout.physics.elastic import is_small, kirchhoff_stress
from runout.physics.elastic import update as law_update
from runout.physics.elastic import update_small as law_update_small
from runout.physics.moments import velocity_gradient
from runout.physics.tensors import dot, real, vec
from runout.physics.transfers import kept_velocity, with_dilatation

RATE, SLIP = 31, 47  # first of the 16 rows of a tile that hold the particles' rates, and their slips
ONE_MATERIAL = True
local_tile = local_array((SLIP + 16, TILE))
load_rates, _ = record_vectors(16)
_, store_16_rows = row_vectors(16, TILE)


def _gradient(t, p, cells, averaged):
    """Velocity gradient times the step [1], with the mean dilatation where it is ``averaged`` (1, else 0)."""
    x = vec(t[RATE + 5, p], t[RATE + 6, p], t[RATE + 7, p])
    y = vec(t[RATE + 9, p], t[RATE + 10, p], t[RATE + 11, p])
    L = velocity_gradient(x, y, vec(t[RATE + 13, p], t[RATE + 14, p], t[RATE + 15, p]), cells)
    return with_dilatation(L, t[RATE, p], averaged)


def _kept(t, p, k, keeps):
    """Three rows of a column from row ``k`` on, with the part of their slip that is kept."""
    slip = vec(t[SLIP + k, p], t[SLIP + k + 1, p], t[SLIP + k + 2, p])
    return kept_velocity(vec(t[k, p], t[k + 1, p], t[k + 2, p]), slip, keeps)


def _finish(t, p, alive, B, history, lost, tau, s, cells, keeps):
    """Write the state of a column, move it with the grid, keep a part of its own velocity and pack its next record."""
    nothing = real(0.0)
    far, refused, code = _move(t, p, cells)
    v = _kept(t, p, 1, keeps)
    t[1, p], t[2, p], t[3, p] = v
    t[5, p], t[6, p], t[7, p] = _kept(t, p, 5, keeps)
    t[9, p], t[10, p], t[11, p] = _kept(t, p, 9, keeps)
    t[13, p], t[14, p], t[15, p] = _kept(t, p, 13, keeps)
    t[SPEED, p] = dot(v, v) if alive else nothing
    t[MOVE, p] = far if alive else nothing
    t[REFUSED, p] = refused if alive else nothing
    t[LOST, p] = lost * t[23, p] if alive else nothing
    t[CODE, p] = code
    _pack(t, p, tau, s)
    t[16, p] = B[0]
    t[17, p] = B[1]
    t[18, p] = B[2]
    t[19, p] = B[3]
    t[20, p] = B[4]
    t[21, p] = B[5]
    t[22, p] = history


def _follow_tile(t, who, label, first, count, mats, s, cells, averaged, keeps):
    """Law, motion and next record of a tile, for small strain; the others are marked LARGE."""
    mat = mats[0]
    for p in range((count + np.uint64(15)) & ~np.uint64(15)):
        alive = p < count
        t[ALIVE, p] = real(1.0) if alive else real(0.0)
        if not ONE_MATERIAL:
            mat = mats[label[who[first + p], 0]]
        B, log, history, lost, size = law_update_small(_strain(t, p), _gradient(t, p, cells, averaged), t[22, p], mat)
        t[LARGE, p] = real(0.0) if is_small(size) else t[ALIVE, p]
        _finish(t, p, alive, B, history, lost, kirchhoff_stress(log, mat), s, cells, keeps)


def _follow_large(t, rec, state, p, slot, mat, s, cells, averaged, keeps):
    """The same for one particle of any strain, from its record and state before the law."""
    r = rec[slot]
    r = _about_particles((r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], r[10], r[11], r[12], r[13], r[14], r[15]))
    for k in range(16):
        t[k, p] = r[k]
    for k in range(8):
        t[16 + k, p] = state[slot, k]
    B, log, history, lost = law_update(_strain(t, p), _gradient(t, p, cells, averaged), t[22, p], mat)
    _finish(t, p, True, B, history, lost, kirchhoff_stress(log, mat), s, cells, keeps)


def _follow_all_large(t, rec, state, slot, who, label, first, groups, mats, s, cells, averaged, keeps):
    """The robust law for the columns that are marked LARGE."""
    for g in range(groups):
        bits = lane_bits(load16(t, LARGE * TILE + 16 * g) > halves(t))
        while bits != np.uint64(0):
            column = np.int64(lowest_bit(bits)) + 16 * g
            bits = bits & (bits - np.uint64(1))
            mat = mats[label[who[first + column], 0]]
            _follow_large(t, rec, state, column, slot + column, mat, s, cells, averaged, keeps)


def grid_to_particles_generally(
    rec, state, cell, who, label, order, starts, first, nown, grid, up, bxyz, rim, domain, mats, s, cells, rates, averaged, slips,
    keeps, rec2, state2, who2, movers, leaving, shifted, thinned, changed, sums,
):  # fmt: skip
    """As :func:`runout.backends.scan.motion.grid_to_particles`, with gradients and mean dilatations of ``rates``, and ``slips``.

    ``averaged`` is 1 with F-bar and 0 without, ``keeps`` the part of the slips that stays with a particle. ``s`` is zero where
    records hold no stress.
    """
    for b in prange(nown):
        leaving[b] = 0
        shifted[b] = 0
        thinned[b] = 0
        changed[b] = 0
        for k in range(4):
            sums[b, k] = 0.0
        held = starts[b, 64]
        if held == 0:
            continue
        buffer = get_thread_id()
        nodes = local_nodes(rec)
        t = local_tile(rec)
        _load_nodes(nodes, grid, up, b)
        _gather_block(rec, state, who, cell, order, starts, first, b, nodes, rec2[buffer], state2[buffer], who2[buffer])
        f = first[b]
        speed = move = lost = refused = zeros(rec)
        left = 0
        stirred = 0
        out_of = np.int64(0)
        new = np.int64(0)
        for k in range(0, held, TILE):
            count = min(TILE, held - k)
            groups = (count + 15) >> 4
            _load_tile(t, rec2[buffer], state2[buffer], k, groups)
            for g in range(groups):
                store_16_rows(t, RATE * TILE + 16 * g, load_rates(rates, 16 * (f + k + 16 * g)))
                store_16_rows(t, SLIP * TILE + 16 * g, load_rates(slips, 16 * (f + k + 16 * g)))
            _follow_tile(t, who, label, np.uint64(f + k), np.uint64(count), mats, s, cells, averaged, keeps)
            _follow_all_large(t, rec2[buffer], state2[buffer], k, who, label, f + k, groups, mats, s, cells, averaged, keeps)
            _store_tile(t, rec, state, f + k, groups)
            for g in range(groups):
                speed = largest(speed, load16(t, SPEED * TILE + 16 * g))
                move = largest(move, load16(t, MOVE * TILE + 16 * g))
                lost = lost + load16(t, LOST * TILE + 16 * g)
                refused = refused + load16(t, REFUSED * TILE + 16 * g)
                left, stirred, out_of, new = _note_moves(
                    t, rec, cell, f, f + k, g, b, bxyz, rim, domain, movers, f + held - 1, left, stirred, out_of, new
                )
        leaving[b] = left
        shifted[b] = stirred
        thinned[b] = out_of
        changed[b] = new
        sums[b, 0] = lane_largest(speed)
        sums[b, 1] = lane_largest(move)
        sums[b, 2] = lane_sum(lost)
        sums[b, 3] = lane_sum(refused)
