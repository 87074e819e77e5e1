"""Friction of the ground on the releases of a batch, by zones where there are any; see :mod:`runout.model.ground_friction`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from runout.backends.hash.groups import SceneGroup
from runout.backends.hash.layout import Vector
from runout.model.scene import Scene


class Zones:
    """Friction and zones of all scenes, on the device; where there are no zones, no kernel looks for them.

    ``friction`` has the records of all scenes; the other arrays are fields of
    :class:`runout.backends.hash.groups.SceneGroup`.
    """

    def __init__(self, scenes: Sequence[Scene], record: Any):
        found = [scene.basal for scene in scenes]
        table = np.zeros((len(found), max(1 if basal.kind is None else basal.kind.size for basal in found)), np.int32)
        lattice = np.ones((len(found), 4))
        for s, (basal, scene) in enumerate(zip(found, scenes, strict=True)):
            if basal.kind is not None:
                table[s, : basal.kind.size] = basal.kind.ravel()
                lattice[s] = *basal.kind.shape, *(basal.size / scene.spacing[:2])
        kinds = np.concatenate([np.full(len(basal.numbers), basal.kinds) for basal in found])
        limits_start = np.concatenate([basal.limits_start for basal in found])
        self.of_friction = wp.array(np.stack([np.cumsum(kinds) - kinds, limits_start], axis=1).astype(np.int32), dtype=wp.int32)
        self.zones, self.lattice = wp.array(table, dtype=wp.int32), wp.array(lattice, dtype=wp.float64)
        self.friction = wp.array(np.concatenate([basal.table(scenes[0].dtype) for basal in found]), dtype=record)


def _kind_of_ground(scenes: SceneGroup, s: int, x: int, y: int, f: Vector):
    """Kind of ground under a particle of scene ``s`` at offset ``f`` from its first node."""
    i = int(wp.floor((wp.float64(x) + wp.float64(f[0])) / scenes.lattice[s, 2]))
    j = int(wp.floor((wp.float64(y) + wp.float64(f[1])) / scenes.lattice[s, 3]))
    columns = int(scenes.lattice[s, 0])
    rows = int(scenes.lattice[s, 1])
    return scenes.zones[s, wp.clamp(i, 0, columns - 1) * rows + wp.clamp(j, 0, rows - 1)]
