"""Pore pressure of the particles (:mod:`runout.physics.pore_pressure`), in scenes where a mass has any.

    grid.nodes, grid.inverse     mass of the nodes            --sum over the blocks of a column-->
    layers.areal[c, 16]          mass by area in plan of 16 columns of nodes of block column c
    layers.upward[b, 16]         upward part of the normal of the ground at the middle columns; changes with the tiles of the ground
      --middle column of each column of cells-->
    layers.fading[b, r, 16]      share of the excess left after half a step, for release r in 16 columns of cells of block b:
                                 one block where no mass drains by the thickness of its layer: it is the same for all
    pores.left, pores.excess     by particle, which never moves: the part that remains; the excess at the start, one number if alike
      --fading-->
    share of the normal stress that grains carry, in the middle of a step: in contacts, and in the row EFFECTIVE of a tile

A particle takes the layer at the middle one of the columns of nodes around it. The part that remains is advanced where the law of
the particle is followed, at the end of each substep. Particles of one release that decay in a time drain alike: one number is left
for all, advanced after the substep (:func:`runout.backends.scan.grid.advance_pores`), until particles join with another one.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import prange

from runout.backends.lanes import load4, load16, local_array, select, store
from runout.backends.scan.groups import Blocks
from runout.backends.scan.node_columns import block_columns
from runout.backends.scan.particles_to_grid import PLAN, heads
from runout.backends.scan.stencil import ones, zeros
from runout.backends.scan.tile import EFFECTIVE, TILE
from runout.model.scene import Scene
from runout.physics.heightfield import normal_z, surface_at
from runout.physics.pore_pressure import effective_share, layer_thickness, remaining_share
from runout.physics.tensors import real

local_numbers = local_array((64,))


class Pores(NamedTuple):
    """Pore pressure of particles."""

    left: np.ndarray  # (n,): the part of the excess that remains [1]; one number where all particles drain alike
    excess: np.ndarray  # (n,): ratio at the start over the one that stays [1]; one number where all particles have the same
    records: np.ndarray  # (releases,): numbers of each release
    fading: np.ndarray  # (nown, releases, 16): share of the excess that is left after half a step [1]
    alike: bool  # whether all particles drain alike


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


def layers_of(blocks: Blocks, scene: Scene) -> Layers | tuple[()]:
    """The layers of an index; empty for a dry scene."""
    if not scene.is_wet:
        return ()
    _, column, start, order = block_columns(blocks)
    fading_blocks = blocks.nown if diffuses(scene.pore_table()) else 1
    areal, fading = np.zeros((len(start) - 1, PLAN)), np.zeros((fading_blocks, len(scene.materials), PLAN))
    upward = np.ones((blocks.nown, PLAN), scene.dtype)
    return Layers(column, start, order, areal.astype(scene.dtype), fading.astype(scene.dtype), upward)


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


def thin_layers(blocks, reached, grid, layers, records, constants, dt):
    """Find how much of the excess pressure is left after half a step of ``dt`` [s] in each column of cells that holds particles."""
    fading = layers.fading
    h = constants.h
    uneven = _any_diffuses(records)
    if not uneven:
        _fade_everywhere(fading, records, dt)
    for k in prange(len(layers.areal) if uneven else 0):
        _sum_column(layers, reached, blocks.down, grid, np.int64(k), h[0] * h[1])
    for b in prange(blocks.nown if uneven else 0):
        if blocks.held[b] > 0:
            for c in range(PLAN):
                if blocks.starts[b, 4 * c + 4] > blocks.starts[b, 4 * c]:
                    mass = _areal_mass(layers, blocks.up, b, c)
                    for r in range(len(records)):
                        thickness = layer_thickness(mass, real(1.0), real(constants.density[r]), layers.upward[b, c])
                        fading[b, r, c] = remaining_share(thickness, real(0.5) * dt, records[r])


def _column(fading, b, cell):
    """Block and column of cells of the numbers of a particle in a cell of block ``b``."""
    return b if len(fading) > 1 else 0, (np.int64(cell) & 63) >> 2


def _effective(pores, label, w, b, cell):
    """Share of the normal stress that the grains of particle ``w``, in a cell of block ``b``, carry in the middle of the step.

    Then what remains of the excess in the middle of the step, and the share of it that is left after half a step.
    """
    r = np.int64(label[w, 0]) if len(pores.records) > 1 else 0
    excess = pores.excess[w] if len(pores.excess) > 1 else pores.excess[0]
    place, column = _column(pores.fading, b, cell)
    share = pores.fading[place, r, column]
    half = share * pores.left[w if not pores.alike else 0]
    return effective_share(excess, half, pores.records[r]), half, share


def _effective_of_all(pores):
    """Share of the normal stress that grains carry in the middle of the step, where all particles have the same pressure."""
    return effective_share(pores.excess[0], pores.fading[0, 0, 0] * pores.left[0], pores.records[0])


def _share_of_contacts(effective, particles, blocks, contacts, pores, b, q, n):
    """Fill the share of the normal stress that grains carry at ``n`` contacts from number ``q`` of block ``b`` on.

    Returns block and number of the next contact.
    """
    listed, first, touching = particles.listed, blocks.first, contacts.touching
    if pores.alike and len(pores.excess) == 1:
        for k in range(16):
            effective[k] = _effective_of_all(pores)
        return b, q
    for k in range(n):
        while q == touching[b]:
            b += 1
            q = 0
        p = np.int64(listed[first[b] + q])
        w = np.int64(particles.particle_index[p])
        effective[k] = _effective(pores, particles.label, w, b, particles.cell[p])[0]
        q += 1
    for k in range(n, 16):
        effective[k] = real(1.0)
    return b, q


def _fill_alike(t, particles, pores, first, count):
    """Fill the row EFFECTIVE of a tile of particles that drain alike."""
    if len(pores.excess) == 1:
        effective = _effective_of_all(pores)
        for p in range(TILE):
            t[EFFECTIVE, p] = effective
    else:
        half, pore = pores.fading[0, 0, 0] * pores.left[0], Numbers(pores.records[0].equilibrium, pores.records[0].closure)
        for p in range(count):
            t[EFFECTIVE, p] = effective_share(pores.excess[np.int64(particles.particle_index[first + p])], half, pore)


def _drain_one_release(t, particles, pores, b, first, count):
    """As ``_drain_tile`` where all particles start alike: numbers that do not change stay in registers."""
    left, particle_index, cell = pores.left, particles.particle_index, particles.cell
    pore, excess = Numbers(pores.records[0].equilibrium, pores.records[0].closure), pores.excess[0]
    for p in range(count):
        w = np.int64(particle_index[first + p])
        place, column = _column(pores.fading, b, cell[first + p])
        share = pores.fading[place, 0, column]
        half = share * left[w]
        t[EFFECTIVE, p] = effective_share(excess, half, pore)
        left[w] = share * half


def _drain_tile(t, particles, pores, b, first, count):
    """Fill the row EFFECTIVE of a tile of ``count`` particles from slot ``first`` on, and advance what remains of their excess."""
    left, particle_index, cell = pores.left, particles.particle_index, particles.cell
    if pores.alike:
        _fill_alike(t, particles, pores, first, count)
    elif len(pores.records) == 1 and len(pores.excess) == 1:
        _drain_one_release(t, particles, pores, b, first, count)
    else:
        for p in range(count):
            w = np.int64(particle_index[first + p])
            t[EFFECTIVE, p], half, share = _effective(pores, particles.label, w, b, cell[first + p])
            left[w] = share * half
    for p in range(count, (count + 15) & ~15):
        t[EFFECTIVE, p] = real(1.0)
