"""The sliding surface on the device: cut into tiles of the blocks, and the blocks that may touch it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from runout.backends.hash.contact_solution import _around
from runout.backends.hash.grid import NodeArrays
from runout.backends.hash.groups import (
    BlockGroup,
    Constants,
    GroundGroup,
    ParticleGroup,
    SceneGroup,
    StatusGroup,
    SurfaceGroup,
    filled,
    groups_of,
)
from runout.backends.hash.index import Index
from runout.backends.hash.layout import (
    GROUNDED,
    GROW,
    HALT,
    NEAR,
    OFFSET,
    SLOT,
    Doubles,
    Doubles2,
    Ints,
    Real,
    Rows,
    lane_count,
    node4,
    own_block,
    own_lane,
    run,
)
from runout.backends.hash.limits import require_index
from runout.backends.hash.scenes import SceneArrays
from runout.model.nodal_surface import NodalSurface
from runout.physics.bed import chance_at as chance_at64
from runout.physics.bed import sunk as sunk64
from runout.physics.bspline import first_node as first_node64
from runout.physics.heightfield import bend_smoothness as bend_smoothness64
from runout.physics.heightfield import distance, upward_normal
from runout.physics.heightfield import normal_z as normal_z64
from runout.physics.heightfield import resampled_coefficient as resampled_coefficient64
from runout.physics.heightfield import surface_at as surface_at64
from runout.physics.tensors import real
from runout.physics.tensors import tens as tens64

sum_before: Any = None  # sums over the lanes before a lane, and over all; the binding puts it in its place

LINES = 3  # along which the surface is sampled for a coefficient of a tile


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


def _change_at(surface: SurfaceGroup, s: int, m: int, n: int):
    """Change [m] of the coefficient of node (m, n) of a scene; zero outside the table of changes."""
    i = m - surface.shapes[s, 4]
    j = n - surface.shapes[s, 5]
    if i < 0 or j < 0 or i >= surface.shapes[s, 6] or j >= surface.shapes[s, 7]:
        return wp.float64(0.0)
    return surface.changes[surface.shapes[s, 3] + i * surface.shapes[s, 7] + j]


def cut_tiles(blocks: BlockGroup, scenes: SceneGroup, surface: SurfaceGroup, cut: Rows, lines: int):
    """Surface coefficients on the nodes of each block that may hold particles, relative to its lowest node [cells].

    The surface is sampled at the nodes in float64, so that float32 keeps the gap of a particle to 1e-7 cells. It is sampled along
    ``lines``, which are three; the compiler does not know their number: it would load the samples of all at once, and spill.
    """
    b, t = wp.tid()
    if blocks.up[b, 0] < 0:
        return
    s = blocks.member[b]
    first = surface.shapes[s, 0]
    nx = surface.shapes[s, 1]
    ny = surface.shapes[s, 2]
    m = 4 * blocks.coordinates[b, 0] + t // 6
    n = 4 * blocks.coordinates[b, 1] - scenes.shift[s] + t % 6
    h = surface.spacing
    lattices = surface.lattices
    qx = (wp.float64(m) * h[0] - lattices[s, 0]) / lattices[s, 2]
    qy = (wp.float64(n) * h[1] - lattices[s, 1]) / lattices[s, 3]
    ax = wp.float64(0.5) * h[0] / lattices[s, 2]
    ay = wp.float64(0.5) * h[1] / lattices[s, 3]
    before = _sample(surface.coefficients, first, nx, ny, qx - ax - ax, qy)
    west, here, east = wp.float64(0.0), wp.float64(0.0), wp.float64(0.0)
    slope_west, slope, slope_east = wp.float64(0.0), wp.float64(0.0), wp.float64(0.0)
    for k in range(lines):
        west, slope_west = here, slope
        here, slope = east, slope_east
        east, slope_east = _along_north(surface.coefficients, first, nx, ny, qx + wp.float64(k - 1) * ax, qy, ay)
    after = _sample(surface.coefficients, first, nx, ny, qx + ax + ax, qy)
    smooth = bend_smoothness64(before[1], slope_west, slope, slope_east, after[1])
    e = resampled_coefficient64(west, here, east, smooth) + _change_at(surface, s, m, n)
    cut[b, t] = real(e / h[2] - wp.float64(4 * blocks.coordinates[b, 2]))


def clear_marks(ground: GroundGroup):
    """No block is near the ground. A mark is a number that is not negative, which ``number_marked`` replaces by another such."""
    b = wp.tid()
    if b < ground.near.shape[0]:
        ground.near[b] = -1
        ground.grounded[b] = -1
    if b < ground.standing.shape[0]:
        ground.standing[b] = -1


def note_near(blocks: BlockGroup, ground: GroundGroup, constants: Constants, reach: Real, cut: Rows):
    """Blocks whose particles may come within ``reach`` [m] of the ground, and the blocks of the nodes that these reach.

    A spline keeps to the hull of its coefficients, and no other slope is found than between two of them: the least east and north
    and the largest are noted behind them.
    """
    b = wp.tid()
    low = node4(real(wp.inf), real(wp.inf), -real(wp.inf), -real(wp.inf))
    for i in range(4):
        cut[b, 36 + i] = low[i]
    if blocks.up[b, 0] < 0:
        return
    top = cut[b, 0]
    for t in range(36):
        top = wp.max(top, cut[b, t])
        if t >= 6:
            east = (cut[b, t] - cut[b, t - 6]) * constants.h[2] / constants.h[0]
            low[0] = wp.min(low[0], east)
            low[2] = wp.max(low[2], east)
        if t % 6 > 0:
            north = (cut[b, t] - cut[b, t - 1]) * constants.h[2] / constants.h[1]
            low[1] = wp.min(low[1], north)
            low[3] = wp.max(low[3], north)
    for i in range(4):
        cut[b, 36 + i] = low[i]
    n = upward_normal(wp.max(wp.abs(low[0]), wp.abs(low[2])), wp.max(wp.abs(low[1]), wp.abs(low[3])))
    if distance((real(0.5) - top) * constants.h[2], n[2]) <= reach:
        ground.near[b] = 0
        for q in range(8):
            ground.grounded[blocks.up[b, q]] = 0


def note_slopes(blocks: BlockGroup, ground: GroundGroup, cut: Rows):
    """Middle of the slopes of the ground under a block and those around it, and how far any lies from it."""
    b = wp.tid()
    found = node4(cut[b, 36], cut[b, 37], cut[b, 38], cut[b, 39])
    for q in range(27):
        other = blocks.around[b, q]
        if other >= 0:
            for i in range(2):
                found[i] = wp.min(found[i], cut[other, 36 + i])
                found[i + 2] = wp.max(found[i + 2], cut[other, 38 + i])
    if found[0] <= found[2]:  # else no particle comes here
        for i in range(2):
            middle = real(0.5) * (found[i] + found[i + 2])
            found[i] = middle
            found[i + 2] = found[i + 2] - middle + real(1e-5) * (real(1.0) + wp.abs(middle))  # with a reserve for rounding
        ground.slopes[b] = found


def note_marks(blocks: BlockGroup, marks: Ints):
    """One for each marked block, zero for the others, to be summed."""
    b = wp.tid()
    blocks.sums[b] = wp.where(marks[b] >= 0, 1, 0)


def _number_mark(status: StatusGroup, blocks: BlockGroup, marks: Ints, which: int, room: int, marked: Ints, b: int, place: int):
    """Give a block its ``place`` if it is marked; the last block knows how many are."""
    mark = wp.where(marks[b] >= 0, 1, 0)
    if b == blocks.sums.shape[0] - 2:
        status.counts[which] = place + mark
        if place + mark > room:
            status.flags[HALT] = GROW
    if mark != 0:
        marks[b] = place
        if place < marked.shape[0]:
            marked[place] = b


def number_marked(
    status: StatusGroup, blocks: BlockGroup, marks: Ints, which: int, room: int, marked: Ints, summed: int, launched: int,
):  # fmt: skip
    """Number the marked blocks in their order, and count them; halt if there is no ``room`` for so many.

    If ``summed``, ``blocks.sums`` are the sums of the marks over the blocks before; else a warp a block counts them: a mark that is
    numbered stays a mark. ``marked`` receives the block of each number that it has room for.
    """
    b, lane = wp.tid()
    b, lane = own_block(b), own_lane(lane)
    last = blocks.sums.shape[0] - 1
    if summed != 0:
        for own in range(b * lane_count() + lane, last, launched * lane_count()):
            _number_mark(status, blocks, marks, which, room, marked, own, blocks.sums[own])
    elif marks[b] >= 0 or b == last - 1:
        before = int(0)
        for other in range(lane, b, lane_count()):
            before += wp.where(marks[other] >= 0, 1, 0)
        place = sum_before(before)[1]
        if lane == 0:
            _number_mark(status, blocks, marks, which, room, marked, b, place)


def note_shares(status: StatusGroup, blocks: BlockGroup, ground: GroundGroup):
    """Where the numbers begin of the eight blocks that the tile of a block near the ground meets."""
    place, q = wp.tid()
    if status.flags[HALT] == 0 and ground.standing[place] >= 0:
        ground.near_up[place, q] = ground.grounded[blocks.up[ground.standing[place], q]] * SLOT


def keep_tiles(status: StatusGroup, ground: GroundGroup, cut: Rows):
    """The surface under the blocks that may touch it."""
    b, t = wp.tid()
    if status.flags[HALT] == 0 and ground.near[b] >= 0:
        ground.tiles[ground.near[b], t] = cut[b, t]


def bound_columns(ground: GroundGroup, constants: Constants):
    """How high the ground comes in each column of cells [cells], and the least upward part of its normal there.

    Within the column a spline keeps to the hull of the middle coefficient and its means with those beside it, along either axis
    (Bezier form). No steeper slope is found than between two coefficients. A thousandth covers what half precision rounds off.
    """
    place, column = wp.tid()
    around = _around(ground.tiles, place, 4 * column)
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
    n = upward_normal(east * constants.h[2] / constants.h[0], north * constants.h[2] / constants.h[1])
    ground.bounds[place, 2 * column] = wp.float16(top + real(0.001) * (real(1.0) + wp.abs(top)))
    ground.bounds[place, 2 * column + 1] = wp.float16(real(0.999) * n[2])


def _place_in(table: Doubles2, i: int, j: int):
    """A place of a table (nx, ny) [m], nothing beyond it."""
    if i < 0 or j < 0 or i >= table.shape[0] or j >= table.shape[1]:
        return wp.float64(0.0)
    return table[i, j]


def _column_at(table: Doubles2, i: int, j: int, fx: wp.float64, fy: wp.float64):
    """Value of a table (nx, ny) [m] and its slopes [m / cell] at a place, from the nodes around (i + 1, j + 1)."""
    nine = tens64(
        _place_in(table, i, j), _place_in(table, i, j + 1), _place_in(table, i, j + 2),
        _place_in(table, i + 1, j), _place_in(table, i + 1, j + 1), _place_in(table, i + 1, j + 2),
        _place_in(table, i + 2, j), _place_in(table, i + 2, j + 1), _place_in(table, i + 2, j + 2),
    )  # fmt: skip
    return surface_at64(nine, fx, fy)


def sink(
    particles: ParticleGroup, blocks: BlockGroup, scenes: SceneGroup, constants: Constants, depth: Doubles2, floor: Doubles2,
    s: int, east: int, north: int, turn: wp.float64,
):  # fmt: skip
    """Let the particles of a scene sink as their ground falls (:func:`runout.physics.bed.sunk`), each in its cell.

    Tables (nx, ny) [m] from node (``east``, ``north``) on: by how much the ground falls, and its coefficients before.
    """
    p = wp.tid()
    k = particles.key[p]
    b = wp.max(k, 0) >> 6
    if k < 0 or blocks.member[b] != s:
        return
    i = 4 * blocks.coordinates[b, 0] + ((k >> 4) & 3) - east
    j = 4 * blocks.coordinates[b, 1] + ((k >> 2) & 3) - scenes.shift[s] - north
    if i <= -3 or j <= -3 or i >= depth.shape[0] or j >= depth.shape[1]:
        return
    fx, fy = wp.float64(particles.rec[OFFSET, p]), wp.float64(particles.rec[OFFSET + 1, p])
    fz, h = wp.float64(particles.rec[OFFSET + 2, p]), constants.h
    base = _column_at(floor, i, j, fx, fy)
    touching = wp.float64(particles.radius[p]) / normal_z64(base[1] / wp.float64(h[0]), base[2] / wp.float64(h[1]))
    height = (wp.float64(4 * blocks.coordinates[b, 2] + (k & 3)) + fz) * wp.float64(h[2]) - base[0]
    chance = chance_at64(wp.float64(i + east) + fx, wp.float64(j + north) + fy, turn)
    way = sunk64(height, _column_at(depth, i, j, fx, fy)[0], touching, chance)
    particles.rec[OFFSET + 2, p] = real(wp.max(fz - way / wp.float64(h[2]), wp.float64(0.5)))


class Ground:
    """The sliding surfaces of the scenes of a batch on the device of the scope; scenes may share one.

    ``reach`` [m] is the distance of a particle's centre beyond which it touches the ground in no step.
    """

    def __init__(self, grounds: list[NodalSurface], spacing: tuple[float, float, float], reach: float, number: Any):
        self.coefficients, starts = self._joined([g.surface.coefficients for g in grounds])
        self.changes, self.first_change = self._joined([g.change for g in grounds])
        shapes = [
            (start, *g.surface.coefficients.shape, other, *g.first, *g.change.shape)
            for start, other, g in zip(starts, self.first_change, grounds, strict=True)
        ]
        self.shapes = wp.array(np.array(shapes, np.int32), dtype=wp.int32)
        self.lattices = wp.array(np.array([(*g.surface.origin, *g.surface.spacing) for g in grounds]), dtype=wp.float64)
        self.spacing = wp.array(np.array(spacing), dtype=wp.float64)
        self.reach = reach
        self.group = filled(groups_of(number).SurfaceGroup, self)

    @staticmethod
    def _joined(tables: list[np.ndarray]) -> tuple[wp.array, list[int]]:
        """Tables one behind the other on the device, each once, and where each begins."""
        first, kept = 0, {}
        for table in tables:
            if id(table) not in kept:
                kept[id(table)] = (first, np.ascontiguousarray(table, np.float64).ravel())
                first += table.size
                require_index(first, "nodes of the ground")
        flat = np.concatenate([np.zeros(0), *(values for _, values in kept.values())])
        return wp.array(flat, dtype=wp.float64), [kept[id(table)][0] for table in tables]

    def take_changes(self, ground: NodalSurface, row: int, rows: int, scene: int = 0) -> None:
        """Bring so many rows of the changes of a scene's ``ground`` from the first ``row`` on to the device."""
        first, width = self.first_change[scene], ground.change.shape[1]
        values = np.ascontiguousarray(ground.change[row : row + rows]).ravel()
        self.changes[first + row * width : first + (row + rows) * width].assign(values)

    def cut(self, k: SimpleNamespace, index: Index, nodes: NodeArrays, scenes: SceneArrays) -> None:
        """Cut the surfaces into tiles of the blocks, and number the blocks near the ground; halts where these need more room."""
        cut, status, ground = nodes.scratch((index.capacity, 40), nodes.number), index.status.group, nodes.ground_group
        run(k.cut_tiles, (index.capacity, 36), index.block_group, scenes.group, self.group, cut, LINES)
        run(k.clear_marks, max(index.capacity, nodes.places), ground)
        run(k.note_near, index.capacity, index.block_group, ground, scenes.constants, nodes.number(self.reach), cut)
        run(k.note_slopes, index.capacity, index.block_group, ground, cut)
        index.number_marked(nodes.near, NEAR, nodes.places, nodes.standing)
        index.number_marked(nodes.grounded, GROUNDED, nodes.slots, nodes.nothing)
        run(k.note_shares, (nodes.places, 8), status, index.block_group, ground)
        run(k.keep_tiles, (index.capacity, 36), status, ground, cut)
        run(k.number_columns, nodes.columns.shape[0], status, index.block_group, nodes.contact_group)
        run(k.number_upper_columns, 4 * nodes.columns.shape[0], status, index.block_group, nodes.contact_group)
        run(k.number_beside, nodes.beside.size, status, index.block_group, nodes.contact_group, nodes.column_group)
        run(k.bound_columns, (nodes.places, 16), ground, scenes.constants)
