"""Maps of one flow on a grid: of a member, or of the percentile of an ensemble that has a stated probability."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from runout.errors import ObservationError
from runout.quantities import ARRIVAL, BED_QUANTITIES, CHANGE, CHANGE_PERCENTILE, ERODED, QUANTITIES, SHARE
from runout.scores.contingency import reached
from runout.scores.grid import Grid, resampled

THICKNESSES = ("thickness", "deposit")  # of the flow
DEPTHS = (*THICKNESSES, ERODED)  # scored at the thresholds of thickness
AT_END = ("deposit", ERODED)  # depths whose sum is a volume
PEAKS = tuple(name for name in QUANTITIES if name not in THICKNESSES)
UNITS = {
    **{name: QUANTITIES[name].units for name in THICKNESSES},
    "change": "m",
    ERODED: BED_QUANTITIES[ERODED].units,
    SHARE: "1",
    **{name: QUANTITIES[name].units for name in PEAKS},
    "arrival": "s",
}
IN_FILES = {name: units.replace("m s-1", "m/s") for name, units in UNITS.items()}  # units as people write them
TITLES = {
    **{name: q.extreme for name, q in QUANTITIES.items()},
    "change": "change of elevation",
    ERODED: BED_QUANTITIES[ERODED].extreme,
    SHARE: "share of the bed in the deposit",
    "arrival": "arrival time",
}
BAR_MAPS = {name: "flow_thickness" if name == "thickness" else name for name in QUANTITIES}  # in convergence.json
OF_MEMBER = {**{name: q.member_map for name, q in QUANTITIES.items()}, "arrival": ARRIVAL}
OF_ENSEMBLE = {name: q.percentile for name, q in QUANTITIES.items()}
OF_BED_MEMBER = {"change": CHANGE, ERODED: ERODED, SHARE: SHARE}  # only where there is an erodible bed
OF_BED_ENSEMBLE = {"change": CHANGE_PERCENTILE, ERODED: BED_QUANTITIES[ERODED].percentile}
DIFFERENCES = {
    **{name: q.difference for name, q in QUANTITIES.items()},
    "change": f"{CHANGE}_difference",
    ERODED: BED_QUANTITIES[ERODED].difference,
    SHARE: f"{SHARE}_difference",
    "arrival": f"{ARRIVAL}_difference",
}


@dataclass(frozen=True)
class Flow:
    """Maps of one flow."""

    grid: Grid  # their cells
    # by the names of :data:`UNITS`; NaN where unknown. ``arrival`` is infinite where the flow never arrives
    maps: Mapping[str, np.ndarray]
    # of an ensemble, by quantity and threshold: probability that the quantity reaches the threshold
    probabilities: Mapping[tuple[str, float], np.ndarray] = field(default_factory=dict)
    # of an ensemble: the outline of a threshold holds the cells that reach it with this probability or more
    probability: float = 0.5
    is_percentile: bool = False  # whether the maps are percentiles over members, which have no volume of their own

    def area(self, quantity: str, threshold: float) -> np.ndarray:
        """Cells (rows, columns) in which a quantity reaches a threshold: 1 or 0, NaN where unknown."""
        if (quantity, threshold) in self.probabilities:
            return reached(self.probabilities[quantity, threshold], self.probability)
        return reached(self.maps[quantity], threshold)

    def on(self, grid: Grid) -> "Flow":
        """The flow on another grid, by area. Where part of a cell is never reached, its arrival is that of the rest."""
        maps = {name: resampled_map(name, values, self.grid, grid) for name, values in self.maps.items()}
        probabilities = {key: resampled(values, self.grid, grid) for key, values in self.probabilities.items()}
        return replace(self, grid=grid, maps=maps, probabilities=probabilities)


def resampled_map(name: str, values: np.ndarray, own: Grid, grid: Grid) -> np.ndarray:
    """A map of a flow on another grid."""
    if name != "arrival":
        return resampled(values, own, grid)
    never = resampled(np.where(np.isnan(values), np.nan, np.isposinf(values)), own, grid)
    times = resampled(np.where(np.isfinite(values), values, np.nan), own, grid)
    return np.where(np.isnan(never), np.nan, np.where(np.isnan(times) | (never > 0.5), np.inf, times))


def percentile_of(probability: float, known: np.ndarray, source: str) -> float:
    """Percentile that a probability of exceedance stands for: 100 (1 - p).

    Raises ObservationError if it is not among the known ones.
    """
    wanted = 100.0 * (1.0 - probability)
    nearest = float(known[np.argmin(np.abs(known - wanted))])
    if abs(nearest - wanted) > 1e-6:
        fitting = ", ".join(f"{1 - value / 100:g}" for value in known)
        raise ObservationError(
            f"{source}: holds no percentile {wanted:g}, which the probability {probability:g} needs; choose one of {fitting}, or "
            "add the percentile to hazard.percentiles of the site"
        )
    return nearest
