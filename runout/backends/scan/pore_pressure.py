"""Pore pressure of the particles (:mod:`runout.physics.pore_pressure`), in scenes where a mass has any.

    grid.nodes, grid.inverse     mass of the nodes            --sum over the blocks of a column-->
    layers.areal[c, 16]          mass by area in plan of 16 columns of nodes of block column c
    layers.upward[b, 16]         upward part of the normal of the ground at the middle columns; changes with the tiles of the ground
      --middle column of each column of cells-->
    layers.fading[c, r, 16]      share of the excess left after half a step, for release r in 16 columns of cells of block column c:
                                 one where no mass drains by the thickness of its layer: it is the same for all
    pores.left, pores.excess     by particle, which never moves: the part that remains; the excess at the start, one number if alike
    pores.present                by slot, between the substeps of a transfer: what remains, excess and release where these differ
    contacts.drained             by contact, likewise: a contact keeps its particle during a transfer
      --fading-->
    share of the normal stress that grains carry, in the middle of a step: in contacts, and in the row EFFECTIVE of a tile

A particle takes the layer at the middle one of the columns of nodes around it. The part that remains is advanced where the law of
the particle is followed, at the end of each substep. Where no mass drains by its thickness, the particles of a release drain alike:
one number is left for each release, advanced after the substep (:func:`runout.backends.scan.grid.advance_pores`), until particles
join with another one.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import prange

from runout.backends.lanes import load4, load16, local_array, looked_up, prefetch, select, store
from runout.backends.scan.groups import Blocks
from runout.backends.scan.node_columns import block_columns
from runout.backends.scan.particles_to_grid import PLAN, heads
from runout.backends.scan.stencil import ones, zeros
from runout.backends.scan.tile import EFFECTIVE, TILE
from runout.model.scene import Scene
from runout.physics.heightfield import normal_z, surface_at
from runout.physics.pore_pressure import drainage_rate, effective_share, layer_thickness, remaining_share, share_left
from runout.physics.tensors import real

LASTS = False  # whether the transfer goes on after this substep; the binding decides
LEFT, SHARE, EXCESS, STAYS, CLOSES = 0, 1, 2, 3, 4  # rows of what is noted of contacts
LEFTS, EXCESSES, RELEASES, SHARES, REST, CLOSURES = (EFFECTIVE + k for k in range(1, 7))  # rows of a tile, where WET is set
SLOTS_AHEAD = 128  # slots from the one that is read to the one that is prefetched
local_numbers = local_array((64,))


class Pores(NamedTuple):
    """Pore pressure of particles."""

    left: np.ndarray  # (n,): the part of the excess that remains [1]; (releases,) where all particles of a release drain alike
    excess: np.ndarray  # (n,): ratio at the start over the one that stays [1]; one number where all particles have the same
    records: np.ndarray  # (releases,): numbers of each release
    fading: np.ndarray  # (columns, releases, 16): share of the excess that is left after half a step [1], by block column
    of_block: np.ndarray  # as of :class:`Layers`
    alike: bool  # whether all particles of a release drain alike
    # (numbers, slots): within a transfer of several substeps, by slot: what remains, excess and release, the last of these that
    # differ where particles of a release drain alike, else the first
    present: np.ndarray
    begins: bool  # whether the substep is the first of its transfer


class Numbers(NamedTuple):
    """What a ratio follows from, of one record."""

    equilibrium: Any  # [1]
    closure: Any  # [1]


class Layers(NamedTuple):
    """Layers of the flow, by block column."""

    of_block: np.ndarray  # (nall,): block column of each node block
    # start, parts (columns + 1,): node blocks column by column, and where those of each column begin
    start: np.ndarray
    parts: np.ndarray
    areal: np.ndarray  # (columns, 16): mass by area in plan of each column of nodes [kg/m2]
    fading: np.ndarray  # as of :class:`Pores`
    # (nown, 16): upward part of the normal of the ground [1] at the middle node above each column of the cells of a block; 1
    # without ground
    upward: np.ndarray
    # (1,): time step [s] that ``fading`` is for, where no mass drains by its thickness, else empty: it then follows each step
    noted: np.ndarray


def layers_of(blocks: Blocks, scene: Scene) -> Layers | tuple[()]:
    """The layers of an index; empty for a dry scene."""
    if not scene.is_wet:
        return ()
    _, column, start, order = block_columns(blocks)
    areal, uneven = np.zeros((len(start) - 1, PLAN), scene.dtype), diffuses(scene.pore_table())
    fading = np.zeros((len(areal) if uneven else 1, len(scene.materials), PLAN), scene.dtype)
    upward = np.ones((blocks.nown, PLAN), scene.dtype)
    return Layers(column, start, order, areal, fading, upward, np.full(0 if uneven else 1, -1.0))


def diffuses(records: np.ndarray) -> bool:
    """Whether any mass drains by the thickness of its layer."""
    return bool((records["diffusion"] > 0.0).any())


def _is_reached(reached, down, b):
    """Whether the particles of any block reach node block ``b``; its nodes are those of an earlier step otherwise."""
    found = False
    for q in range(8):
        owner = np.int64(down[b, q])
        if owner >= 0:
            found = found or (np.int64(reached[owner]) >> q) & 1 > 0
    return found


def _add_masses(grid, b, numbers):
    """Add the masses [kg] of the nodes of a block to ``numbers``, four numbers for each column of nodes, whose sum is its mass."""
    if grid.shared[b]:
        for n in range(0, 64, 16):
            one_over = load16(grid.inverse, 64 * b + n)
            filled = one_over > zeros(one_over)
            mass = select(filled, ones(one_over) / select(filled, one_over, ones(one_over)), zeros(one_over))
            store(numbers, n, load16(numbers, n) + mass)
    else:
        for n in range(PLAN):
            store(numbers, 4 * n, load4(numbers, 4 * n) + heads(load16(grid.nodes, 256 * b + 16 * n)))


def _sum_column(layers, reached, down, grid, k, area):
    """Fill the masses by area of the 16 columns of nodes of block column ``k``."""
    numbers = local_numbers(grid.nodes)
    for n in range(0, 64, 16):
        store(numbers, n, zeros(grid.nodes))
    for e in range(layers.start[k], layers.start[k + 1]):
        b = np.int64(layers.parts[e])
        if _is_reached(reached, down, b):
            _add_masses(grid, b, numbers)
    for n in range(PLAN):
        mass = (numbers[4 * n] + numbers[4 * n + 1]) + (numbers[4 * n + 2] + numbers[4 * n + 3])
        layers.areal[k, n] = mass / area


def note_normals(tiles, h, upward):
    """Note the ``upward`` (nown, 16) part of the normal of the ground at the middle nodes above the columns of cells of blocks."""
    for b in prange(len(upward)):
        t = tiles[b]
        for c in range(PLAN):
            o = 6 * (c >> 2) + (c & 3)
            nine = (t[o], t[o + 1], t[o + 2], t[o + 6], t[o + 7], t[o + 8], t[o + 12], t[o + 13], t[o + 14])
            e = surface_at(nine, real(1.0), real(1.0))
            upward[b, c] = normal_z(e[1] * (h[2] / h[0]), e[2] * (h[2] / h[1]))


def _areal_mass(layers, up, b, c):
    """Mass by area [kg/m2] of the middle column of nodes above column ``c`` of the cells of block ``b``."""
    x = (c >> 2) + 1
    y = (c & 3) + 1
    column = np.int64(layers.of_block[up[b, 4 * (x >> 2) + 2 * (y >> 2)]])
    return layers.areal[column, 4 * (x & 3) + (y & 3)]


def _any_diffuses(records):
    """:func:`diffuses`, in kernels."""
    found = False
    for r in range(len(records)):
        found = found or records[r].diffusion > 0.0
    return found


def _fade_everywhere(fading, records, dt):
    """Fill how much of the excess is left after half a step of ``dt`` [s] by the times of decay alone."""
    for r in range(len(records)):
        share = remaining_share(real(1.0), real(0.5) * dt, records[r])
        for c in range(PLAN):
            fading[0, r, c] = share


def _filled_block(blocks, layers, k):
    """A block with particles in block column ``k``; -1 if there is none."""
    for e in range(layers.start[k], layers.start[k + 1]):
        b = np.int64(layers.parts[e])
        if b < blocks.nown and blocks.held[b] > 0:
            return b
    return np.int64(-1)


def _fade_column(blocks, layers, records, constants, b, k, dt):
    """Fill how much of the excess is left after half a step of ``dt`` [s] above the 16 columns of cells of block ``b``."""
    numbers, fading, upward = local_numbers(layers.areal), layers.fading, layers.upward
    for c in range(PLAN):
        numbers[c] = _areal_mass(layers, blocks.up, b, c)
    for r in range(len(records)):
        pore, density = records[r], real(constants.density[r])
        for c in range(np.uint64(PLAN)):
            rate = drainage_rate(layer_thickness(numbers[c], real(1.0), density, upward[np.uint64(b), c]), pore)
            numbers[PLAN + c] = rate
        for c in range(np.uint64(PLAN)):
            fading[k, r, c] = share_left(numbers[PLAN + c], real(0.5) * dt)


def thin_layers(blocks, reached, grid, layers, records, constants, dt):
    """Find how much of the excess pressure is left after half a step of ``dt`` [s] in the columns of cells that hold particles."""
    h = constants.h
    uneven = _any_diffuses(records)
    if not uneven:
        _fade_everywhere(layers.fading, records, dt)
    for k in prange(len(layers.areal) if uneven else 0):
        _sum_column(layers, reached, blocks.down, grid, np.int64(k), h[0] * h[1])
    for k in prange(len(layers.areal) if uneven else 0):
        b = _filled_block(blocks, layers, np.int64(k))
        if b >= 0:
            _fade_column(blocks, layers, records, constants, b, np.int64(k), dt)


def _is_one(pores):
    """Whether all particles have the same pressure."""
    return pores.alike and len(pores.excess) == 1 and len(pores.records) == 1


def _effective_of_all(pores):
    """Share of the normal stress that grains carry in the middle of the step, where all particles have the same pressure."""
    return effective_share(pores.excess[0], pores.fading[0, 0, 0] * pores.left[0], pores.records[0])


def _fading_of(pores, b):
    """Row of ``pores.fading`` for the particles of block ``b``."""
    return np.int64(pores.of_block[b]) if len(pores.fading) > 1 else np.int64(0)


def _note_pores(drained, particles, pores, b, f, row, n):
    """As a transfer begins, note what the ``n`` contacts of a block, listed from place ``f`` on, have of the excess.

    Their rows begin with ``row``. Nothing where all particles have the same pressure.
    """
    if not pores.begins or _is_one(pores):
        return
    listed, particle_index, cell, fading = particles.listed, particles.particle_index, particles.cell, pores.fading
    place = np.uint64(_fading_of(pores, b))
    for q in range(np.uint64(n)):
        p = np.uint64(listed[np.uint64(f) + q])
        w = np.uint64(particle_index[p])
        r = np.uint64(particles.label[w, 0]) if len(pores.records) > 1 else np.uint64(0)
        g = (np.uint64(row) + q) >> np.uint64(4)
        k = (np.uint64(row) + q) & np.uint64(15)
        drained[g, LEFT, k] = pores.left[r if pores.alike else w]
        drained[g, SHARE, k] = fading[place, r, (np.uint64(cell[p]) & np.uint64(63)) >> np.uint64(2)]
        drained[g, EXCESS, k] = pores.excess[w if len(pores.excess) > 1 else np.uint64(0)]
        drained[g, STAYS, k] = pores.records[r].equilibrium
        drained[g, CLOSES, k] = pores.records[r].closure


def _share_of_contacts(effective, drained, pores, g):
    """Fill the share of the normal stress that the grains of 16 contacts carry, and advance what remains of their excess."""
    if _is_one(pores):
        for q in range(np.uint64(16)):
            effective[q] = _effective_of_all(pores)
    else:
        for q in range(np.uint64(16)):
            share = drained[g, SHARE, q]
            half = share * drained[g, LEFT, q]
            effective[q] = effective_share(drained[g, EXCESS, q], half, Numbers(drained[g, STAYS, q], drained[g, CLOSES, q]))
            drained[g, LEFT, q] = share * half


def _fill_alike(t, particles, pores, first, count):
    """Fill the row EFFECTIVE of a tile of particles of one release that drain alike."""
    if len(pores.excess) == 1:
        effective = _effective_of_all(pores)
        for p in range(np.uint64(TILE)):
            t[EFFECTIVE, p] = effective
    else:
        half, pore = pores.fading[0, 0, 0] * pores.left[0], Numbers(pores.records[0].equilibrium, pores.records[0].closure)
        for p in range(count):
            w = np.uint64(particles.particle_index[first + p])
            t[EFFECTIVE, p] = effective_share(pores.excess[w], half, pore)


def _take_numbers(t, particles, pores, first, count):
    """Fill the rows of the numbers of a tile of particles, from those by particle."""
    particle_index = particles.particle_index
    if not pores.alike:
        for p in range(count):
            t[LEFTS, p] = pores.left[np.uint64(particle_index[first + p])]
    if len(pores.excess) > 1:
        for p in range(count):
            t[EXCESSES, p] = pores.excess[np.uint64(particle_index[first + p])]
    if len(pores.records) > 1:
        for p in range(count):
            t[RELEASES, p] = real(particles.label[np.uint64(particle_index[first + p]), 0])


def _row_of_first(pores):
    """Row of a tile that the first of the numbers by slot belongs to."""
    return LEFTS + 3 - len(pores.present) if pores.alike else LEFTS


def _fetch_numbers(t, pores, first, groups):
    """The same from those by slot, in which the substep before has left them."""
    present, row = pores.present, _row_of_first(pores)
    for k in range(len(present)):
        for g in range(groups):
            place = present.shape[1] * k + first + 16 * g
            prefetch(present, place + SLOTS_AHEAD)
            store(t, (row + k) * TILE + 16 * g, load16(present, place))


def _keep_numbers(t, pores, first, groups):
    """Leave the numbers by slot for the next substep: in the first one all of them, later what remains, if that is by particle."""
    present, row = pores.present, _row_of_first(pores)
    many = len(present) if pores.begins else 0 if pores.alike else 1
    for k in range(many):
        for g in range(groups):
            store(present, present.shape[1] * k + first + 16 * g, load16(t, (row + k) * TILE + 16 * g))


def _find_shares(t, g, cell, slot, pores, b):
    """Fill the rows of what 16 particles from a ``slot`` on follow by their place and, of several releases, by their release."""
    records, fading, many = pores.records, pores.fading, len(pores.records)
    place, nothing = PLAN * many * _fading_of(pores, b), zeros(fading)
    share = looked_up(load16(fading, place), cell, slot)
    if many > 1:
        stays, closes = nothing + records[0].equilibrium, nothing + records[0].closure
        left, release = nothing + pores.left[0], load16(t, RELEASES * TILE + 16 * g)
        for r in range(1, many):
            own = release > nothing + (real(r) - real(0.5))
            share = select(own, looked_up(load16(fading, place + PLAN * r), cell, slot), share)
            stays = select(own, nothing + records[r].equilibrium, stays)
            closes = select(own, nothing + records[r].closure, closes)
            if pores.alike:
                left = select(own, nothing + pores.left[r], left)
        if pores.alike:
            store(t, LEFTS * TILE + 16 * g, left)
        store(t, REST * TILE + 16 * g, stays)
        store(t, CLOSURES * TILE + 16 * g, closes)
        if len(pores.excess) == 1:
            store(t, EXCESSES * TILE + 16 * g, nothing + pores.excess[0])
    store(t, SHARES * TILE + 16 * g, share)


def _advance(t, p, excess, pore):
    """Fill the share that the grains of a particle carry in the middle of the step, and advance what remains to its end."""
    half = t[SHARES, p] * t[LEFTS, p]
    t[EFFECTIVE, p] = effective_share(excess, half, pore)
    t[LEFTS, p] = t[SHARES, p] * half


def _advance_tile(t, pores, many):
    """:func:`_advance` for ``many`` particles; numbers that all of them share are no rows."""
    one = Numbers(pores.records[0].equilibrium, pores.records[0].closure)
    if len(pores.records) > 1:
        for p in range(many):
            _advance(t, p, t[EXCESSES, p], Numbers(t[REST, p], t[CLOSURES, p]))
    elif len(pores.excess) > 1:
        for p in range(many):
            _advance(t, p, t[EXCESSES, p], one)
    else:
        for p in range(many):
            _advance(t, p, pores.excess[0], one)


def _drain_each(t, particles, pores, b, first, count):
    """As :func:`_drain_tile` where what drains lies by particle or release, or, within a transfer, by slot."""
    groups = (count + 15) >> 4
    f, many = np.uint64(first), np.uint64(count)
    if pores.begins:
        _take_numbers(t, particles, pores, f, many)
    else:
        _fetch_numbers(t, pores, first, groups)
    for g in range(groups):
        _find_shares(t, g, particles.cell, first + 16 * g, pores, b)
    _advance_tile(t, pores, np.uint64(16 * groups))
    if LASTS:
        _keep_numbers(t, pores, first, groups)
    elif not pores.alike:
        for p in range(many):
            pores.left[np.uint64(particles.particle_index[f + p])] = t[LEFTS, p]


def _drain_tile(t, particles, pores, b, first, count):
    """Fill the row EFFECTIVE of a tile of ``count`` particles from slot ``first`` on, and advance what remains of their excess."""
    if pores.alike and len(pores.records) == 1:
        _fill_alike(t, particles, pores, np.uint64(first), np.uint64(count))
    else:
        _drain_each(t, particles, pores, b, first, count)
    for p in range(np.uint64(count), np.uint64((count + 15) & ~15)):
        t[EFFECTIVE, p] = real(1.0)
