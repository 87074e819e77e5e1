"""Structures on the device: their fields, the sums of the impulses on their patches, and arrays by block for their contacts.

    rows      field 0: row of each of its blocks, -1 for none | field 1 ...       distance, patch   row 0: 729 nodes | row 1 ...
    friction  release 0 of scene 0: one record a patch | release 1 ... | release 0 of scene 1 ...

Scenes may share a field, which is on the device once. The sums of each scene are its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
import warp as wp

from runout.backends.hash.account import Account
from runout.backends.hash.grid import NodeArrays, new_room
from runout.backends.hash.groups import filled, groups_of
from runout.backends.hash.index import Index
from runout.backends.hash.layout import BESIDE, CELL_LANES, REACHED, room_for, run
from runout.backends.hash.scenes import SceneArrays
from runout.backends.hash.state import Store
from runout.backends.hash.structure_surface import OF_FIELD, PARTED
from runout.model.friction_laws import numbers_of
from runout.model.scene import Scene
from runout.model.structures import StructureField

FRICTION = numbers_of(0.0)[0]  # the law of a friction coefficient
UNITS = 2.0**30  # of the upper sums in the impulse of all mass at 1 m/s


class Structures:
    """The structures of the scenes of a batch on the device of the scope, some of which may have none.

    Its arrays are those of :class:`runout.backends.hash.groups.StructureGroup`, and of ``GroundGroup`` and ``ContactGroup`` for
    blocks beside structures.

    Parameters
    ----------
    scenes : SceneArrays
    kernels : SimpleNamespace
    accounts : sequence of Account
        Mass of each scene, for the unit of its sums.
    particles : int
        Number of all particles that are loaded.
    reach : float
        Distance [m] of a particle's centre beyond which it touches no structure in a step.

    Attributes
    ----------
    places, slots : int
        Room for blocks whose particles may touch a structure, and for blocks whose nodes these reach.
    generation : int
        Counts how often arrays were made anew.
    """

    def __init__(
        self, scenes: SceneArrays, kernels: SimpleNamespace, accounts: Sequence[Account], particles: int, reach: float
    ):  # fmt: skip
        self.number, self.types, self.generation = scenes.number, groups_of(scenes.number), 0
        self._take_fields(scenes.scenes, reach)
        self._take_friction(scenes.scenes, kernels)
        self.units = wp.array(np.array([_units(a.mass) for a in accounts]), dtype=wp.float64)
        self.upper, self.lower = (wp.zeros(3 * int(self.ends[-1]) + len(accounts), dtype=wp.int64) for _ in range(2))
        self.forces = wp.zeros(particles, dtype=wp.types.vector(length=4, dtype=self.number))
        self.group = filled(self.types.StructureGroup, self)

    def grow(self, particles: int) -> None:
        """Room for the forces of so many particles; a new index has to follow."""
        longer = wp.zeros(particles, dtype=self.forces.dtype)
        if len(self.forces):
            wp.copy(longer, self.forces, count=len(self.forces))
        self.forces = longer
        self.group = filled(self.types.StructureGroup, self)
        self.generation += 1

    def reach_farther(self, scenes: SceneArrays, reach: float) -> None:
        """Take the parts of the fields that come within a larger ``reach`` [m]."""
        self._take_fields(scenes.scenes, reach)
        self.group = filled(self.types.StructureGroup, self)
        self.generation += 1

    def _take_fields(self, scenes: Sequence[Scene], reach: float) -> None:
        found, kept, first_block, first_row = np.zeros((len(scenes), OF_FIELD), np.int32), [], 0, 0
        places: dict[int, tuple[int, int]] = {}  # first block and first patch of each field
        lattices = np.ones((len(scenes), 7))
        first_patch = 0
        self.ends = np.cumsum([0, *(len(s.structures.patches.area) if s.structures else 0 for s in scenes)])
        for row, lattice, first_sum, scene in zip(found, lattices, self.ends, scenes, strict=False):
            if (field := scene.structures) is None:
                continue
            if id(field) not in places:
                places[id(field)] = first_block, first_patch
                kept.append((*_within(field, reach, first_row), _planes(field)))
                first_block, first_row = first_block + field.blocks.size, first_row + len(field.distance)
                first_patch += len(field.patches.area)
            row[:] = *field.blocks.shape, *places[id(field)], first_sum, len(field.patches.area)
            lattice[:] = *field.origin, field.spacing, *scene.spacing
        rows, distance, patch, planes = (np.concatenate(arrays) for arrays in zip(*kept, strict=True))
        self.fields, self.lattices = wp.array(found, dtype=wp.int32), wp.array(lattices, dtype=wp.float64)
        self.planes = wp.array(planes, dtype=wp.float64)
        self.rows, self.patch = wp.array(rows, dtype=wp.int32), wp.array(patch, dtype=wp.int32)
        self.distance = wp.array(distance, dtype=wp.float32)

    def _take_friction(self, scenes: Sequence[Scene], kernels: SimpleNamespace) -> None:
        tables = [s.structure_friction() for s in scenes]
        many = np.concatenate([np.full(len(table), table.shape[1]) for table in tables])
        self.first_friction = wp.array((np.cumsum(many) - many).astype(np.int32), dtype=wp.int32)
        records = np.zeros(int(many.sum()), [(FRICTION.fields[0], scenes[0].dtype)])
        records[FRICTION.fields[0]] = np.concatenate([table.ravel() for table in tables])
        self.friction = wp.array(records, dtype=kernels.structure_friction)

    def make_nodes(self, index: Index, store: Store, nodes: NodeArrays) -> None:
        """New arrays by block for an index."""
        capacity, self.slots, self.places = index.capacity, -1, -1
        self.vec4 = nodes.vec4
        self.near, self.grounded = (wp.full(capacity, -1, dtype=wp.int32) for _ in range(2))
        self.touching = wp.zeros(capacity, dtype=wp.int32)
        apart = nodes.substepped
        lists = store.size * apart, (capacity * apart, CELL_LANES + 1)
        self.pressed, self.pressed_start = (wp.zeros(shape, dtype=wp.int32) for shape in lists)
        self.listed = (self.pressed, self.pressed_start) if apart else (store.order, index.cstart)
        self.make_room(0, 0)

    def make_room(self, places: int, slots: int, exactly: bool = False) -> None:
        """Room for so many blocks beside structures, and for the impulses of so many; see :meth:`NodeArrays.make_room`."""
        places, slots = new_room((places, slots), (self.places, self.slots), exactly)
        if (places, slots) == (self.places, self.slots):
            return
        self.generation += 1
        self.places, self.slots = places, slots
        self.standing = wp.full(places, -1, dtype=wp.int32)
        self.near_up = wp.zeros((places, 8), dtype=wp.int32)
        self.contact = wp.zeros(64 * slots, dtype=self.vec4)
        shares = wp.array(ptr=self.contact.ptr, dtype=self.number, shape=256 * slots, device=self.contact.device)
        none = {"tiles": (0, 36), "bounds": (0, 32), "slopes": 0, "plan": 0, "approach_speeds": 0, "touched": (0, 2)}
        none |= {"columns": (0, 5), "column_pushes": 0}
        kinds = {"bounds": wp.float16, "slopes": self.vec4, "column_pushes": self.vec4}
        kinds |= dict.fromkeys(("tiles", "plan", "approach_speeds"), self.number)
        empty = {name: wp.zeros(shape, dtype=kinds.get(name, wp.int32)) for name, shape in none.items()}
        pressed, pressed_start = self.listed
        self.ground_group = filled(self.types.GroundGroup, self, **empty)
        self.contact_group = filled(
            self.types.ContactGroup, self, **empty, shares=shares, memory=self.contact, pressed=pressed, pressed_start=pressed_start
        )

    def note_beside(self, k: SimpleNamespace, index: Index, scenes: SceneArrays) -> None:
        """Number the blocks beside structures; halts where these need more room."""
        ground = self.ground_group
        run(k.clear_marks, max(index.capacity, self.places), ground)
        run(k.note_beside, index.capacity, index.block_group, ground, scenes.group, self.group)
        index.number_marked(self.near, BESIDE, self.places, self.standing)
        index.number_marked(self.grounded, REACHED, self.slots, wp.empty(0, dtype=wp.int32))
        self.note_shares(k, index)

    def note_shares(self, k: SimpleNamespace, index: Index) -> None:
        """Launch that finds the sums of contact around each block beside structures."""
        run(k.note_shares, (self.places, 8), index.status.group, index.block_group, self.ground_group)

    def impulses(self, scene: int) -> np.ndarray:
        """Impulse (patches, 3) [N s] of the mass on each patch of a scene since the start; the host waits."""
        found = self._sums(3 * int(self.ends[scene]), 3 * int(self.ends[scene + 1]))
        return (found / self.units.numpy()[scene]).reshape(-1, 3)

    def dissipation(self) -> np.ndarray:
        """Energy (scenes,) [J] that the structures of each scene have taken since the start; the host waits."""
        first = 3 * int(self.ends[-1])
        return self._sums(first, first + len(self.ends) - 1) / self.units.numpy()  # type: ignore[no-any-return]

    def _sums(self, first: int, end: int) -> np.ndarray:
        """Sums from one place to another, in units."""
        if first == end:
            return np.zeros(0)
        upper, lower = (a[first:end].numpy() for a in (self.upper, self.lower))
        return upper + lower / PARTED  # type: ignore[no-any-return]


def _units(mass: float) -> float:
    """Whole numbers for a newton second or a joule: a power of two, so that no digit is lost to it."""
    return float(2.0 ** np.floor(np.log2(UNITS / max(mass, 1e-30))))


def _within(field: StructureField, reach: float, first_row: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row of each block of a field that comes within ``reach`` [m] of a structure, else -1; distances and patches of all rows."""
    least = field.distance.reshape(len(field.distance), -1).min(axis=1, initial=np.inf)
    there = field.blocks.ravel() >= 0
    there[there] = least[field.blocks.ravel()[there]] <= reach
    rows = np.where(there, field.blocks.ravel() + first_row, -1).astype(np.int32)
    return rows, field.distance.ravel(), field.patch.ravel()


def _planes(field: StructureField) -> np.ndarray:
    """Centre [lattice cells] and normal of each patch: (patches, 6)."""
    return np.column_stack([(field.patches.centre - np.array(field.origin)) / field.spacing, field.patches.normal])


def bytes_of_structures(field: StructureField, particles: int, blocks: int, number: int, beside: int = 0) -> int:
    """Forecast of the memory [byte] that structures add to a run with so many particles and blocks.

    Parameters
    ----------
    field : StructureField
    particles, blocks : int
    number : int
        Bytes of a real number.
    beside : int
        Blocks of nodes that particles beside structures reach; 0 while the flow is away from them.
    """
    nodes, patches = field.distance.size, len(field.patches.area)
    of_field = 4 * field.blocks.size + 8 * nodes + (96 + number) * patches
    by_block = (12 + 4 * (CELL_LANES + 1)) * room_for(blocks)  # marks, and where the cells start in a second list
    return of_field + (4 + 4 * number) * particles + by_block + 64 * 4 * number * room_for(beside) + 36 * room_for(beside // 2)
