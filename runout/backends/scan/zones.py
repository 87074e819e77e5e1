"""Friction zones of the ground; see :mod:`runout.model.friction`. Called only where a scene has them."""

import math

import numpy as np
from numba import prange

from runout.backends.scan.observe import _node_of
from runout.physics.contact import zone_friction


def take_zones(contacts, place, listed, cell, first, nown, candidates, bxyz, corner, h, factor, own, size):
    """Change the friction of all rows of contacts to that of the raster's cells (nx, ny), of ``size`` [m], under them."""
    flat = contacts.reshape(-1)
    for b in prange(nown):
        for t in range(candidates[b]):
            x, y, _ = _node_of(bxyz, b, np.int64(cell[listed[first[b] + t]]), corner)
            r = 16 * (place[b] + t)
            i = np.int64(math.floor((x + np.float64(flat[r + 4])) * h[0] / size[0]))
            j = np.int64(math.floor((y + np.float64(flat[r + 8])) * h[1] / size[1]))
            i = min(max(i, 0), factor.shape[0] - 1)
            j = min(max(j, 0), factor.shape[1] - 1)
            flat[r + 10] = zone_friction(flat[r + 10], factor[i, j], own[i, j])
