"""Phase "grid to particles": new velocities, law, motion and next record of all particles, block by block.

    grid.nodes --gather, by cell--> buffers.rec[thread]     m | v | fx | moments | fy | moments | fz | moments
                                    buffers.state[thread]   B - I (6) | history | volume
    buffers --transposed, 32 particles--> tile t[row, column], see runout.backends.scan.tile
    tile --law, motion, next record, transposed back--> particles.rec, particles.state, from the first slot of the block on

The law is plain scalar source. LLVM vectorises it over the columns of a tile because the index is unsigned (a signed index needs
numba's test for negative values in the loop), all functions are inlined, and tiles lie on the stack.
"""

import numpy as np
from numba import prange

from runout.backends.lanes import (
    constant,
    lane_bits,
    lane_largest,
    lane_sum,
    largest,
    load8,
    load16,
    lowest_bit,
    prefetch,
    store,
    whole,
)
from runout.backends.scan.column_drag import _add_changes
from runout.backends.scan.domain import _lies_in_domain
from runout.backends.scan.pore_pressure import _drain_tile, _sort_pores
from runout.backends.scan.stencil import (
    AHEAD,
    EVERY,
    _expect_nodes,
    _first_node,
    _gather,
    _load_nodes,
    _load_rows,
    _next_filled,
    _place_of,
    _weigh,
    heads_and_tails,
    local_nodes,
    local_weights,
    zeros,
)
from runout.backends.scan.tile import (
    ALIVE,
    CODE,
    EFFECTIVE,
    LARGE,
    LOST,
    MOVE,
    REFUSED,
    RELEASES,
    SPEED,
    SUMS,
    TILE,
    _about_particles,
    _clear_sums,
    _load_sums,
    _load_tile,
    _moments,
    _rows,
    _stay_on_grid,
    _store_tile,
    _way_before,
    _way_gradient,
    local_tile,
)
from runout.physics.elastic import is_small, kirchhoff_stress
from runout.physics.moments import affine_columns, momentum_at, stress_columns, velocity_gradient
from runout.physics.plastic import step as law_update
from runout.physics.plastic import step_small as law_update_small
from runout.physics.substeps import inverse_deformation, present_gradient
from runout.physics.tensors import real, sym, vec

LEFT = 64  # added to the cell of a slot whose particle leaves the block
STAYS = 13  # move code of a particle that stays in its cell
HERE = 13  # as destination: the block itself
OUTSIDE = 32  # added to a destination out of the domain
ONE_MATERIAL = True
SEVERAL = False  # whether transfers may have several substeps (substep.py)
LASTS = False  # whether it goes on after this one
WET = False  # whether particles have pore pressure
CHANGES = False  # whether columns of nodes change their velocity here (column_drag.py)
stays = constant([float(STAYS)] * 16)
halves = constant([0.5] * 16)


def _gradient(t, p, s):
    """Velocity gradient times the step [1] from first moments, s = 4 dt / h [s/m]."""
    x, y, z = _moments(t, p)
    L = velocity_gradient(x, y, z, s)
    if SEVERAL:
        way = _way_before(t, p, s) if LASTS else _way_gradient(t, p, s)
        return present_gradient(L, inverse_deformation(way))
    return L


def _strain(t, p):
    return sym(t[16, p], t[17, p], t[18, p], t[19, p], t[20, p], t[21, p])


def _pack(t, p, tau, s):
    """Next momentum and A of a column that has moved, from its velocity, first moments and stress."""
    m = t[0, p]
    x, y, z = _moments(t, p)
    a = affine_columns(m, x, y, z)
    f = stress_columns(tau, t[23, p], s)
    ax = vec(a[0] + f[0], a[1] + f[1], a[2] + f[2])
    ay = vec(a[3] + f[3], a[4] + f[4], a[5] + f[5])
    az = vec(a[6] + f[6], a[7] + f[7], a[8] + f[8])
    here = vec(m * t[1, p], m * t[2, p], m * t[3, p])
    to_node = vec(real(1.0) - t[4, p], real(1.0) - t[8, p], real(1.0) - t[12, p])
    t[1, p], t[2, p], t[3, p] = momentum_at(here, ax, ay, az, to_node)
    t[5, p], t[6, p], t[7, p] = ax
    t[9, p], t[10, p], t[11, p] = ay
    t[13, p], t[14, p], t[15, p] = az


