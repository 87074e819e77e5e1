"""What a step makes of a particle: velocity and its first moments from the nodes, the law, and the next record."""

from __future__ import annotations

from typing import Any

from runout.backends.hash.layout import (
    AFFINE,
    CELL_LANES,
    HISTORY,
    MOMENTUM,
    PITCH,
    STRAIN,
    WET,
    WIDE_X,
    WIDE_Y,
    Rows,
    Tile,
    Vector,
)
from runout.backends.hash.stencil import _arms
from runout.physics.bspline import weights
from runout.physics.elastic import kirchhoff_stress
from runout.physics.moments import affine_columns, moment_slope, stress_columns, velocity_gradient
from runout.physics.plastic import step
from runout.physics.substeps import force_columns, inverse_deformation, present_gradient, stress_at_start
from runout.physics.tensors import real, sym, vec


def _strain_of(rec: Rows, p: int):
    return sym(rec[STRAIN, p], rec[STRAIN + 1, p], rec[STRAIN + 2, p], rec[STRAIN + 3, p], rec[STRAIN + 4, p], rec[STRAIN + 5, p])


def _slopes(dt: Any, h: Vector):
    return vec(moment_slope(dt, h[0]), moment_slope(dt, h[1]), moment_slope(dt, h[2]))


def _store_strain(rec: Rows, p: int, B: Any, history: Any):
    """Write strain and history of a particle."""
    for d in range(6):
        rec[STRAIN + d, p] = B[d]
    rec[HISTORY, p] = history


def _store(rec: Rows, p: int, m: Any, v: Vector, affine: Any, packed: Any, B: Any, history: Any):
    """Write the next record of a particle, except for its place."""
    for d in range(3):
        rec[MOMENTUM + d, p] = m * v[d]
        rec[AFFINE + d, p] = affine[d] + packed[d]
        rec[AFFINE + 3 + d, p] = affine[3 + d] + packed[3 + d]
        rec[AFFINE + 6 + d, p] = affine[6 + d] + packed[6 + d]
    _store_strain(rec, p, B, history)


def _lever(w: Any, f: Any):
    """Weights of the three nodes of an axis times their distances [cells] from a particle."""
    d = _arms(f)
    return vec(w[0] * d[0], w[1] * d[1], w[2] * d[2])


def _gather(f: Any, tile: Tile, first: int, stride_x: int, stride_y: int):
    """Velocity and its first moments sum w v (x_j - f_j) [m/s cells] along each axis from the 27 nodes at place ``first``.

    The nodes lie in a tile with such strides. All are products over the axes and are summed axis by axis.
    """
    wx = weights(f[0])
    wy = weights(f[1])
    wz = weights(f[2])
    ax = _lever(wx, f[0])
    ay = _lever(wy, f[1])
    az = _lever(wz, f[2])
    v = vec(real(0.0), real(0.0), real(0.0))
    x = vec(real(0.0), real(0.0), real(0.0))
    y = vec(real(0.0), real(0.0), real(0.0))
    z = vec(real(0.0), real(0.0), real(0.0))
    for i in range(3):
        si = vec(real(0.0), real(0.0), real(0.0))
        yi = vec(real(0.0), real(0.0), real(0.0))
        zi = vec(real(0.0), real(0.0), real(0.0))
        for j in range(3):
            s = vec(real(0.0), real(0.0), real(0.0))
            r = vec(real(0.0), real(0.0), real(0.0))
            for k in range(3):
                g = tile[first + i * stride_x + j * stride_y + k]
                u = vec(g[1], g[2], g[3])
                s += wz[k] * u
                r += az[k] * u
            si += wy[j] * s
            yi += ay[j] * s
            zi += wy[j] * r
        v += wx[i] * si
        x += ax[i] * si
        y += wx[i] * yi
        z += wx[i] * zi
    return v, x, y, z


def _held(room: Tile, staged: int, apart: int, n: int):
    """Number ``n`` of the record that begins at place ``staged``, see :mod:`runout.backends.hash.shared_memory`."""
    return room[staged + n * apart]


