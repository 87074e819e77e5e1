"""The sliding surface on the device: cut into tiles of the blocks, and the blocks that may touch it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import warp as wp

from runout.backends.hash.contact_solution import _around
from runout.backends.hash.grid import NodeArrays
from runout.backends.hash.index import Index
from runout.backends.hash.layout import (
    GROUNDED,
    GROW,
    HALT,
    NEAR,
    SLOT,
    Doubles,
    Doubles2,
    Halves,
    Ints,
    Nodes,
    Real,
    Rows,
    Table2,
    Vector,
    node4,
    run,
)
from runout.model.nodal_surface import NodalSurface
from runout.physics.bspline import first_node as first_node64
from runout.physics.heightfield import bend_smoothness as bend_smoothness64
from runout.physics.heightfield import distance, upward_normal
from runout.physics.heightfield import resampled_coefficient as resampled_coefficient64
from runout.physics.heightfield import surface_at as surface_at64
from runout.physics.tensors import real
from runout.physics.tensors import tens as tens64


def _sample(coefficients: Doubles, first: int, nx: int, ny: int, qx: wp.float64, qy: wp.float64):
    """Elevation [m] at lattice position (qx, qy) and its slopes by qx and qy [m]; nx x ny coefficients start at ``first``."""
    i = wp.clamp(first_node64(qx), 0, nx - 3)
    j = wp.clamp(first_node64(qy), 0, ny - 3)
    a = first + i * ny + j
    b = a + ny
    c = b + ny
    nine = tens64(
        coefficients[a], coefficients[a + 1], coefficients[a + 2], coefficients[b], coefficients[b + 1], coefficients[b + 2],
        coefficients[c], coefficients[c + 1], coefficients[c + 2],
    )  # fmt: skip
    return surface_at64(nine, qx - wp.float64(i), qy - wp.float64(j))


def _along_north(coefficients: Doubles, first: int, nx: int, ny: int, qx: wp.float64, qy: wp.float64, ay: wp.float64):
    """Coefficient along the north axis from samples ``ay`` apart, and the slope along the east axis."""
    before = _sample(coefficients, first, nx, ny, qx, qy - ay - ay)
    south = _sample(coefficients, first, nx, ny, qx, qy - ay)
    here = _sample(coefficients, first, nx, ny, qx, qy)
    north = _sample(coefficients, first, nx, ny, qx, qy + ay)
    after = _sample(coefficients, first, nx, ny, qx, qy + ay + ay)
    smooth = bend_smoothness64(before[2], south[2], here[2], north[2], after[2])
    return resampled_coefficient64(south[0], here[0], north[0], smooth), here[1]


def _change_at(changes: Doubles, shapes: Table2, s: int, m: int, n: int):
    """What the coefficient of a node has more [m]: a place of the table of a scene, nothing beyond it."""
    i = m - shapes[s, 4]
    j = n - shapes[s, 5]
    if i < 0 or j < 0 or i >= shapes[s, 6] or j >= shapes[s, 7]:
        return wp.float64(0.0)
    return changes[shapes[s, 3] + i * shapes[s, 7] + j]


def cut_tiles(
    coefficients: Doubles, changes: Doubles, shapes: Table2, lattices: Doubles2, member: Ints, shift: Ints, coordinates: Table2,
    up: Table2, h: Doubles, tiles: Rows,
):  # fmt: skip
    """Surface coefficients on the nodes of each block that may hold particles, relative to its lowest node [cells].

    The surface is sampled at the nodes in float64, so that float32 keeps the gap of a particle to 1e-7 cells.
    """
    b, t = wp.tid()
    if up[b, 0] < 0:
        return
    s = member[b]
    first = shapes[s, 0]
    nx = shapes[s, 1]
    ny = shapes[s, 2]
    m = 4 * coordinates[b, 0] + t // 6
    n = 4 * coordinates[b, 1] - shift[s] + t % 6
    qx = (wp.float64(m) * h[0] - lattices[s, 0]) / lattices[s, 2]
    qy = (wp.float64(n) * h[1] - lattices[s, 1]) / lattices[s, 3]
    ax = wp.float64(0.5) * h[0] / lattices[s, 2]
    ay = wp.float64(0.5) * h[1] / lattices[s, 3]
    before = _sample(coefficients, first, nx, ny, qx - ax - ax, qy)
    west, slope_west = _along_north(coefficients, first, nx, ny, qx - ax, qy, ay)
    here, slope = _along_north(coefficients, first, nx, ny, qx, qy, ay)
    east, slope_east = _along_north(coefficients, first, nx, ny, qx + ax, qy, ay)
    after = _sample(coefficients, first, nx, ny, qx + ax + ax, qy)
    smooth = bend_smoothness64(before[1], slope_west, slope, slope_east, after[1])
    e = resampled_coefficient64(west, here, east, smooth) + _change_at(changes, shapes, s, m, n)
    tiles[b, t] = real(e / h[2] - wp.float64(4 * coordinates[b, 2]))


def note_near(tiles: Rows, up: Table2, h: Vector, reach: Real, near: Ints, grounded: Ints):
    """Blocks whose particles may come within ``reach`` [m] of the ground, and the blocks of the nodes that these reach.

    A spline keeps to the hull of its coefficients, and no other slope is found than between two of them: the least east and north
    and the largest are noted behind them.
    """
    b = wp.tid()
    low = node4(real(wp.inf), real(wp.inf), -real(wp.inf), -real(wp.inf))
    for i in range(4):
        tiles[b, 36 + i] = low[i]
    if up[b, 0] < 0:
        return
    top = tiles[b, 0]
    for t in range(36):
        top = wp.max(top, tiles[b, t])
        if t >= 6:
            east = (tiles[b, t] - tiles[b, t - 6]) * h[2] / h[0]
            low[0] = wp.min(low[0], east)
            low[2] = wp.max(low[2], east)
        if t % 6 > 0:
            north = (tiles[b, t] - tiles[b, t - 1]) * h[2] / h[1]
            low[1] = wp.min(low[1], north)
            low[3] = wp.max(low[3], north)
    for i in range(4):
        tiles[b, 36 + i] = low[i]
    n = upward_normal(wp.max(wp.abs(low[0]), wp.abs(low[2])), wp.max(wp.abs(low[1]), wp.abs(low[3])))
    if distance((real(0.5) - top) * h[2], n[2]) <= reach:
        near[b] = 1
        for q in range(8):
            grounded[up[b, q]] = 1


def note_slopes(tiles: Rows, around: Table2, slopes: Nodes):
    """Middle of the slopes of the ground under a block and those around it, and how far any lies from it."""
    b = wp.tid()
    found = node4(tiles[b, 36], tiles[b, 37], tiles[b, 38], tiles[b, 39])
    for q in range(27):
        other = around[b, q]
        if other >= 0:
            for i in range(2):
                found[i] = wp.min(found[i], tiles[other, 36 + i])
                found[i + 2] = wp.max(found[i + 2], tiles[other, 38 + i])
    if found[0] <= found[2]:  # else no particle comes here
        for i in range(2):
            middle = real(0.5) * (found[i] + found[i + 2])
            found[i] = middle
            found[i + 2] = found[i + 2] - middle + real(1e-5) * (real(1.0) + wp.abs(middle))  # with a reserve for rounding
        slopes[b] = found


def number_marked(places: Ints, marks: Ints, counts: Ints, which: int, blocks: Ints):
    """Place of each marked block, -1 for the others, and how many there are; ``places`` are sums over the blocks before.

    ``blocks`` are told the block at a place, as far as there is room.
    """
    b = wp.tid()
    if b == 0:
        counts[which] = places[places.shape[0] - 1]
    if marks[b] != 0:
        marks[b] = places[b]
        if places[b] < blocks.shape[0]:
            blocks[places[b]] = b
    else:
        marks[b] = -1


def require_ground(counts: Ints, places: int, slots: int, flags: Ints):
    """Halt if there is no room for the surface under so many blocks, or for the impulses of so many."""
    if wp.tid() == 0 and (counts[NEAR] > places or counts[GROUNDED] > slots):
        flags[HALT] = GROW


def note_shares(flags: Ints, standing: Ints, up: Table2, grounded: Ints, near_up: Table2):
    """Where the numbers begin of the eight blocks that the tile of a block near the ground meets."""
    place, q = wp.tid()
    if flags[HALT] == 0 and standing[place] >= 0:
        near_up[place, q] = grounded[up[standing[place], q]] * SLOT


def keep_tiles(flags: Ints, cut: Rows, near: Ints, tiles: Rows):
    """The surface under the blocks that may touch it."""
    b, t = wp.tid()
    if flags[HALT] == 0 and near[b] >= 0:
        tiles[near[b], t] = cut[b, t]


def bound_columns(tiles: Rows, h: Vector, bounds: Halves):
    """How high the ground comes in each column of cells [cells], and the least upward part of its normal there.

    Within the column a spline keeps to the hull of the middle coefficient and its means with those beside it, along either axis
    (Bezier form). No steeper slope is found than between two coefficients. A thousandth covers what half precision rounds off.
    """
    place, column = wp.tid()
    around = _around(tiles, place, 4 * column)
    top = around[4]
    east = real(0.0)
    north = real(0.0)
    for i in range(3):
        middle = real(0.5) * (around[3 * i + 1] + around[4])
        for j in range(3):
            side = real(0.5) * (around[3 * i + j] + around[3 + j])
            top = wp.max(top, real(0.5) * (middle + side))
            if i > 0:
                east = wp.max(east, wp.abs(around[3 * i + j] - around[3 * i + j - 3]))
            if j > 0:
                north = wp.max(north, wp.abs(around[3 * i + j] - around[3 * i + j - 1]))
    n = upward_normal(east * h[2] / h[0], north * h[2] / h[1])
    bounds[place, 2 * column] = wp.float16(top + real(0.001) * (real(1.0) + wp.abs(top)))
    bounds[place, 2 * column + 1] = wp.float16(real(0.999) * n[2])


class Ground:
    """The sliding surfaces of the scenes of a batch on the device of the scope; scenes may share one.

    ``reach`` [m] is the distance of a particle's centre beyond which it touches the ground in no step.
    """

    def __init__(self, grounds: list[NodalSurface], spacing: tuple[float, float, float], reach: float):
        self.coefficients, starts = self._joined([g.surface.coefficients for g in grounds])
        self.changes, others = self._joined([g.change for g in grounds])
        shapes = [
            (start, *g.surface.coefficients.shape, other, *g.first, *g.change.shape)
            for start, other, g in zip(starts, others, grounds, strict=True)
        ]
        self.shapes = wp.array(np.array(shapes, np.int32), dtype=wp.int32)
        self.lattices = wp.array(np.array([(*g.surface.origin, *g.surface.spacing) for g in grounds]), dtype=wp.float64)
        self.spacing = wp.array(np.array(spacing), dtype=wp.float64)
        self.reach = reach

    @staticmethod
    def _joined(tables: list[np.ndarray]) -> tuple[wp.array, list[int]]:
        """Tables one behind the other on the device, each once, and where each begins."""
        first, kept = 0, {}
        for table in tables:
            if id(table) not in kept:
                kept[id(table)] = (first, np.ascontiguousarray(table, np.float64).ravel())
                first += table.size
        flat = np.concatenate([np.zeros(0), *(values for _, values in kept.values())])
        return wp.array(flat, dtype=wp.float64), [kept[id(table)][0] for table in tables]

    def cut(self, kernels: SimpleNamespace, index: Index, nodes: NodeArrays, shift: wp.array, h: wp.array) -> None:
        """Cut the surfaces into tiles of the blocks, and number the blocks near the ground; halts where these need more room."""
        cut, flags, counts = (
            nodes.scratch((index.capacity, 40), nodes.number),
            index.device_status.flags,
            index.device_status.counts,
        )
        run(
            kernels.cut_tiles, (index.capacity, 36), self.coefficients, self.changes, self.shapes, self.lattices, index.member,
            shift, index.coordinates, index.up, self.spacing, cut,
        )  # fmt: skip
        nodes.near.zero_(), nodes.grounded.zero_(), nodes.standing.fill_(-1)
        run(kernels.note_near, index.capacity, cut, index.up, h, nodes.number(self.reach), nodes.near, nodes.grounded)
        run(kernels.note_slopes, index.capacity, cut, index.around, nodes.ground_slopes)
        for marks, which, blocks in ((nodes.near, NEAR, nodes.standing), (nodes.grounded, GROUNDED, wp.empty(0, dtype=wp.int32))):
            wp.copy(index.sums, marks, count=index.capacity)
            wp.utils.array_scan(index.sums, index.sums, inclusive=False)
            run(kernels.number_marked, index.capacity, index.sums, marks, counts, which, blocks)
        run(kernels.require_ground, 1, counts, nodes.places, nodes.slots, flags)
        run(kernels.note_shares, (nodes.places, 8), flags, nodes.standing, index.up, nodes.grounded, nodes.near_up)
        run(kernels.keep_tiles, (index.capacity, 36), flags, cut, nodes.near, nodes.tiles)
        run(kernels.bound_columns, (nodes.places, 16), nodes.tiles, h, nodes.bounds)
