"""Pore pressure of the particles (:mod:`runout.physics.pore_pressure`), in scenes where a mass has any.

    grid.masses[b, 64]           mass of the nodes            --sum over the blocks of a column-->
    layers.areal[c, 16]          mass by area in plan of 16 columns of nodes of block column c
    layers.upward[b, 16]         upward part of the normal of the ground at the middle columns; changes with the tiles of the ground
      --middle column of each column of cells-->
    layers.fading[c, r, 16]      share of the excess left after half a step, for release r in 16 columns of cells of block column c:
                                 one where no mass drains by the thickness of its layer: it is the same for all
    layers.passed[c, r, 16]      the same from the start of the transfer to the middle of the present substep
    particles.pores              by slot: the part that remains as the transfer begins, excess at the start, release, as far as
                                 particles differ
    pores.left, pores.excess     what all particles of a release have, or all particles
    contacts.drained             by contact: a contact keeps its particle and its column of cells during a transfer
      --passed-->
    share of the normal stress that grains carry, in the middle of a step: in contacts, and in the row EFFECTIVE of a tile

A particle takes the layer at the middle one of the columns of nodes around it. The part that remains is advanced where the law of
the particle is followed in the last substep of a transfer. Where no mass drains by its thickness, the particles of a release drain
alike: one number is left for each release, advanced then too (:func:`runout.backends.scan.grid.advance_pores`), until particles
join with another one.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import prange

from runout.backends.lanes import load16, local_array, looked_up, prefetch, select, store
from runout.backends.scan.groups import Blocks
from runout.backends.scan.node_columns import block_columns
from runout.backends.scan.particles_to_grid import PLAN
from runout.backends.scan.stencil import zeros
from runout.backends.scan.tile import EFFECTIVE, RELEASES, TILE
from runout.model.scene import Scene
from runout.physics.heightfield import normal_z, surface_at
from runout.physics.pore_pressure import drainage_rate, effective_share, layer_thickness, remaining_share, share_left
from runout.physics.tensors import real

LASTS = False  # whether the transfer goes on after this substep; the binding decides
NOTED = 5  # rows of what is noted of contacts
LEFT, PASSED, FADING, EXCESS, RELEASE = range(NOTED)
SLOTS_AHEAD = 128  # slots from the one that is read to the one that is prefetched
local_numbers = local_array((64,))


class Pores(NamedTuple):
    """Pore pressure of particles."""

    left: np.ndarray  # (releases,): part of the excess [1] that remains as the transfer begins; empty where it lies by slot
    excess: np.ndarray  # (1,): ratio at the start over the one that stays [1]; empty where it lies by slot
    records: np.ndarray  # (releases,): numbers of each release
    # fading, passed: (columns, releases, 16): share of the excess that is left after half a step, and in the middle of the substep
    # of that at the start of the transfer [1], by block column
    fading: np.ndarray
    passed: np.ndarray
    of_block: np.ndarray  # as of :class:`Layers`
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
    # fading, passed: as of :class:`Pores`
    fading: np.ndarray
    passed: np.ndarray
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
    return Layers(column, start, order, areal, fading, fading.copy(), upward, np.full(0 if uneven else 1, -1.0))


def diffuses(records: np.ndarray) -> bool:
    """Whether any mass drains by the thickness of its layer."""
    return bool((records["diffusion"] > 0.0).any())


def _sum_column(layers, masses, k, area):
    """Fill the masses by area of the 16 columns of nodes of block column ``k``."""
    numbers = local_numbers(masses)
    for n in range(0, 64, 16):
        total = zeros(masses)
        for e in range(layers.start[k], layers.start[k + 1]):
            total = total + load16(masses, 64 * np.int64(layers.parts[e]) + n)
        store(numbers, n, total)
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


def thin_layers(blocks, masses, layers, records, constants, dt):
    """Find how much of the excess pressure is left after half a step of ``dt`` [s] in the columns of cells that hold particles."""
    h = constants.h
    uneven = _any_diffuses(records)
    if not uneven:
        _fade_everywhere(layers.fading, records, dt)
    for k in prange(len(layers.areal) if uneven else 0):
        _sum_column(layers, masses, np.int64(k), h[0] * h[1])
    for k in prange(len(layers.areal) if uneven else 0):
        b = _filled_block(blocks, layers, np.int64(k))
        if b >= 0:
            _fade_column(blocks, layers, records, constants, b, np.int64(k), dt)


def _fading_of(pores, b):
    """Row of ``pores.fading`` for the particles of block ``b``."""
    return np.int64(pores.of_block[b]) if len(pores.fading) > 1 else np.int64(0)


def _alike(pores):
    """Whether all particles of a release drain alike."""
    return len(pores.left) > 0


def _uneven(pores):
    """Whether particles differ in their excess at the start."""
    return len(pores.excess) == 0


def _note_pores(drained, particles, pores, b, f, row, n):
    """As a transfer begins, note what the ``n`` contacts of a block, listed from place ``f`` on, have of the excess.

    Their rows begin with ``row``. Numbers that all particles share, or all of a release, are not noted.
    """
    listed, numbers, cell, fading = particles.listed, particles.pores, particles.cell, pores.fading
    several, uneven, alike = len(pores.records) > 1, _uneven(pores), _alike(pores)
    if not pores.begins or len(numbers) == 0:
        return
    place, last = np.uint64(_fading_of(pores, b)), np.uint64(len(numbers) - 1)
    for q in range(np.uint64(n)):
        p = np.uint64(listed[np.uint64(f) + q])
        r = np.uint64(numbers[last, p]) if several else np.uint64(0)
        g = (np.uint64(row) + q) >> np.uint64(4)
        k = (np.uint64(row) + q) & np.uint64(15)
        if not alike:
            drained[g, LEFT, k] = numbers[0, p]
            drained[g, FADING, k] = drained[g, PASSED, k] = fading[place, r, (np.uint64(cell[p]) & np.uint64(63)) >> np.uint64(2)]
        if uneven:
            drained[g, EXCESS, k] = numbers[np.uint64(not alike), p]
        if several:
            drained[g, RELEASE, k] = real(r)


def _carried(remains, excess, release, pores):
    """Share of the normal stress that the grains of 16 particles carry where a part of their excess ``remains``.

    ``remains`` is that of their releases where these drain alike; ``excess`` is that of all where they have the same.
    """
    records, left, passed = pores.records, pores.left, pores.passed
    nothing = zeros(passed)
    stays, closes = nothing + records[0].equilibrium, nothing + records[0].closure
    if _alike(pores):
        remains = nothing + left[0] * passed[0, 0, 0]
    if not _uneven(pores):
        excess = nothing + pores.excess[0]
    for r in range(1, len(records)):
        own = release > nothing + (real(r) - real(0.5))
        stays = select(own, nothing + records[r].equilibrium, stays)
        closes = select(own, nothing + records[r].closure, closes)
        if _alike(pores):
            remains = select(own, nothing + left[r] * passed[0, r, 0], remains)
    return effective_share(excess, remains, Numbers(stays, closes))


def _share_of_contacts(effective, drained, pores, g):
    """Fill the share of the normal stress that the grains of 16 contacts carry, and go on to the next substep."""
    nothing, place = zeros(effective), 16 * NOTED * np.int64(g)
    remains = excess = release = nothing
    if not _alike(pores):
        passed, fading = load16(drained, place + 16 * PASSED), load16(drained, place + 16 * FADING)
        remains = load16(drained, place + 16 * LEFT) * passed
        store(drained, place + 16 * PASSED, passed * fading * fading)
    if _uneven(pores):
        excess = load16(drained, place + 16 * EXCESS)
    if len(pores.records) > 1:
        release = load16(drained, place + 16 * RELEASE)
    store(effective, 0, _carried(remains, excess, release, pores))


def _sort_pores(numbers, order, f, held, row):
    """Bring the numbers of the particles of a block into the ``order`` of its cells, through a ``row`` of a buffer."""
    for k in range(np.uint64(len(numbers))):
        for t in range(np.uint64(held)):
            row[t] = numbers[k, np.uint64(order[f + t])]
        for t in range(np.uint64(held)):
            numbers[k, f + t] = row[t]


def _number(numbers, slot, k):
    """Number ``k`` of 16 particles from a ``slot`` on."""
    place = numbers.shape[1] * k + slot
    prefetch(numbers, place + SLOTS_AHEAD)
    return load16(numbers, place)


def _share_of_column(shares, pores, b, cell, slot, release):
    """Those of the ``shares`` that belong to 16 particles by the columns of their cells."""
    many = len(pores.records)
    place = PLAN * many * _fading_of(pores, b)
    share = looked_up(load16(shares, place), cell, slot)
    for r in range(1, many):
        own = release > zeros(shares) + (real(r) - real(0.5))
        share = select(own, looked_up(load16(shares, place + PLAN * r), cell, slot), share)
    return share


def _drain_group(t, g, particles, pores, b, slot):
    """:func:`_drain_tile` for 16 particles from a ``slot`` on."""
    numbers, cell = particles.pores, particles.cell
    remains = excess = release = zeros(pores.fading)
    if _uneven(pores):
        excess = _number(numbers, slot, np.int64(not _alike(pores)))
    if len(pores.records) > 1:
        release = _number(numbers, slot, len(numbers) - 1)
        store(t, RELEASES * TILE + 16 * g, release)
    if not _alike(pores):
        remains = _number(numbers, slot, 0) * _share_of_column(pores.passed, pores, b, cell, slot, release)
        if not LASTS:
            store(numbers, slot, remains * _share_of_column(pores.fading, pores, b, cell, slot, release))
    store(t, EFFECTIVE * TILE + 16 * g, _carried(remains, excess, release, pores))


def _drain_tile(t, particles, pores, b, first, count):
    """Fill the row EFFECTIVE of a tile of ``count`` particles from slot ``first`` on; of several releases the row RELEASES too.

    The last substep of a transfer advances what remains of their excess.
    """
    for g in range((count + 15) >> 4):
        _drain_group(t, g, particles, pores, b, first + 16 * g)
