"""Kernels of blocks that sleep: which may sleep, which wake, and how particles come to rest (:mod:`runout.backends.scan.sleep`)."""

from numba import prange

from runout.backends.scan.observe import _add_stress, _moduli, _strain_of
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
