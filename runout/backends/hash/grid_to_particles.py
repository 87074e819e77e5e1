"""Grid to particles: velocities, the law, the next record, motion, and the cell that each particle moves to.

    homes[a]    block b, and particles first ... last in memory that were in it at the last sort: all of them, or a piece
    tile        8 x 8 x 8 nodes in shared memory, from one node below block b to three above; [x][y][z], rows 74 and 9 apart
    record      24 rows, one column a particle: read, replaced
    key         64 block + cell, replaced; ends counts the particles that enter each cell

Particles are taken in the order of memory, not by cell: they have moved at most one cell out of their block since the last sort.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.deform import _deform, _deform_on_way, _slopes
from runout.backends.hash.groups import BlockGroup, Constants, GridGroup, Home, ParticleGroup, PoreGroup, SceneGroup, StatusGroup
from runout.backends.hash.layout import (
    CELL_LANES,
    FAILED,
    GONE,
    HALT,
    HOMES,
    LEFT_INDEX,
    NOT_NEGATIVE,
    OFFSET,
    PENDING,
    PLACES,
    SECTOR,
    SUBSTEPPED,
    UNSTABLE,
    VELOCITIES,
    WARP,
    WAYS,
    WIDE_TILE,
    WIDE_X,
    WIDE_Y,
    Materials,
    Rows,
    Table2,
    Tile,
    Vector,
    lane_count,
    node4,
)
from runout.backends.hash.pore_pressure import _drained
from runout.backends.hash.shared_memory import ROOM
from runout.backends.hash.stencil import _cell_entry, _load_wide
from runout.physics.blocks import local_index
from runout.physics.tensors import dot, real, vec

count_in: Any = None  # adds one to a count; the binding puts it in its place
raise_peak: Any = None  # brings a largest value up to one of a warp
max_lanes: Any = None  # the largest of the lanes' numbers, likewise
sum_lanes: Any = None  # sum over the lanes of a warp
book: Any = None  # adds to a number that no other thread adds to
arrive: Any = None  # waits for copies to shared memory
meet: Any = None  # the lanes of a block wait for each other
stage: Any = None  # begins to copy what is needed of a record to shared memory
come: Any = None  # a lane waits for its own copies


def _inside(node: int, f: Any, last: int, limit: wp.float64):
    """Whether a coordinate lies in the domain, 0 <= node + f <= limit [cells]; surely so from node 0 to ``last``."""
    if node >= 0 and node <= last:
        return True
    q = wp.float64(node) + wp.float64(f)
    return q >= wp.float64(0.0) and q <= limit


def _place_around(x: int, y: int, z: int):
    """Which of the 27 blocks around a home holds cell (x, y, z), -1 to 4."""
    return (((x + 4) >> 2) * 9 + ((y + 4) >> 2) * 3 + ((z + 4) >> 2)) & 31


def _home(blocks: BlockGroup, scenes: SceneGroup, b: int, scene: int):
    """Block ``b`` of a scene as the home of particles; products, so that all is read once, here."""
    home = Home()
    home.block = b
    home.scene = scene
    home.x = blocks.coordinates[b, 0]
    home.y = blocks.coordinates[b, 1]
    home.z = blocks.coordinates[b, 2]
    home.shift = scenes.shift[scene]
    home.limit_x = scenes.limits[scene, 0] * wp.float64(1.0)
    home.limit_y = scenes.limits[scene, 1] * wp.float64(1.0)
    return home


def _next_cell(blocks: BlockGroup, home: Home, f: Vector, x: int, y: int, z: int, k: int):
    """Cell of a particle that has moved to offset ``f`` from cell (x, y, z) of its home, or of the blocks around.

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
            to = blocks.around[home.block, place]
            if to >= 0:
                to = wp.where(blocks.up[to & NOT_NEGATIVE, 0] < 0, -1, to)
        if to >= 0:
            new = to * 64 + local_index(i, j, n)
    inside = _inside(4 * home.x + i, f[0] - sx, int(home.limit_x) - 2, home.limit_x)
    if not (inside and _inside(4 * home.y - home.shift + j, f[1] - sy, int(home.limit_y) - 2, home.limit_y)):
        new = -2 - k
    return new


def _cell_from_home(home: Home, k: int, coordinates: Table2):
    """Place of cell ``k``, counted from the first of a home."""
    i = (k >> 4) & 3
    j = (k >> 2) & 3
    n = k & 3
    if (k >> 6) != home.block:
        i += 4 * (coordinates[k >> 6, 0] - home.x)
        j += 4 * (coordinates[k >> 6, 1] - home.y)
        n += 4 * (coordinates[k >> 6, 2] - home.z)
    return wp.vec3i(i, j, n)


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


def _enter_cell(status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, p: int, new: int, k: int):
    """Store the new key of a particle, and count it in the cell that it enters or keeps."""
    kept = _keep(status, new, k)
    if kept != k:
        particles.key[p] = kept
    if kept >= 0:
        count_in(blocks.ends, _cell_entry(kept))


def _is_sound(status: StatusGroup, moves: Vector, scene: int):
    """Whether a particle moves less than a cell; otherwise sets the UNSTABLE flag."""
    far = wp.max(wp.abs(moves[0]), wp.max(wp.abs(moves[1]), wp.abs(moves[2])))
    if far < real(1.0) and wp.isfinite(moves[0] + moves[1] + moves[2]):
        return True
    wp.atomic_max(status.flags, PENDING, UNSTABLE)
    status.flags[FAILED] = scene
    wp.atomic_max(status.peaks, status.peaks.shape[0] - 1, wp.where(wp.isfinite(far), far, real(wp.inf)))
    return False


