"""Grid to particles where gradients use the slopes of the weights, dilatation is averaged, or particles keep some motion.

These are scenes with transfer apic or aflip, or with F-bar. Their clock holds a factor for each choice; zero switches it off.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.deform import _gather, _moments, _particle_of, _slopes, _store
from runout.backends.hash.groups import BlockGroup, Constants, GridGroup, ParticleGroup, SceneGroup, StatusGroup
from runout.backends.hash.layout import (
    ACTIVE,
    AFFINE,
    AVERAGED,
    BLOCKS,
    BY_SLOPES,
    CELL_LANES,
    HALT,
    HALVES,
    KEPT,
    MASS,
    MOMENTUM,
    NOT_NEGATIVE,
    OFFSET,
    ORDERED,
    PADDED,
    TILE,
    VOLUME,
    WIDE,
    WIDE_X,
    WIDE_Y,
    Nodes,
    Rows,
    Table2,
    Tile,
    Vector,
    lane_count,
    node4,
    node_at,
    sums4,
)
from runout.backends.hash.stencil import (
    _add_cell,
    _first_node,
    _give_tile,
    _node,
    _set_bases,
    _sum_arenas,
    _wide_block,
    _wide_node,
    _wide_place,
)
from runout.physics.bspline import moment_slopes, weight_slopes, weights
from runout.physics.elastic import kirchhoff_stress
from runout.physics.moments import affine_columns, stress_columns, velocity_gradient
from runout.physics.plastic import step as law_update
from runout.physics.tensors import real, vec
from runout.physics.transfers import dilatation, gradient_slope, kept_velocity, slip_moment, slip_velocity, with_dilatation


def _cells(dt: Any, h: Vector):
    """Factors dt / h [s/m] by axis."""
    return vec(gradient_slope(dt, h[0]), gradient_slope(dt, h[1]), gradient_slope(dt, h[2]))


def _slopes_at(f: Any, by_slopes: Any):
    """Slopes of the three weights of an axis [1 / cell], or those of the packed form."""
    s = moment_slopes(f)
    if by_slopes > real(0.0):
        s = weight_slopes(f)
    return s


def _rate(f: Any, tile: Tile, first: int, stride_x: int, stride_y: int, cells: Any, by_slopes: Any):
    """Velocity gradient times the step [1] from the 27 nodes at place ``first`` of a tile with such strides."""
    wx = weights(f[0])
    wy = weights(f[1])
    wz = weights(f[2])
    ax = _slopes_at(f[0], by_slopes)
    ay = _slopes_at(f[1], by_slopes)
    az = _slopes_at(f[2], by_slopes)
    _v, x, y, z = _moments(tile, first, stride_x, stride_y, wx, wy, wz, ax, ay, az)
    return velocity_gradient(x, y, z, cells)


def _mean(f: Any, tile: Tile, first: int):
    """Weighted mean of the first number of the 27 nodes at place ``first`` of a wide tile."""
    wx = weights(f[0])
    wy = weights(f[1])
    wz = weights(f[2])
    mean = real(0.0)
    for i in range(3):
        for j in range(3):
            s = real(0.0)
            for k in range(3):
                g = tile[first + i * WIDE_X + j * WIDE_Y + k]
                s += wz[k] * g[0]
            mean += wx[i] * wy[j] * s
    return mean


def _given_node(grid: Nodes, around: Table2, b: int, t: int):
    """Velocity that particles gave to node ``t`` of the 8 x 8 x 8 around a block: it lies behind the nodes of all blocks."""
    o = _wide_block(around, b, t)
    return _wide_node(grid, wp.where(o >= 0, o + around.shape[0], o), t)


def _load_given(seen: Tile, grid: Nodes, around: Table2, b: int, lane: int, keeps: Any):
    """Velocities that particles gave to the nodes around a block, where they keep slips; a lane loads four at once."""
    lanes = lane_count()
    for q in range(wp.where(keeps > real(0.0), WIDE // lanes // 4, 0)):
        t = 4 * q * lanes + lane
        u0 = _given_node(grid, around, b, t)
        u1 = _given_node(grid, around, b, t + lanes)
        u2 = _given_node(grid, around, b, t + 2 * lanes)
        u3 = _given_node(grid, around, b, t + 3 * lanes)
        wp.tile_scatter_masked(seen, _wide_place(t), u0, True)
        wp.tile_scatter_masked(seen, _wide_place(t + lanes), u1, True)
        wp.tile_scatter_masked(seen, _wide_place(t + 2 * lanes), u2, True)
        wp.tile_scatter_masked(seen, _wide_place(t + 3 * lanes), u3, True)


def _with_slips(rec: Rows, p: int, f: Vector, seen: Tile, first: int, v: Vector, x: Vector, y: Vector, z: Vector, keeps: Any):
    """Velocity and first moments [m/s] with the part ``keeps`` of what the nodes had not seen of a particle's own."""
    m = rec[MASS, p]
    u, ux, uy, uz = _gather(f, seen, first, WIDE_X, WIDE_Y)
    c = affine_columns(real(1.0), ux, uy, uz)
    slip = slip_velocity(vec(rec[MOMENTUM, p] / m, rec[MOMENTUM + 1, p] / m, rec[MOMENTUM + 2, p] / m), u)
    sx = slip_moment(vec(rec[AFFINE, p], rec[AFFINE + 1, p], rec[AFFINE + 2, p]), m, vec(c[0], c[1], c[2]))
    sy = slip_moment(vec(rec[AFFINE + 3, p], rec[AFFINE + 4, p], rec[AFFINE + 5, p]), m, vec(c[3], c[4], c[5]))
    sz = slip_moment(vec(rec[AFFINE + 6, p], rec[AFFINE + 7, p], rec[AFFINE + 8, p]), m, vec(c[6], c[7], c[8]))
    return (
        kept_velocity(v, slip, keeps),
        kept_velocity(x, sx, keeps),
        kept_velocity(y, sy, keeps),
        kept_velocity(z, sz, keeps),
    )


