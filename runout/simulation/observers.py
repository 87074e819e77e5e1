"""Records of a run: maps on the cells of the raster, and the ledger."""

import math
from dataclasses import dataclass, field

import numpy as np

from runout.backends import footprints
from runout.backends.compile import array_binding
from runout.backends.protocol import LedgerRow, RasterSums
from runout.backends.state import State, part, plain
from runout.model.joint_conditions import Condition, limits_of, met_map
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.model.structures import Structures
from runout.quantities import MET, member_map_names, peak_quantities
from runout.simulation.structure_forces import StructureForces

THICKNESS = 0  # of the peaks
BLOCK_NODES = 64


@dataclass
class PeakMaps:
    """Peaks over time in columns of the flow.

    Thickness is vertical: the volume that flows over a cell divided by its area; single particles have none. Speed is that of the
    column as a whole, momentum over mass; all but the thickness count while the flow is at least ``arrival_threshold`` thick.
    Between two observations, thickness grows at a steady rate to where it arrives.
    """

    scene: Scene
    arrival_threshold: float  # [m]
    # whether the columns are those over the lattice of :mod:`runout.backends.footprints`, with rows from the south, and not those
    # over the raster. :meth:`maps` are on the raster
    on_lattice: bool = False
    conditions: tuple[Condition, ...] = ()  # joint conditions (:mod:`runout.model.joint_conditions`)
    time: float = 0.0  # [s] of the last observation
    observations: int = 0
    cells: int = 0  # cells of all windows that were observed
    # (quantities, rows, columns): largest values of :func:`runout.quantities.peak_quantities`: thickness [m], speed [m/s], dynamic
    # pressure [Pa],
    peaks: np.ndarray = field(init=False)
    # (conditions, rows, columns): largest share of the thresholds of each condition that was reached at one time [1]; 1 and more:
    # all of them
    shares: np.ndarray = field(init=False)
    arrival: np.ndarray = field(init=False)  # (rows, columns): time of arrival [s]; NaN where nothing has arrived
    # (rows, columns): thickness of all volume at the last observation [m], single particles included
    thickness: np.ndarray = field(init=False)
    # (4,): first row and column, and one past the last; outside of them that thickness is zero
    window: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        raster = self.scene.raster
        self.cell = footprints.lattice_cell(self.scene) if self.on_lattice else raster.cell_size
        shape = footprints.lattice_shape(raster, self.cell) if self.on_lattice else (raster.rows, raster.columns)
        self.peaks, self.shares = np.zeros((len(peak_quantities()), *shape)), np.zeros((len(self.conditions), *shape))
        self.limits = limits_of(self.conditions)
        self.thickness, self.arrival = np.zeros(shape), np.full(shape, np.nan)
        self.window = np.zeros(4, np.int64)

    def observe(self, time: float, columns: RasterSums) -> None:
        """Update the peaks with the columns at one time [s]."""
        corner = np.array((columns.row, columns.column))
        window = np.array((*corner, *(corner + columns.mass.shape)))
        self._clear_beside(window)
        momentum = np.ascontiguousarray(np.moveaxis(columns.momentum, -1, 0))
        footprints.loop(
            "take_peaks", columns.mass.size, np.ascontiguousarray(columns.volume), np.ascontiguousarray(columns.depth_volume),
            np.ascontiguousarray(columns.mass), momentum, corner, self.cell[0] * self.cell[1], self.arrival_threshold,
            np.array((self.time, time)), self.thickness, self.peaks, self.arrival, self.limits, self.shares,
        )  # fmt: skip
        self.time, self.window = time, window
        self.observations, self.cells = self.observations + 1, self.cells + columns.mass.size

    def _clear_beside(self, window: np.ndarray) -> None:
        """Set the last thickness to zero outside of a new window."""
        top, left, bottom, right = self.window
        low, west, high, east = window
        for rows, columns in (
            (slice(top, min(bottom, low)), slice(left, right)), (slice(max(top, high), bottom), slice(left, right)),
            (slice(top, bottom), slice(left, min(right, west))), (slice(top, bottom), slice(max(left, east), right)),
        ):  # fmt: skip
            self.thickness[rows, columns] = 0.0

    def maps(self) -> dict[str, np.ndarray]:
        """The maps (rows, columns) by name, on the raster; the largest thickness is at least that of the deposit."""
        shares, *maps = self._on_raster() if self.on_lattice else (self.shares, *self.peaks, self.arrival, self.thickness)
        thickest, *others, deposit = maps
        names = member_map_names()
        record = {MET: met_map(shares)} if self.conditions else {}
        return dict(zip(names, (np.maximum(thickest, deposit), *others, deposit), strict=True)) | record

    def _on_raster(self) -> tuple[np.ndarray, ...]:
        """Shares and maps on the raster: volumes by area, the others as means over the volume that has arrived."""
        raster, came = self.scene.raster, np.isfinite(self.arrival)
        weight = np.where(came, self.peaks[THICKNESS], 0.0)
        others = weight * np.stack([*self.peaks[THICKNESS + 1 :], *self.shares, np.where(came, self.arrival, 0.0)])
        sums = np.stack([self.peaks[THICKNESS], self.thickness, weight, *others]) * (self.cell[0] * self.cell[1])
        *_, (thickest, deposit, weight, *others) = footprints.shared_by_area(sums, (0, 0), raster, self.cell)
        area = raster.cell_size[0] * raster.cell_size[1]
        reached = (thickest / area >= self.arrival_threshold) & (weight > 0)
        *means, arrival = np.where(reached, np.array(others) / np.maximum(weight, np.finfo(float).tiny), 0.0)
        peaks, shares = means[: len(self.peaks) - 1], means[len(self.peaks) - 1 :]
        return np.array(shares), thickest / area, *peaks, np.where(reached, arrival, np.nan), deposit / area


