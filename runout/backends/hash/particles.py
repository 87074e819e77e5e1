"""Particles: the law, the motion, the next record, and sums over them."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from runout.backends.hash.index import (
    CONTACTS,
    CURSOR,
    HALT,
    LEFT_INDEX,
    PENDING,
    STEPS,
    UNSTABLE,
    Doubles,
    Doubles2,
    Flags,
    Index,
    Ints,
    Longs,
    Materials,
    Nodes,
    Real,
    Reals,
    Rows,
    Shorts,
    Table,
    Table2,
    Vector,
    Vectors,
    _slot,
    run,
)
from runout.backends.hash.transfer import (
    AFFINE,
    HISTORY,
    MASS,
    MOMENTUM,
    OFFSET,
    PADDED,
    RADIUS,
    ROWS,
    STRAIN,
    VOLUME,
    _first_node,
    _gather,
    _load,
    node4,
)
from runout.model.particles import Particles
from runout.physics.blocks import block_key, local_index
from runout.physics.elastic import energy_density, kirchhoff_stress, log_strain
from runout.physics.elastic import update as law_update
from runout.physics.tensors import real, sym, tens, vec

SUMS = 7  # mass, momentum, kinetic, potential and elastic energy


def begin_step(flags: Flags, peaks: Reals):
    """Open a step, unless the last one asked to halt; one thread."""
    if wp.tid() > 0:
        return
    if flags[PENDING] != 0:
        flags[HALT] = flags[PENDING]
        return
    flags[STEPS] = flags[STEPS] + 1
    flags[CURSOR] = 0
    flags[CONTACTS] = 0
    peaks[0] = real(0.0)


def _strain_of(rec: Rows, p: int):
    return sym(rec[STRAIN, p], rec[STRAIN + 1, p], rec[STRAIN + 2, p], rec[STRAIN + 3, p], rec[STRAIN + 4, p], rec[STRAIN + 5, p])


def _stress_columns(tau: Any, volume: Any, dt: Any, h: Vector):
    """Impulse of the internal force over ``dt`` in the packed columns of a record."""
    x = -dt * real(4.0) / h[0] * volume
    y = -dt * real(4.0) / h[1] * volume
    z = -dt * real(4.0) / h[2] * volume
    return tens(x * tau[0], x * tau[3], x * tau[5], y * tau[3], y * tau[1], y * tau[4], z * tau[5], z * tau[4], z * tau[2])


def change_step(rec: Rows, key: Ints, release: Shorts, mats: Materials, ddt: Real, h: Vector):
    """Repack the records for a time step longer by ``ddt`` [s]."""
    p = wp.tid()
    if key[p] < 0:
        return
    tau = kirchhoff_stress(log_strain(_strain_of(rec, p)), mats[int(release[p])])
    packed = _stress_columns(tau, rec[VOLUME, p], ddt, h)
    for k in range(9):
        rec[AFFINE + k, p] = rec[AFFINE + k, p] + packed[k]


def _deform(rec: Rows, p: int, v: Vector, x: Vector, y: Vector, z: Vector, mat: Any, dt: Any, h: Vector):
    """Law and next record of a particle from what the grid gave it; returns the dissipated energy [J]."""
    m = rec[MASS, p]
    volume = rec[VOLUME, p]
    sx = dt * real(4.0) / h[0]
    sy = dt * real(4.0) / h[1]
    sz = dt * real(4.0) / h[2]
    L = tens(sx * x[0], sy * y[0], sz * z[0], sx * x[1], sy * y[1], sz * z[1], sx * x[2], sy * y[2], sz * z[2])
    B, log, history, lost = law_update(_strain_of(rec, p), L, rec[HISTORY, p], mat)
    packed = _stress_columns(kirchhoff_stress(log, mat), volume, dt, h)
    m4 = real(4.0) * m
    for d in range(3):
        rec[MOMENTUM + d, p] = m * v[d]
        rec[AFFINE + d, p] = m4 * x[d] + packed[d]
        rec[AFFINE + 3 + d, p] = m4 * y[d] + packed[3 + d]
        rec[AFFINE + 6 + d, p] = m4 * z[d] + packed[6 + d]
    for k in range(3):
        rec[STRAIN + k, p] = B[k]
        rec[STRAIN + 3 + k, p] = B[3 + k]
    rec[HISTORY, p] = history
    return lost * volume


def _inside(node: int, f: Any, limit: wp.float64):
    """Whether a coordinate lies in the domain, 0 <= node + f <= limit [cells]."""
    q = wp.float64(node) + wp.float64(f)
    return q >= wp.float64(0.0) and q <= limit


def _move(rec: Rows, p: int, moves: Vector, k: int, coordinates: Table2, up: Table2, table: Table, slots: Ints, limit: Any):
    """Move a particle of cell ``k``; returns its new cell, -1 where there is no block for it, -2 - k outside the domain.

    In the last two cases it keeps its cell, and an offset beyond it, until the index is made anew.
    """
    b = k >> 6
    fx = rec[OFFSET, p] + moves[0]
    fy = rec[OFFSET + 1, p] + moves[1]
    fz = rec[OFFSET + 2, p] + moves[2]
    sx = wp.floor(fx - real(0.5))
    sy = wp.floor(fy - real(0.5))
    sz = wp.floor(fz - real(0.5))
    x = ((k >> 4) & 3) + int(sx)
    y = ((k >> 2) & 3) + int(sy)
    z = (k & 3) + int(sz)
    to = b
    if (x >> 2) != 0 or (y >> 2) != 0 or (z >> 2) != 0:
        to = _slot(
            table, slots, block_key(coordinates[b, 0] + (x >> 2), coordinates[b, 1] + (y >> 2), coordinates[b, 2] + (z >> 2))
        )
        if to >= 0 and up[wp.max(to, 0), 0] < 0:
            to = -1
    inside = _inside(4 * coordinates[b, 0] + x, fx - sx, limit[0]) and _inside(4 * coordinates[b, 1] + y, fy - sy, limit[1])
    new = to * 64 + local_index(x, y, z)
    if to < 0 or not inside:
        sx = real(0.0)
        sy = real(0.0)
        sz = real(0.0)
        new = -1
    if not inside:
        new = -2 - k
    rec[OFFSET, p] = fx - sx
    rec[OFFSET + 1, p] = fy - sy
    rec[OFFSET + 2, p] = fz - sz
    return new


def grid_to_particles(
    rec: Rows, release: Shorts, key: Ints, rank: Ints, order: Ints, cstart: Table2, count: Ints, up: Table2, coordinates: Table2,
    table: Table, slots: Ints, flags: Flags, clock: Reals, grid: Nodes, pushes: Vectors, pushed: int, mats: Materials, h: Vector,
    limit: wp.vec2d, peaks: Reals, booked: Doubles2,
):  # fmt: skip
    """Velocities to particles, law, motion and next record; cells of the particles anew, and how many enter each."""
    b, lane = wp.tid()
    if flags[HALT] != 0 or cstart[b, 0] == cstart[b, 64]:
        return
    tile = wp.tile_zeros(shape=PADDED, dtype=node4, storage="shared")
    _load(tile, grid, pushes, pushed, up, b, lane)
    dt = clock[0]
    fastest = real(0.0)
    lost = wp.float64(0.0)
    for t in range(cstart[b, 0] + lane, cstart[b, 64], wp.block_dim()):
        p = order[t]
        k = key[p]
        v, x, y, z = _gather(rec, p, tile, _first_node(k & 63))
        lost += wp.float64(_deform(rec, p, v, x, y, z, mats[int(release[p])], dt, h))
        fastest = wp.max(fastest, v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        moves = vec(dt * v[0] / h[0], dt * v[1] / h[1], dt * v[2] / h[2])
        step = wp.max(wp.abs(moves[0]), wp.max(wp.abs(moves[1]), wp.abs(moves[2])))
        new = k
        if step < real(1.0) and wp.isfinite(moves[0] + moves[1] + moves[2]):
            new = _move(rec, p, moves, k, coordinates, up, table, slots, limit)
            if new == -1:
                wp.atomic_max(flags, PENDING, LEFT_INDEX)
                new = k
        else:
            wp.atomic_max(flags, PENDING, UNSTABLE)
            wp.atomic_max(peaks, 1, wp.where(wp.isfinite(moves[0] + moves[1] + moves[2]), step, real(wp.inf)))
        key[p] = new
        if new >= 0:
            rank[p] = wp.atomic_add(count, new, 1)
    all_fastest = wp.tile_max(wp.tile(fastest))
    all_lost = wp.tile_sum(wp.tile(lost))
    if lane == 0:
        wp.atomic_max(peaks, 0, all_fastest[0])
        booked[b, 0] = booked[b, 0] + all_lost[0]


def _velocity_gradient(rec: Rows, p: int, tau: Any, dt: Any, h: Vector, i: int, j: int):
    """Component dv_i/dx_j [1/s] of the affine matrix of a particle."""
    packed = _stress_columns(tau, rec[VOLUME, p], dt, h)
    return wp.float64(rec[AFFINE + 3 * j + i, p] - packed[3 * j + i]) / wp.float64(rec[MASS, p] * h[j])


def unpack(
    rec: Rows, release: Shorts, key: Ints, coordinates: Table2, mats: Materials, dt: Real, h: Vector, first: int, node: Table2,
    affine: Doubles2,
):  # fmt: skip
    """First node (n, 3) and velocity gradient (n, 9) of the particles from number ``first`` on."""
    t = wp.tid()
    p = first + t
    k = key[p]
    if k < 0:
        return
    for d in range(3):
        node[t, d] = 4 * coordinates[k >> 6, d] + ((k >> (4 - 2 * d)) & 3)
    tau = kirchhoff_stress(log_strain(_strain_of(rec, p)), mats[int(release[p])])
    for i in range(3):
        for j in range(3):
            affine[t, 3 * i + j] = _velocity_gradient(rec, p, tau, dt, h, i, j)


def sum_particles(
    rec: Rows, release: Shorts, key: Ints, coordinates: Table2, mats: Materials, dt: Real, h: Vector, gravity: wp.vec3d,
    n: int, present: int, sums: Doubles2,
):  # fmt: skip
    """Mass [kg], momentum [kg m/s], kinetic, potential and elastic energy [J] of the particles that are there, or have gone.

    Each thread adds up every so many-th particle, so that the sums do not depend on which thread comes first. Where a particle
    went over the edge, its elevation is found from its last cell, which the key still tells.
    """
    t = wp.tid()
    for p in range(t, n, sums.shape[0]):
        k = key[p]
        if (k >= 0) == (present != 0) and k != -1:
            k = wp.where(k >= 0, k, -2 - k)
            mat = mats[int(release[p])]
            log = log_strain(_strain_of(rec, p))
            tau = kirchhoff_stress(log, mat)
            m = wp.float64(rec[MASS, p])
            v = wp.vec3d(wp.float64(rec[MOMENTUM, p]), wp.float64(rec[MOMENTUM + 1, p]), wp.float64(rec[MOMENTUM + 2, p])) / m
            twice = wp.dot(v, v)
            potential = wp.float64(0.0)
            for j in range(3):
                hj = wp.float64(h[j])
                for i in range(3):
                    c = _velocity_gradient(rec, p, tau, dt, h, i, j)
                    twice += c * c * hj * hj / wp.float64(4.0)
                cell = 4 * coordinates[k >> 6, j] + ((k >> (4 - 2 * j)) & 3)
                potential -= m * (wp.float64(cell) + wp.float64(rec[OFFSET + j, p])) * hj * gravity[j]
            sums[t, 0] = sums[t, 0] + m
            for d in range(3):
                sums[t, 1 + d] = sums[t, 1 + d] + m * v[d]
            sums[t, 4] = sums[t, 4] + wp.float64(0.5) * m * twice
            sums[t, 5] = sums[t, 5] + potential
            sums[t, 6] = sums[t, 6] + wp.float64(energy_density(log, mat)) * wp.float64(rec[VOLUME, p])


def _covered(x: wp.float64, width: wp.float64, i: int):
    """Share of an interval from ``x`` on that lies in raster cell ``i``."""
    return (wp.min(x + width, wp.float64(i + 1)) - wp.max(x, wp.float64(i))) / width


def _add_whole(raster: Longs, place: int, value: wp.float64):
    wp.atomic_add(raster, place, wp.int64(wp.round(value)))


def add_columns(
    rec: Rows, release: Shorts, key: Ints, coordinates: Table2, density: Doubles, h: wp.vec3d, cell: wp.vec2d,
    rows: int, columns: int, scale: wp.vec3d, raster: Longs,
):  # fmt: skip
    """Add each particle, spread over a plan box of one grid cell, to the raster (rows x columns x 5): volume, mass, momentum.

    The sums are whole numbers of a tiny unit, 1 / ``scale``: exact in any order, so that they repeat bit by bit.
    """
    p = wp.tid()
    k = key[p]
    if k < 0:
        return
    qx = wp.float64(4 * coordinates[k >> 6, 0] + ((k >> 4) & 3)) + wp.float64(rec[OFFSET, p])
    qy = wp.float64(4 * coordinates[k >> 6, 1] + ((k >> 2) & 3)) + wp.float64(rec[OFFSET + 1, p])
    wx = h[0] / cell[0]
    wy = h[1] / cell[1]
    x = (qx - wp.float64(0.5)) * wx
    y = (qy - wp.float64(0.5)) * wy
    m = wp.float64(rec[MASS, p])
    for i in range(int(wp.floor(x)), int(wp.floor(x + wx)) + 1):
        sx = _covered(x, wx, i)
        for j in range(int(wp.floor(y)), int(wp.floor(y + wy)) + 1):
            share = sx * _covered(y, wy, j)
            if share > wp.float64(0.0):
                row = rows - 1 - wp.clamp(j, 0, rows - 1)
                place = (row * columns + wp.clamp(i, 0, columns - 1)) * 5
                _add_whole(raster, place, share * m / density[int(release[p])] * scale[0])
                _add_whole(raster, place + 1, share * m * scale[1])
                for d in range(3):
                    _add_whole(raster, place + 2 + d, share * wp.float64(rec[MOMENTUM + d, p]) * scale[2])


class Store:
    """Particle arrays on the device of the scope.

    Attributes
    ----------
    size, n : int
        Places; places that hold a particle or one that has gone since the last sort.
    rec : (ROWS, size)
        See :mod:`runout.backends.hash.transfer`.
    release : (size,) int16
    number : (size,) int32
        Place in the particles as they were loaded.
    key : (size,) int32
        64 times the block plus the cell; -2 - key for a particle that has gone, -1 for no particle.
    order : (size,) int32
        Places of the particles, cell by cell.
    rank : (size,) int32
        Rank in its cell of a particle that has just moved; shares its memory with ``scratch``.
    touches : (size,) uint8
        Whether a particle is in contact; valid in blocks near the ground.
    """

    def __init__(self, size: int, number: Any):
        self.size = self.n = size
        self.rec = wp.zeros((ROWS, size), dtype=number)
        self.release, self.number = wp.zeros(size, dtype=wp.int16), wp.array(np.arange(size, dtype=np.int32), dtype=wp.int32)
        self.key, self.order = wp.full(size, -1, dtype=wp.int32), wp.zeros(size, dtype=wp.int32)
        self.touches = wp.zeros(size, dtype=wp.uint8)
        self.scratch = wp.zeros(size, dtype=number)
        self.rank = self._view(wp.int32)

    def _view(self, kind: Any) -> Any:
        """The scratch memory as another kind of number."""
        return wp.array(ptr=self.scratch.ptr, dtype=kind, shape=self.size, device=self.scratch.device)

    def fill(self, p: Particles, spacing: tuple[float, float, float], dtype: Any) -> None:
        """Bring particles to the device; the records hold no stress yet (time step 0)."""
        self.release.assign(p.release.astype(np.int16))
        for row, values in self._rows(p, spacing):
            self.rec[row].assign(values.astype(dtype))

    def sort(self, k: SimpleNamespace, index: Index, ordered: bool, flags: Any) -> None:
        """After the cells have been numbered: list the particles and sort them in memory; those that have gone drop out."""
        left = index.start_cells()
        run(k.place_particles, self.n, flags, self.key, self.rank, index.cstart, self.order)
        if ordered:
            run(k.sort_cells, index.room * 64, flags, index.cstart, self.order)
        for row in range(ROWS):
            self._gather(k.gather_reals, self.rec[row], self.scratch, left)
        for array in (self.key, self.number):
            self._gather(k.gather_ints, array, self.rank, left)
        self._gather(k.gather_shorts, self.release, self._view(wp.int16), left)
        self.n = left
        run(k.count_up, self.size, self.order, left, self.key)

    def _gather(self, kernel: Any, array: Any, scratch: Any, count: int) -> None:
        if count:
            run(kernel, count, array, self.order, scratch)
            wp.copy(array, scratch, count=count)

    def brought(self, first: int, count: int, node: Any, affine: Any) -> tuple[Particles, np.ndarray]:
        """Particles of a stretch of places that are still there, without identity, and their numbers."""
        stretch = slice(first, first + count)
        rec = np.stack([self.rec[row][stretch].numpy() for row in range(ROWS)]).astype(np.float64)
        there = self.key[stretch].numpy() >= 0
        m = rec[MASS]
        p = Particles(
            node.numpy(), rec[OFFSET : OFFSET + 3].T, (rec[MOMENTUM : MOMENTUM + 3] / m).T, affine.numpy().reshape(-1, 3, 3),
            rec[STRAIN : STRAIN + 6].T, rec[HISTORY], m, rec[VOLUME], rec[RADIUS],
            self.release[stretch].numpy().astype(np.int32), np.zeros(count, np.int64),
        )  # fmt: skip
        return p.take(there), self.number[stretch].numpy()[there]

    @staticmethod
    def _rows(p: Particles, spacing: tuple[float, float, float]) -> Iterator[tuple[int, np.ndarray]]:
        """Rows of the particle matrix and their values."""
        yield MASS, p.mass
        for d in range(3):
            yield MOMENTUM + d, p.mass * p.velocity[:, d]
            yield OFFSET + d, p.offset[:, d]
            for j in range(3):
                yield AFFINE + 3 * j + d, p.mass * p.affine[:, d, j] * spacing[j]
        for k in range(6):
            yield STRAIN + k, p.strain[:, k]
        yield HISTORY, p.history
        yield VOLUME, p.volume
        yield RADIUS, p.radius
