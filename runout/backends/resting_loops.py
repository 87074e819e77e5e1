"""Loops over the particles of releases at rest, for numba in double precision; they release the lock of Python.

Each loop does one thing to all particles of a chunk, on arrays in a row, so that the compiler makes it work on several at once.
``room`` holds numbers between two loops, a row each.
"""

import math
from typing import NamedTuple

import numpy as np

from runout.model.nodal_surface import TILE, WIDTH
from runout.physics.elastic import energy_density, is_small, log_strain, strain_of_log, strain_series
from runout.physics.geostatic import strain_at_rest
from runout.physics.heightfield import surface_at
from runout.physics.pore_pressure import effective_friction, total_lateral_ratio
from runout.physics.tensors import contracted, scaled, sym

ROWS = 8  # of ``room``


class Elasticity(NamedTuple):
    """Record of a material; here, since the cache of compiled code names its module."""

    lame_lambda: float  # [Pa]
    shear_modulus: float  # [Pa]


def spread_columns(rows, centre, share, column, jitter, size, plan, above, depth, volume, mass, radius):
    """Fill columns from the ground upwards.

    ``centre`` (m, 2), ``share`` (m,) and ``column`` (m, 5) are of the columns: where the particles lie around, the position in
    their layer, and layer height, thickness, volume, mass and radius on level ground. ``jitter`` (n, 2) is in sizes of a column.
    """
    p = 0
    for c in range(len(rows)):
        for row in range(rows[c]):
            plan[p, 0] = centre[c, 0] + jitter[p, 0] * size[0]
            plan[p, 1] = centre[c, 1] + jitter[p, 1] * size[1]
            above[p] = (row + share[c]) * column[c, 0]
            depth[p] = column[c, 1] - above[p]
            volume[p] = column[c, 2]
            mass[p] = column[c, 3]
            radius[p] = column[c, 4]
            p += 1


def _follow(table, begins, stride, fx, fy, spacing, value, east, north):
    """Elevation and slopes of a spline; the nine coefficients of a point lie from where it ``begins``, in rows."""
    for p in range(np.uint64(len(begins))):
        a = begins[p]
        b = a + stride
        c = b + stride
        nine = (table[a], table[a + 1], table[a + 2], table[b], table[b + 1], table[b + 2], table[c], table[c + 1], table[c + 2])
        s = surface_at(nine, fx[p], fy[p])
        value[p] = 0.0 + s[0]
        east[p] = (0.0 + s[1]) / spacing[0]
        north[p] = (0.0 + s[2]) / spacing[1]


