"""The GPU backend of :mod:`runout.backends.protocol`: a batch of one scene."""

from collections.abc import Callable, Sequence

import numpy as np
import warp as wp

from runout.backends.hash.batch import Batch
from runout.backends.hash.checkpoint import restore_state, save
from runout.backends.hash.grid import bytes_of_areas
from runout.backends.hash.index import first_table
from runout.backends.hash.layout import FEW, ROWS, SPARE, TILE, layers_of, room_for
from runout.backends.hash.limits import largest_blocks, require_particles, room_within
from runout.backends.hash.structures import bytes_of_structures
from runout.backends.protocol import INDEXES, Counters, LedgerRow, NodeSums, RasterSums, Sinking
from runout.backends.state import State
from runout.errors import ConfigError
from runout.model.basal_friction import BasalFriction
from runout.model.friction_laws import FrictionLaw
from runout.model.particle_source import ParticleSource
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.model.structures import StructureField


def create(device: str = "cpu", deterministic: bool = False, index: str = "sparse") -> "HashBackend":
    """A backend on a device; ``deterministic`` makes a GPU repeat a run bit by bit (the CPU always does).

    ``index`` is "sparse", or "dense" for every block of the box around the particles at the start: what sparse is measured against.

    Raises ConfigError: for another index.
    """
    if index not in INDEXES:
        raise ConfigError(f"index is {index!r}; choose one of {', '.join(INDEXES)}")
    return HashBackend(device, deterministic, dense=index == "dense")


def cuda_devices() -> tuple[str, ...]:
    """Names of the CUDA devices of this machine."""
    return tuple(device.alias for device in wp.get_cuda_devices())


def free_memory(device: str) -> float:
    """Memory [byte] that is free on a CUDA device."""
    return float(wp.get_device(device).free_memory)


class HashBackend(Batch):
    """Sparse hash backend (see :class:`runout.backends.protocol.Backend`)."""

    def __init__(self, device: str = "cpu", deterministic: bool = False, dense: bool = False):
        self.device, self.deterministic, self.dense = wp.get_device(device), deterministic, dense
        self.counters = Counters()

    def load(self, scene: Scene, particles: ParticleSource, more: int = 0) -> None:
        """Take over a scene and its particles, with places for so many ``more``."""
        super().__init__([(scene, particles)], self.device.alias, self.deterministic, self.dense, more)

    def add(self, particles: Particles) -> None:
        """Add particles to those that are there; only these are brought to the device, before the next step."""
        self.join([(0, particles)])

    def lower(self, first: tuple[int, int], depth: np.ndarray, flow: Sinking | None = None) -> None:
        """Lower the ground at the nodes from the ``first`` on by a ``depth`` (nx, ny) [m]; the ``flow`` above follows."""
        self.lower_of(0, first, depth, flow)

    def step(self, dt: float, substeps: int = 1) -> None:
        """One transfer of ``substeps`` explicit substeps of ``dt`` [s]."""
        self.advance([dt], [1], substeps=[substeps])

    def steps(
        self, dt: float, count: int, looks: Sequence[int] = (), take: Callable[[int, RasterSums], None] | None = None,
        substeps: int = 1, nodes: bool = False,
    ) -> None:  # fmt: skip
        """``count`` transfers of ``substeps`` of ``dt`` [s]; the host looks in when particles are sorted or the index grows."""
        each = (lambda _, step, columns: take(step, columns)) if take else None
        self.advance([dt], [count], {0: looks}, each, substeps=[substeps], nodes=[0] if nodes else [])

    def checkpoint(self) -> State:
        """The state between two steps, for :meth:`restore`."""
        with self._at_rest():
            return save(self)

    def restore(self, scene: Scene, state: State) -> None:
        """Take over a scene in the state that :meth:`checkpoint` gave for it."""
        restore_state(self, scene, state)

    def ledger(self) -> LedgerRow:
        """Sums of the present state."""
        return self.ledgers()[0]

    def particles(self) -> Particles:
        """The particles as they are, in the order of their identity."""
        return self.particles_of(0)

    def columns(self) -> RasterSums:
        """Sums over the columns of the raster's cells."""
        return self.columns_of(0)

    def flow_columns(self) -> RasterSums:
        """The same over a window of cells that holds all mass."""
        return self.flow_columns_of(0)

    def lattice_columns(self) -> RasterSums:
        """The same on the lattice of footprints."""
        return self.lattice_columns_of(0)

    def node_columns(self) -> NodeSums | None:
        """Sums around nodes of the plan."""
        return self.node_columns_of(0)

    def plan_masses(self, first: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
        """Masses (releases, 2, nx, ny) by release around nodes of the plan."""
        return self.plan_masses_of(0, first, shape)

    def structure_impulses(self) -> np.ndarray:
        """Impulse (patches, 3) [N s] of the mass on each patch of the structures since ``load``; (0, 3) without any."""
        return self.structure_impulses_of(0)

    @property
    def max_speed(self) -> float:
        """Largest speed [m/s] of any particle."""
        return self.max_speed_of(0)


def bytes_needed(
    particles: int,
    blocks: int,
    precision: str = "float32",
    deterministic: bool = False,
    near: int | None = None,
    structures: StructureField | None = None,
    beside: int = 0,
    friction: BasalFriction | FrictionLaw | None = None,
    mixed: int = 1,
    substeps: int = 1,
) -> int:
    """Forecast of the memory [byte] of a run with so many particles and blocks, ``near`` of them with impulses of the ground.

    Without ``near``, three quarters of the blocks: a flow a few blocks thick. ``beside``: blocks with impulses of ``structures``.
    ``friction``: the law on the ground; without one, one that needs no areas. ``mixed``: releases whose frictions differ, 1 if
    all are alike. ``substeps``: most of a transfer.

    Raises CapacityError if so many particles or blocks cannot be addressed (:mod:`runout.backends.hash.limits`).
    """
    number = 4 if precision == "float32" else 8
    require_particles(particles, number)
    substepped = substeps > 1
    room_within(blocks, blocks, largest_blocks(deterministic, friction, mixed, substepped), "blocks")
    near = 3 * blocks // 4 if near is None else near
    entries = max(first_table(particles), 1 << (2 * blocks - 1).bit_length())
    rows = ROWS + 1 + SPARE * (particles < FEW)
    particle = (rows + 4) * number + 14 + 4 * substepped  # rows, radius, force; ...
    nodes = 64 * room_for(blocks)
    grid = 4 * number * max(layers_of(substepped) * nodes, particles // 4)
    block = 520 + 2 * number + 260 * substepped + deterministic * (TILE * 4 * number + 36)
    tiles = room_for(near // 2) * (36 * number + 100)  # half of these blocks lie above the others
    contact = room_for(near) * 64 * 4 * number * (1 + substepped) + tiles
    more = bytes_of_structures(structures, particles, blocks, number, beside) if structures else 0
    if friction:
        more += bytes_of_areas(friction, mixed, room_for(blocks), number, deterministic)
    return particles * particle + grid + room_for(blocks) * block + contact + 20 * entries + more
