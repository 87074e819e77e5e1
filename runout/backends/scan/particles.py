"""Particles: the law, the motion, the next record, the order by cell, and sums over them."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import get_thread_id, prange

from runout.backends.scan.transfer import _first_node, _gather, _load_arena
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.physics.elastic import energy_density, kirchhoff_stress, log_strain
from runout.physics.elastic import update as law_update
from runout.physics.tensors import real, sym, tens


@dataclass
class Store:
    """Particle arrays in the order of their cells.

    Attributes
    ----------
    rec : (n, 16)
        Records, see :mod:`runout.backends.scan.transfer`.
    state : (n, 8)
        B = b_e - I (6), history variable of the law, stress-free volume [m3].
    radius : (n,) [m]
    release : (n,) int32
    identity : (n,) int64
    """

    rec: np.ndarray
    state: np.ndarray
    radius: np.ndarray
    release: np.ndarray
    identity: np.ndarray

    @classmethod
    def empty(cls, n: int, dtype: type) -> "Store":
        """Room for ``n`` particles."""
        rec: Any = np.zeros((n, 16), dtype)
        state: Any = np.zeros((n, 8), dtype)
        radius: Any = np.zeros(n, dtype)
        return cls(rec, state, radius, np.zeros(n, np.int32), np.zeros(n, np.int64))

    @classmethod
    def of(cls, p: Particles, scene: Scene) -> "Store":
        """Particles in their order; the records hold no stress yet (time step 0)."""
        s = cls.empty(len(p), scene.dtype)
        s.rec[:, 0] = p.mass
        s.rec[:, 1:4] = p.mass[:, None] * p.velocity
        for j in range(3):
            s.rec[:, 4 + 4 * j] = p.offset[:, j]
            s.rec[:, 5 + 4 * j : 8 + 4 * j] = p.mass[:, None] * p.affine[:, :, j] * scene.spacing[j]
        s.state[:, :6], s.state[:, 6], s.state[:, 7] = p.strain, p.history, p.volume
        s.radius[:], s.release[:], s.identity[:] = p.radius, p.release, p.identity
        return s

    def arrays(self) -> tuple[np.ndarray, ...]:
        """The arrays, as kernels take them."""
        return self.rec, self.state, self.radius, self.release, self.identity


def _strain_of(state, p):
    return sym(state[p, 0], state[p, 1], state[p, 2], state[p, 3], state[p, 4], state[p, 5])


def _add_stress(rec, p, tau, volume, dt, h):
    """Add the impulse of the internal force over ``dt`` to the packed columns of a record."""
    x = -dt * real(4.0) / h[0] * volume
    y = -dt * real(4.0) / h[1] * volume
    z = -dt * real(4.0) / h[2] * volume
    rec[p, 5] += x * tau[0]
    rec[p, 6] += x * tau[3]
    rec[p, 7] += x * tau[5]
    rec[p, 9] += y * tau[3]
    rec[p, 10] += y * tau[1]
    rec[p, 11] += y * tau[4]
    rec[p, 13] += z * tau[5]
    rec[p, 14] += z * tau[4]
    rec[p, 15] += z * tau[2]


def change_step(rec, state, release, n, mats, ddt, h):
    """Repack the records for a time step longer by ``ddt`` [s]."""
    for p in prange(n):
        mat = mats[release[p]]
        tau = kirchhoff_stress(log_strain(_strain_of(state, p)), mat)
        _add_stress(rec, p, tau, state[p, 7], ddt, h)


def _deform(rec, state, p, moments, mat, dt, h):
    """Law and next record of a particle from what the grid gave it; returns the dissipated energy [J]."""
    v0, v1, v2, x0, x1, x2, y0, y1, y2, z0, z1, z2 = moments
    m = rec[p, 0]
    sx = dt * real(4.0) / h[0]
    sy = dt * real(4.0) / h[1]
    sz = dt * real(4.0) / h[2]
    L = tens(sx * x0, sy * y0, sz * z0, sx * x1, sy * y1, sz * z1, sx * x2, sy * y2, sz * z2)
    B, log, history, lost = law_update(_strain_of(state, p), L, state[p, 6], mat)
    for k in range(6):
        state[p, k] = B[k]
    state[p, 6] = history
    rec[p, 1] = m * v0
    rec[p, 2] = m * v1
    rec[p, 3] = m * v2
    m4 = real(4.0) * m
    rec[p, 5] = m4 * x0
    rec[p, 6] = m4 * x1
    rec[p, 7] = m4 * x2
    rec[p, 9] = m4 * y0
    rec[p, 10] = m4 * y1
    rec[p, 11] = m4 * y2
    rec[p, 13] = m4 * z0
    rec[p, 14] = m4 * z1
    rec[p, 15] = m4 * z2
    _add_stress(rec, p, kirchhoff_stress(log, mat), state[p, 7], dt, h)
    return lost * state[p, 7]


def _advance(rec, p, k, cells):
    """Move one coordinate by ``cells``; returns the change of its first node."""
    f = rec[p, k] + cells
    s = math.floor(f - real(0.5))
    rec[p, k] = f - s
    return int(s)


def _inside(node, f, limit):
    """Whether a coordinate lies in the domain, 0 <= node + f <= limit [cells]."""
    return (node + f >= 0.0) and (node + f <= limit)


def _new_cell(rec, p, b, c, moves, bxyz, around, limit):
    """Move a particle; returns the number of its new cell, -1 outside the domain."""
    x = (c >> 4) + _advance(rec, p, 4, moves[0])
    y = ((c >> 2) & 3) + _advance(rec, p, 8, moves[1])
    z = (c & 3) + _advance(rec, p, 12, moves[2])
    if not (_inside(4 * bxyz[b, 0] + x, rec[p, 4], limit[0]) and _inside(4 * bxyz[b, 1] + y, rec[p, 8], limit[1])):
        return -1
    to = around[b, ((x >> 2) + 1) * 9 + ((y >> 2) + 1) * 3 + (z >> 2) + 1]
    return to * 64 + ((x & 3) << 4 | (y & 3) << 2 | (z & 3))


def grid_to_particles(
    rec, state, release, cstart, nown, grid, up, around, bxyz, mats, dt, h, limit, scratch, key, movers, nmovers, sums
):
    """Velocities to particles, law, motion and next record; keys of the new cells and a list of those that leave theirs.

    ``sums`` (nown, 4): largest speed squared, largest move [cells], dissipated energy [J], particles that left the domain.
    """
    for b in prange(nown):
        start = cstart[b * 64]
        nmovers[b] = 0
        for d in range(4):
            sums[b, d] = 0.0
        if start == cstart[b * 64 + 64]:
            continue
        arena = scratch[get_thread_id()]
        _load_arena(grid, up, b, arena)
        moved = 0
        for c in range(64):
            o = _first_node(c)
            for p in range(cstart[b * 64 + c], cstart[b * 64 + c + 1]):
                got = _gather(rec, p, arena, o)
                sums[b, 2] += _deform(rec, state, p, got, mats[release[p]], dt, h)
                sums[b, 0] = max(sums[b, 0], got[0] * got[0] + got[1] * got[1] + got[2] * got[2])
                moves = (dt * got[0] / h[0], dt * got[1] / h[1], dt * got[2] / h[2])
                step = max(abs(moves[0]), max(abs(moves[1]), abs(moves[2])))
                key[p] = b * 64 + c
                if step < real(1.0):
                    sums[b, 1] = max(sums[b, 1], step)
                    key[p] = _new_cell(rec, p, b, c, moves, bxyz, around, limit)
                    sums[b, 3] += key[p] == -1
                else:
                    sums[b, 1] = math.inf  # too far, or not a number: the step is refused
                if key[p] != b * 64 + c:
                    movers[start + moved] = p
                    moved += 1
        nmovers[b] = moved


def count_cells(key, cstart, nown, around, movers, nmovers, count):
    """Number of particles that each cell will hold: those that stay in the block, and the movers of 26 neighbours."""
    for b in prange(nown):
        for c in range(64):
            count[b * 64 + c] = 0
        for p in range(cstart[b * 64], cstart[b * 64 + 64]):
            if key[p] >> 6 == b:
                count[key[p]] += 1
        for q in range(27):
            s = around[b, q]
            if s < 0 or s == b:
                continue
            for t in range(nmovers[s]):
                k = key[movers[cstart[s * 64] + t]]
                if k >> 6 == b:
                    count[k] += 1


def _copy(rec, state, radius, release, identity, p, rec2, state2, radius2, release2, identity2, d):
    for k in range(16):
        rec2[d, k] = rec[p, k]
    for k in range(8):
        state2[d, k] = state[p, k]
    radius2[d] = radius[p]
    release2[d] = release[p]
    identity2[d] = identity[p]


def arrange(old, new, key, cstart, place, nown, around, movers, nmovers):
    """Copy the particles into the order of their new cells; ``place`` starts as the first place of each cell."""
    rec, state, radius, release, identity = old
    rec2, state2, radius2, release2, identity2 = new
    for b in prange(nown):
        for p in range(cstart[b * 64], cstart[b * 64 + 64]):
            k = key[p]
            if k >> 6 == b:
                _copy(rec, state, radius, release, identity, p, rec2, state2, radius2, release2, identity2, place[k])
                place[k] += 1
        for q in range(27):
            s = around[b, q]
            if s < 0 or s == b:
                continue
            for t in range(nmovers[s]):
                p = movers[cstart[s * 64] + t]
                k = key[p]
                if k >> 6 == b:
                    _copy(rec, state, radius, release, identity, p, rec2, state2, radius2, release2, identity2, place[k])
                    place[k] += 1


def unpack(rec, state, release, cstart, nown, bxyz, mats, dt, h, node, affine):
    """First node (n, 3) and velocity gradient (n, 3, 3) of the particles, in float64."""
    for b in prange(nown):
        for c in range(64):
            for p in range(cstart[b * 64 + c], cstart[b * 64 + c + 1]):
                node[p, 0] = 4 * bxyz[b, 0] + (c >> 4)
                node[p, 1] = 4 * bxyz[b, 1] + ((c >> 2) & 3)
                node[p, 2] = 4 * bxyz[b, 2] + (c & 3)
                tau = kirchhoff_stress(log_strain(_strain_of(state, p)), mats[release[p]])
                stress = (tau[0], tau[3], tau[5], tau[3], tau[1], tau[4], tau[5], tau[4], tau[2])
                for j in range(3):
                    for i in range(3):
                        a = rec[p, 5 + 4 * j + i] + dt * real(4.0) / h[j] * state[p, 7] * stress[3 * i + j]
                        affine[p, i, j] = a / (rec[p, 0] * h[j])


def stored_energy(state, release, n, mats, energy):
    """Elastic energy [J] of each particle."""
    for p in prange(n):
        energy[p] = energy_density(log_strain(_strain_of(state, p)), mats[release[p]]) * state[p, 7]


def add_columns(rec, release, cstart, nown, bxyz, density, h, cell, raster):
    """Add each particle, spread over a plan box of one grid cell, to the raster (rows, columns, 5): volume, mass, momentum."""
    rows, columns, _ = raster.shape
    for b in range(nown):
        for c in range(64):
            for p in range(cstart[b * 64 + c], cstart[b * 64 + c + 1]):
                x = ((4 * bxyz[b, 0] + (c >> 4)) + rec[p, 4] - 0.5) * h[0] / cell[0]
                y = ((4 * bxyz[b, 1] + ((c >> 2) & 3)) + rec[p, 8] - 0.5) * h[1] / cell[1]
                wx = h[0] / cell[0]
                wy = h[1] / cell[1]
                m = rec[p, 0]
                for i in range(math.floor(x), math.floor(x + wx) + 1):
                    sx = (min(x + wx, i + 1.0) - max(x, i)) / wx
                    for j in range(math.floor(y), math.floor(y + wy) + 1):
                        share = sx * (min(y + wy, j + 1.0) - max(y, j)) / wy
                        if share > 0.0:
                            row = rows - 1 - min(max(j, 0), rows - 1)
                            column = min(max(i, 0), columns - 1)
                            raster[row, column, 0] += share * m / density[release[p]]
                            raster[row, column, 1] += share * m
                            for d in range(3):
                                raster[row, column, 2 + d] += share * rec[p, 1 + d]
