"""What observers see: sums over the particles of each scene, columns of the raster, and particles as the backends exchange them."""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.layout import (
    AFFINE,
    MASS,
    MOMENTUM,
    NEXT,
    OFFSET,
    VOLUME,
    Doubles,
    Doubles2,
    Ints,
    Longs,
    Materials,
    Reals,
    Rows,
    Shorts,
    Table2,
    Vector,
    double7,
)
from runout.backends.hash.motion import _slopes, _strain_of
from runout.physics.elastic import energy_density, kirchhoff_stress, log_strain
from runout.physics.moments import gradient_column as gradient_column64
from runout.physics.moments import kinetic_energy as kinetic_energy64
from runout.physics.moments import potential_energy as potential_energy64
from runout.physics.moments import stress_columns

SUMS = 7  # mass, momentum, kinetic, potential and elastic energy


def change_step(rec: Rows, key: Ints, release: Shorts, member: Ints, mats: Materials, longer: Reals, h: Vector):
    """Repack the records of each scene for a time step so much longer [s]."""
    p = wp.tid()
    if key[p] < 0:
        return
    tau = kirchhoff_stress(log_strain(_strain_of(rec, p)), mats[int(release[p])])
    packed = stress_columns(tau, rec[VOLUME, p], _slopes(longer[member[key[p] >> 6]], h))
    for k in range(9):
        rec[AFFINE + k, p] = rec[AFFINE + k, p] + packed[k]


def leave(key: Ints, member: Ints, gone: Ints):
    """Take the particles of scenes that are done away."""
    p = wp.tid()
    if key[p] >= 0 and gone[member[wp.max(key[p], 0) >> 6]] != 0:
        key[p] = -1


def _gradient_column(rec: Rows, p: int, tau: Any, dt: Any, h: Vector, j: int):
    """Column j of the velocity gradient C [1/s] of a particle, in float64."""
    packed = stress_columns(tau, rec[VOLUME, p], _slopes(dt, h))
    x = wp.float64(rec[AFFINE + 3 * j, p] - packed[3 * j])
    y = wp.float64(rec[AFFINE + 3 * j + 1, p] - packed[3 * j + 1])
    z = wp.float64(rec[AFFINE + 3 * j + 2, p] - packed[3 * j + 2])
    return gradient_column64(wp.vec3d(x, y, z), wp.float64(rec[MASS, p]), wp.float64(h[j]))


def _place(rec: Rows, p: int, k: int, coordinates: Table2, shift: int):
    """Local position [cells] of a particle whose cell is ``k``."""
    b = k >> 6
    x = 4 * coordinates[b, 0] + ((k >> 4) & 3)
    y = 4 * coordinates[b, 1] + ((k >> 2) & 3) - shift
    z = 4 * coordinates[b, 2] + (k & 3)
    fx = wp.float64(rec[OFFSET, p])
    fy = wp.float64(rec[OFFSET + 1, p])
    fz = wp.float64(rec[OFFSET + 2, p])
    return wp.vec3d(wp.float64(x) + fx, wp.float64(y) + fy, wp.float64(z) + fz)


def _position(rec: Rows, p: int, k: int, coordinates: Table2, shift: int, h: Vector):
    """Local position [m] of a particle whose cell is ``k``."""
    return wp.cw_mul(_place(rec, p, k, coordinates, shift), wp.vec3d(wp.float64(h[0]), wp.float64(h[1]), wp.float64(h[2])))


def unpack(
    rec: Rows, release: Shorts, key: Ints, coordinates: Table2, member: Ints, shift: Ints, mats: Materials, packed: Reals,
    h: Vector, where: Ints, node: Table2, affine: Doubles2,
):  # fmt: skip
    """First node (n, 3) and velocity gradient (n, 9) of the particles at the places ``where`` (n,)."""
    t = wp.tid()
    p = where[t]
    k = key[p]
    s = member[k >> 6]
    for d in range(3):
        node[t, d] = 4 * coordinates[k >> 6, d] + ((k >> (4 - 2 * d)) & 3)
    node[t, 1] = node[t, 1] - shift[s]
    tau = kirchhoff_stress(log_strain(_strain_of(rec, p)), mats[int(release[p])])
    for j in range(3):
        column = _gradient_column(rec, p, tau, packed[s], h, j)
        for i in range(3):
            affine[t, 3 * i + j] = column[i]


def _energies(rec: Rows, release: Shorts, p: int, mats: Materials, dt: Any, h: Vector, gravity: wp.vec3d, x: wp.vec3d):
    """Kinetic, potential and elastic energy [J] of a particle at ``x`` [m]."""
    mat = mats[int(release[p])]
    log = log_strain(_strain_of(rec, p))
    tau = kirchhoff_stress(log, mat)
    m = wp.float64(rec[MASS, p])
    v = wp.vec3d(wp.float64(rec[MOMENTUM, p]), wp.float64(rec[MOMENTUM + 1, p]), wp.float64(rec[MOMENTUM + 2, p])) / m
    cx = _gradient_column(rec, p, tau, dt, h, 0)
    cy = _gradient_column(rec, p, tau, dt, h, 1)
    cz = _gradient_column(rec, p, tau, dt, h, 2)
    size = wp.vec3d(wp.float64(h[0]), wp.float64(h[1]), wp.float64(h[2]))
    kinetic = kinetic_energy64(m, v, cx, cy, cz, size)
    return wp.vec3d(kinetic, potential_energy64(m, gravity, x), wp.float64(energy_density(log, mat)) * wp.float64(rec[VOLUME, p]))