def _deform_by_rates(
    particles: ParticleGroup, scenes: SceneGroup, constants: Constants, p: int, room: Tile, staged: int, tile: Tile,
    seen: Tile, first: int, mat: Any, cells: Any, s: int,
):  # fmt: skip
    """As ``_deform``; returns offset, velocity of the nodes, own velocity and dissipated energy [J].

    Records of a scene by gradients of the weights hold no stress. ``cells`` = dt / h [s/m]; the first number of a node is its
    mean dilatation.
    """
    rec = particles.rec
    m, volume, history, B, f = _particle_of(room, staged)
    v, x, y, z = _gather(f, tile, first, WIDE_X, WIDE_Y)
    L = _rate(f, tile, first, WIDE_X, WIDE_Y, cells, scenes.clock[s, BY_SLOPES])
    L = with_dilatation(L, _mean(f, tile, first), scenes.clock[s, AVERAGED])
    B, log, history, work = law_update(B, L, history, mat)
    stressed_dt = scenes.clock[s, 0] * (real(1.0) - scenes.clock[s, BY_SLOPES])
    packed = stress_columns(kirchhoff_stress(log, mat), volume, _slopes(stressed_dt, constants.h))
    own = v * real(1.0)
    if scenes.clock[s, KEPT] > real(0.0):
        own, x, y, z = _with_slips(rec, p, f, seen, first, v, x, y, z, scenes.clock[s, KEPT])
    _store(rec, p, m, own, affine_columns(m, x, y, z), packed, B, history)
    return f, v, own, work * volume


def _sum_dilatations(particles: ParticleGroup, tile: Tile, corner: int, first: int, last: int, cells: Any, by_slopes: Any):
    """Volume and volume times dilatation that the particles at some places of the list hand to the 27 nodes of their cell."""
    acc = sums4()
    for t in range(first, last):
        p = particles.order[t] & NOT_NEGATIVE
        f = vec(particles.rec[OFFSET, p], particles.rec[OFFSET + 1, p], particles.rec[OFFSET + 2, p])
        volume = particles.rec[VOLUME, p] * real(1.0)
        change = volume * dilatation(_rate(f, tile, corner, 36, 6, cells, by_slopes))
        wx = weights(f[0])
        wy = weights(f[1])
        wz = weights(f[2])
        for i in range(3):
            for j in range(3):
                wij = wx[i] * wy[j]
                for k in range(3):
                    w = wij * wz[k]
                    acc[(i * 3 + j) * 3 + k, 0] += w * volume
                    acc[(i * 3 + j) * 3 + k, 1] += w * change
    return acc


def spread_dilatation(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, grid: GridGroup, scenes: SceneGroup,
    constants: Constants, launched: int,
):  # fmt: skip
    """Volume and volume times dilatation of the particles to the nodes. In fixed order, each block only fills its own arena."""
    begin, lane = wp.tid()
    if status.flags[HALT] != 0:
        return
    for a in range(begin, status.tally[ACTIVE], launched):
        b = blocks.active[a]
        s = blocks.member[b]
        if scenes.clock[s, 0] > real(0.0):
            cells = _cells(scenes.clock[s, 0], constants.h)
            bases = wp.tile_empty(shape=8, dtype=int, storage="shared")
            _set_bases(bases, blocks.up, b, lane)
            velocities = wp.tile_zeros(shape=PADDED, dtype=node4, storage="shared")
            for q in range(PADDED // lane_count()):
                t = q * lane_count() + lane
                u = node4()
                if t < TILE:
                    u = node_at(grid.nodes, _node(bases, t))
                wp.tile_scatter_masked(velocities, t, u, True)
            tile = wp.tile_zeros(shape=HALVES, dtype=node4, storage="shared")
            for c in range(lane, CELL_LANES, lane_count()):
                first = _first_node(c)
                begins, ends = blocks.cstart[b, c], blocks.cstart[b, c + 1]
                acc = _sum_dilatations(particles, velocities, first, begins, ends, cells, scenes.clock[s, BY_SLOPES])
                _add_cell(tile, c, acc)
            _give_tile(tile, grid.arenas, grid.dilated, bases, b, lane, 0)


def average_dilatation(status: StatusGroup, blocks: BlockGroup, grid: GridGroup):
    """Put the mean dilatation of each node in the place of its mass, which nothing reads any more in this step."""
    t = wp.tid()
    if status.flags[HALT] != 0 or (t >> 6) >= status.tally[BLOCKS]:
        return
    if ORDERED:
        s = _sum_arenas(blocks, grid, grid.held, t)
    else:
        s = grid.dilated[t] * real(1.0)
        grid.dilated[t] = node4()
    mean = real(0.0)
    if s[0] > real(0.0):
        mean = s[1] / s[0]
    g = grid.nodes[t]
    grid.nodes[t] = node4(mean, g[1], g[2], g[3])