def _move(t, p, cells):
    """Advance a column by its velocity; ``cells`` = dt / h [s/m]. Returns longest move, whether it is refused, and move code."""
    v = _rows(t, p, 1)
    if SEVERAL:
        v = vec(v[0] + t[SUMS + 1, p], v[1] + t[SUMS + 2, p], v[2] + t[SUMS + 3, p])
    x = cells[0] * v[0]
    y = cells[1] * v[1]
    z = cells[2] * v[2]
    fx = t[4, p] + x
    fy = t[8, p] + y
    fz = t[12, p] + z
    sx = whole(fx - real(0.5))
    sy = whole(fy - real(0.5))
    sz = whole(fz - real(0.5))
    t[4, p] = fx - sx
    t[8, p] = fy - sy
    t[12, p] = fz - sz
    x = abs(x)
    y = abs(y)
    z = abs(z)
    far = x if x > y else y
    far = far if far > z else z
    refused = real(0.0) if (x < real(1.0)) & (y < real(1.0)) & (z < real(1.0)) else real(1.0)
    code = real(9.0) * sx + real(3.0) * sy + sz + real(13.0)
    return far, refused, code


def _leave_grid(t, p, alive, tau, s, cells):
    """Move a column and pack its next record."""
    nothing = real(0.0)
    far, refused, code = _move(t, p, cells)
    speed2 = t[1, p] * t[1, p] + t[2, p] * t[2, p] + t[3, p] * t[3, p]
    t[SPEED, p] = speed2 if alive else nothing
    t[MOVE, p] = far if alive else nothing
    t[REFUSED, p] = refused if alive else nothing
    t[CODE, p] = code
    _pack(t, p, tau, s)


def _finish(t, p, alive, B, history, lost, tau, s, cells):
    """Write the state of a column and what it hands on; a column without a particle adds 0 to all sums."""
    if LASTS:
        _stay_on_grid(t, p, tau, s)
    else:
        _leave_grid(t, p, alive, tau, s, cells)
    t[LOST, p] = lost * t[23, p] if alive else real(0.0)
    t[16, p] = B[0]
    t[17, p] = B[1]
    t[18, p] = B[2]
    t[19, p] = B[3]
    t[20, p] = B[4]
    t[21, p] = B[5]
    t[22, p] = history


def _follow_tile(t, particle_index, label, first, count, mats, s, cells):
    """Law, motion and next record of a tile, for small strain; columns with large strain are marked LARGE."""
    mat = mats[0]
    for p in range((count + np.uint64(15)) & ~np.uint64(15)):
        alive = p < count
        t[ALIVE, p] = real(1.0) if alive else real(0.0)
        if not ONE_MATERIAL:
            mat = mats[np.int64(t[RELEASES, p])] if WET else mats[label[particle_index[first + p], 0]]
        if WET:
            B, log, history, lost, size = law_update_small(_strain(t, p), _gradient(t, p, s), t[22, p], mat, t[EFFECTIVE, p])
        else:
            B, log, history, lost, size = law_update_small(_strain(t, p), _gradient(t, p, s), t[22, p], mat)
        t[LARGE, p] = real(0.0) if is_small(size) else t[ALIVE, p]
        _finish(t, p, alive, B, history, lost, kirchhoff_stress(log, mat), s, cells)


def _follow_large(t, r, state, p, mat, s, cells):
    """The same for one particle of any strain, from its record ``r`` and its state before the law."""
    r = _about_particles((r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], r[10], r[11], r[12], r[13], r[14], r[15]))
    for k in range(16):
        t[k, p] = r[k]
    for k in range(8):
        t[16 + k, p] = state[k]
    if WET:
        B, log, history, lost = law_update(_strain(t, p), _gradient(t, p, s), t[22, p], mat, t[EFFECTIVE, p])
    else:
        B, log, history, lost = law_update(_strain(t, p), _gradient(t, p, s), t[22, p], mat)
    _finish(t, p, True, B, history, lost, kirchhoff_stress(log, mat), s, cells)


def _follow_all_large(t, rec, slot, state, place, particles, first, groups, mats, s, cells):
    """Apply the law for any strain to the columns that are marked LARGE, from records from ``slot`` and states from ``place`` on.

    Their labels are those of the slots from ``first`` on.
    """
    particle_index, label = particles.particle_index, particles.label
    for g in range(groups):
        bits = lane_bits(load16(t, LARGE * TILE + 16 * g) > halves(t))
        while bits != np.uint64(0):
            column = np.int64(lowest_bit(bits)) + 16 * g
            bits = bits & (bits - np.uint64(1))
            mat = mats[label[particle_index[first + column], 0]]
            _follow_large(t, rec[slot + column], state[place + column], np.uint64(column), mat, s, cells)


