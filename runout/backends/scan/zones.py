"""Friction zones of the ground; see :mod:`runout.model.friction`. Called only where a scene has them."""

import math

import numpy as np
from numba import prange

from runout.backends.scan.contact import GRIP
from runout.backends.scan.observe import _node_of
from runout.physics.contact import zone_friction


def take_zones(rec, measured, place, listed, cell, first, nown, touching, bxyz, corner, h, factor, own, size):
    """Change the friction of all contacts to that of the raster's cells (nx, ny), of ``size`` [m], under them."""
    for b in prange(nown):
        for t in range(touching[b]):
            p = listed[first[b] + t]
            x, y, _ = _node_of(bxyz, b, np.int64(cell[p]), corner)
            r = place[b] + t
            i = np.int64(math.floor((x + np.float64(rec[p, 4])) * h[0] / size[0]))
            j = np.int64(math.floor((y + np.float64(rec[p, 8])) * h[1] / size[1]))
            i = min(max(i, 0), factor.shape[0] - 1)
            j = min(max(j, 0), factor.shape[1] - 1)
            g = r >> 4
            measured[g, GRIP, r & 15] = zone_friction(measured[g, GRIP, r & 15], factor[i, j], own[i, j])
