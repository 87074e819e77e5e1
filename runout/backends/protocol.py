"""Interface of all backends; only :func:`get_backend` imports them."""

import ctypes
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from runout.backends.state import State
from runout.errors import DeviceError, DeviceNameError
from runout.model.basal_friction import BasalFriction
from runout.model.friction_laws import FrictionLaw
from runout.model.materials import Material
from runout.model.particle_source import ParticleSource
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.model.structures import StructureField

BACKENDS = ("scan", "hash", "reference")
INDEXES = ("sparse", "dense")  # of scan and hash; the second is a control for measurements


@dataclass
class LedgerRow:
    """Sums over all particles at one time; losses and dissipation are totals since the start."""

    mass: float  # [kg] on the domain
    escaped_mass: float  # [kg] left over the edge of the domain
    momentum: np.ndarray  # (3,) [kg m/s]
    kinetic_energy: float  # [J], with the affine part
    potential_energy: float  # [J], against local elevation 0
    elastic_energy: float  # [J]
    basal_dissipation: float  # [J] by friction and impact at the ground
    plastic_dissipation: float  # [J] inside the material
    escaped_energy: float  # [J] carried over the edge
    basal_impulse: np.ndarray  # (3,) [N s] by the ground on the mass
    max_speed: float  # [m/s] of any particle
    active_blocks: int  # that hold particles
    box_blocks: int  # of the smallest box around these
    contact_particles: int  # on the ground
    structure_dissipation: float = 0.0  # [J] by friction and impact at structures
    entrained_mass: float = 0.0  # [kg] from an erodible bed; backends know no bed, the run books it
    entrained_energy: float = 0.0  # [J] that this mass brought
    entrainment_dissipation: float = 0.0  # [J] to bring it to the speed of the flow
    entered_mass: float = 0.0  # [kg] from releases that start later and other sources; the run books it, as what follows
    entered_energy: float = 0.0  # [J] that this mass brought, kinetic, potential and elastic
    waiting_mass: float = 0.0  # [kg] of releases that have not started


def box_blocks(coordinates: np.ndarray) -> int:
    """Number of blocks in the smallest box that holds those of ``coordinates`` (n, 3); 0 without any."""
    return int(np.prod(np.ptp(coordinates, axis=0).astype(np.int64) + 1)) if len(coordinates) else 0


@dataclass
class BoxSums:
    """Sums over particles, each a box of one grid cell in plan, on cells of the lattice of :mod:`runout.backends.footprints`."""

    source: np.ndarray | Callable[[], np.ndarray]  # of the sums; a function is called once, if they are asked for
    row: int  # first row, from the south, and column of the window
    column: int
    density: float  # [kg/m3]

    @cached_property
    def sums(self) -> np.ndarray:
        """Volume [m3], momentum (3) [kg m/s] and, unless all have one ``density``, mass [kg]: (4 or 5, rows, columns)."""
        return self.source() if callable(self.source) else self.source

    @property
    def mass(self) -> np.ndarray:
        """Mass [kg] (rows, columns)."""
        return self.sums[4] if len(self.sums) > 4 else self.density * self.sums[0]


class Sinking(NamedTuple):
    """What lets the particles of a flow sink with their ground (:func:`runout.physics.bed.sunk`), at nodes of the plan."""

    first: tuple[int, int]  # node; two before the first that falls, as there are two behind the last
    column: np.ndarray  # (2, nx, ny) [m]: by how much the ground falls, and its coefficients before
    turn: float  # 0 to 1, another one each time: with the place of a particle it decides whether that sinks


@dataclass
class NodeSums:
    """Sums over particles, each a box of one grid cell in plan, around nodes of the plan: half a cell to either side."""

    first: tuple[int, int]  # first node, east and north
    sums: np.ndarray  # (5, nx, ny): volume [m3], momentum (3) [kg m/s], mass [kg]