def _particle_of(room: Tile, staged: int, apart: int):
    """Mass [kg], volume [m3], history, strain and offset of a particle from numbers in shared memory."""
    B = sym(
        _held(room, staged, apart, 4), _held(room, staged, apart, 5), _held(room, staged, apart, 6),
        _held(room, staged, apart, 7), _held(room, staged, apart, 8), _held(room, staged, apart, 9),
    )  # fmt: skip
    f = vec(_held(room, staged, apart, 1), _held(room, staged, apart, 2), _held(room, staged, apart, 3))
    return _held(room, staged, apart, 0), _held(room, staged, apart, 11), _held(room, staged, apart, 10), B, f


law_update: Any = step  # of a law, by effective stress where WET is set; the binding puts it in its place


def _law(B: Any, L: Any, history: Any, mat: Any, effective: Any):
    """Law of a particle whose grains carry the share ``effective`` [1] of the mean stress."""
    if WET:
        B, log, history, work = law_update(B, L, history, mat, effective)
    else:
        B, log, history, work = law_update(B, L, history, mat)
    return B, log, history, work


def _deform(rec: Rows, p: int, room: Tile, staged: int, tile: Tile, first: int, mat: Any, slopes: Any, effective: Any):
    """Law and next record of a particle from the nodes at ``first``; returns its offset, velocity and dissipated energy [J]."""
    m, volume, history, B, f = _particle_of(room, staged, CELL_LANES)
    v, x, y, z = _gather(f, tile, first, WIDE_X, WIDE_Y)
    B, log, history, work = _law(B, velocity_gradient(x, y, z, slopes), history, mat, effective)
    packed = stress_columns(kirchhoff_stress(log, mat), volume, slopes)
    _store(rec, p, m, v, affine_columns(m, x, y, z), packed, B, history)
    return f, v, work * volume


def _deform_on_way(
    rec: Rows, p: int, room: Tile, staged: int, tile: Tile, ways: Tile, first: int, mat: Any, slopes: Any, of_way: Any,
    effective: Any,
):  # fmt: skip
    """As :func:`_deform` at the end of several substeps; returns the way [m] before the last one too.

    ``ways`` are those of the nodes, ``of_way`` the factors of their moments.
    """
    m, volume, history, B, f = _particle_of(room, staged, CELL_LANES)
    v, x, y, z = _gather(f, tile, first, WIDE_X, WIDE_Y)
    way, ux, uy, uz = _gather(f, ways, first, WIDE_X, WIDE_Y)
    inverse = inverse_deformation(velocity_gradient(ux, uy, uz, of_way))
    B, log, history, work = _law(B, present_gradient(velocity_gradient(x, y, z, slopes), inverse), history, mat, effective)
    packed = stress_columns(kirchhoff_stress(log, mat), volume, slopes)
    _store(rec, p, m, v, affine_columns(m, x, y, z), packed, B, history)
    return f, v, way, work * volume


def _strain_in_place(
    rec: Rows, p: int, held: Tile, place: int, tile: Tile, ways: Tile, first: int, mat: Any, slopes: Any, of_way: Any, gone: int,
    effective: Any,
):  # fmt: skip
    """Law of a particle that stays, in a further substep, from the nodes at ``first`` of tiles of 6 x 6 x 6.

    ``gone``: whether the nodes have gone any way before, which ``ways`` holds then. Returns velocity, that way [m], columns of the
    impulse of its internal force and dissipated energy [J].
    """
    _mass, volume, history, B, f = _particle_of(held, place, PITCH)
    v, x, y, z = _gather(f, tile, first, 36, 6)
    way = vec(real(0.0), real(0.0), real(0.0))
    moved = velocity_gradient(way, way, way, of_way)
    if gone != 0:
        u, ux, uy, uz = _gather(f, ways, first, 36, 6)
        way = u * real(1.0)
        moved = velocity_gradient(ux, uy, uz, of_way)
    rate = velocity_gradient(x, y, z, slopes)
    B, log, history, work = _law(B, present_gradient(rate, inverse_deformation(moved)), history, mat, effective)
    stress = stress_at_start(kirchhoff_stress(log, mat), inverse_deformation(moved + rate))
    _store_strain(rec, p, B, history)
    return v, way, force_columns(stress, volume, slopes), work * volume
