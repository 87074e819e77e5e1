"""Observation: sums over the particles of each scene, columns of the raster, and particles as the backends exchange them.

    found[b]        mass, momentum (3), kinetic, potential, elastic energy of the particles of block b     (blocks, 7)
    sums.here[s]    the same by scene          sums.gone[s]   the same for particles that left since the last sort
    sums.booked[s]  dissipation and impulse of the ground since the last sort
    sums.kept[s]    booked (6) and gone (7) up to the last sort
    sums.ledger[s]  | kept + booked + gone: 13 | here: 7 | blocks with particles and their extent: 7 |
    raster          (rows, columns, 5) of each window, one behind the other: volume, mass, momentum (3) as whole numbers

Sums over blocks and over particles that have left are made apart and joined in one row a scene, which the host reads at once.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.deform import _slopes, _strain_of
from runout.backends.hash.groups import (
    AroundGroup,
    BlockGroup,
    Constants,
    ParticleGroup,
    PoreGroup,
    SceneGroup,
    StatusGroup,
    SumGroup,
)
from runout.backends.hash.layout import (
    AFFINE,
    BLOCKS,
    GONE,
    GROW,
    HALT,
    MASS,
    MOMENTUM,
    NEXT,
    OFFSET,
    VOLUME,
    Doubles2,
    Ints,
    Longs,
    Materials,
    Reals,
    Rows,
    Table2,
    Vector,
    double7,
    lane_count,
)
from runout.physics.elastic import energy_density, kirchhoff_stress, log_strain
from runout.physics.moments import gradient_column as gradient_column64
from runout.physics.moments import kinetic_energy as kinetic_energy64
from runout.physics.moments import potential_energy as potential_energy64
from runout.physics.moments import stress_columns
from runout.physics.pore_pressure import pore_ratio

whole5: Any = None  # five whole numbers; the binding puts it in its place
add_wholes: Any = None  # adds them to those at a place; likewise

SUMS = 7  # mass, momentum, kinetic, potential and elastic energy
BOUNDS = 7  # of the blocks of a scene: their number, lowest and highest coordinates
NOWHERE = 2**29  # beyond every block
REACH = 5  # cells from the first of a block that its particles cover
BOOKED = 6  # plastic dissipation, work and impulse of the ground, plastic dissipation by the second warp of a block


def change_step(particles: ParticleGroup, blocks: BlockGroup, constants: Constants, mats: Materials, longer: Reals):
    """Repack the records of each scene for a time step so much longer [s]."""
    p = wp.tid()
    if particles.key[p] < 0:
        return
    tau = kirchhoff_stress(log_strain(_strain_of(particles.rec, p)), mats[int(particles.release[p])])
    packed = stress_columns(tau, particles.rec[VOLUME, p], _slopes(longer[blocks.member[particles.key[p] >> 6]], constants.h))
    for k in range(9):
        particles.rec[AFFINE + k, p] = particles.rec[AFFINE + k, p] + packed[k]


def leave(particles: ParticleGroup, blocks: BlockGroup, gone: Ints):
    """Remove the particles of scenes that are done."""
    p = wp.tid()
    if particles.key[p] >= 0 and gone[blocks.member[wp.max(particles.key[p], 0) >> 6]] != 0:
        particles.key[p] = -1


def _affine_column(rec: Rows, p: int, tau: Any, dt: Any, h: Vector, j: int):
    """Column j of the affine momentum m C_j h_j [kg m/s] of a particle, in float64."""
    packed = stress_columns(tau, rec[VOLUME, p], _slopes(dt, h))
    x = wp.float64(rec[AFFINE + 3 * j, p] - packed[3 * j])
    y = wp.float64(rec[AFFINE + 3 * j + 1, p] - packed[3 * j + 1])
    z = wp.float64(rec[AFFINE + 3 * j + 2, p] - packed[3 * j + 2])
    return wp.vec3d(x, y, z)


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
    particles: ParticleGroup, blocks: BlockGroup, scenes: SceneGroup, constants: Constants, mats: Materials, where: Ints,
    node: Table2, affine: Doubles2,
):  # fmt: skip
    """First node (n, 3) and velocity gradient (n, 9) of the particles at the places ``where`` (n,)."""
    t = wp.tid()
    p = where[t]
    k = particles.key[p]
    s = blocks.member[k >> 6]
    for d in range(3):
        node[t, d] = 4 * blocks.coordinates[k >> 6, d] + ((k >> (4 - 2 * d)) & 3)
    node[t, 1] = node[t, 1] - scenes.shift[s]
    tau = kirchhoff_stress(log_strain(_strain_of(particles.rec, p)), mats[int(particles.release[p])])
    for j in range(3):
        affine_momentum = _affine_column(particles.rec, p, tau, scenes.packed[s], constants.h, j)
        column = gradient_column64(affine_momentum, wp.float64(particles.rec[MASS, p]), wp.float64(constants.h[j]))
        for i in range(3):
            affine[t, 3 * i + j] = column[i]


def _energies(particles: ParticleGroup, constants: Constants, p: int, mats: Materials, dt: Any, x: wp.vec3d):
    """Kinetic, potential and elastic energy [J] of a particle at ``x`` [m]."""
    mat = mats[int(particles.release[p])]
    log = log_strain(_strain_of(particles.rec, p))
    tau = kirchhoff_stress(log, mat)
    m = wp.float64(particles.rec[MASS, p])
    rec = particles.rec
    momentum = wp.vec3d(wp.float64(rec[MOMENTUM, p]), wp.float64(rec[MOMENTUM + 1, p]), wp.float64(rec[MOMENTUM + 2, p]))
    ax = _affine_column(particles.rec, p, tau, dt, constants.h, 0)
    ay = _affine_column(particles.rec, p, tau, dt, constants.h, 1)
    az = _affine_column(particles.rec, p, tau, dt, constants.h, 2)
    kinetic = kinetic_energy64(m, momentum, ax, ay, az)
    elastic = wp.float64(energy_density(log, mat)) * wp.float64(rec[VOLUME, p])
    return wp.vec3d(kinetic, potential_energy64(m, constants.gravity, x), elastic)


def _row(particles: ParticleGroup, constants: Constants, p: int, mats: Materials, dt: Any, x: wp.vec3d):
    """Mass [kg], momentum [kg m/s], kinetic, potential and elastic energy [J] of a particle."""
    e = _energies(particles, constants, p, mats, dt, x)
    mass = wp.float64(particles.rec[MASS, p])
    row = double7(mass)
    for d in range(3):
        row[1 + d] = wp.float64(particles.rec[MOMENTUM + d, p])
        row[4 + d] = e[d]
    row[0] = mass
    return row


def sum_blocks(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, scenes: SceneGroup, constants: Constants,
    mats: Materials, sums: SumGroup, found: Doubles2, launched: int,
):  # fmt: skip
    """Sums (blocks, 7) over the particles of each block, see ``_row``; number and extent of the blocks of each scene."""
    begin, lane = wp.tid()
    for a in range(begin, status.tally[NEXT], launched):
        b = blocks.active[a]
        s = blocks.member[b]
        acc = double7()
        for t in range(blocks.cstart[b, 0] + lane, blocks.cstart[b, 64], lane_count()):
            p = particles.order[t]
            x = _position(particles.rec, p, particles.key[p], blocks.coordinates, scenes.shift[s], constants.h)
            acc += _row(particles, constants, p, mats, scenes.packed[s], x)
        total = wp.tile_sum(wp.tile(acc, preserve_type=True))
        if lane == 0:
            for k in range(SUMS):
                found[b, k] = total[0][k]
            wp.atomic_add(sums.bounds, s, 0, 1)
            for d in range(3):
                wp.atomic_min(sums.bounds, s, 1 + d, blocks.coordinates[b, d])
                wp.atomic_max(sums.bounds, s, 4 + d, blocks.coordinates[b, d])


def sum_rows(status: StatusGroup, blocks: BlockGroup, rows: Doubles2, parts: int, sums: Doubles2):
    """Sums (scenes parts, width) of the rows of the blocks of each scene; part q takes every ``parts``-th."""
    i, lane = wp.tid()
    scene = i // parts
    for d in range(rows.shape[1]):
        acc = wp.float64(0.0)
        for b in range((i % parts) * lane_count() + lane, status.tally[BLOCKS], parts * lane_count()):
            if blocks.member[b] == scene:
                acc += rows[b, d]
        total = wp.tile_sum(wp.tile(acc))
        if lane == 0:
            sums[i, d] = total[0]


def _add_gone(
    particles: ParticleGroup, blocks: BlockGroup, scenes: SceneGroup, constants: Constants, mats: Materials, sums: SumGroup,
    p: int, key: int, row: int,
):  # fmt: skip
    """Add a particle that has left to the row of its scene; the rows of a thread begin at ``row``."""
    k = -2 - key
    s = blocks.member[k >> 6]
    x = _position(particles.rec, p, k, blocks.coordinates, scenes.shift[s], constants.h)
    found = _row(particles, constants, p, mats, scenes.packed[s], x)
    for d in range(SUMS):
        sums.gone[row + s, d] = sums.gone[row + s, d] + found[d]


def sum_gone(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, scenes: SceneGroup, constants: Constants,
    mats: Materials, sums: SumGroup,
):  # fmt: skip
    """The same sums over the particles that have left the domain. Thread t takes every so many-th; its rows are one a scene.

    The elevation at which a particle crossed the edge is found from its last cell, which its key still tells.
    """
    t = wp.tid()
    if status.tally[GONE] == 0:
        return
    many = sums.kept.shape[0]
    threads = sums.gone.shape[0] // many
    for s in range(many):
        for d in range(SUMS):
            sums.gone[many * t + s, d] = wp.float64(0.0)
    last = particles.key.shape[0] - 1
    for p in range(t, particles.key.shape[0], 4 * threads):  # four keys at once: nearly all of them are of particles that are here
        first, second = int(particles.key[p]), int(particles.key[wp.min(p + threads, last)])
        third, fourth = int(particles.key[wp.min(p + 2 * threads, last)]), int(particles.key[wp.min(p + 3 * threads, last)])
        if wp.min(wp.min(first, second), wp.min(third, fourth)) < -1:
            for r in range(p, wp.min(p + 4 * threads, last + 1), threads):
                if particles.key[r] < -1:
                    _add_gone(particles, blocks, scenes, constants, mats, sums, r, particles.key[r], many * t)


def _since_sort(status: StatusGroup, sums: SumGroup, s: int, d: int, lane: int):
    """A lane's share of number ``d`` of what a scene keeps: booked since the last sort, or lost with particles that left since."""
    many = sums.kept.shape[0]
    total = wp.float64(0.0)
    if d < BOOKED:
        parts = sums.booked.shape[0] // many
        for q in range(lane, parts, lane_count()):
            total += sums.booked[s * parts + q, d]
    elif status.tally[GONE] > 0:
        for t in range(lane, sums.gone.shape[0] // many, lane_count()):
            total += sums.gone[many * t + s, d - BOOKED]
    return total


def keep_sums(status: StatusGroup, sums: SumGroup):
    """Add what has been booked and lost since the last sort to what is kept by scene; a block of threads a scene and number."""
    i, lane = wp.tid()
    s, d = i // sums.kept.shape[1], i % sums.kept.shape[1]
    total = wp.tile_sum(wp.tile(_since_sort(status, sums, s, d, lane)))
    if lane == 0:
        sums.kept[s, d] = sums.kept[s, d] + total[0]


def write_sums(status: StatusGroup, sums: SumGroup):
    """All that is known of a scene in one row: booked and lost, sums over its particles, number and extent of its blocks."""
    i, lane = wp.tid()
    s, d = i // sums.ledger.shape[1], i % sums.ledger.shape[1]
    share = wp.float64(0.0)
    if d < BOOKED + SUMS:
        share = _since_sort(status, sums, s, d, lane)
    elif d < BOOKED + 2 * SUMS:
        parts = sums.here.shape[0] // sums.kept.shape[0]
        for q in range(lane, parts, lane_count()):
            share += sums.here[s * parts + q, d - BOOKED - SUMS]
    total = wp.tile_sum(wp.tile(share))
    if lane == 0:
        found = total[0]
        if d < BOOKED + SUMS:
            found += sums.kept[s, d]
        elif d >= BOOKED + 2 * SUMS:
            found = wp.float64(sums.bounds[s, d - BOOKED - 2 * SUMS])
        sums.ledger[s, d] = found


def _covered(x: wp.float64, width: wp.float64, i: int):
    """Share of an interval from ``x`` on that lies in cell ``i``."""
    return (wp.min(x + width, wp.float64(i + 1)) - wp.max(x, wp.float64(i))) / width


def note_step(scenes: SceneGroup, packed: Longs):
    """Write the steps that each scene has made before the columns: a look that comes after a halt finds fewer than it should."""
    s = wp.tid()
    packed[s] = wp.int64(scenes.step_counts[s])


def add_columns(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, scenes: SceneGroup, windows: Table2, units: Doubles2,
    raster: Longs,
):  # fmt: skip
    """Add each particle, spread over a plan box of one grid cell, to the window (rows x columns x 5) of its scene's lattice.

    A window holds all mass; a particle outside counts at its rim, so that no other memory is written. ``windows`` and ``units`` are
    those of :mod:`runout.backends.hash.spreading`. Volume, mass and momentum are whole numbers of a tiny unit, exact in any order,
    so that they repeat bit by bit. Shares are those at the place on the whole lattice: their bits do not depend on where a window
    begins.
    """
    p = wp.tid()
    k = particles.key[p]
    if status.flags[HALT] == GROW or k < 0:
        return
    s = blocks.member[k >> 6]
    begin = windows[s, 0]
    if begin < 0:
        return
    place = _place(particles.rec, p, k, blocks.coordinates, scenes.shift[s])
    qx = place[0]
    qy = place[1]
    wide = units[s, 12]
    x = (qx - wp.float64(0.5)) * wide
    y = (qy - wp.float64(0.5)) * wide
    first_column = int(units[s, 13])
    first_row = int(units[s, 14])
    m = wp.float64(particles.rec[MASS, p])
    volume = m / scenes.density[int(particles.release[p])] * units[s, 0]
    columns = windows[s, 1]
    rows = windows[s, 2]
    for i in range(int(wp.floor(x)), int(wp.floor(x + wide)) + 1):
        sx = _covered(x, wide, i)
        for j in range(int(wp.floor(y)), int(wp.floor(y + wide)) + 1):
            share = sx * _covered(y, wide, j)
            if share > wp.float64(0.0):
                o = (begin + wp.clamp(j - first_row, 0, rows - 1) * columns + wp.clamp(i - first_column, 0, columns - 1)) * 5
                added = whole5()
                added[0] = wp.int64(wp.round(share * volume))
                added[1] = wp.int64(wp.round(share * m * units[s, 1]))
                for d in range(3):
                    added[2 + d] = wp.int64(wp.round(share * wp.float64(particles.rec[MOMENTUM + d, p]) * units[s, 2]))
                add_wholes(raster, o, added)


def weigh_plan(
    particles: ParticleGroup, blocks: BlockGroup, scenes: SceneGroup, pores: PoreGroup, window: Ints, scale: wp.float64, sums: Longs
):  # fmt: skip
    """Add mass, and mass times pore pressure ratio, of each particle of a scene to (releases x 2 x nx x ny) sums, by nearest node.

    ``window``: first node east and north, nodes east and north, scene, its first release, whether any mass is wet. The sums are
    whole numbers, ``scale`` to a kilogram, exact in any order.
    """
    p = wp.tid()
    k = particles.key[p]
    if k < 0 or blocks.member[wp.max(k, 0) >> 6] != window[4]:
        return
    b = k >> 6
    i = 4 * blocks.coordinates[b, 0] + ((k >> 4) & 3) + int(wp.rint(particles.rec[OFFSET, p])) - window[0]
    j = 4 * blocks.coordinates[b, 1] + ((k >> 2) & 3) + int(wp.rint(particles.rec[OFFSET + 1, p])) - window[1]
    j -= scenes.shift[window[4]]
    if i < 0 or j < 0 or i >= window[2] or j >= window[3]:
        return
    release = int(particles.release[p])
    nodes = window[2] * window[3]
    o = 2 * (release - window[5]) * nodes + i * window[3] + j
    m = wp.float64(particles.rec[MASS, p]) * scale
    wp.atomic_add(sums, o, wp.int64(wp.round(m)))
    if window[6] != 0:
        n = particles.number[p]
        ratio = pore_ratio(pores.excess[n], pores.left[n], pores.records[release])
        wp.atomic_add(sums, o + nodes, wp.int64(wp.round(m * wp.float64(ratio))))


def _folded(n: int, cells: int):
    """A node inside of the raster, which has so many half cells: those beyond an edge are mirrored at it."""
    inside = wp.abs(n)
    return wp.where(2 * inside > cells, cells - inside, inside)


def _bound_block(status: StatusGroup, blocks: BlockGroup, around: AroundGroup, a: int):
    """Add the block at place ``a`` of those with particles to number and extent of the blocks of a scene."""
    if a >= status.tally[NEXT]:
        return
    b = blocks.active[a]
    if blocks.member[b] == around.scene:
        wp.atomic_add(around.bounds, around.turn, 0, 1)
        for d in range(3):
            wp.atomic_min(around.bounds, around.turn, 1 + d, blocks.coordinates[b, d])
            wp.atomic_max(around.bounds, around.turn, 4 + d, blocks.coordinates[b, d])


def add_around_nodes(status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, scenes: SceneGroup, around: AroundGroup):
    """Add each particle of a scene, a plan box of one grid cell, to the nodes half a cell around which it covers; bound its blocks.

    The sums are whole numbers, exact in any order. Nothing is added behind a sort that found too little room.
    """
    p = wp.tid()
    if status.flags[HALT] == GROW:
        return
    _bound_block(status, blocks, around, p)
    if p >= particles.key.shape[0]:
        return
    k = particles.key[p]
    if k < 0 or blocks.member[wp.max(k, 0) >> 6] != around.scene:
        return
    place = _place(particles.rec, p, k, blocks.coordinates, scenes.shift[around.scene])
    x = int(wp.floor(place[0]))
    y = int(wp.floor(place[1]))
    east = place[0] - wp.float64(x)
    north = place[1] - wp.float64(y)
    m = wp.float64(particles.rec[MASS, p])
    volume = m / scenes.density[int(particles.release[p])] * around.volume
    for q in range(4):
        i = wp.clamp(_folded(x + (q >> 1), around.cells_east) - around.east, 0, around.columns - 1)
        j = wp.clamp(_folded(y + (q & 1), around.cells_north) - around.north, 0, around.rows - 1)
        share = wp.where((q >> 1) == 1, east, wp.float64(1.0) - east) * wp.where((q & 1) == 1, north, wp.float64(1.0) - north)
        added = whole5()
        added[0] = wp.int64(wp.round(share * volume))
        added[1] = wp.int64(wp.round(share * m * around.mass))
        for d in range(3):
            added[2 + d] = wp.int64(wp.round(share * wp.float64(particles.rec[MOMENTUM + d, p]) * around.momentum))
        add_wholes(around.sums, (i * around.rows + j) * 5, added)


def _clipped(n: int, cells: int):
    """A node within the raster, which has so many half cells."""
    return wp.min(wp.max(n, 0), cells / 2)


def take_around_nodes(scenes: SceneGroup, around: AroundGroup):
    """Sums of the nodes that the blocks of a scene cover to ``found``, in SI, behind the bounds of the blocks; they are zero again.

    A thread for each number. The other row of the bounds is made ready for the next launch.
    """
    t = wp.tid()
    total = around.sums[t]
    around.sums[t] = wp.int64(0)
    shift = scenes.shift[around.scene]
    if t < BOUNDS:
        around.found[t] = wp.float64(around.bounds[around.turn, t])
        around.bounds[1 - around.turn, t] = wp.where(t == 0, 0, wp.where(t < 4, NOWHERE, -NOWHERE))
    if around.bounds[around.turn, 0] == 0:
        return
    i = _clipped(4 * around.bounds[around.turn, 1], around.cells_east)
    j = _clipped(4 * around.bounds[around.turn, 2] - shift, around.cells_north)
    high_x = 4 * around.bounds[around.turn, 4] + REACH
    high_y = 4 * around.bounds[around.turn, 5] - shift + REACH
    columns = wp.min(wp.max(wp.min(high_x, around.cells_east / 2) - i, 0) + 1, around.columns)
    rows = wp.min(wp.max(wp.min(high_y, around.cells_north / 2) - j, 0) + 1, around.rows)
    node = t / 5
    x = around.east + node / around.rows - i
    y = around.north + node % around.rows - j
    if x < 0 or y < 0 or x >= columns or y >= rows:
        return
    lane = t % 5  # volume, mass, momentum
    unit = wp.where(lane == 0, around.volume, wp.where(lane == 1, around.mass, around.momentum))
    place = wp.where(lane == 0, 0, wp.where(lane == 1, 4, lane - 1))
    around.found[BOUNDS + (place * columns + x) * rows + y] = wp.float64(total) * (wp.float64(1.0) / unit)
