"""Grid to particles: velocities, the law, the next record, motion, and the cell that each particle moves to.

    home[b]     particles first ... last in memory that were in block b at the last sort
    tile        8 x 8 x 8 nodes in shared memory, from one node below block b to three above; [x][y][z], rows 74 and 9 apart
    record      24 rows, one column a particle: read, replaced
    key         64 block + cell, replaced; ends counts the particles that enter each cell

Particles are taken in the order of memory, not by cell: they have moved at most one cell out of their block since the last sort.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.deform import _deform, _slopes
from runout.backends.hash.gradients import _deform_by_rates, _load_given
from runout.backends.hash.groups import BlockGroup, Constants, GridGroup, ParticleGroup, SceneGroup, StatusGroup
from runout.backends.hash.layout import (
    ACTIVE,
    CURSOR,
    FAILED,
    GONE,
    GRADIENT_TRANSFER,
    GROW,
    HALT,
    HOMES,
    KEPT,
    LEFT_INDEX,
    MASS,
    NEXT,
    NOT_NEGATIVE,
    OFFSET,
    PENDING,
    PLACES,
    STEPS,
    STRAIN,
    TOUCHED,
    UNSTABLE,
    WARP,
    WIDE_TILE,
    WIDE_X,
    WIDE_Y,
    Materials,
    Rows,
    Table2,
    Vector,
    lane_count,
    node4,
)
from runout.backends.hash.stencil import _cell_entry, _load_wide
from runout.physics.blocks import local_index
from runout.physics.contact import reach
from runout.physics.tensors import dot, real, vec

SECTOR = 8  # numbers that memory moves at once: where a block of threads begins
count_in: Any = None  # adds one to a count; the binding puts it in its place
raise_peak: Any = None  # brings a largest value up to one of a warp
max_lanes: Any = None  # the largest of the lanes' numbers, likewise
sum_lanes: Any = None  # sum over the lanes of a warp
book: Any = None  # adds to a number that no other thread adds to
prefetch: Any = None  # prefetches a place in memory


def begin_step(status: StatusGroup, scenes: SceneGroup, constants: Constants):
    """Open a step, unless the last one asked to halt; a thread a scene. A scene without steps left has time step 0.

    ``counts`` are the steps of each scene so far, with this one.

    Row of the clock: time step [s], change of velocity by gravity [m/s], distance beyond which no particle is in contact [m]; and
    what the transfer does, see :func:`runout.backends.hash.scenes.choices`.
    """
    s = wp.tid()
    if status.flags[HALT] == GROW:
        return
    if status.flags[PENDING] != 0:
        if s == 0:
            status.flags[HALT] = status.flags[PENDING]
        return
    if s == 0:
        status.flags[STEPS] = status.flags[STEPS] + 1
        status.tally[ACTIVE] = status.tally[NEXT]
        status.tally[CURSOR] = 0
        status.tally[NEXT] = 0
        status.tally[TOUCHED] = 0
    scenes.clock[s, 0] = real(0.0)
    if scenes.left[s] > 0:
        scenes.left[s] = scenes.left[s] - 1
        scenes.step_counts[s] = scenes.step_counts[s] + 1
        scenes.clock[s, 0] = scenes.steps[s]
        scenes.clock[s, 4] = reach(constants.largest, wp.sqrt(status.peaks[s]), scenes.steps[s], constants.band)
        status.peaks[s] = real(0.0)
        status.contacts[s] = 0


def _inside(node: int, f: Any, last: int, limit: wp.float64):
    """Whether a coordinate lies in the domain, 0 <= node + f <= limit [cells]; surely so from node 0 to ``last``."""
    if node >= 0 and node <= last:
        return True
    q = wp.float64(node) + wp.float64(f)
    return q >= wp.float64(0.0) and q <= limit


def _place_around(x: int, y: int, z: int):
    """Which of the 27 blocks around a home holds cell (x, y, z), -1 to 4."""
    return (((x + 4) >> 2) * 9 + ((y + 4) >> 2) * 3 + ((z + 4) >> 2)) & 31


def _next_cell(
    blocks: BlockGroup, f: Vector, x: int, y: int, z: int, k: int, b: int, bx: int, by: int, shift: int, limit_x: wp.float64,
    limit_y: wp.float64,
):  # fmt: skip
    """Cell of a particle that has moved to offset ``f`` from cell (x, y, z) of block ``b``, its home, or of those around.

    -1: more than one cell out of its home, or no block there; -2 - k: outside the domain.
    """
    sx = wp.floor(f[0] - real(0.5))
    sy = wp.floor(f[1] - real(0.5))
    sz = wp.floor(f[2] - real(0.5))
    i = x + int(sx)
    j = y + int(sy)
    n = z + int(sz)
    new = int(-1)
    if wp.min(i, wp.min(j, n)) >= -1 and wp.max(i, wp.max(j, n)) <= 4:
        place = _place_around(i, j, n)
        to = k >> 6
        if place != _place_around(x, y, z):  # seldom: no warp waits for memory otherwise
            to = blocks.around[b, place]
            if to >= 0:
                to = wp.where(blocks.up[to & NOT_NEGATIVE, 0] < 0, -1, to)
        if to >= 0:
            new = to * 64 + local_index(i, j, n)
    inside = _inside(4 * bx + i, f[0] - sx, int(limit_x) - 2, limit_x)
    if not (inside and _inside(4 * by - shift + j, f[1] - sy, int(limit_y) - 2, limit_y)):
        new = -2 - k
    return new


def _cell_from_home(k: int, b: int, bx: int, by: int, bz: int, coordinates: Table2):
    """Place of cell ``k``, counted from the first of block ``b`` at (bx, by, bz)."""
    i = (k >> 4) & 3
    j = (k >> 2) & 3
    n = k & 3
    if (k >> 6) != b:
        i += 4 * (coordinates[k >> 6, 0] - bx)
        j += 4 * (coordinates[k >> 6, 1] - by)
        n += 4 * (coordinates[k >> 6, 2] - bz)
    return i, j, n


def _in_cell(f: Any):
    """Offset in the cell that holds it."""
    return f - wp.floor(f - real(0.5))


def _rates(dt: Any, h: Vector):
    """Cells that a particle moves in a step at unit velocity [s/m]."""
    return vec(dt / h[0], dt / h[1], dt / h[2])


def _write_place(rec: Rows, p: int, f: Vector, new: int):
    """Offset of a particle from its cell, or from the one that it keeps."""
    for d in range(3):
        g = f[d]
        if new >= 0:
            g = _in_cell(f[d])
        rec[OFFSET + d, p] = g


def _keep(status: StatusGroup, new: int, k: int):
    """New key of a particle; sets the LEFT_INDEX flag if it is in no cell of the index."""
    if new == k:
        return k
    if new == -1 and k >= 0:
        wp.atomic_max(status.flags, PENDING, LEFT_INDEX)
        return k
    if new < -1:
        wp.atomic_add(status.tally, GONE, 1)
    return new


def _prefetch(rec: Rows, p: int, lane: int, last: int):
    """Prefetch what will be read of the 32 particles from place ``p`` on: four sectors of twelve rows, by the lanes of a warp."""
    for turn in range(2):
        t = turn * 32 + (lane & 31)
        n = t >> 2
        row = wp.where(n < 4, n + OFFSET - 1, n + STRAIN - 4)
        place = p + (t & 3) * SECTOR
        if n < 12 and place < last:
            prefetch(rec, wp.where(n == 0, MASS, row), place)


def _is_sound(status: StatusGroup, moves: Vector, scene: int, worst: int):
    """Whether a particle moves less than a cell; otherwise sets the UNSTABLE flag."""
    far = wp.max(wp.abs(moves[0]), wp.max(wp.abs(moves[1]), wp.abs(moves[2])))
    if far < real(1.0) and wp.isfinite(moves[0] + moves[1] + moves[2]):
        return True
    wp.atomic_max(status.flags, PENDING, UNSTABLE)
    status.flags[FAILED] = scene
    wp.atomic_max(status.peaks, worst, wp.where(wp.isfinite(far), far, real(wp.inf)))
    return False


def grid_to_particles(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, scenes: SceneGroup,
    constants: Constants, mats: Materials, launched: int,
):  # fmt: skip
    """Velocity, law, motion and next record of each particle; its new cell, and the count of the particles of each cell.

    A block of threads takes the particles that were in one block at the last sort. A particle more than one cell outside of that
    block, without a block, or outside the domain keeps its cell until the next sort, with an offset beyond it.
    """
    begin, lane = wp.tid()
    if status.flags[HALT] != 0:
        return
    for a in range(begin, status.tally[HOMES], launched):
        b = blocks.homes[a] & NOT_NEGATIVE
        first = int(blocks.home[b, 0]) // SECTOR * SECTOR
        last = int(blocks.home[b, 1])
        _prefetch(particles.rec, first + lane - (lane & 31), lane, last)
        scene = blocks.member[b] & NOT_NEGATIVE
        dt = scenes.clock[scene, 0]
        wp.tile_zeros(shape=1, dtype=int, storage="shared")  # waits for lanes still at the last block
        tile = wp.tile_empty(shape=WIDE_TILE, dtype=node4, storage="shared")
        _load_wide(tile, grid.nodes, blocks.around, b, lane)
        slopes = _slopes(dt, constants.h)
        if GRADIENT_TRANSFER:
            seen = wp.tile_zeros(shape=WIDE_TILE, dtype=node4, storage="shared")
            _load_given(seen, grid.nodes, blocks.around, b, lane, scenes.clock[scene, KEPT])
        rates = _rates(dt, constants.h)
        bx, by, bz = int(blocks.coordinates[b, 0]), int(blocks.coordinates[b, 1]), int(blocks.coordinates[b, 2])
        move_y = int(scenes.shift[scene])
        limit_x = scenes.limits[scene, 0] * wp.float64(1.0)  # a product: read once, here
        limit_y = scenes.limits[scene, 1] * wp.float64(1.0)
        begins = int(blocks.home[b, 0])
        fastest = real(0.0)
        lost = wp.float64(0.0)
        next_key = int(particles.key[wp.min(first + lane, last - 1) & NOT_NEGATIVE])
        for place in range(first + lane, last, lane_count()):
            p = place & NOT_NEGATIVE
            k = int(next_key)
            next_key = particles.key[wp.min(p + lane_count(), last - 1) & NOT_NEGATIVE]
            _prefetch(particles.rec, p + lane_count() - (lane & 31), lane, last)
            if p >= begins:
                new = int(k)
                if k >= 0 and dt > real(0.0):
                    i, j, n = _cell_from_home(k, b, bx, by, bz, blocks.coordinates)
                    mat = mats[int(particles.release[p])]
                    corner = ((i + 1) * WIDE_X + (j + 1) * WIDE_Y + n + 1) & PLACES
                    if GRADIENT_TRANSFER:
                        f, v, own, work = _deform_by_rates(particles, scenes, constants, p, tile, seen, corner, mat, rates, scene)
                        fastest = wp.max(fastest, dot(own, own))
                    else:
                        f, v, work = _deform(particles.rec, p, tile, corner, mat, slopes)
                        fastest = wp.max(fastest, dot(v, v))
                    lost += wp.float64(work)
                    moves = vec(rates[0] * v[0], rates[1] * v[1], rates[2] * v[2])
                    if _is_sound(status, moves, scene, scenes.shift.shape[0]):
                        f = f + moves
                        new = _next_cell(blocks, f, i, j, n, k, b, bx, by, move_y, limit_x, limit_y)
                        _write_place(particles.rec, p, f, new)
                new = _keep(status, new, k)
                if new != k:
                    particles.key[p] = new
                if new >= 0:
                    count_in(blocks.ends, _cell_entry(new))
        if dt > real(0.0):
            raise_peak(status.peaks, scene, max_lanes(fastest))
            all_lost = sum_lanes(lost)
            if lane % WARP == 0:  # no warp waits for the other
                book(grid.booked, b, 5 * (lane // WARP), all_lost)
