"""Cells of the raster without elevation as the device holds them: particles that come into one leave the domain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from runout.backends.hash.groups import BlockGroup, ParticleGroup, SceneGroup, StatusGroup
from runout.backends.hash.layout import GONE, HALT, OFFSET, Doubles2, Rows, Shorts, run
from runout.backends.hash.observe import _place
from runout.backends.hash.stencil import _cell_entry
from runout.model.scene import Scene
from runout.physics.tensors import real

if TYPE_CHECKING:
    from runout.backends.hash.parts import Parts


class UnknownCells:
    """Unknown cells of all scenes, on the device; a batch without any launches nothing for them.

    ``mask`` has the cells of one scene after the other, and ``lattice`` (scenes, 5) numbers of cells east and north, their sizes
    [cells of the grid], and where the cells of the scene begin in the mask, or -1.
    """

    def __init__(self, scenes: Sequence[Scene]):
        masks = [s.unknown for s in scenes if s.unknown is not None]
        if not masks:
            self.mask = self.lattice = None
            return
        lattice, begin = np.full((len(scenes), 5), -1.0), 0
        for row, scene in zip(lattice, scenes, strict=True):
            if scene.unknown is not None:
                row[:] = *scene.unknown.shape, *(np.array(scene.raster.cell_size) / scene.spacing[:2]), begin
                begin += scene.unknown.size
        self.mask = wp.array(np.concatenate([m.ravel() for m in masks]).astype(np.int16), dtype=wp.int16)
        self.lattice = wp.array(lattice, dtype=wp.float64)

    def let_escape(self, parts: Parts) -> None:
        """Launch that takes out the particles that have come into unknown cells in this step."""
        if self.mask is None:
            return
        groups = parts.status.group, parts.store.group, parts.index.block_group, parts.scenes.group
        run(parts.k.enter_unknown, parts.store.size, *groups, self.mask, self.lattice)


def _is_counted(rec: Rows, p: int):
    """Whether a particle lies in the cell that its key tells; one that has left the index keeps an offset beyond."""
    counted = True
    for d in range(3):
        counted = counted and rec[OFFSET + d, p] >= real(0.5) and rec[OFFSET + d, p] <= real(1.5)
    return counted


def enter_unknown(
    status: StatusGroup, particles: ParticleGroup, blocks: BlockGroup, scenes: SceneGroup, mask: Shorts, lattice: Doubles2,
):  # fmt: skip
    """Particles in unknown cells leave the domain: their keys tell so, and their cells no longer count them."""
    p = wp.tid()
    k = particles.key[p]
    if status.flags[HALT] != 0 or k < 0:
        return
    s = blocks.member[k >> 6]
    if lattice[s, 4] < wp.float64(0.0):
        return
    place = _place(particles.rec, p, k, blocks.coordinates, scenes.shift[s])
    i = wp.clamp(int(wp.floor(place[0] / lattice[s, 2])), 0, int(lattice[s, 0]) - 1)
    j = wp.clamp(int(wp.floor(place[1] / lattice[s, 3])), 0, int(lattice[s, 1]) - 1)
    if int(mask[int(lattice[s, 4]) + i * int(lattice[s, 1]) + j]) == 0:
        return
    particles.key[p] = -2 - k
    wp.atomic_add(status.tally, GONE, 1)
    if _is_counted(particles.rec, p):
        wp.atomic_sub(blocks.ends, _cell_entry(k), 1)
