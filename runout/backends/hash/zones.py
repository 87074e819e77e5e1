"""Friction zones of the scenes of a batch as the device holds them; see :mod:`runout.model.friction`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from runout.backends.hash.groups import SceneGroup
from runout.backends.hash.layout import Vector
from runout.model.scene import Scene
from runout.physics.contact import zone_friction
from runout.physics.geostatic import acting_friction
from runout.physics.tensors import real


class Zones:
    """Zones of all scenes, on the device; where there are none, no kernel looks for them.

    Of the two ``tables`` one (2 scenes, cells) holds factors and own coefficients [1] in turn. The other has a row for each scene,
    then for each release of all scenes: the cells of the raster, their numbers east and north and sizes [cells of the grid], and
    friction and strength of the mass [1]. Where there are zones, ``friction`` (releases,) has the row of each release instead of a
    coefficient.
    """

    def __init__(self, scenes: Sequence[Scene], real: Any):
        found = [scene.friction_zones for scene in scenes]
        masses = np.array([m for scene in scenes for m in zip(scene.friction, scene.strengths, strict=True)])
        table, lattice = np.zeros((2 * len(found), max((z.factor.size for z in found if z), default=1))), np.ones((len(found), 4))
        table[::2] = 1.0
        for s, (zones, scene) in enumerate(zip(found, scenes, strict=True)):
            if zones:
                table[2 * s : 2 * s + 2, : zones.factor.size] = zones.factor.ravel(), zones.coefficient.ravel()
                lattice[s] = *zones.factor.shape, *(np.array(zones.cell_size) / scene.spacing[:2])
        lattice = np.concatenate([lattice, np.column_stack([masses, masses])])
        self.tables = wp.array(table, dtype=real), wp.array(lattice, dtype=wp.float64)
        acting = np.array([f for scene in scenes for f in scene.acting_friction])
        self.friction = wp.array(len(found) + np.arange(len(masses)) if any(found) else acting, dtype=real)


def _friction_in_zone(scenes: SceneGroup, mass: Any, s: int, x: int, y: int, f: Vector):
    """Friction coefficient under a particle of scene ``s`` and release ``mass`` (its row) at offset ``f`` from its first node."""
    i = int(wp.floor((wp.float64(x) + wp.float64(f[0])) / scenes.lattice[s, 2]))
    j = int(wp.floor((wp.float64(y) + wp.float64(f[1])) / scenes.lattice[s, 3]))
    columns = int(scenes.lattice[s, 0])
    rows = int(scenes.lattice[s, 1])
    cell = wp.clamp(i, 0, columns - 1) * rows + wp.clamp(j, 0, rows - 1)
    ground = zone_friction(real(scenes.lattice[int(mass), 0]), scenes.zones[2 * s, cell], scenes.zones[2 * s + 1, cell])
    return acting_friction(ground, real(scenes.lattice[int(mass), 1]))