def flow_fields(columns: RasterSums, raster: Raster) -> tuple[np.ndarray, np.ndarray]:
    """Thickness [m] and speed [m/s] of the columns (rows, columns)."""
    mass = np.maximum(columns.mass, np.finfo(float).tiny)
    speed = array_binding().flow_columns.column_speed(mass, *np.moveaxis(columns.momentum, -1, 0))
    return columns.volume / (raster.cell_size[0] * raster.cell_size[1]), speed


@dataclass(frozen=True)
class ParticleSample:
    """Some particles of a run, evenly spaced by their identity, that are followed through the snapshots."""

    size: int = 0  # number of particles; 0 for none
    stride: int = 1  # step of their identities

    @classmethod
    def of(cls, particles: int, most: int) -> "ParticleSample":
        """Sample of at most ``most`` particles from a number of ``particles``."""
        stride = -(-particles // most) if most else 1
        return cls(-(-particles // stride) if most else 0, max(1, stride))

    def take(self, particles: Particles, spacing: tuple[float, float, float]) -> np.ndarray:
        """Local position [m] and speed [m/s] of the sample, (size, 4) float32; NaN for a particle that has left the domain.

        Particles that an erodible bed gave are not among them.
        """
        of_start = particles.identity < self.size * self.stride
        sample = particles.take((particles.identity % self.stride == 0) & of_start)
        frame = np.full((self.size, 4), np.nan, np.float32)
        speed = np.linalg.norm(sample.velocity, axis=1)
        frame[sample.identity // self.stride] = np.column_stack([sample.position(np.array(spacing)), speed])
        return frame


@dataclass(frozen=True)
class Frame:
    """State of a run at one time, as snapshots keep it."""

    time: float  # [s]
    # thickness, speed (rows, columns): [m] and [m/s], on the raster
    thickness: np.ndarray
    speed: np.ndarray
    particles: np.ndarray  # (sample, 4): see :meth:`ParticleSample.take`

    def blend(self, after: "Frame", time: float) -> "Frame":
        """State at a ``time`` [s] between this one and that ``after`` a step: volume, momentum and places change steadily."""
        share = min(1.0, (time - self.time) / (after.time - self.time))
        thickness, flux, particles = (
            (1.0 - share) * a + share * b
            for a, b in (
                (self.thickness, after.thickness),
                (self.thickness * self.speed, after.thickness * after.speed),
                (self.particles, after.particles),
            )
        )
        return Frame(time, thickness, flux / np.maximum(thickness, np.finfo(float).tiny), particles.astype(np.float32))


OF_A_BED = "entrained_mass", "entrained_energy", "entrainment_dissipation"  # of a row, only where there is one
OF_SOURCES = "entered_mass", "entered_energy", "waiting_mass"  # of a row, only where mass enters later


class Ledger:
    """Rows of the backend's ledger over time.

    Parameters
    ----------
    entrains : bool
        Whether there is an erodible bed.
    enters : bool
        Whether mass enters while the run goes on.
    """

    def __init__(self, entrains: bool = False, enters: bool = False) -> None:
        absent = (*(() if entrains else OF_A_BED), *(() if enters else OF_SOURCES))
        self.left_out = ("momentum", "basal_impulse", "box_blocks", *absent)
        self.time: list[float] = []
        self.dt: list[float] = []
        self.memory: list[int] = []
        self.rows: list[LedgerRow] = []

    def record(self, time: float, dt: float, row: LedgerRow, memory: int) -> None:
        """Add the row of one time [s]; ``dt`` [s] is the length of the steps before it, ``memory`` [byte] that of the backend."""
        self.time.append(time)
        self.dt.append(dt)
        self.memory.append(memory)
        self.rows.append(row)

    def state(self) -> State:
        """All rows as arrays (times, ...) by name, for :meth:`restore`."""
        rows = {f"row.{name}": np.array([getattr(row, name) for row in self.rows]) for name in vars(self.rows[0])}
        return {"time": np.array(self.time), "dt": np.array(self.dt), "memory": np.array(self.memory), **rows}

    def restore(self, state: State) -> None:
        """Restore the rows from :meth:`state`."""
        self.time, self.dt, self.memory = (state[name].tolist() for name in ("time", "dt", "memory"))
        rows = part(state, "row.")
        self.rows = [LedgerRow(**{name: plain(values[i, ...]) for name, values in rows.items()}) for i in range(len(self.time))]

    def series(self) -> dict[str, np.ndarray]:
        """Arrays (times,) by name; ``numerical_dissipation`` [J] closes the energy budget."""
        plain = [name for name in vars(self.rows[0]) if name not in self.left_out]
        series = {name: np.array([getattr(row, name) for row in self.rows]) for name in plain}
        for d, axis in enumerate("xyz"):
            series[f"momentum_{axis}"] = np.array([row.momentum[d] for row in self.rows])
        stored = series["kinetic_energy"] + series["potential_energy"] + series["elastic_energy"]
        outside = series["basal_dissipation"] + series["structure_dissipation"]
        series["dissipation"] = outside + series["plastic_dissipation"]
        series["numerical_dissipation"] = stored[0] - stored - series["dissipation"] - series["escaped_energy"]
        if "entrained_energy" in series:
            series["numerical_dissipation"] += series["entrained_energy"] - series["entrainment_dissipation"]
        if "entered_energy" in series:
            series["numerical_dissipation"] += series["entered_energy"]
        series["dt"], series["memory"] = np.array(self.dt), np.array(self.memory, np.int64)
        return series | self._sparsity(series["active_blocks"])

    def _sparsity(self, active: np.ndarray) -> dict[str, np.ndarray]:
        """Number of nodes of the active blocks, and the nodes of their bounding box over that number; NaN without active blocks."""
        boxes = np.array([row.box_blocks for row in self.rows], float)
        return {"active_nodes": BLOCK_NODES * active, "sparsity": np.where(active > 0, boxes / np.maximum(active, 1), np.nan)}


class StructureImpulses:
    """Impulses on the patches of structures, interval by interval.

    Parameters
    ----------
    structures : Structures or None
        None where the scene has none: nothing is due then.
    interval : float
        Least time between two records [s].
    """

    def __init__(self, structures: Structures | None, interval: float):
        self.structures, self.interval = structures, interval
        self.due = 0.0 if structures else math.inf
        self.times: list[float] = []
        self.totals: list[np.ndarray] = []

    def record(self, time: float, impulses: np.ndarray) -> None:
        """Keep the impulses (patches, 3) [N s] since the start at one time [s]."""
        self.times.append(time)
        self.totals.append(impulses)
        self.due = time + self.interval

    def state(self) -> State:
        """All records as arrays by name, for :meth:`restore`."""
        return {"times": np.array(self.times), "totals": np.array(self.totals), "due": np.array(self.due)}

    def restore(self, state: State) -> None:
        """Restore the records from :meth:`state`."""
        self.times, self.totals, self.due = state["times"].tolist(), list(state["totals"]), float(state["due"])

    def result(self) -> StructureForces | None:
        """The forces; None without structures."""
        if self.structures is None:
            return None
        return StructureForces(self.structures, np.array(self.times), np.diff(np.array(self.totals), axis=0))


@dataclass
class AtRest:
    """Stop rule: kinetic energy below 1 % of its peak and falling (AvaFrame), and a root mean square speed below a floor.

    The floor is a root mean square speed: a deposit that still creeps faster is not at rest, however fast the flow has
    been; a mass that never moves faster than a hundredth of it is at rest from the start.
    """

    share: float = 0.01
    floor_speed: float = 0.5  # [m/s]
    peak: float = 0.0
    last: float = 0.0

    def reached(self, row: LedgerRow) -> bool:
        """Whether the flow has come to rest, given the next row of the ledger."""
        energy = row.kinetic_energy
        falling = energy < self.last
        self.peak, self.last = max(self.peak, energy), energy
        floor = 0.5 * row.mass * self.floor_speed**2
        return row.mass == 0 or (falling and energy < max(min(self.share * self.peak, floor), 1e-4 * floor))
