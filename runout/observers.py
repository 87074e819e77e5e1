"""Records of a run: maps on the cells of the raster, and the ledger."""

from dataclasses import dataclass, field

import numpy as np

from runout.backends.protocol import LedgerRow, RasterSums
from runout.backends.state import State, part, plain
from runout.model.scene import Raster


@dataclass
class PeakMaps:
    """Peaks over time on the cells of the raster (rows, columns).

    Thickness is vertical: the volume over a cell divided by its area. Speed is that of the column as a whole, momentum
    over mass; speed and pressure count while the flow is at least ``arrival_threshold`` thick, so that a single stray
    particle makes no peak.
    """

    raster: Raster
    arrival_threshold: float  # [m]
    max_flow_thickness: np.ndarray = field(init=False)
    max_speed: np.ndarray = field(init=False)
    max_pressure: np.ndarray = field(init=False)
    arrival_time: np.ndarray = field(init=False)
    deposit_thickness: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        shape = (self.raster.rows, self.raster.columns)
        for name in ("max_flow_thickness", "max_speed", "max_pressure", "deposit_thickness"):
            setattr(self, name, np.zeros(shape))
        self.arrival_time = np.full(shape, np.nan)

    def observe(self, time: float, columns: RasterSums) -> None:
        """Update the maps with the columns at one time [s]."""
        thickness, speed, pressure = flow_fields(columns, self.raster)
        thick, window = thickness >= self.arrival_threshold, columns.window
        highest, fastest, hardest = (m[window] for m in (self.max_flow_thickness, self.max_speed, self.max_pressure))
        np.maximum(highest, thickness, out=highest)
        np.maximum(fastest, np.where(thick, speed, 0.0), out=fastest)
        np.maximum(hardest, np.where(thick, pressure, 0.0), out=hardest)
        arrival = self.arrival_time[window]
        arrival[thick & np.isnan(arrival)] = time
        self.deposit_thickness.fill(0.0)
        self.deposit_thickness[window] = thickness

    def maps(self) -> dict[str, np.ndarray]:
        """The maps by name."""
        names = ("max_flow_thickness", "max_speed", "max_pressure", "arrival_time", "deposit_thickness")
        return {name: getattr(self, name) for name in names}


def flow_fields(columns: RasterSums, raster: Raster) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Thickness [m], speed [m/s] and dynamic pressure rho v^2 [Pa] of the columns (rows, columns)."""
    thickness = columns.volume / (raster.cell_size[0] * raster.cell_size[1])
    mass = np.maximum(columns.mass, np.finfo(float).tiny)
    speed = np.linalg.norm(columns.momentum, axis=-1) / mass
    density = columns.mass / np.maximum(columns.volume, np.finfo(float).tiny)
    return thickness, speed, density * speed**2


class Ledger:
    """Rows of the backend's ledger over time."""

    def __init__(self) -> None:
        self.time: list[float] = []
        self.dt: list[float] = []
        self.rows: list[LedgerRow] = []

    def record(self, time: float, dt: float, row: LedgerRow) -> None:
        """Add the row of one time [s]; ``dt`` [s] is the length of the steps before it."""
        self.time.append(time)
        self.dt.append(dt)
        self.rows.append(row)

    def state(self) -> State:
        """All rows as arrays (times, ...) by name, for :meth:`restore`."""
        rows = {f"row.{name}": np.array([getattr(row, name) for row in self.rows]) for name in vars(self.rows[0])}
        return {"time": np.array(self.time), "dt": np.array(self.dt), **rows}

    def restore(self, state: State) -> None:
        """Restore the rows from :meth:`state`."""
        self.time, self.dt = state["time"].tolist(), state["dt"].tolist()
        rows = part(state, "row.")
        self.rows = [LedgerRow(**{name: plain(values[i, ...]) for name, values in rows.items()}) for i in range(len(self.time))]

    def series(self) -> dict[str, np.ndarray]:
        """Arrays (times,) by name; ``numerical_dissipation`` [J] closes the energy budget."""
        plain = [name for name in vars(self.rows[0]) if name not in ("momentum", "basal_impulse")]
        series = {name: np.array([getattr(row, name) for row in self.rows]) for name in plain}
        for d, axis in enumerate("xyz"):
            series[f"momentum_{axis}"] = np.array([row.momentum[d] for row in self.rows])
        stored = series["kinetic_energy"] + series["potential_energy"] + series["elastic_energy"]
        series["dissipation"] = series["basal_dissipation"] + series["plastic_dissipation"]
        series["numerical_dissipation"] = stored[0] - stored - series["dissipation"] - series["escaped_energy"]
        series["dt"] = np.array(self.dt)
        return series


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
