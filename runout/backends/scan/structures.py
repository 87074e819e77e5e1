"""Contact with structures: the calls of its kernels, and what a run keeps of it. A scene without structures makes none of this."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from runout.backends.scan.constants import Tables
from runout.backends.scan.groups import Blocks, Constants, Grid
from runout.backends.scan.state import Store, bytes_of, stamp_of
from runout.backends.scan.structure_groups import Field, Near, Touching
from runout.backends.state import State, arrays_of
from runout.model.scene import Scene
from runout.model.structures import CELLS, StructureField
from runout.physics import contact as contact_law

LOWEST, HIGHEST = 0.5, 4.5  # [cells] of the particles of a block from its first node
SHARE = 216  # nodes that the particles of a block reach


class Structures:
    """Contacts of a run with the structures of its scene.

    Attributes
    ----------
    force : (n, 4) real
        By particle index: stamp of the step in which it last touched a structure, and the force [N] on it.
    impulses : (patches, 3)
        Of the mass on each patch since the start [N s].
    dissipation : float
        Work that the structures took [J].
    contacts, stopped : int
        Particles that touch structures; those that a second impulse stopped since the start.
    """

    near: Near

    def __init__(self, scene: Scene, field: StructureField, particles: int):
        real = scene.dtype
        self.band, self.scene_field = real(scene.contact_band * min(scene.spacing)), field
        self.field = _group(field, scene)
        self.force = np.zeros((particles, 4), real)
        self.impulses, self.dissipation = np.zeros((len(field.patches.area), 3)), 0.0
        self.contacts = self.stopped = 0
        self._blocks_before = np.pad(np.cumsum(np.cumsum(np.cumsum(field.blocks >= 0, 0), 1), 2), ((1, 0),) * 3)

    def checkpoint(self, prefix: str) -> State:
        """What the next step needs, by name."""
        return arrays_of(self, ("band",), prefix)

    def join(self, particles: int) -> None:
        """So many particles more, without a force from a step before."""
        self.force = np.concatenate([self.force, np.zeros((particles, 4), self.force.dtype)])

    def find_near(self, blocks: Blocks, constants: Constants) -> None:
        """Find the blocks near structures, of a new index."""
        n, field = blocks.nown, self.scene_field
        owners = np.flatnonzero(_meets(field, self._blocks_before, blocks.bxyz[:n], constants)).astype(np.int32)
        if not len(owners) and hasattr(self, "near") and not len(self.near.owners):
            return  # nothing is near, as before
        nodes = np.unique(blocks.up[owners])
        row_of = np.full(n + 1, -1, np.int32)  # the last one stands for no block
        row_of[owners] = np.arange(len(owners))
        up = np.searchsorted(nodes, blocks.up[owners]).astype(np.int32)
        self.near = Near(owners, up, nodes.astype(np.int32), np.ascontiguousarray(row_of[blocks.down[nodes]]))
        real = self.force.dtype
        self.touching = Touching(
            np.zeros(len(owners) + 1, np.int64), np.zeros(len(owners), np.int64), np.zeros(len(owners), np.int64),
            *_rows(0, real), np.zeros((len(owners), SHARE, 4), real), *np.zeros((2, len(nodes), 64), real),
        )  # fmt: skip

    def find(
        self, k: SimpleNamespace, store: Store, blocks: Blocks, tables: Tables, steps: int, substeps: int, max_speed: float
    ) -> None:
        """Find the particles that touch structures within so many substeps, the last of them number ``steps``."""
        near, dt, real = self.near, tables.step.dt, self.force.dtype.type
        if not len(near.owners):
            self.contacts = 0
            return
        np.cumsum(blocks.held[near.owners], out=self.touching.place[1:])
        rows = int(self.touching.place[-1])
        if rows > len(self.touching.entry):
            made = _rows(rows + rows // 4, self.force.dtype)
            self.touching = self.touching._replace(**dict(zip(("entry", "patch", "measured", "given", "push"), made, strict=True)))
        lasting = real(substeps * dt)
        reach = contact_law.reach(store.largest_radius, max_speed, lasting, self.band)
        self.contacts = k.find_structure_contacts(
            store.particles, blocks, near, self.field, self.touching, tables.constants, (lasting, self.band, real(reach), dt),
            self.force, real(stamp_of(steps - substeps))
        )  # fmt: skip

    def push(self, k: SimpleNamespace, store: Store, tables: Tables, steps: int, grid: Grid, follows: bool) -> None:
        """Add the impulses of the structures to the velocities of the nodes, and book them; ``steps`` is as for :meth:`find`.

        If another substep ``follows``, the contacts are moved on with the velocities that the nodes then have.
        """
        if self.contacts == 0:
            return
        step = tables.step.dt, self.band, self.force.dtype.type(stamp_of(steps))
        self.dissipation, stopped = k.push_from_structures(
            store.particles, self.near, self.touching, grid, self.field, step, self.force, self.impulses, self.dissipation, follows
        )
        self.stopped += stopped

    def memory(self) -> dict[str, int]:
        """Bytes by array."""
        return bytes_of(self.near, self.touching, structure_force=self.force)


def _group(field: StructureField, scene: Scene) -> Field:
    origin, patches = np.array(field.origin, np.float64), field.patches
    return Field(
        np.ascontiguousarray(field.blocks, np.int32), _by_node(field.distance, np.float32), _by_node(field.patch, np.int32),
        origin, np.array([field.spacing], np.float64), np.ascontiguousarray((patches.centre - origin) / field.spacing),
        patches.normal.astype(scene.dtype), scene.structure_friction().astype(scene.dtype),
    )  # fmt: skip


def _by_node(values: np.ndarray, dtype: Any) -> np.ndarray:
    return np.ascontiguousarray(values.reshape(len(values), -1), dtype)


def _rows(n: int, real: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Entries, patches, measurements and impulses of so many contacts."""
    return np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros((n, 8), real), np.zeros((n, 4), real), np.zeros((n, 4), real)


def _meets(field: StructureField, before: np.ndarray, bxyz: np.ndarray, constants: Constants) -> np.ndarray:
    """Whether the particles of blocks (n, 3) may lie in a block of the lattice; ``before`` counts its blocks below each corner."""
    size, shape = CELLS * field.spacing, np.array(field.blocks.shape)
    most, least = (4 * extreme + constants.corner for extreme in (bxyz.max(0, initial=0), bxyz.min(0, initial=0)))
    outside = ((least + LOWEST) * constants.spacing > field.origin + size * shape) | (
        (most + HIGHEST) * constants.spacing < np.array(field.origin)
    )
    if outside.any():
        return np.zeros(len(bxyz), np.bool_)
    first = constants.corner + 4 * bxyz.astype(np.int64)
    low, high = (
        np.clip(np.floor(((first + by) * constants.spacing - field.origin) / size).astype(np.int64) + more, 0, shape)
        for by, more in ((LOWEST, 0), (HIGHEST, 1))
    )
    count = np.zeros(len(bxyz), np.int64)
    for q in range(8):
        corner = [np.where(q >> a & 1, high[:, a], low[:, a]) for a in range(3)]
        count += (1 if q.bit_count() % 2 else -1) * before[tuple(corner)]
    return count > 0