def _release_at(particles: ParticleGroup, constants: Constants, p: int):
    """Release of the particle at a place; it is read only where there are several."""
    release = constants.only
    if release < 0:
        release = int(particles.release[p])
    return release


def _deform_by_two(
    particles: ParticleGroup, scenes: SceneGroup, constants: Constants, p: int, room: Tile, staged: int, tile: Tile, ways: Tile,
    corner: int, mat: Any, slopes: Any, scene: int, effective: Any,
):  # fmt: skip
    """As ``_deform`` after several substeps; returns the velocity that moves a particle in a substep, and then its own."""
    of_way = _slopes(real(1.0), constants.h)
    f, own, way, work = _deform_on_way(particles.rec, p, room, staged, tile, ways, corner, mat, slopes, of_way, effective)
    return f, own + way / scenes.clock[scene, 0], own, work


def _moved(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, home: Home, p: int, f: Vector, moves: Vector, cell: wp.vec3i,
    k: int,
):  # fmt: skip
    """Move a particle from offset ``f`` in a cell, counted from its home; returns its new cell."""
    new = int(k)
    if _is_sound(status, moves, home.scene):
        new = _next_cell(blocks, home, f + moves, cell[0], cell[1], cell[2], k)
        _write_place(particles.rec, p, f + moves, new)
    return new


def _book(status: StatusGroup, grid: GridGroup, home: Home, lane: int, fastest: Any, lost: wp.float64):
    """Book the largest squared speed of a warp's particles and the energy that they have lost."""
    raise_peak(status.peaks, home.scene, max_lanes(fastest))
    all_lost = sum_lanes(lost)
    if lane % WARP == 0:  # no warp waits for the other
        book(grid.booked, home.block, 5 * (lane // WARP), all_lost)


def grid_to_particles(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, scenes: SceneGroup,
    constants: Constants, mats: Materials, pores: PoreGroup, launched: int,
):  # fmt: skip
    """Velocity, law, motion and next record of each particle; its new cell, and the count of the particles of each cell.

    Records are copied to shared memory while a block of threads works on the particles before. A particle more than one cell out
    of its home, without a block, or outside the domain keeps its cell until the next sort, with an offset beyond it.
    """
    begin, lane = wp.tid()
    if status.flags[HALT] != 0:
        return
    for a in range(begin, status.tally[HOMES], launched):
        b = blocks.homes[a, 0] & NOT_NEGATIVE
        begins = int(blocks.homes[a, 1])
        last = int(blocks.homes[a, 2])
        first = begins // SECTOR * SECTOR + lane
        ahead = int(wp.min(first, last - 1) & NOT_NEGATIVE)
        meet()  # lanes still at the piece before
        tile = wp.tile_empty(shape=WIDE_TILE, dtype=node4, storage="shared")
        _load_wide(tile, grid.nodes, blocks.around, b, lane, VELOCITIES)
        room = wp.tile_empty(shape=ROOM, dtype=real, storage="shared")
        stage(room, particles.rec, ahead, lane, CELL_LANES, 0)
        scene = blocks.member[b] & NOT_NEGATIVE
        dt = scenes.clock[scene, 0]
        slopes = _slopes(dt, constants.h)
        if SUBSTEPPED:
            ways = wp.tile_empty(shape=WIDE_TILE, dtype=node4, storage="shared")
            _load_wide(ways, grid.nodes, blocks.around, b, lane, WAYS)
        rates = _rates(dt, constants.h)
        home = _home(blocks, scenes, b, scene)
        fastest, lost = real(0.0), wp.float64(0.0)
        key_ahead = int(particles.key[ahead])
        release_ahead = int(_release_at(particles, constants, ahead))
        turn = int(0)
        arrive()
        for place in range(first, last, lane_count()):
            p = place & NOT_NEGATIVE
            k, release = int(key_ahead), int(release_ahead)
            ahead = wp.min(p + lane_count(), last - 1) & NOT_NEGATIVE
            key_ahead = particles.key[ahead]
            release_ahead = _release_at(particles, constants, ahead)
            come()
            staged = (turn & 1) * (ROOM // 2) + lane
            turn += 1
            if p + lane_count() < last:
                stage(room, particles.rec, ahead, (turn & 1) * (ROOM // 2) + lane, CELL_LANES, 0)
            if p >= begins:
                new = int(k)
                if k >= 0 and dt > real(0.0):
                    cell = _cell_from_home(home, k, blocks.coordinates)
                    mat = mats[release]
                    corner = ((cell[0] + 1) * WIDE_X + (cell[1] + 1) * WIDE_Y + cell[2] + 1) & PLACES
                    effective = _drained(particles, pores, p, k, dt)
                    if SUBSTEPPED:
                        f, v, own, work = _deform_by_two(
                            particles, scenes, constants, p, room, staged, tile, ways, corner, mat, slopes, scene, effective
                        )
                        fastest = wp.max(fastest, dot(own, own))
                    else:
                        f, v, work = _deform(particles.rec, p, room, staged, tile, corner, mat, slopes, effective)
                        fastest = wp.max(fastest, dot(v, v))
                    lost += wp.float64(work)
                    moves = vec(rates[0] * v[0], rates[1] * v[1], rates[2] * v[2])
                    new = _moved(status, particles, blocks, home, p, f, moves, cell, k)
                _enter_cell(status, particles, blocks, p, new, k)
        if dt > real(0.0):
            _book(status, grid, home, lane, fastest, lost)