@dataclass
class RasterSums:
    """Sums over the particles above each cell of the raster or of a window of it (rows, columns)."""

    volume: np.ndarray  # [m3]
    mass: np.ndarray  # [kg]
    momentum: np.ndarray  # (rows, columns, 3) [kg m/s]
    row: int = 0  # first row and column of the window
    column: int = 0
    flowing: np.ndarray | None = None  # [m3] without single particles, the volume that has a thickness; None: all of it
    boxes: "BoxSums | None" = None  # the same particles before they are spread; None without any
    lanes: np.ndarray | None = None  # volume, momentum (3), mass unless all have one density, and flowing, where one array has them

    @property
    def depth_volume(self) -> np.ndarray:
        """Volume [m3] of which the thickness of the flow is made."""
        return self.volume if self.flowing is None else self.flowing

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of the window; there are no particles outside."""
        rows, columns = self.mass.shape
        return slice(self.row, self.row + rows), slice(self.column, self.column + columns)


@dataclass
class Counters:
    """Work since ``load``; CI checks these counters instead of times."""

    steps: int = 0  # substeps of all transfers
    transfers: int = 0
    particle_steps: int = 0
    rebuilds: int = 0
    seconds: dict[str, float] = field(default_factory=dict)

    def add(self, substeps: int, particles: int, transfers: int = 1) -> None:
        """Count ``transfers`` of so many substeps and particles."""
        self.steps += transfers * substeps
        self.transfers += transfers
        self.particle_steps += transfers * substeps * particles


class Backend(Protocol):
    """A backend stores nodes and particles and orders the loops. It contains no formula."""

    counters: Counters

    def load(self, scene: Scene, particles: ParticleSource, more: int = 0) -> None:
        """Load a scene and its particles, a chunk at a time; a backend may make places for ``more`` that are expected to join."""

    def add(self, particles: Particles) -> None:
        """Add particles to those that are there, between two steps.

        All sums since ``load``, counters, impulses and forces of the last step go on; the numbers of no other particle change.

        Parameters
        ----------
        particles : Particles
            In any state, of releases of the scene, with identities that no particle has or had.

        Raises
        ------
        StabilityError, CapacityError
            As by :meth:`load`, before anything has changed.
        """

    def lower(self, first: tuple[int, int], depth: np.ndarray, flow: Sinking | None = None) -> None:
        """Lower the ground of the scene between two steps (:meth:`runout.model.nodal_surface.NodalSurface.lower`), in place.

        Of a ``flow`` above, particles on the ground sink as :func:`runout.physics.bed.sunk` states, with the same velocity and
        stress, each in its cell.

        Parameters
        ----------
        first : tuple of int
            Node of ``depth[0, 0]``.
        depth : ndarray (nx, ny)
            By which the coefficients of the nodes fall [m]. The ground has room for them
            (:meth:`runout.model.nodal_surface.NodalSurface.with_room`).
        flow : Sinking, optional
            None: nothing sinks.
        """

    @property
    def max_speed(self) -> float:
        """Largest speed [m/s] of any particle after the last step."""

    def stable_step(self) -> float:
        """Largest admissible time step [s] from the acoustic and the particle limit."""

    def step(self, dt: float, substeps: int = 1) -> None:
        """One transfer of ``substeps`` explicit substeps of ``dt`` [s] (:mod:`runout.physics.substeps`)."""

    def particles(self) -> Particles:
        """Present particles, ordered by identity."""

    def ledger(self) -> LedgerRow:
        """Sums of the present state."""

    def structure_impulses(self) -> np.ndarray:
        """Impulse (patches, 3) [N s] of the mass on each patch of the structures since ``load``, float64; (0, 3) without any."""

    def columns(self) -> RasterSums:
        """Sums over the columns of the raster's cells."""

    def memory_bytes(self) -> int:
        """Memory [byte] of the arrays that grow with particles and blocks; on the device if the backend has one."""


@runtime_checkable
class BatchBackend(Protocol):
    """A backend that makes several transfers without the host. This saves time if a launch costs as much as a step."""

    def steps(
        self, dt: float, count: int, looks: Sequence[int] = (), take: Callable[[int, RasterSums], None] | None = None,
        substeps: int = 1, nodes: bool = False,
    ) -> None:  # fmt: skip
        """``count`` transfers of ``substeps`` explicit substeps of ``dt`` [s].

        After the transfers that ``looks`` names, from 1 on, ``take`` gets the number of the transfer and its columns: those of
        :meth:`WindowBackend.lattice_columns`. ``nodes`` announces that :meth:`WindowBackend.node_columns` is called next.
        """


