"""Arrays by scene, the numbers that all scenes share, and their time steps.

    clock    scene 0: [dt | g dt x, y, z | reach of contact | length of a transfer | its substeps], scene 1: [ ...
    shift    scenes lie one behind the other to the north in the index; each starts at its own node, 0, 4 rows, 8 rows, ...
    density  release 0 of scene 0, release 1 of scene 0, ..., release 0 of scene 1, ...

Every release of every scene has a number of its own: materials, densities and friction are in that order.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import warp as wp

from runout.backends.hash import limits
from runout.backends.hash.block_numbers import GAP
from runout.backends.hash.groups import filled, pore_record
from runout.backends.hash.layout import CLOCK, LASTING, SUBSTEPS
from runout.backends.hash.unknown import UnknownCells
from runout.backends.hash.validation import LARGEST_BLOCK, extent
from runout.backends.hash.zones import Zones
from runout.errors import CapacityError
from runout.model.scene import Scene

FARTHEST = 1.75  # cells that a particle moves in a step at most, in any direction, before the run is called unstable


class SceneArrays:
    """Scenes of a batch on the device of the scope.

    Attributes
    ----------
    scenes : list of Scene
    number : warp type
        Of real numbers.
    rows : int
        Blocks from south to north that a scene has in the index.
    substeps : (scenes,) int
        Of a transfer.
    shifts, first_release : (scenes,), (scenes + 1,) int
        Nodes from the origin of the index north to each scene; number of its first release among those of all scenes.
    table, materials : (releases,) records
        Parameters of the law, on the host and on the device.
    friction : (releases times kinds of ground,) records
        Basal friction of the releases.
    releases, numbers : (scenes,) int32
        First release and number of each scene, on the device.
    mixed : int
        Most releases of a scene if the friction of those of any scene differs, else 1.
    wet : bool
        Whether any mass has pore pressure.
    pores, pore_density : (releases,) records, (releases,)
        Records of pore pressure; density [kg/m3].
    group : SceneGroup
    constants : Constants
    unknown : UnknownCells
    """

    def __init__(self, scenes: list[Scene], kernels: SimpleNamespace):
        first, many = scenes[0], len(scenes)
        self.scenes, self.number = scenes, wp.float32 if first.precision == "float32" else wp.float64
        materials = [m for scene in scenes for m in scene.materials]
        self.table = first.law.table(tuple(materials), first.dtype, min(first.spacing))
        self.materials = wp.array(self.table, dtype=kernels.record)
        self.first_release = np.cumsum([0, *(len(scene.materials) for scene in scenes)])
        extents = np.array([extent(scene) for scene in scenes])
        self.unknown = UnknownCells(scenes)
        self.rows = 2**20 if many == 1 else int(extents[:, 1].max()) // 4 + 1 + GAP
        if many > 1 and many * self.rows >= LARGEST_BLOCK:
            raise CapacityError(f"{many} scenes of {self.rows} blocks from south to north pass the {LARGEST_BLOCK} of the index")
        self.shifts, self.substeps = 4 * self.rows * np.arange(many), np.ones(many, np.int64)
        self.wet = any(scene.is_wet for scene in scenes)
        pores = np.concatenate([scene.pore_table(first.dtype) for scene in scenes])
        self.pores = wp.array(pores, dtype=pore_record(self.number))
        self.pore_density = wp.array(np.array([m.density for m in materials]), dtype=self.number)
        zones = Zones(scenes, kernels.friction_record)
        self.friction = zones.friction
        self.releases = wp.array(self.first_release[:-1].astype(np.int32), dtype=wp.int32)
        self.numbers = wp.array(np.arange(many, dtype=np.int32), dtype=wp.int32)
        self.mixed = max(scene.basal.mixed for scene in scenes)
        steps, packed = (wp.zeros(many, dtype=self.number) for _ in range(2))
        left, step_counts = (wp.zeros(many, dtype=wp.int32) for _ in range(2))
        self.group = filled(
            kernels.groups.SceneGroup, self, clock=wp.zeros((many, CLOCK), dtype=self.number), left=left, steps=steps,
            step_counts=step_counts, packed=packed, shift=wp.array(self.shifts.astype(np.int32), dtype=wp.int32),
            limits=wp.array(extents, dtype=wp.float64),
            density=wp.array(np.array([m.density for m in materials]), dtype=wp.float64),
            of_friction=zones.of_friction, zones=zones.zones, lattice=zones.lattice,
        )  # fmt: skip
        h = wp.types.vector(length=3, dtype=self.number)(*first.spacing)
        band = first.contact_band * min(first.spacing)
        self.constants = filled(
            kernels.groups.Constants, self, h=h, band=band, largest=0.0, gravity=wp.vec3d(*first.gravity), only=-1
        )

    @property
    def substepped(self) -> bool:
        """Whether transfers may have several substeps."""
        return any(scene.substeps > 1 for scene in self.scenes)

    def largest_blocks(self, ordered: bool) -> int:
        """Blocks that a run can address; ``ordered``: sums have a fixed order."""
        return limits.largest_blocks(ordered, self.scenes[0].basal.law, self.mixed, self.substepped)

    def set_left(self, left: np.ndarray) -> None:
        """Bring the numbers (scenes,) of transfers that are left to the device; one number needs no copy from the host."""
        if len(left) == 1:
            self.group.left.fill_(int(left[0]))
        else:
            self.group.left.assign(left.astype(np.int32))

    def set_steps(self, now: np.ndarray, substeps: np.ndarray | None = None) -> None:
        """Time steps [s] of the scenes and the ``substeps`` of their transfers (1) to the device, and what depends on them."""
        first, clock = self.scenes[0], np.zeros((len(now), CLOCK))
        self.substeps = np.ones(len(now), np.int64) if substeps is None else substeps
        self.group.steps.assign(now.astype(first.dtype))
        self.group.packed.assign(now.astype(first.dtype))
        clock[:, 1:4] = now[:, None] * np.array(first.gravity)
        clock[:, LASTING], clock[:, SUBSTEPS] = now * self.substeps, self.substeps
        self.group.clock.assign(clock.astype(first.dtype))
        if first.law.depends_on_rate:
            for step, begin, end in zip(now, self.first_release[:-1], self.first_release[1:], strict=True):
                first.law.set_step(self.table[begin:end], step)
            wp.copy(self.materials, wp.array(self.table, dtype=self.materials.dtype))


def reach_of(scenes: SceneArrays, largest: float) -> float:
    """Distance [m] of a particle's centre beyond which it touches neither ground nor structures in any step."""
    first = scenes.scenes[0]
    band = float(scenes.number(first.contact_band * min(first.spacing)))
    return largest + band + FARTHEST * max(first.spacing)