def _row(rec: Rows, release: Shorts, p: int, mats: Materials, dt: Any, h: Vector, gravity: wp.vec3d, x: wp.vec3d):
    """Mass [kg], momentum [kg m/s], kinetic, potential and elastic energy [J] of a particle."""
    e = _energies(rec, release, p, mats, dt, h, gravity, x)
    mass = wp.float64(rec[MASS, p])
    row = double7(mass)
    for d in range(3):
        row[1 + d] = wp.float64(rec[MOMENTUM + d, p])
        row[4 + d] = e[d]
    row[0] = mass
    return row


def sum_blocks(
    rec: Rows, release: Shorts, key: Ints, order: Ints, cstart: Table2, tally: Ints, active: Ints, coordinates: Table2,
    member: Ints, shift: Ints, mats: Materials, packed: Reals, h: Vector, gravity: wp.vec3d, sums: Doubles2, launched: int,
):  # fmt: skip
    """Sums (blocks, 7) over the particles of each block; see ``_row``."""
    begin, lane = wp.tid()
    for a in range(begin, tally[NEXT], launched):
        b = active[a]
        s = member[b]
        acc = double7()
        for t in range(cstart[b, 0] + lane, cstart[b, 64], wp.block_dim()):
            p = order[t]
            x = _position(rec, p, key[p], coordinates, shift[s], h)
            acc += _row(rec, release, p, mats, packed[s], h, gravity, x)
        total = wp.tile_sum(wp.tile(acc, preserve_type=True))
        if lane == 0:
            for k in range(SUMS):
                sums[b, k] = total[0][k]


def sum_rows(rows: Doubles2, member: Ints, blocks: int, width: int, parts: int, sums: Doubles2):
    """Sums (scenes parts, width) of the rows of the blocks of each scene; part q takes every ``parts``-th."""
    i, lane = wp.tid()
    scene = i // parts
    for d in range(width):
        acc = wp.float64(0.0)
        for b in range((i % parts) * wp.block_dim() + lane, blocks, parts * wp.block_dim()):
            if member[b] == scene:
                acc += rows[b, d]
        total = wp.tile_sum(wp.tile(acc))
        if lane == 0:
            sums[i, d] = total[0]


def sum_gone(
    rec: Rows, release: Shorts, key: Ints, coordinates: Table2, member: Ints, shift: Ints, mats: Materials, packed: Reals,
    h: Vector, gravity: wp.vec3d, n: int, scenes: int, threads: int, sums: Doubles2,
):  # fmt: skip
    """The same sums over the particles that have left the domain; thread t takes every so many-th, row ``scenes`` t + s scene s.

    The elevation where a particle went over the edge is found from its last cell, which the key still tells.
    """
    t = wp.tid()
    for p in range(t, n, threads):
        if key[p] < -1:
            k = -2 - key[p]
            s = member[k >> 6]
            x = _position(rec, p, k, coordinates, shift[s], h)
            row = _row(rec, release, p, mats, packed[s], h, gravity, x)
            for d in range(SUMS):
                sums[scenes * t + s, d] = sums[scenes * t + s, d] + row[d]


def bound_blocks(tally: Ints, active: Ints, member: Ints, scene: int, coordinates: Table2, bounds: Ints):
    """Least and largest coordinates in plan of the blocks of a scene that hold particles."""
    i = wp.tid()
    if i >= tally[NEXT]:
        return
    b = active[i]
    if member[b] == scene:
        for d in range(2):
            wp.atomic_min(bounds, d, coordinates[b, d])
            wp.atomic_max(bounds, 2 + d, coordinates[b, d])


def _covered(x: wp.float64, width: wp.float64, i: int):
    """Share of an interval from ``x`` on that lies in raster cell ``i``."""
    return (wp.min(x + width, wp.float64(i + 1)) - wp.max(x, wp.float64(i))) / width


def _add_whole(raster: Longs, place: int, value: wp.float64):
    wp.atomic_add(raster, place, wp.int64(wp.round(value)))


def add_columns(
    rec: Rows, release: Shorts, key: Ints, coordinates: Table2, member: Ints, scene: int, shift: Ints, density: Doubles,
    h: wp.vec3d, cell: wp.vec2d, rows: int, columns: int, row: int, column: int, width: int, scale: wp.vec3d, raster: Longs,
):  # fmt: skip
    """Add each particle of a scene, spread over a plan box of one grid cell, to a window (x width x 5) of the raster.

    The window begins at ``row``, ``column`` of the raster (rows, columns) and holds all mass.
    Volume, mass, momentum: whole numbers of a tiny unit, 1 / ``scale``, exact in any order, so that they repeat bit by bit.
    """
    p = wp.tid()
    k = key[p]
    if k < 0 or member[wp.max(k, 0) >> 6] != scene:
        return
    place = _place(rec, p, k, coordinates, shift[scene])
    qx = place[0]
    qy = place[1]
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
                o = (rows - 1 - wp.clamp(j, 0, rows - 1) - row) * width
                o = (o + wp.clamp(i, 0, columns - 1) - column) * 5
                _add_whole(raster, o, share * m / density[int(release[p])] * scale[0])
                _add_whole(raster, o + 1, share * m * scale[1])
                for d in range(3):
                    _add_whole(raster, o + 2 + d, share * wp.float64(rec[MOMENTUM + d, p]) * scale[2])
