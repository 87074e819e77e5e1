"""Nodes: momentum to velocity, and the impulses of the ground."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from runout.backends.hash.index import (
    CONTACTS,
    HALT,
    ORDERED,
    Bytes,
    Doubles,
    Doubles2,
    Flags,
    Index,
    Ints,
    Nodes,
    Real,
    Reals,
    Rows,
    Shorts,
    Table2,
    Vector,
    Vectors,
    run,
)
from runout.backends.hash.transfer import MASS, MOMENTUM, OFFSET, PADDED, RADIUS, TILE, _first_node, _load, _node, node4
from runout.model.surface import Surface
from runout.physics.bspline import first_node as first_node64
from runout.physics.bspline import weight_slopes, weights
from runout.physics.bspline import weights as weights64
from runout.physics.contact import impulse, in_contact, work
from runout.physics.heightfield import distance, interpolate, normal_z
from runout.physics.heightfield import interpolate as interpolate64
from runout.physics.heightfield import quasi_interpolant as quasi_interpolant64
from runout.physics.tensors import real, vec

CLOCK_STEP = 0  # the clock on the device: time step [s], then the change of velocity by gravity [m/s]
NEAR = 2.0  # a block whose lowest node lies higher above the ground [cells] holds no contact particle

# vectors of the compiler that the binding puts in their place: one and three numbers of 27 nodes, four in float64
sums1: Any = None
sums3: Any = None
double4: Any = None


def _sum_arenas(arenas: Nodes, held: Ints, down: Table2, t: int):
    """Sum at a node over the up to eight arenas that overlap it and hold something, in a fixed order."""
    b = t >> 6
    s = node4()
    for q in range(8):
        o = down[b, q]
        x = ((t >> 4) & 3) + (q & 4)
        y = ((t >> 2) & 3) + ((q & 2) << 1)
        z = (t & 3) + ((q & 1) << 2)
        if o >= 0 and x < 6 and y < 6 and z < 6 and held[wp.max(o, 0)] > 0:
            s += arenas[o * TILE + (x * 6 + y) * 6 + z]
    return s


def note_held(cstart: Table2, held: Ints):
    """Particles of each block, for sums in fixed order."""
    b = wp.tid()
    held[b] = cstart[b, 64] - cstart[b, 0]


def update_nodes(flags: Flags, clock: Reals, arenas: Nodes, held: Ints, down: Table2, grid: Nodes):
    """Mass and velocity of every node after internal forces and gravity; nodes without mass stay at rest."""
    t = wp.tid()
    if flags[HALT] != 0:
        return
    g = grid[t]
    if ORDERED:
        g = _sum_arenas(arenas, held, down, t)
    if g[0] > real(0.0):
        i = real(1.0) / g[0]
        g = node4(g[0], g[1] * i + clock[1], g[2] * i + clock[2], g[3] * i + clock[3])
    grid[t] = g


def _surface_at(tiles: Rows, b: int, cx: int, cy: int, fx: Any, fy: Any):
    """Elevation above the block [cells] and its two slopes [cells per cell], from the 6 x 6 coefficients of a block."""
    wx = weights(fx)
    wy = weights(fy)
    dx = weight_slopes(fx)
    dy = weight_slopes(fy)
    o = cx * 6 + cy
    r0 = interpolate(wy, tiles[b, o], tiles[b, o + 1], tiles[b, o + 2])
    r1 = interpolate(wy, tiles[b, o + 6], tiles[b, o + 7], tiles[b, o + 8])
    r2 = interpolate(wy, tiles[b, o + 12], tiles[b, o + 13], tiles[b, o + 14])
    s0 = interpolate(dy, tiles[b, o], tiles[b, o + 1], tiles[b, o + 2])
    s1 = interpolate(dy, tiles[b, o + 6], tiles[b, o + 7], tiles[b, o + 8])
    s2 = interpolate(dy, tiles[b, o + 12], tiles[b, o + 13], tiles[b, o + 14])
    return interpolate(wx, r0, r1, r2), interpolate(dx, r0, r1, r2), interpolate(wx, s0, s1, s2)


def _ground(tiles: Rows, b: int, c: int, rec: Rows, p: int, h: Vector):
    """Unit normal and gap [m] of a particle in cell ``c`` of a block."""
    e, sx, sy = _surface_at(tiles, b, c >> 4, (c >> 2) & 3, rec[OFFSET, p], rec[OFFSET + 1, p])
    sx = sx * h[2] / h[0]
    sy = sy * h[2] / h[1]
    nz = normal_z(sx, sy)
    gap = distance((real(c & 3) + rec[OFFSET + 2, p] - e) * h[2], nz) - rec[RADIUS, p]
    return vec(-sx * nz, -sy * nz, nz), gap


def find_contacts(
    rec: Rows, order: Ints, cstart: Table2, up: Table2, flags: Flags, clock: Reals, tiles: Rows, highest: Reals, h: Vector,
    band: Real, touches: Bytes, touching: Ints, shares: Reals, arenas: Nodes,
):  # fmt: skip
    """Mark the particles that touch the ground, and add their weights to the nodes."""
    b, lane = wp.tid()
    if flags[HALT] != 0 or cstart[b, 0] == cstart[b, 64] or highest[b] < real(-NEAR):
        return
    tile = wp.tile_zeros(shape=TILE, dtype=real, storage="shared")
    found = int(0)
    for c in range(lane, 64, wp.block_dim()):
        acc = sums1()
        for t in range(cstart[b, c], cstart[b, c + 1]):
            p = order[t]
            n, gap = _ground(tiles, b, c, rec, p, h)
            approach = (rec[MOMENTUM, p] * n[0] + rec[MOMENTUM + 1, p] * n[1] + rec[MOMENTUM + 2, p] * n[2]) / rec[MASS, p]
            touches[p] = wp.uint8(0)
            if in_contact(gap, approach, clock[CLOCK_STEP], band):
                touches[p] = wp.uint8(1)
                found += 1
                wx = weights(rec[OFFSET, p])
                wy = weights(rec[OFFSET + 1, p])
                wz = weights(rec[OFFSET + 2, p])
                for i in range(3):
                    for j in range(3):
                        for k in range(3):
                            acc[(i * 3 + j) * 3 + k] += wx[i] * wy[j] * wz[k]
        first = _first_node(c)
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    wp.tile_scatter_add(tile, first + (i * 6 + j) * 6 + k, acc[(i * 3 + j) * 3 + k], True, False)
    all_found = wp.tile_sum(wp.tile(found))
    if lane == 0:
        touching[b] = all_found[0]
        wp.atomic_add(flags, CONTACTS, all_found[0])
    for t in range(lane, TILE, wp.block_dim()):
        s = tile[t]
        if ORDERED:
            arenas[b * TILE + t] = node4(s, real(0.0), real(0.0), real(0.0))
        elif s != real(0.0):
            wp.atomic_add(shares, _node(up, b, t), s)


def sum_shares(flags: Flags, arenas: Nodes, touching: Ints, down: Table2, shares: Reals):
    """Weights of the contact particles at each node, in fixed order."""
    t = wp.tid()
    if flags[HALT] == 0:
        shares[t] = _sum_arenas(arenas, touching, down, t)[0]


def sum_pushes(flags: Flags, arenas: Nodes, touching: Ints, down: Table2, pushes: Vectors):
    """Impulses of the contact particles at each node, in fixed order."""
    t = wp.tid()
    if flags[HALT] == 0:
        s = _sum_arenas(arenas, touching, down, t)
        pushes[t] = vec(s[1], s[2], s[3])


def _book(booked: Doubles2, b: int, done: Any):
    for d in range(4):
        booked[b, d + 1] = booked[b, d + 1] + done[d]


def _load_compliances(tile: Any, grid: Nodes, shares: Reals, up: Table2, b: int, lane: int):
    """Sum of the contact weights over mass [1/kg] at the nodes that the particles of a block reach."""
    for q in range(PADDED // wp.block_dim()):
        t = q * wp.block_dim() + lane
        a = real(0.0)
        if t < TILE:
            n = _node(up, b, t)
            m = grid[n][0]
            if m > real(0.0):
                a = shares[n] / m
        wp.tile_scatter_add(tile, t, a, t < TILE, False)


def _contact_velocity(velocities: Any, compliances: Any, first: int, wx: Vector, wy: Vector, wz: Vector):
    """Velocity that a particle would receive, and its lumped compliance [1/kg]."""
    u = vec(real(0.0), real(0.0), real(0.0))
    compliance = real(0.0)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                n = first + (i * 6 + j) * 6 + k
                w = wx[i] * wy[j] * wz[k]
                g = velocities[n]
                u += vec(w * g[1], w * g[2], w * g[3])
                compliance += w * compliances[n]
    return u, compliance


def solve_contacts(
    rec: Rows, release: Shorts, order: Ints, cstart: Table2, up: Table2, flags: Flags, clock: Reals, tiles: Rows, h: Vector,
    friction: Reals, touches: Bytes, touching: Ints, grid: Nodes, shares: Reals, pushes: Vectors, arenas: Nodes, booked: Doubles2,
):  # fmt: skip
    """One impulse per contact particle, spread to the nodes; ``booked`` (blocks, 5) adds up work [J] and impulse [N s]."""
    b, lane = wp.tid()
    if flags[HALT] != 0 or touching[b] == 0:
        return
    velocities = wp.tile_zeros(shape=PADDED, dtype=node4, storage="shared")
    _load(velocities, grid, pushes, 0, up, b, lane)
    compliances = wp.tile_zeros(shape=PADDED, dtype=real, storage="shared")
    _load_compliances(compliances, grid, shares, up, b, lane)
    tile = wp.tile_zeros(shape=TILE, dtype=vec, storage="shared")
    done = double4()
    for c in range(lane, 64, wp.block_dim()):
        acc = sums3()
        first = _first_node(c)
        for t in range(cstart[b, c], cstart[b, c + 1]):
            p = order[t]
            if touches[p] != wp.uint8(0):
                wx = weights(rec[OFFSET, p])
                wy = weights(rec[OFFSET + 1, p])
                wz = weights(rec[OFFSET + 2, p])
                u, compliance = _contact_velocity(velocities, compliances, first, wx, wy, wz)
                n, gap = _ground(tiles, b, c, rec, p, h)
                push = impulse(u, n, gap, compliance, friction[int(release[p])], clock[CLOCK_STEP])
                m = rec[MASS, p]
                before = vec(rec[MOMENTUM, p] / m, rec[MOMENTUM + 1, p] / m, rec[MOMENTUM + 2, p] / m)
                w = wp.float64(work(push, before, u, compliance))
                done += double4(w, wp.float64(push[0]), wp.float64(push[1]), wp.float64(push[2]))
                for i in range(3):
                    for j in range(3):
                        for k in range(3):
                            for d in range(3):
                                acc[(i * 3 + j) * 3 + k, d] += wx[i] * wy[j] * wz[k] * push[d]
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    a = (i * 3 + j) * 3 + k
                    wp.tile_scatter_add(tile, first + (i * 6 + j) * 6 + k, vec(acc[a, 0], acc[a, 1], acc[a, 2]), True, False)
    all_done = wp.tile_sum(wp.tile(done, preserve_type=True))
    if lane == 0:
        _book(booked, b, all_done[0])
    for t in range(lane, TILE, wp.block_dim()):
        s = tile[t]
        if ORDERED:
            arenas[b * TILE + t] = node4(real(0.0), s[0], s[1], s[2])
        elif s[0] != real(0.0) or s[1] != real(0.0) or s[2] != real(0.0):
            wp.atomic_add(pushes, _node(up, b, t), s)


def _surface_value(coefficients: Doubles2, qx: wp.float64, qy: wp.float64):
    """Elevation [m] at lattice position (qx, qy)."""
    i = wp.clamp(first_node64(qx), 0, coefficients.shape[0] - 3)
    j = wp.clamp(first_node64(qy), 0, coefficients.shape[1] - 3)
    wx = weights64(qx - wp.float64(i))
    wy = weights64(qy - wp.float64(j))
    r0 = interpolate64(wy, coefficients[i, j], coefficients[i, j + 1], coefficients[i, j + 2])
    r1 = interpolate64(wy, coefficients[i + 1, j], coefficients[i + 1, j + 1], coefficients[i + 1, j + 2])
    r2 = interpolate64(wy, coefficients[i + 2, j], coefficients[i + 2, j + 1], coefficients[i + 2, j + 2])
    return interpolate64(wx, r0, r1, r2)


def _north_south(coefficients: Doubles2, qx: wp.float64, qy: wp.float64, ay: wp.float64):
    south = _surface_value(coefficients, qx, qy - ay)
    return quasi_interpolant64(south, _surface_value(coefficients, qx, qy), _surface_value(coefficients, qx, qy + ay))


def cut_tiles(coefficients: Doubles2, lattice: Doubles, coordinates: Table2, nall: int, h: Doubles, tiles: Rows, highest: Reals):
    """Surface coefficients on the nodes of each block, relative to its lowest node [cells], and the highest of them.

    The surface is sampled at the nodes in float64, so that float32 keeps the gap of a particle to 1e-7 cells.
    """
    b, t = wp.tid()
    if b >= nall:
        return
    qx = (wp.float64(4 * coordinates[b, 0] + t // 6) * h[0] - lattice[0]) / lattice[2]
    qy = (wp.float64(4 * coordinates[b, 1] + t % 6) * h[1] - lattice[1]) / lattice[3]
    ax = h[0] / lattice[2]
    ay = h[1] / lattice[3]
    west = _north_south(coefficients, qx - ax, qy, ay)
    here = _north_south(coefficients, qx, qy, ay)
    e = quasi_interpolant64(west, here, _north_south(coefficients, qx + ax, qy, ay))
    c = real(e / h[2] - wp.float64(4 * coordinates[b, 2]))
    tiles[b, t] = c
    wp.atomic_max(highest, b, c)


class NodeArrays:
    """Arrays by block on the device of the scope: nodes, the ground under them and what is booked there.

    Attributes
    ----------
    grid : (64 room,) four numbers
        Mass [kg] and momentum [kg m/s], then velocity [m/s].
    shares, pushes : (64 room,)
        Sum of the weights of the contact particles; impulse of the ground [N s]. Empty without a ground.
    tiles, highest : (room, 36), (room,)
        Coefficients of the surface relative to the block's lowest node, and the highest of them [cells].
    arenas : (216 room,) four numbers
        Sums of each block, for sums in fixed order; else empty.
    booked : (room, 5) float64
        Plastic dissipation and work of the ground [J], impulse of the ground [N s].
    """

    def __init__(self, room: int, number: Any, ground: bool, ordered: bool):
        vec4, vec3 = (wp.types.vector(length=length, dtype=number) for length in (4, 3))
        self.grid = wp.zeros(room * 64, dtype=vec4)
        self.arenas = wp.zeros(room * TILE * ordered, dtype=vec4)
        self.pushes, self.shares = wp.zeros(room * 64 * ground, dtype=vec3), wp.zeros(room * 64 * ground, dtype=number)
        self.tiles, self.highest = wp.zeros((room * ground, 36), dtype=number), wp.zeros(room * ground, dtype=number)
        self.touching, self.held = wp.zeros(room, dtype=wp.int32), wp.zeros(room, dtype=wp.int32)
        self.booked = wp.zeros((room, 5), dtype=wp.float64)


class Ground:
    """The sliding surface on the device of the scope."""

    def __init__(self, surface: Surface, spacing: tuple[float, float, float]):
        self.coefficients = wp.array(np.ascontiguousarray(surface.coefficients, np.float64), dtype=wp.float64)
        self.lattice = wp.array(np.array([*surface.origin, *surface.spacing]), dtype=wp.float64)
        self.spacing = wp.array(np.array(spacing), dtype=wp.float64)

    def cut(self, kernels: SimpleNamespace, index: Index, nodes: NodeArrays) -> None:
        """Cut the surface into tiles of the blocks."""
        nodes.highest.fill_(-1e30)
        run(
            kernels.cut_tiles, (index.room, 36), self.coefficients, self.lattice, index.coordinates, index.nall, self.spacing,
            nodes.tiles, nodes.highest,
        )  # fmt: skip
