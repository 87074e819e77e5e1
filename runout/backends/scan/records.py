"""Writes particles into the slots of the store, in double precision without fused operations.

rec       m | p (3)  |  fx | A column 0 (3)  |  fy | A column 1 (3)  |  fz | A column 2 (3)
state     B - I (6)  |  history  |  volume
"""

from runout.physics.moments import momentum_at
from runout.physics.tensors import vec


def put_particles(store, rank, slots, release, identity, mass, volume, radius, offset, strain):
    """Put particles at rest of a ``rank`` (n,) by block and cell into the ``slots`` of the ranks; returns the largest radius.

    Their motion stays zero, as in an empty store.
    """
    rec, state, largest = store.rec, store.state, 0.0
    for p in range(len(rank)):
        r = rank[p]
        s = slots[r]
        store.label[r, 0], store.label[r, 1] = release[p], identity[p]
        store.radius[r] = radius[p]
        store.particle_index[s] = r
        rec[s, 0] = mass[p]
        rec[s, 4], rec[s, 8], rec[s, 12] = offset[p, 0], offset[p, 1], offset[p, 2]
        for k in range(6):
            state[s, k] = strain[p, k]
        state[s, 7] = volume[p]
        largest = max(largest, radius[p])
    return largest


def set_in_motion(store, rank, slots, mass, offset, velocity, affine, history, force, spacing):
    """Add the motion, history and force of the ground of particles that are in their ``slots``."""
    rec = store.rec
    for p in range(len(rank)):
        r = rank[p]
        s, m = slots[r], mass[p]
        for i in range(3):
            store.force[r, 1 + i] = force[p, i]
            for j in range(3):
                rec[s, 5 + 4 * j + i] = m * affine[p, i, j] * spacing[j]
        x = vec(m * affine[p, 0, 0] * spacing[0], m * affine[p, 1, 0] * spacing[0], m * affine[p, 2, 0] * spacing[0])
        y = vec(m * affine[p, 0, 1] * spacing[1], m * affine[p, 1, 1] * spacing[1], m * affine[p, 2, 1] * spacing[1])
        z = vec(m * affine[p, 0, 2] * spacing[2], m * affine[p, 1, 2] * spacing[2], m * affine[p, 2, 2] * spacing[2])
        d = vec(1.0 - offset[p, 0], 1.0 - offset[p, 1], 1.0 - offset[p, 2])
        momentum = momentum_at(vec(m * velocity[p, 0], m * velocity[p, 1], m * velocity[p, 2]), x, y, z, d)
        rec[s, 1], rec[s, 2], rec[s, 3] = momentum[0], momentum[1], momentum[2]
        store.state[s, 6] = history[p]