def _destination(rec, cell, slot, code, b, bxyz, at_rim, domain):
    """Where a particle goes: neighbour 0 to 26, OUTSIDE more if that is out of the domain, and its cell there."""
    c = np.int64(cell[slot])
    x = (c >> 4) + code // 9 - 1
    y = ((c >> 2) & 3) + (code // 3) % 3 - 1
    z = (c & 3) + code % 3 - 1
    q = ((x >> 2) + 1) * 9 + ((y >> 2) + 1) * 3 + (z >> 2) + 1
    if at_rim and not _lies_in_domain(bxyz, b, (x, y), rec, slot, domain):
        q += OUTSIDE
    return q, ((x & 3) << 4) | ((y & 3) << 2) | (z & 3)


def _note_moves(t, particles, blocks, b, p, g, at_rim, domain, last, counts):
    """Set the new cells of the particles of a group of lanes, and list those that change theirs.

    An entry of the list is slot - first << 12 | neighbour << 6 | cell for a particle that leaves the block, from ``first`` on,
    and slot - first << 12 | old cell << 6 | cell for the others, from ``last`` down. ``counts`` are those that leave, those that
    change their cell, and bits: bit q is set if a particle moves to destination q. Returns the new counts.
    """
    rec, cell, listed, first = particles.rec, particles.cell, particles.listed, blocks.first[b]
    leaving, shifted, changed = counts
    bits = lane_bits(load16(t, CODE * TILE + 16 * g) != stays(t))
    if at_rim:
        bits = np.uint64(0xFFFF)
    bits = bits & lane_bits(load16(t, ALIVE * TILE + 16 * g) > halves(t))
    while bits != np.uint64(0):
        lane = lowest_bit(bits)
        bits = bits & (bits - np.uint64(1))
        column = np.int64(lane) + 16 * g
        slot = p + column
        q, to = _destination(rec, cell, slot, np.int64(t[CODE, column]), b, blocks.bxyz, at_rim, domain)
        c = np.int64(cell[slot])
        if q != HERE:
            changed = changed | (np.int64(1) << q)
            cell[slot] = LEFT + c
            listed[first + leaving] = ((slot - first) << 12) | (q << 6) | to
            leaving += 1
        elif to != c:
            changed = changed | (np.int64(1) << HERE)
            cell[slot] = to
            listed[last - shifted] = ((slot - first) << 12) | (c << 6) | to
            shifted += 1
    return leaving, shifted, changed


def _gather_block(particles, held, f, nodes, rec2, state2, labels, cell2, row):
    """Copy the particles of a block into a buffer, sorted by cell; the records hold velocities and first moments there."""
    rec, state, order = particles.rec, particles.state, particles.order
    particle_index, cell = particles.particle_index, particles.cell
    ready = local_weights(rec)
    if WET:
        _sort_pores(particles.pores, order, f, held, row)
    _weigh(rec, np.uint64(order[f]) * np.uint64(16), ready, _place_of(np.uint64(0)))
    for t in range(np.uint64(held)):
        p = np.uint64(order[f + t])
        later = np.uint64(order[f + t + np.uint64(AHEAD)])
        prefetch(rec, later * np.uint64(16))
        prefetch(state, later * np.uint64(8))
        _weigh(rec, np.uint64(order[f + t + np.uint64(1)]) * np.uint64(16), ready, _place_of(t + np.uint64(1)))
        c = cell[p]
        rows = _load_rows(nodes, _first_node(np.uint64(c)))
        store(rec2, t * np.uint64(16), _gather(rec, p * np.uint64(16), ready, _place_of(t), rows))
        store(state2, t * np.uint64(8), load8(state, p * np.uint64(8)))
        labels[t] = particle_index[p]
        cell2[t] = c
        order[f + t] = f + t
    for t in range(np.uint64(held)):
        particle_index[f + t] = labels[t]
        cell[f + t] = cell2[t]


def _gather_again(particles, f, count, nodes, records, k):
    """Gather the records of a tile, which lie in the order of cells already, into a buffer from place ``k`` on.

    If the transfer goes on, their sums go on too.
    """
    rec, state, cell = particles.rec, particles.state, particles.cell
    ready = local_weights(rec)
    _weigh(rec, f * np.uint64(16), ready, _place_of(f))
    for p in range(f, f + count):
        prefetch(rec, (p + np.uint64(AHEAD)) * np.uint64(16))
        prefetch(state, (p + np.uint64(AHEAD)) * np.uint64(8))
        _weigh(rec, (p + np.uint64(1)) * np.uint64(16), ready, _place_of(p + np.uint64(1)))
        rows = _load_rows(nodes, _first_node(np.uint64(cell[p])))
        seen = _gather(rec, p * np.uint64(16), ready, _place_of(p), rows)
        store(records, (p - f + k) * np.uint64(16), seen)
        if LASTS:
            before = load16(rec, p * np.uint64(16))
            store(rec, p * np.uint64(16), heads_and_tails(before, before + seen))


def _expect_list(order, particle_index, blocks, b):
    """Prefetch the list and the labels of the next block with particles."""
    first, held = blocks.first, blocks.held
    later = _next_filled(held, b, blocks.nown)
    if later < blocks.nown:
        for t in range(0, held[later] + 15, 16):
            prefetch(order, first[later] + t)
            prefetch(particle_index, first[later] + t)


def _expect_next(rec, state, order, blocks, b, nodes):
    """Prefetch the nodes and the first particles of the next block with particles; its own loop prefetches the later ones."""
    first, held = blocks.first, blocks.held
    later = _next_filled(held, b, blocks.nown)
    if later == blocks.nown:
        return
    for t in range(first[later], first[later] + min(held[later], AHEAD)):
        prefetch(rec, 16 * np.int64(order[t]))
        prefetch(state, 8 * np.int64(order[t]))
    _expect_nodes(nodes, blocks.up, later, EVERY)


def _total_motion(motion, changed, nown):
    """Largest speed squared, longest move, dissipated energy, refused moves, and whether any particle changed its cell.

    A move that is not a number counts as refused, so that the other numbers are sound if none is.
    """
    speed = 0.0
    move = 0.0
    lost = 0.0
    refused = 0.0
    moved = False
    for b in range(nown):
        speed = max(speed, motion[b, 0])
        move = max(move, motion[b, 1])
        lost += motion[b, 2]
        refused += motion[b, 3]
        moved = moved or changed[b] != 0
    return speed, move, lost, refused, moved


def grid_to_particles(particles, blocks, cuts, reached, nodes, columns, moves, domain, step, buffers, alone):
    """One step of all particles; afterwards the particles of a block lie in the order of the cells in which they started.

    ``nodes`` (nall, 256) hold the new velocities, but for the changes of the ``columns``. ``alone``: this is the only substep of
    the transfer, so that no sums lie in the records. Fills ``moves`` and lists the particles that change their cell. Returns sums.
    """
    rec, state, particle_index, label = particles.rec, particles.state, particles.particle_index, particles.label
    mats, s, cells = step.mats, step.slopes, step.cells
    leaving = moves.leaving
    shifted = moves.shifted
    changed = moves.changed
    motion = moves.motion
    for thread in prange(len(cuts) - 1):
        records, states = buffers.rec[thread], buffers.state[thread]
        labels, of_cell = buffers.particle_index[thread], buffers.cell[thread]
        around = local_nodes(rec)
        t = local_tile(rec)
        for b in range(np.uint64(cuts[thread]), np.uint64(cuts[thread + 1])):
            leaving[b] = shifted[b] = changed[b] = 0
            for k in range(4):
                motion[b, k] = 0.0
            held = blocks.held[b]
            if held == 0:
                continue
            _load_nodes(around, nodes, blocks.up, b, reached[b])
            if CHANGES:
                _add_changes(around, columns, blocks.up, b, reached[b])
            f = blocks.first[b]
            _expect_list(particles.order, particle_index, blocks, b)
            if alone:
                _gather_block(particles, held, np.uint64(f), around, records, states, labels, of_cell, buffers.pores[thread])
            _expect_next(rec, state, particles.order, blocks, b, nodes)
            speed = move = lost = refused = zeros(rec)
            counts = np.int64(0), np.int64(0), np.int64(0)
            for k in range(0, held, TILE):
                count = min(TILE, held - k)
                groups = (count + 15) >> 4
                if alone:
                    _load_tile(t, records, k, states, k, groups)
                    if SEVERAL:
                        _clear_sums(t, groups)
                else:
                    _gather_again(particles, np.uint64(f + k), np.uint64(count), around, records, np.uint64(k))
                    _load_tile(t, records, k, state, f + k, groups)
                    _load_sums(t, rec, f + k, groups)
                if WET:
                    _drain_tile(t, particles, step.pores, np.int64(b), f + k, count)
                _follow_tile(t, particle_index, label, np.uint64(f + k), np.uint64(count), mats, s, cells)
                before, place = (states, k) if alone else (state, f + k)
                _follow_all_large(t, records, k, before, place, particles, f + k, groups, mats, s, cells)
                _store_tile(t, rec, f + k, state, f + k, groups)
                for g in range(groups):
                    speed = largest(speed, load16(t, SPEED * TILE + 16 * g))
                    move = largest(move, load16(t, MOVE * TILE + 16 * g))
                    lost = lost + load16(t, LOST * TILE + 16 * g)
                    refused = refused + load16(t, REFUSED * TILE + 16 * g)
                    counts = _note_moves(t, particles, blocks, b, f + k, g, moves.rim[b], domain, f + held - 1, counts)
            leaving[b], shifted[b], changed[b] = counts
            motion[b, 0] = lane_largest(speed)
            motion[b, 1] = lane_largest(move)
            motion[b, 2] = lane_sum(lost)
            motion[b, 3] = lane_sum(refused)
    return _total_motion(motion, changed, blocks.nown)
