"""Pore pressure of the particles (:mod:`runout.physics.pore_pressure`), in scenes where a mass has any.

    grid.nodes, grid.inverse     mass of the nodes            --sum over the blocks of a column-->
    layers.areal[c, 16]          mass by area in plan of 16 columns of nodes of block column c
    layers.upward[b, 16]         upward part of the normal of the ground at the middle columns; changes with the tiles of the ground
      --middle column of each column of cells-->
    layers.fading[c, r, 16]      share of the excess left after half a step, for release r in 16 columns of cells of block column c:
                                 one where no mass drains by the thickness of its layer: it is the same for all
    pores.left, pores.excess     by particle, which never moves: the part that remains; the excess at the start, one number if alike
    pores.present                by slot, between the substeps of a transfer: what remains, excess and release where these differ
    contacts.drained             by contact, likewise: a contact keeps its particle and its column of cells during a transfer
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

from runout.backends.lanes import listed_numbers, load4, load16, local_array, looked_up, prefetch, select, store
from runout.backends.scan.groups import Blocks
from runout.backends.scan.node_columns import block_columns
from runout.backends.scan.particles_to_grid import PLAN, heads
from runout.backends.scan.stencil import ones, zeros
from runout.backends.scan.tile import EFFECTIVE, LEFTS, RELEASES, TILE
from runout.model.scene import Scene
from runout.physics.heightfield import normal_z, surface_at
from runout.physics.pore_pressure import drainage_rate, effective_share, layer_thickness, remaining_share, share_left
from runout.physics.tensors import real

LASTS = False  # whether the transfer goes on after this substep; the binding decides
LEFT, SHARE, EXCESS, RELEASE = 0, 1, 2, 3  # rows of what is noted of contacts
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
    # (numbers, slots): within a transfer of several substeps, by slot: those of what remains, excess and release in which particles
    # differ; what remains only where particles of a release do not drain alike
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


def _fading_of(pores, b):
    """Row of ``pores.fading`` for the particles of block ``b``."""
    return np.int64(pores.of_block[b]) if len(pores.fading) > 1 else np.int64(0)


def _note_pores(drained, particles, pores, b, f, row, n):
    """As a transfer begins, note what the ``n`` contacts of a block, listed from place ``f`` on, have of the excess.

    Their rows begin with ``row``. Numbers that all particles share, or all of a release, are not noted.
    """
    listed, particle_index, cell, fading = particles.listed, particles.particle_index, particles.cell, pores.fading
    several, uneven = len(pores.records) > 1, len(pores.excess) > 1
    if not pores.begins or not (several or uneven or not pores.alike):
        return
    place = np.uint64(_fading_of(pores, b))
    for q in range(np.uint64(n)):
        p = np.uint64(listed[np.uint64(f) + q])
        w = np.uint64(particle_index[p])
        r = np.uint64(particles.label[w, 0]) if several else np.uint64(0)
        g = (np.uint64(row) + q) >> np.uint64(4)
        k = (np.uint64(row) + q) & np.uint64(15)
        if not pores.alike:
            drained[g, LEFT, k] = pores.left[w]
            drained[g, SHARE, k] = fading[place, r, (np.uint64(cell[p]) & np.uint64(63)) >> np.uint64(2)]
        if uneven:
            drained[g, EXCESS, k] = pores.excess[w]
        if several:
            drained[g, RELEASE, k] = real(r)


def _drained(left, excess, share, release, pores):
    """Share of the normal stress that the grains of 16 particles carry in the middle of the step, and what remains at its end.

    ``left`` and ``share``, of what remains in half a step, are those of their releases where these drain alike; ``excess`` is that
    of all where they have the same.
    """
    records, fading = pores.records, pores.fading
    nothing = zeros(fading)
    stays, closes = nothing + records[0].equilibrium, nothing + records[0].closure
    if pores.alike:
        left, share = nothing + pores.left[0], nothing + fading[0, 0, 0]
    if len(pores.excess) == 1:
        excess = nothing + pores.excess[0]
    for r in range(1, len(records)):
        own = release > nothing + (real(r) - real(0.5))
        stays = select(own, nothing + records[r].equilibrium, stays)
        closes = select(own, nothing + records[r].closure, closes)
        if pores.alike:
            left = select(own, nothing + pores.left[r], left)
            share = select(own, nothing + fading[0, r, 0], share)
    half = share * left
    return effective_share(excess, half, Numbers(stays, closes)), share * half


def _share_of_contacts(effective, drained, pores, g):
    """Fill the share of the normal stress that the grains of 16 contacts carry, and advance what remains of their excess."""
    nothing, place = zeros(effective), 64 * np.int64(g)
    left = share = excess = release = nothing
    if not pores.alike:
        left, share = load16(drained, place + 16 * LEFT), load16(drained, place + 16 * SHARE)
    if len(pores.excess) > 1:
        excess = load16(drained, place + 16 * EXCESS)
    if len(pores.records) > 1:
        release = load16(drained, place + 16 * RELEASE)
    carried, remains = _drained(left, excess, share, release, pores)
    store(effective, 0, carried)
    if not pores.alike:
        store(drained, place + 16 * LEFT, remains)


def _expect_numbers(pores, w):
    """Prefetch what particle ``w`` has of the excess, as far as particles differ."""
    if not pores.alike:
        prefetch(pores.left, w)
    if len(pores.excess) > 1:
        prefetch(pores.excess, w)


def _number(values, particles, pores, slot, k):
    """A number of 16 particles from a ``slot`` on: by particle as a transfer begins, then from row ``k`` of those by slot."""
    if pores.begins:
        return listed_numbers(pores.fading, values, particles.particle_index, slot)
    place = pores.present.shape[1] * k + slot
    prefetch(pores.present, place + SLOTS_AHEAD)
    return load16(pores.present, place)


def _keep_number(number, pores, slot, k):
    """Leave a number of 16 particles from a ``slot`` on to the later substeps, in row ``k``."""
    store(pores.present, pores.present.shape[1] * k + slot, number)


def _share_of_column(pores, b, cell, slot, release):
    """Share of the excess of 16 particles that is left after half a step, by the columns of their cells."""
    fading, many = pores.fading, len(pores.records)
    place = PLAN * many * _fading_of(pores, b)
    share = looked_up(load16(fading, place), cell, slot)
    for r in range(1, many):
        own = release > zeros(fading) + (real(r) - real(0.5))
        share = select(own, looked_up(load16(fading, place + PLAN * r), cell, slot), share)
    return share


def _drain_group(t, g, particles, pores, b, slot):
    """:func:`_drain_tile` for 16 particles from a ``slot`` on."""
    several, uneven, keeps = len(pores.records) > 1, len(pores.excess) > 1, LASTS and pores.begins
    left = excess = share = release = zeros(pores.fading)
    k = np.int64(not pores.alike)
    if uneven:
        excess = _number(pores.excess, particles, pores, slot, k)
        if keeps:
            _keep_number(excess, pores, slot, k)
        k += 1
    if several:
        release = _number(particles.label, particles, pores, slot, k)
        if keeps:
            _keep_number(release, pores, slot, k)
        store(t, RELEASES * TILE + 16 * g, release)
    if not pores.alike:
        left = _number(pores.left, particles, pores, slot, 0)
        share = _share_of_column(pores, b, particles.cell, slot, release)
    carried, remains = _drained(left, excess, share, release, pores)
    store(t, EFFECTIVE * TILE + 16 * g, carried)
    if LASTS and not pores.alike:
        _keep_number(remains, pores, slot, 0)
    store(t, LEFTS * TILE + 16 * g, remains)


def _drain_tile(t, particles, pores, b, first, count):
    """Fill the row EFFECTIVE of a tile of ``count`` particles from slot ``first`` on, and advance what remains of their excess.

    Of several releases the row RELEASES is filled too. What drains lies by particle or release, or, within a transfer, by slot.
    """
    for g in range((count + 15) >> 4):
        _drain_group(t, g, particles, pores, b, first + 16 * g)
    if not (LASTS or pores.alike):
        f = np.uint64(first)
        for p in range(np.uint64(count)):
            pores.left[np.uint64(particles.particle_index[f + p])] = t[LEFTS, p]
