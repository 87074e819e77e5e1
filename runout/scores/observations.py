"""Observations of a site on the cells of its terrain."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from runout.errors import ObservationError
from runout.scores.grid import Grid, outline_shares, resampled
from runout.scores.points import Gauges
from runout.scores.reaches import Reaches
from runout.scores.thalweg import Thalweg


@dataclass(frozen=True)
class Observations:
    """What was observed of a flow; None for what was not."""

    grid: Grid  # cells of the maps
    outline: Any = None  # area that was reached, in map coordinates
    outline_shows: str = "flow"  # "flow": all ground that was reached; "deposit": ground with a deposit
    deposit: np.ndarray | None = None  # (rows, columns): vertical thickness of the deposit [m], NaN where unknown
    change: np.ndarray | None = None  # (rows, columns): DEM of difference: later minus earlier elevation [m], NaN where unknown
    detection_limit: float = 0.0  # smallest change that the DEM of difference shows [m]
    gauges: Gauges | None = None
    thalweg: Thalweg | None = None
    reaches: Reaches | None = None  # reaches of the thalweg in which the volumes of the DEM of difference are scored
    changes: tuple[str, ...] = field(default=())  # what was changed on the way in, one sentence each

    @property
    def shares(self) -> np.ndarray:
        """Share (rows, columns) of each cell inside the outline [1]."""
        return outline_shares(self.outline, self.grid)

    def statement(self) -> str:
        """What was observed, in one sentence."""
        parts = []
        if self.outline is not None:
            parts.append(f"outline of the {self.outline_shows}, {float(f'{self.outline.area:.4g}'):.10g} m2")
        if self.deposit is not None:
            parts.append(f"deposit, {np.nansum(self.deposit) * self.grid.cell_area:.4g} m3{_unknown(self.deposit)}")
        if self.change is not None:
            lost, gained = (np.nansum(np.maximum(sign * self.change, 0.0)) * self.grid.cell_area for sign in (-1.0, 1.0))
            parts.append(f"DEM of difference, -{lost:.4g} and +{gained:.4g} m3{_unknown(self.change)}")
        if self.gauges is not None:
            known = ", ".join(f"{np.isfinite(v).sum()} of {name.replace('_', ' ')}" for name, v in self.gauges.values.items())
            parts.append(f"{len(self.gauges.easting)} gauges ({known})")
        if self.thalweg is not None:
            reaches = f" in {len(self.reaches.ends) - 1} reaches" if self.reaches else ""
            parts.append(f"thalweg of {self.thalweg.length:.4g} m{reaches}")
        return f"observations: {'; '.join(parts)}"


def _unknown(values: np.ndarray) -> str:
    """Number of cells without a value, in words."""
    count = int(np.isnan(values).sum())
    return f" ({count} of {values.size} cells unknown)" if count else ""


def on_grid(values: np.ndarray, own: Grid, grid: Grid, fill: float = np.nan) -> np.ndarray:
    """A map by area on another grid; cells beyond the map hold ``fill``.

    Raises ObservationError if the map lies beside the grid, or no transformation is known.
    """
    on_cells = resampled(values, own, grid)
    if not np.isfinite(on_cells).any():
        raise ObservationError(f"{own.source}: no known cell lies on {grid.source}; check the coordinate system of both")
    return on_cells if np.isnan(fill) else np.where(np.isnan(on_cells), fill, on_cells)
