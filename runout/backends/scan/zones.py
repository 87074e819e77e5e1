"""Friction zones of the ground (:mod:`runout.model.friction`). The kernel is called only for scenes that have zones."""

import numpy as np
from numba import prange

from runout.backends.scan.contact_detection import BEFORE, FRICTION
from runout.backends.scan.ground import _kind_at
from runout.backends.scan.observe import _node_of


def take_zones(particles, blocks, contacts, corner, h, zones, ahead):
    """Friction of all contacts, from the cells of the raster under them after a time ``ahead`` [s].

    Until then, contacts hold the number of their release instead of a friction.
    """
    rec, cell, listed = particles.rec, particles.cell, particles.listed
    place, touching, bxyz, first = contacts.place, contacts.touching, blocks.bxyz, blocks.first
    measured = contacts.measured
    kind, size, friction = zones.kind, zones.cell_size, zones.friction
    for b in prange(blocks.nown):
        for t in range(touching[b]):
            p = listed[first[b] + t]
            x, y, _ = _node_of(bxyz, b, np.int64(cell[p]), corner)
            r = place[b] + t
            g = r >> 4
            east = (x + np.float64(rec[p, 4])) * h[0] + ahead * np.float64(measured[g, BEFORE, r & 15])
            north = (y + np.float64(rec[p, 8])) * h[1] + ahead * np.float64(measured[g, BEFORE + 1, r & 15])
            below = _kind_at(east, north, size, kind)
            measured[g, FRICTION, r & 15] = friction[np.int64(measured[g, FRICTION, r & 15]), below]
