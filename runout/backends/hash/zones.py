"""Friction zones of the scenes of a batch as the device holds them; see :mod:`runout.model.friction`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from runout.backends.hash.layout import Doubles2, Rows, Vector
from runout.model.scene import Scene
from runout.physics.contact import zone_friction


class Zones:
    """Zones of all scenes, on the device; where there are none, no kernel looks for them.

    Of the two ``tables`` one (2 scenes, cells) holds factors and own coefficients [1] in turn, the other (scenes, 4) the cells of
    the raster: their numbers east and north, and their sizes [cells of the grid].
    """

    def __init__(self, scenes: Sequence[Scene], real: Any):
        found = [scene.friction_zones for scene in scenes]
        table, lattice = np.zeros((2 * len(found), max((z.factor.size for z in found if z), default=1))), np.ones((len(found), 4))
        table[::2] = 1.0
        for s, (zones, scene) in enumerate(zip(found, scenes, strict=True)):
            if zones:
                table[2 * s : 2 * s + 2, : zones.factor.size] = zones.factor.ravel(), zones.coefficient.ravel()
                lattice[s] = *zones.factor.shape, *(np.array(zones.cell_size) / scene.spacing[:2])
        self.tables = wp.array(table, dtype=real), wp.array(lattice, dtype=wp.float64)


def _friction_in_zone(friction: Any, zones: Rows, lattice: Doubles2, s: int, x: int, y: int, f: Vector):
    """Friction coefficient under a particle of scene ``s`` at offset ``f`` from its first node (x, y)."""
    i = int(wp.floor((wp.float64(x) + wp.float64(f[0])) / lattice[s, 2]))
    j = int(wp.floor((wp.float64(y) + wp.float64(f[1])) / lattice[s, 3]))
    columns = int(lattice[s, 0])
    rows = int(lattice[s, 1])
    cell = wp.clamp(i, 0, columns - 1) * rows + wp.clamp(j, 0, rows - 1)
    return zone_friction(friction, zones[2 * s, cell], zones[2 * s + 1, cell])