@runtime_checkable
class WindowBackend(Protocol):
    """A backend that knows the part of the raster with mass, so that observers skip the rest."""

    def flow_columns(self) -> RasterSums:
        """The sums of :meth:`Backend.columns`, bit by bit, over a window of the raster that holds all mass."""

    def lattice_columns(self) -> RasterSums:
        """The same sums over a window of the lattice of :mod:`runout.backends.footprints`; its row 0 is the southernmost."""

    def node_columns(self) -> NodeSums | None:
        """Sums around nodes of the plan, without the smoothing of footprints; None without particles."""

    def plan_masses(self, first: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
        """Mass [kg], and mass times pore pressure ratio, (releases, 2, nx, ny) by release around nodes of the plan.

        A particle counts at the nearest of the nodes, of which ``shape`` are taken from the ``first`` on.
        """


@runtime_checkable
class ResumableBackend(Protocol):
    """A backend whose state can be saved, so that an interrupted run continues to the same bits."""

    def checkpoint(self) -> State:
        """State between two steps by name. Arrays may belong to the backend: write them before the next step."""

    def restore(self, scene: Scene, state: State) -> None:
        """Load a scene in the state that :meth:`checkpoint` returned for it; the number of threads may differ."""


class SceneBatch(Protocol):
    """Scenes that share the launches of one device, each with its own time step and end; s is the number of a scene."""

    def stable_step(self, s: int, /) -> float:
        """Largest admissible time step [s]."""

    def advance(
        self, dt: Sequence[float], count: Sequence[int], looks: Mapping[int, Sequence[int]] | None = None,
        take: Callable[[int, int, RasterSums], None] | None = None, going_on: Collection[int] = (),
        substeps: Sequence[int] | None = None, nodes: Collection[int] = (),
    ) -> None:  # fmt: skip
        """``count[s]`` transfers of ``substeps[s]`` substeps of ``dt[s]`` [s], by default one each.

        ``take`` gets scene, transfer and columns, as of :meth:`BatchBackend.steps`; ``nodes`` are scenes for which it announces.

        Scenes that are ``going_on`` with steps that began in an earlier call keep the length that was admissible then.
        """

    def leave(self, scenes: Sequence[int]) -> None:
        """Remove these scenes from the batch; they have ended."""

    def failure(self, s: int, /) -> str:
        """Reason why a scene ended early; empty if it did not."""

    def ledgers(self) -> list[LedgerRow]:
        """Sums of the present state, a row a scene."""

    def structure_impulses_of(self, s: int, /) -> np.ndarray:
        """As :meth:`Backend.structure_impulses`."""

    def memory_bytes(self) -> int:
        """As :meth:`Backend.memory_bytes`, of all scenes together."""

    def particles_of(self, s: int, /) -> Particles:
        """As :meth:`Backend.particles`."""

    def columns_of(self, s: int, /) -> RasterSums:
        """As :meth:`Backend.columns`."""

    def flow_columns_of(self, s: int, /) -> RasterSums:
        """As :meth:`WindowBackend.flow_columns`."""

    def lattice_columns_of(self, s: int, /) -> RasterSums:
        """As :meth:`WindowBackend.lattice_columns`."""

    def node_columns_of(self, s: int, /) -> NodeSums | None:
        """As :meth:`WindowBackend.node_columns`."""

    def plan_masses_of(self, s: int, first: tuple[int, int], shape: tuple[int, int], /) -> np.ndarray:
        """As :meth:`WindowBackend.plan_masses`."""

    def join(self, more: Sequence[tuple[int, Particles]]) -> None:
        """Add particles to scenes, given by number, all at once; as :meth:`Backend.add`."""

    def lower_of(self, s: int, first: tuple[int, int], depth: np.ndarray, flow: Sinking | None = None, /) -> None:
        """As :meth:`Backend.lower`; scenes that share the ground share what is lowered."""

    def max_speed_of(self, s: int, /) -> float:
        """As :attr:`Backend.max_speed`."""

    def look_at(self, scenes: Sequence[int]) -> None:
        """Announce that the columns of these scenes will be read before the next step, so that the device is waited for once."""


def get_batch(scenes: Sequence[tuple[Scene, ParticleSource]], device: str, more: int = 0) -> SceneBatch:
    """Batch of scenes on a device, with the backend hash, and with places for ``more`` particles that are expected to join.

    Raises ConfigError or CapacityError if scenes differ in settings that they must share, or need more memory than the device has.
    """
    return import_module("runout.backends.hash.batch").Batch(scenes, device, more=more)  # type: ignore[no-any-return]


class Compilation(Protocol):
    """Compilation of kernels that goes on beside this process."""

    @property
    def is_running(self) -> bool:
        """Whether something is left to compile."""

    def wait(self, progress: Callable[[float], None]) -> None:
        """Wait for the end; ``progress`` is called with the finished fraction, 0 to 1."""


def start_compilation(
    materials: tuple[Material, ...], frictions: tuple[BasalFriction, ...], choices: dict[str, Any], *, zones: bool,
    structures: bool = False, wet: bool = False, marked: Callable[[Path], None] | None = None,
) -> Compilation:  # fmt: skip
    """Compilation for the backend scan, with the parameters of :class:`runout.backends.scan.ahead.CompilingAhead`."""
    ahead = import_module("runout.backends.scan.ahead")
    return ahead.CompilingAhead(materials, frictions, choices, zones=zones, structures=structures, wet=wet, marked=marked)  # type: ignore[no-any-return]


def free_memory(device: str) -> float:
    """Free memory [byte] of a CUDA device."""
    return import_module("runout.backends.hash.backend").free_memory(device)  # type: ignore[no-any-return]


def get_backend(
    name: str, device: str = "auto", threads: int | None = None, *, deterministic: bool = False, index: str = "sparse"
) -> Backend:
    """Backend by name: "scan" (numba, CPU), "hash" (warp, CPU or GPU), "reference" (NumPy), or "auto".

    Parameters
    ----------
    name : str
        "auto" takes hash on a CUDA device, and scan where there is none.
    device : str
        "cpu", "cuda" or "cuda:N", or "auto": the first CUDA device for hash if there is one, else the CPU.
    threads : int, optional
        Threads of the CPU, for scan.
    deterministic : bool
        Results on a GPU repeat bit by bit; those on the CPU always do.
    index : str
        "sparse", or for scan and hash "dense": every block of the box around the particles, a control for measurements.

    Raises
    ------
    DeviceError
        In one line, with the names of what is there.
    """
    if name not in (*BACKENDS, "auto"):
        raise DeviceError(f"backend is {name!r}; choose one of {', '.join(BACKENDS)}, auto")
    if name in ("hash", "auto"):
        place = find_device(device)
        if name == "hash" or place != "cpu":
            return import_module("runout.backends.hash.backend").create(place, deterministic, index)  # type: ignore[no-any-return]
        name = "scan"
    elif device not in ("cpu", "auto"):
        raise DeviceError(f"device is {device!r}; backend {name!r} runs on 'cpu' only")
    options = {"index": index} if name == "scan" else {}
    backend = import_module(f"runout.backends.{name}.backend").create(threads, **options)
    return backend  # type: ignore[no-any-return]


def bytes_on_host(
    particles: int, held: int, owners: int, nodes: int, precision: str, friction: BasalFriction | FrictionLaw | None = None
) -> int:
    """Memory [byte] that the scan backend takes (see :func:`runout.backends.scan.forecast.bytes_needed`)."""
    forecast = import_module("runout.backends.scan.forecast")
    return forecast.bytes_needed(particles, held, owners, nodes, precision, friction)  # type: ignore[no-any-return]


def bytes_on_device(
    particles: int, blocks: int, precision: str, structures: StructureField | None = None,
    friction: BasalFriction | FrictionLaw | None = None, mixed: int = 1, substeps: int = 1,
) -> int:  # fmt: skip
    """Memory [byte] that the hash backend takes for so many particles and blocks of nodes.

    ``mixed``: releases whose frictions differ, 1 if all are alike. ``substeps``: most of a transfer.
    """
    needed = import_module("runout.backends.hash.backend").bytes_needed
    has = {"structures": structures, "friction": friction, "mixed": mixed}
    return needed(particles, blocks, precision, substeps=substeps, **has)  # type: ignore[no-any-return]


def find_device(wanted: str) -> str:
    """Device with this name: "cpu", "cuda:N", or for "auto" the first CUDA device, else "cpu".

    Raises DeviceError if it does not exist; the message lists the devices of the machine.
    """
    if wanted == "cpu":
        return wanted
    if wanted != "auto" and not re.fullmatch(r"cuda(:\d+)?", wanted):
        raise DeviceNameError(f"device is {wanted!r}; choose cpu, auto, or a GPU such as cuda:0")
    there = _cuda_devices()
    if wanted == "auto":
        return (*there, "cpu")[0]
    named = f"{wanted}:0" if wanted == "cuda" else wanted
    if named not in there:
        raise DeviceError(f"device is {wanted!r}, which is not there; this machine has {', '.join((*there, 'cpu'))}")
    return named


def devices_of(device: str) -> tuple[str, ...]:
    """GPUs for the members of an ensemble: all for "cuda", the named one for "cuda:N", none for "cpu"."""
    if not device.startswith("cuda"):
        return ()
    return _cuda_devices() if device == "cuda" else (find_device(device),)


def _cuda_devices() -> tuple[str, ...]:
    """Names of the CUDA devices that warp finds. Without a driver warp is not imported, since it would warn."""
    if not any(_loads(library) for library in ("libcuda.so.1", "libcuda.so", "nvcuda.dll")):
        return ()
    return import_module("runout.backends.hash.backend").cuda_devices()  # type: ignore[no-any-return]


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
