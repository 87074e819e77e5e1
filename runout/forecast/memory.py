"""Forecasts the memory of a run from its releases before large allocations, and refuses runs that do not fit."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from typing import Any

import numpy as np

from runout.backends.protocol import Backend, bytes_on_device, bytes_on_host
from runout.errors import CapacityError
from runout.model.basal_friction import BasalFriction
from runout.model.bed import Bed
from runout.model.facts import short
from runout.model.friction_laws import FrictionLaw
from runout.model.inflow import Inflow
from runout.model.limits import PARTICLES_PER_CELL
from runout.model.numerics import Numerics, Scheme
from runout.model.release import Release
from runout.model.structures import StructureField, Structures
from runout.model.surface import Surface
from runout.quantities import member_map_names

GIGABYTE = 1e9
# cells around the first node of a square of two cells by two, west and south, there, and east and north; and above and below:
# extent of the index of scan, and of hash, whose particles move one cell between two sorts
REACH, REACH_ON_DEVICE = ((-4, 0, 3), 3), ((-2, 0, 2), 1)
WHILE_LOADED = 8, 24  # bytes a particle beside the arrays of a backend on the CPU while it loads them, and on the host of a GPU
CHUNKS = 1e7  # bytes of the particles that are made at once
BYTES_PER_SQUARE = 40, 1000  # bytes per square of two by two cells while blocks are counted: around the release, and below it
PER_MAP_CELL = 110 + 8 * len(member_map_names())  # bytes per cell of the raster: sums, work arrays, and the maps
PER_CONDITION = 8  # bytes per cell of the raster and joint condition: the largest share of its thresholds
STRUCTURE_SUMS = 4 * 216 + 4 * 128  # numbers by block near structures: of the nodes that its particles reach, and of its nodes
PLAN = 16  # columns of a block
PROGRAM = 0.22e9  # libraries and compiled code


@dataclass(frozen=True)
class Share:
    """Particles of one source of mass: a release, the bed, an inflow."""

    what: str  # names the source, its size and what states that
    particles: int
    key: str  # names the value to lower
    value: float  # that gives so many particles; their number is in proportion to it
    unit: str


@dataclass(frozen=True)
class Extent:
    """Counts for the forecast: particles, blocks with particles, blocks that they may enter, and blocks of nodes (on a GPU).

    ``mixed``: releases whose frictions differ, 1 if all are alike. ``wet``: releases, if any has pore pressure, else 0.
    ``friction``: the law on the ground, or the mixture of those that releases follow; None if it is not known.
    ``shares``: the particles by source.
    """

    particles: int
    occupied: int
    owners: int
    nodes: int
    nodes_on_device: int
    mixed: int = 1
    wet: int = 0
    friction: FrictionLaw | None = field(default=None, kw_only=True)
    shares: tuple[Share, ...] = field(default=(), kw_only=True)

    @property
    def largest_share(self) -> Share | None:
        """The source of half of the particles or more; None where it is the only one, or none has half of them."""
        largest = max(self.shares, key=lambda one: one.particles, default=None)
        return largest if len(self.shares) > 1 and largest and 2 * largest.particles >= self.particles else None


@dataclass(frozen=True)
class MemoryForecast:
    """Memory of a run at its start [byte]; a flow that spreads thinly may take more blocks later."""

    backend: float  # particles, index and blocks; on the device if that is a GPU
    host: float  # further memory of the host: what loading takes, maps, the program. `Result.state` takes 250 bytes a particle more
    on_device: bool = False
    extent: Extent | None = field(default=None, repr=False)  # what it is of
    # memory of an extent, of the part that grows with it: on the device if the backend runs there
    bytes_of: Callable[[Extent], float] | None = field(default=None, repr=False)

    @property
    def total(self) -> float:
        """Memory of the host [byte], with the backend if it runs there."""
        return self.host + (0.0 if self.on_device else self.backend)

    def require(self, limit: float, what: str) -> None:
        """Raise CapacityError if the host needs more than ``limit`` [byte]; ``what`` names the limit."""
        if self.total > limit:
            raise _too_much(self.total, limit, what, self.because(limit))

    def because(self, limit: float) -> str:
        """Part of a message: whose particles most are, and the value that fits into ``limit`` [byte]; empty for a single source."""
        share = self.extent.largest_share if self.extent else None
        if share is None or self.extent is None or self.bytes_of is None:
            return ""
        particles = self.extent.particles
        without = self.bytes_of(replace(self.extent, particles=particles - share.particles, shares=()))
        fitting = share.value * (limit - without) / max(self.bytes_of(self.extent) - without, 1.0)
        if fitting <= 0.0:
            return f"{_part_of(share, particles)}; the rest alone does not fit either"
        digit = 10.0 ** (math.floor(math.log10(fitting)) - 1)
        return f"{_part_of(share, particles)}; {share.key} of at most {math.floor(fitting / digit) * digit:.3g} {share.unit} fits"


def _part_of(share: Share, particles: int) -> str:
    return f"; {share.particles:.3g} of its {particles:.3g} particles are {share.what}"


def _too_much(needed: float, limit: float, what: str, because: str) -> CapacityError:
    coarser = math.ceil(100 * (needed / limit) ** (1 / 3)) / 100 if limit > 0 else math.inf
    return CapacityError(
        f"the run needs about {needed / GIGABYTE:.3g} GB of memory, {what} is {limit / GIGABYTE:.3g} GB; "
        f"use a cell_size {coarser:g} times as large, fewer particles_per_cell, or raise the limit{because}"
    )


def require_memory(forecast: MemoryForecast, engine: Backend, memory_gb: float | None) -> None:
    """Raise CapacityError if a run needs more than ``memory_gb`` [GB], or than machine and device have free."""
    if memory_gb is not None:
        forecast.require(memory_gb * GIGABYTE, "memory_gb")
    free = available_bytes()
    if free is not None:
        forecast.require(free, "the memory that is available")
    device: Any = getattr(engine, "device", None)
    if forecast.on_device and forecast.backend > device.free_memory:
        because = forecast.because(device.free_memory)
        raise _too_much(forecast.backend, device.free_memory, f"the free memory of {device.alias}", because)


def available_bytes() -> float | None:
    """Memory that this process may still allocate [byte]; None if unknown."""
    if find_spec("psutil") is None:
        return None
    import psutil

    return float(psutil.virtual_memory().available)


def expected_memory(
    extent: Extent, map_cells: int, scheme: Scheme, engine: Backend | None = None, structures: Structures | None = None,
    friction: BasalFriction | FrictionLaw | None = None, host_bytes: Callable[..., int] = bytes_on_host, conditions: int = 0,
) -> MemoryForecast:  # fmt: skip
    """Forecast for a backend, by default scan.

    Parameters
    ----------
    extent : Extent
    map_cells : int
        Cells of the elevation raster.
    scheme : Scheme
    engine : Backend, optional
        A GPU backend gives its own numbers; otherwise those of scan are used.
    structures : Structures, optional
    friction : BasalFriction or FrictionLaw, optional
        The law on the ground, if ``extent`` does not hold it.
    host_bytes : callable
        Takes the place of :func:`runout.backends.protocol.bytes_on_host`, which imports the backend.
    conditions : int
        Number of joint conditions that the run records; the host holds them for every backend.

    Raises
    ------
    CapacityError
        If a GPU backend cannot address so many particles or blocks.
    """
    device: Any = getattr(engine, "device", None)
    on_device = device is not None and bool(device.is_cuda)
    field = structures.field if structures else None
    precision, friction = scheme.precision, extent.friction or friction

    def of_host(one: Extent) -> float:
        maps = (PER_MAP_CELL + PER_CONDITION * conditions) * map_cells
        return PROGRAM + CHUNKS + WHILE_LOADED[on_device] * one.particles + maps

    def of_backend(one: Extent) -> float:
        if on_device:
            sizes = one.particles, one.nodes_on_device
            backend = bytes_on_device(*sizes, precision, field, friction, one.mixed, scheme.substeps)
            return backend + pore_bytes(one, precision)
        backend = host_bytes(one.particles, one.occupied, one.owners, one.nodes, precision, friction)
        return backend + (structure_bytes(field, one, precision) if field else 0) + pore_bytes(one, precision, on_cpu=True)

    try:
        backend = of_backend(extent)
    except CapacityError as error:  # more than a GPU can address
        share = extent.largest_share
        raise CapacityError(f"{error}{_part_of(share, extent.particles) if share else ''}") from None
    growing = of_backend if on_device else lambda one: of_backend(one) + of_host(one)
    return MemoryForecast(backend, of_host(extent), on_device, extent, growing)


def pore_bytes(extent: Extent, precision: str, on_cpu: bool = False) -> int:
    """Memory [byte] of pore pressure: two numbers a particle at most, and the layers in which it drains; 0 without any.

    The backend scan, ``on_cpu``, has the release of each particle too where there are several, and the masses of the nodes.
    """
    number, numbers = 4 if precision == "float32" else 8, 2 + on_cpu * (extent.wet > 1)
    layers = PLAN * ((1 + on_cpu) * extent.owners * extent.wet + (1 + 4 * on_cpu) * extent.nodes)
    return number * (numbers * extent.particles + layers) if extent.wet else 0


def structure_bytes(structures: StructureField, extent: Extent, precision: str) -> int:
    """Memory [byte] of structures in scan: their field, a force by particle, and the sums of the blocks that may be near them."""
    number = 4 if precision == "float32" else 8
    near = min(len(structures.distance), extent.owners)
    return structures.nbytes + number * (4 * extent.particles + STRUCTURE_SUMS * near)


def expected_extent(
    releases: Sequence[Release], surface: Surface, spacing: tuple[float, float, float], per_axis: tuple[int, int, int]
) -> Extent:
    """Particles and blocks of releases, estimated from their thickness without making particles."""
    shares = tuple(_share(release, spacing, per_axis) for release in releases)
    columns = [_columns(release, surface, spacing) for release in releases]
    low, high = (np.concatenate([c[k] for c in columns]) for k in (0, 1))
    occupied = _blocks(low, high, (0,), 0)
    owners = _blocks(low, high, *REACH)
    kinds = occupied, owners, _with_nodes(owners), _with_nodes(_blocks(low, high, *REACH_ON_DEVICE))
    number = sum(share.particles for share in shares)
    extent = Extent(number, *(int((b[:, 3] - b[:, 2] + 1).sum()) for b in kinds), shares=shares)
    return replace(extent, wet=len(releases)) if any(release.pore_pressure for release in releases) else extent


def with_births(
    extent: Extent, bed: Bed | None, releases: Sequence[Release], numerics: Numerics, friction: BasalFriction | float
) -> Extent:
    """The counts with all particles that a bed can give: its volume on the ground that a mass can reach.

    ``friction`` is that of the run, or its angle [deg].
    """
    if bed is None:
        return extent
    from runout.release.sample import particles_per_axis
    from runout.terrain.prepare import reachable

    basal = friction if isinstance(friction, BasalFriction) else math.radians(friction)
    under = [r.friction_on(basal) for r in releases]
    angle = min(math.atan(f.least) if isinstance(f, BasalFriction) else f for f in under)
    terrain = releases[0].terrain
    reached = reachable(terrain, np.sum([r.thickness for r in releases], axis=0), angle)
    depth = bed.depth_on(terrain, releases) * reached
    volume, deepest = float(depth.sum() * terrain.cell_area), float(depth.max(initial=0.0))
    per_cell = math.prod(particles_per_axis(numerics.particles_per_cell or PARTICLES_PER_CELL))
    born = math.ceil(volume * per_cell / math.prod(numerics.spacing))
    what = f"reserved for the bed ({bed.source}), {deepest:g} m deep and {short(volume, 'm3')} within reach of the mass"
    share = Share(what, born, "a depth", deepest, "m")
    return replace(extent, particles=extent.particles + born, shares=(*extent.shares, share))


def with_inflow(extent: Extent, inflows: Sequence[Inflow], numerics: Numerics, end_time: float) -> Extent:
    """The counts with all particles that inflows bring until ``end_time`` [s], instead of those that stand for them at the line."""
    if not inflows:
        return extent
    from runout.release.inlet import mass_at
    from runout.release.sample import particles_per_axis

    per_axis = particles_per_axis(numerics.particles_per_cell or PARTICLES_PER_CELL)
    stand_ins = [_share(mass_at(one), numerics.spacing, per_axis) for one in inflows]
    shares = [share for share in extent.shares if share not in stand_ins]
    for one in inflows:
        volume = float(one.hydrograph.entered.at(end_time))
        born = math.ceil(volume * math.prod(per_axis) / math.prod(numerics.spacing))
        what = f"what inflow {one.name} brings until end_time, {short(volume, 'm3')}"
        shares.append(Share(what, born, "an inflow", volume, "m3"))
    known = max(0, extent.particles - sum(share.particles for share in stand_ins))
    born = sum(share.particles for share in shares[len(shares) - len(inflows) :])
    return replace(extent, particles=known + born, shares=tuple(shares))


def _share(release: Release, spacing: tuple[float, float, float], per_axis: tuple[int, int, int]) -> Share:
    """The particles of a release."""
    particles, what = _particles(release, spacing, per_axis), f"of release {release.name}, {short(release.volume, 'm3')}"
    return Share(what, particles, "a volume", release.volume, "m3")


def _particles(release: Release, spacing: tuple[float, float, float], per_axis: tuple[int, int, int]) -> int:
    """Particles of a release: at least one in each column of the lattice of particles."""
    layer, plan = spacing[2] / per_axis[2], spacing[0] * spacing[1] / (per_axis[0] * per_axis[1])
    rows = np.maximum(1.0, release.thickness[release.thickness > 0] / layer)
    return math.ceil(rows.sum() * release.terrain.cell_area / plan)


def _columns(release: Release, surface: Surface, spacing: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest grid node (n, 3) of the mass in squares of two by two cells."""
    terrain = release.terrain
    rows, columns = (np.flatnonzero((release.thickness > 0).any(axis=axis)) for axis in (1, 0))
    width, height = ((np.ptp(n) + 1) * terrain.cell_size[k] for k, n in enumerate((columns, rows)))
    _require_countable(release.name, spacing, (width / (2 * spacing[0])) * (height / (2 * spacing[1])) * BYTES_PER_SQUARE[0])
    x = _middles(columns[0] * terrain.cell_size[0], (columns[-1] + 1) * terrain.cell_size[0], 2 * spacing[0])
    south, north = terrain.shape[0] - 1 - rows[-1], terrain.shape[0] - rows[0]
    y = _middles(south * terrain.cell_size[1], north * terrain.cell_size[1], 2 * spacing[1])
    row = terrain.shape[0] - 1 - np.minimum(y // terrain.cell_size[1], terrain.shape[0] - 1).astype(np.int64)
    column = np.minimum(x // terrain.cell_size[0], terrain.shape[1] - 1).astype(np.int64)
    thickness = release.thickness[np.ix_(row, column)]
    j, i = np.nonzero(thickness)
    _require_countable(release.name, spacing, len(j) * BYTES_PER_SQUARE[1])
    x, y, thickness = (x[i], y[j], thickness[j, i]) if len(j) else _cells(release)  # single cells may lie between the middles
    ground, east, north_slope = surface.evaluate(x, y)
    rise = 0.5 * (np.abs(east) * spacing[0] + np.abs(north_slope) * spacing[1])  # of the mean corner
    plan = np.floor(np.column_stack([x / spacing[0], y / spacing[1]]) - 0.5)
    bottom, top = (np.floor(z / spacing[2] - 0.5) for z in (ground - rise, ground + rise + thickness))
    return np.column_stack([plan, bottom]).astype(np.int64), np.column_stack([plan, top]).astype(np.int64)


def _cells(release: Release) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Easting, northing and thickness [m] of the cells of a release."""
    row, column = np.nonzero(release.thickness)
    north = release.thickness.shape[0] - 0.5 - row
    return (column + 0.5) * release.terrain.cell_size[0], north * release.terrain.cell_size[1], release.thickness[row, column]


def _require_countable(name: str, spacing: tuple[float, float, float], needed: float) -> None:
    """Raise CapacityError if even the count of cells below a release does not fit into memory."""
    free = available_bytes() or float(2**34)
    if not needed <= free:
        raise CapacityError(
            f"release {name}: to count its cells of {spacing[0]:g} x {spacing[1]:g} m takes {needed / GIGABYTE:.3g} GB of memory, "
            f"{free / GIGABYTE:.3g} GB are free; use a larger cell_size"
        )


def _middles(first: float, last: float, step: float) -> np.ndarray:
    return first + (np.arange(max(1, math.ceil((last - first) / step))) + 0.5) * step


def _blocks(low: np.ndarray, high: np.ndarray, shifts: tuple[int, ...], margin: int) -> np.ndarray:
    """Columns (m, 4) of blocks around nodes: block index east and north, lowest and highest block."""
    plan = np.concatenate([(low[:, :2] + np.array((i, j))) >> 2 for i in shifts for j in shifts])
    heights = np.column_stack([(low[:, 2] - margin) >> 2, (high[:, 2] + margin) >> 2])
    return _hull(plan, np.tile(heights, (len(shifts) ** 2, 1)))


def _with_nodes(owners: np.ndarray) -> np.ndarray:
    """Columns (m, 4) of the blocks that hold the nodes of others."""
    up = np.concatenate([owners[:, :2] + (i, j) for i in (0, 1) for j in (0, 1)])
    return _hull(up, np.tile(owners[:, 2:] + (0, 1), (4, 1)))


def _hull(plan: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Lowest and highest of the heights (n, 2) over each place (n, 2): (m, 4)."""
    corner, rows = plan.min(axis=0), int(np.ptp(plan[:, 1])) + 1
    keys, which = np.unique((plan - corner) @ (rows, 1), return_inverse=True)  # several times as fast as by rows
    places = corner + np.column_stack(np.divmod(keys, rows))
    low, high = np.full(len(places), np.iinfo(np.int64).max), np.full(len(places), np.iinfo(np.int64).min)
    np.minimum.at(low, which.ravel(), heights[:, 0])
    np.maximum.at(high, which.ravel(), heights[:, 1])
    return np.column_stack([places, low, high])
