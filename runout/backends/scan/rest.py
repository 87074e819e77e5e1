"""Kernels of blocks that sleep: which may sleep, which wake, and how particles come to rest (:mod:`runout.backends.scan.sleep`)."""

import numpy as np
from numba import prange

from runout.backends.scan.observe import _add_stress, _moduli, _strain_of
from runout.physics.bspline import weights
from runout.physics.elastic import kirchhoff_stress, log_strain
from runout.physics.moments import moment_slope
from runout.physics.tensors import real

CALM_STEPS = 50  # that a block and its neighbours stay slow before it falls asleep
AWAKE = 13  # the block itself among its neighbours


def count_calm(blocks, moves, sleep, slow2):
    """Count the steps in a row in which no particle of a block was fast and none entered; a block that a particle enters wakes."""
    held, motion, arrivals = blocks.held, moves.motion, moves.arrivals
    asleep = sleep.asleep
    calm = sleep.calm
    for b in prange(blocks.nown):
        if held[b] == 0 or arrivals[b] > 0:
            asleep[b] = False
            calm[b] = 0
        elif not asleep[b]:
            calm[b] = calm[b] + 1 if motion[b, 0] < slow2 else 0


def choose_sleepers(blocks, moves, sleep, fast2):
    """Set ``falling``: the particles of a block that falls asleep, -1 for a block that a fast neighbour wakes, else 0.

    A block falls asleep only in a step in which none of its particles changes its cell: they lie in the order of their cells then.
    """
    held, around, motion, changed = blocks.held, blocks.around, moves.motion, moves.changed
    asleep, calm = sleep.asleep, sleep.calm
    falling = sleep.falling
    for b in prange(blocks.nown):
        falling[b] = 0
        if held[b] == 0:
            continue
        calm_around = calm[b] >= CALM_STEPS and changed[b] == 0
        hit = False
        for q in range(27):
            s = around[b, q]
            if q == AWAKE or s < 0 or held[s] == 0:
                continue
            calm_around = calm_around and calm[s] >= CALM_STEPS
            hit = hit or (not asleep[s] and motion[s, 0] > fast2)
        if asleep[b]:
            falling[b] = -1 if hit else 0
        elif calm_around:
            falling[b] = held[b]


def change_sleepers(nown, sleep):
    """Let blocks fall asleep or wake, as was chosen; returns how many sleep."""
    asleep, calm, falling = sleep.asleep, sleep.calm, sleep.falling
    n = 0
    for b in range(nown):
        if falling[b] < 0:
            asleep[b] = False
            calm[b] = 0
        elif falling[b] > 0:
            asleep[b] = True
        n += asleep[b]
    return n


def share_work(blocks, sleep):
    """Set the particles that move, those of blocks awake, and those that give to nodes: of their neighbours too."""
    held, around, asleep = blocks.held, blocks.around, sleep.asleep
    moving = sleep.moving
    giving = sleep.giving
    for b in prange(blocks.nown):
        moving[b] = 0 if asleep[b] else held[b]
        giving[b] = moving[b]
        if asleep[b]:
            for q in range(27):
                s = around[b, q]
                if s >= 0 and held[s] > 0 and not asleep[s]:
                    giving[b] = held[b]


def _velocity_of_nodes(nodes, up, b, c, wx, wy, wz):
    """Velocity [m/s] that the nodes give to a particle in cell ``c`` of a block."""
    ux = real(0.0)
    uy = real(0.0)
    uz = real(0.0)
    for i in range(3):
        x = (np.int64(c) >> 4) + i
        for j in range(3):
            y = ((np.int64(c) >> 2) & 3) + j
            for k in range(3):
                z = (np.int64(c) & 3) + k
                o = up[b, (x >> 2) * 4 + (y >> 2) * 2 + (z >> 2)]
                a = 4 * (((x & 3) << 4) | ((y & 3) << 2) | (z & 3))
                s = wx[i] * wy[j] * wz[k]
                ux += s * nodes[o, a + 1]
                uy += s * nodes[o, a + 2]
                uz += s * nodes[o, a + 3]
    return ux, uy, uz


def sum_held(particles, blocks, sleep, nodes, held):
    """Fill ``held`` (nown, 4): mass [kg] of the sleeping particles of each block that give to nodes, and their momentum [kg m/s].

    The momentum is that of the nodes, which these particles do not take.
    """
    rec, order, cell, first, up = particles.rec, particles.order, particles.cell, blocks.first, blocks.up
    asleep, giving = sleep.asleep, sleep.giving
    for b in prange(blocks.nown):
        for k in range(4):
            held[b, k] = 0.0
        if not asleep[b]:
            continue
        for t in range(first[b], first[b] + giving[b]):
            p = np.int64(order[t])
            u = _velocity_of_nodes(nodes, up, b, cell[p], weights(rec[p, 4]), weights(rec[p, 8]), weights(rec[p, 12]))
            mass = np.float64(rec[p, 0])
            held[b, 0] += mass
            held[b, 1] += mass * np.float64(u[0])
            held[b, 2] += mass * np.float64(u[1])
            held[b, 3] += mass * np.float64(u[2])


def put_to_rest(particles, blocks, falling, moduli, dt, h):
    """Take the velocity of the particles that fall asleep: their records hold the stress alone."""
    state, order, particle_index = particles.state, particles.order, particles.particle_index
    rec = particles.rec
    first, label = blocks.first, particles.label
    slopes = moment_slope(dt, h[0]), moment_slope(dt, h[1]), moment_slope(dt, h[2])
    for b in prange(blocks.nown):
        for k in range(first[b], first[b] + max(falling[b], 0)):
            p = order[k]
            tau = kirchhoff_stress(log_strain(_strain_of(state, p)), _moduli(moduli, label[particle_index[p], 0]))
            for k in range(1, 4):
                for j in range(4):
                    rec[p, k + 4 * j] = real(0.0)
            _add_stress(rec, p, tau, state[p, 7], slopes)
