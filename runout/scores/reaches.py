"""Volumes of a change of elevation by reach along a thalweg, and their errors."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from runout.errors import ObservationError
from runout.scores.contingency import require_same_shape
from runout.scores.grid import Grid
from runout.scores.thalweg import Thalweg


@dataclass(frozen=True)
class Reaches:
    """Reaches of a thalweg: each is the cells whose nearest point of the line lies in one part of it.

    Attributes
    ----------
    thalweg : Thalweg
    ends : tuple of float
        Lengths (n + 1,) along the line [m] between which the n reaches lie, ascending, 0 to the length of the line. Cells beside
        the first and the last end are in no reach; beyond an end of the line the end is the nearest point.
    grid : Grid
        Cells of the maps.

    Raises
    ------
    ObservationError
        If there are fewer than two ends, they do not ascend, or one is not on the line.
    """

    thalweg: Thalweg
    ends: tuple[float, ...]
    grid: Grid

    def __post_init__(self) -> None:
        ends, length = np.asarray(self.ends, np.float64), self.thalweg.length
        if len(ends) < 2 or not (np.diff(ends) > 0).all():
            raise ObservationError(f"reaches: {list(self.ends)} are no lengths in ascending order; state two or more [m]")
        if ends[0] < 0 or ends[-1] > length * (1.0 + 1e-9):
            wrong = ends[0] if ends[0] < 0 else ends[-1]
            raise ObservationError(f"reaches: {wrong:g} m is not on the thalweg, which is {length:.6g} m long; state 0 to that")

    @classmethod
    def of(cls, thalweg: Thalweg, parts: int | Sequence[float], grid: Grid) -> "Reaches":
        """Reaches between lengths [m], or a number of reaches of equal length."""
        ends = np.linspace(0.0, thalweg.length, parts + 1) if isinstance(parts, int) else parts
        return cls(thalweg, tuple(map(float, ends)), grid)

    @cached_property
    def number(self) -> np.ndarray:
        """Reach (rows, columns) of each cell, from 0; -1 in none. A cell at an end belongs to the reach downstream."""
        s, _ = self.thalweg.coordinates(self.grid.easting[None, :], self.grid.northing[:, None])
        s, last = np.clip(s, 0.0, self.thalweg.length), len(self.ends) - 2
        reach = np.searchsorted(self.ends, s, "right") - 1
        reach[s == self.ends[-1]] = last
        return np.where(reach > last, -1, reach)

    def volumes(self, change: np.ndarray) -> np.ndarray:
        """Net volume (n,) [m3] of a change of elevation (rows, columns) [m], without its unknown cells (NaN)."""
        counted = (self.number >= 0) & np.isfinite(change)
        return self.grid.cell_area * np.bincount(self.number[counted], change[counted], len(self.ends) - 1)  # type: ignore[no-any-return]


@dataclass(frozen=True)
class ReachErrors:
    """Net volumes (n,) [m3] of a modelled and an observed change of elevation in the reaches between ``ends`` (n + 1,) [m]."""

    ends: tuple[float, ...]
    modelled: np.ndarray
    observed: np.ndarray

    @property
    def error(self) -> float:
        """Sum over the reaches of the absolute difference of both volumes [m3]; 0 is best."""
        return float(np.abs(self.modelled - self.observed).sum())

    def stored(self) -> dict[str, list[float]]:
        """Values for JSON."""
        return {"ends_m": list(self.ends), "modelled_m3": self.modelled.tolist(), "observed_m3": self.observed.tolist()}


def reach_errors(modelled: np.ndarray, observed: np.ndarray, reaches: Reaches) -> ReachErrors:
    """Volumes by reach of two changes of elevation (rows, columns) [m] on the cells that both know (NaN elsewhere).

    Raises
    ------
    ObservationError
        If the shapes differ.
    """
    m, o = np.asarray(modelled, np.float64), np.asarray(observed, np.float64)
    require_same_shape(m, o)
    known = np.isfinite(m) & np.isfinite(o)
    volumes = (reaches.volumes(np.where(known, change, np.nan)) for change in (m, o))
    return ReachErrors(reaches.ends, *volumes)