def stand_on_ground(first, plan, above, spacing, slots, tiles, begins, room, node, offset, radius):
    """Put particles above the ground from a place in the plan, or return the first whose tile of the ground is missing.

    ``slots`` holds where a tile lies among the ``tiles``, from tile (-1, -1) on; -1 if it is not there.
    """
    n = len(plan)
    for p in range(first, n):
        q, r = plan[p, 0] / spacing[0], plan[p, 1] / spacing[1]
        i, j = np.int64(math.floor(q - 0.5)), np.int64(math.floor(r - 0.5))
        node[p, 0], node[p, 1] = i, j
        room[0, p], room[1, p] = q - i, r - j
        slot = slots[i // TILE + 1, j // TILE + 1]
        if slot < 0:
            return p
        begins[p] = slot * (WIDTH * WIDTH) + (i % TILE) * WIDTH + j % TILE
    ground, east, north = room[2], room[3], room[4]
    for p in range(np.uint64(n)):
        offset[p, 0], offset[p, 1] = room[0, p], room[1, p]
    _follow(tiles, begins, WIDTH, room[0], room[1], spacing, ground, east, north)
    for p in range(np.uint64(n)):
        q = (ground[p] + above[p]) / spacing[2]
        k = math.floor(q - 0.5)
        node[p, 2] = k
        offset[p, 2] = q - k
        radius[p] = radius[p] / math.sqrt(1.0 + east[p] * east[p] + north[p] * north[p])
    return n


def _cell(place, size, count):
    """Index of the cell that holds a place, or of the nearest one."""
    return min(max(np.int64(math.floor(place / size)), 0), count - 1)


def count_outside(node, offset, spacing, size, limits, unknown):
    """Number of particles beyond the ``limits`` of a raster, or on its cells that are ``unknown`` (nx, ny), if this has any."""
    columns, rows = unknown.shape
    outside = 0
    for p in range(np.uint64(len(node))):
        x, y = (node[p, 0] + offset[p, 0]) * spacing[0], (node[p, 1] + offset[p, 1]) * spacing[1]
        inside = (x >= 0.0) & (x <= limits[0]) & (y >= 0.0) & (y <= limits[1])
        if columns > 0:
            inside = inside & (not unknown[_cell(x, size[0], columns), _cell(y, size[1], rows)])
        outside += not inside
    return outside


def meet_free_surface(node, offset, spacing, coefficients, origin, size, corner, cell, thickness_slopes, begins, room, east, north):
    """Slopes of the free surface at particles (:class:`runout.terrain.free_surface.FreeSurface`).

    The spline of the ground has its first coefficient at ``origin`` from the ``corner`` of the window of the release, and a lattice
    of ``size``; the cells of the ``thickness_slopes`` (2, nx, ny) are of size ``cell``, and there may be none.
    """
    rows, stride = coefficients.shape
    for p in range(np.uint64(len(node))):
        x = (node[p, 0] + offset[p, 0]) * spacing[0] - corner[0]
        y = (node[p, 1] + offset[p, 1]) * spacing[1] - corner[1]
        q, r = (x - origin[0]) / size[0], (y - origin[1]) / size[1]
        i = min(max(np.int64(math.floor(q - 0.5)), 0), rows - 3)
        j = min(max(np.int64(math.floor(r - 0.5)), 0), stride - 3)
        begins[p] = i * stride + j
        room[0, p], room[1, p] = q - i, r - j
        room[3, p], room[4, p] = x, y
    _follow(coefficients.reshape(-1), begins, stride, room[0], room[1], size, room[2], east, north)
    columns, rows = thickness_slopes.shape[1:]
    if columns > 0:
        for p in range(np.uint64(len(node))):
            i = min(max(np.int64(room[3, p] / cell[0]), 0), columns - 1)
            j = min(max(np.int64(room[4, p] / cell[1]), 0), rows - 1)
            east[p] += thickness_slopes[0, i, j]
            north[p] += thickness_slopes[1, i, j]


def meet_friction(node, offset, spacing, size, kind, coefficients, friction):
    """Friction below particles: the one of the ``coefficients`` of their release that the ``kind`` (nx, ny) of the ground names."""
    for p in range(np.uint64(len(node))):
        x, y = (node[p, 0] + offset[p, 0]) * spacing[0], (node[p, 1] + offset[p, 1]) * spacing[1]
        friction[p] = coefficients[kind[_cell(x, size[0], kind.shape[0]), _cell(y, size[1], kind.shape[1])]]


def press_at_rest(depth, east, north, friction, unit_weight, slope, intercept, rest, elasticity, room, strain):
    """Elastic strains of masses under their own weight (:mod:`runout.physics.geostatic`).

    ``slope`` and ``intercept`` [Pa] are of the yield cone. Small strains are formed several at once, the others after them.
    """
    n, large = len(depth), 0
    tangent, hencky, small = room[0], room[1:7], room[7]
    for p in range(n):
        tangent[p] = math.hypot(east[p], north[p])
    for p in range(np.uint64(n)):
        weight = unit_weight * max(depth[p], 0.0)
        h = strain_at_rest(weight, east[p], north[p], tangent[p], friction[p], slope, intercept, rest, elasticity)
        small[p] = 4.0 * contracted(h, h)
        B = strain_series(scaled(h, 2.0))
        for k in range(6):
            hencky[k, p] = B[k]
    for p in range(n):
        for k in range(6):
            strain[p, k] = hencky[k, p]
        if not is_small(small[p]):
            weight = unit_weight * max(depth[p], 0.0)
            h = strain_at_rest(weight, east[p], north[p], tangent[p], friction[p], slope, intercept, rest, elasticity)
            B = strain_of_log(h)
            for k in range(6):
                strain[p, k] = B[k]
            large += 1
    return large


def press_wet_mass(depth, east, north, friction, effective, unit_weight, slope, intercept, rest, elasticity, strain):
    """The same for masses with pore pressure, whose grains carry the share ``effective`` (n,) of the normal stress."""
    for p in range(len(depth)):
        share = effective[p]
        tangent, weight = math.hypot(east[p], north[p]), unit_weight * max(depth[p], 0.0)
        ground, ratio = effective_friction(friction[p], share), total_lateral_ratio(rest, share)
        h = strain_at_rest(weight, east[p], north[p], tangent, ground, share * slope, intercept, ratio, elasticity)
        B = strain_of_log(h)
        for k in range(6):
            strain[p, k] = B[k]


def store_energy(strain, release, moduli, stored):
    """Set the energy ``stored`` (n,) [J/m3] in elastic strains B (n, 6) [1] by Lame's moduli (releases, 2) [Pa]."""
    for p in range(len(strain)):
        B, own = strain[p], moduli[release[p]]
        stored[p] = energy_density(log_strain(sym(B[0], B[1], B[2], B[3], B[4], B[5])), Elasticity(own[0], own[1]))
