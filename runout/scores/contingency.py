"""Contingency table of areas that a model and an observation say are reached, and the scores made of it."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.errors import ObservationError


@dataclass(frozen=True)
class Contingency:
    """Areas by what a model and an observation say of them.

    Attributes
    ----------
    hits, misses, false_alarms, correct_rejections : float
        Areas [m2] that both say are reached, the observation alone, the model alone, and neither.
    unknown : float
        Area [m2] that one of the two does not know. It is in no score.
    near : float
        Area [m2] of misses and false alarms whose cell, or one of the eight around it, the other reaches.

    Notes
    -----
    Scores are those of a 2 x 2 table (Wilks 2011, Statistical Methods in the Atmospheric Sciences, section 8.2; Fawcett 2006,
    Pattern Recognition Letters 27:861). They do not depend on the size of the map, which only adds correct rejections. A score
    whose denominator is 0 is NaN.
    """

    hits: float
    misses: float
    false_alarms: float
    correct_rejections: float = 0.0
    unknown: float = 0.0
    near: float = 0.0

    @property
    def modelled(self) -> float:
        """Area that the model reaches [m2]."""
        return self.hits + self.false_alarms

    @property
    def observed(self) -> float:
        """Area that was reached [m2]."""
        return self.hits + self.misses

    @property
    def critical_success_index(self) -> float:
        """CSI = hits / (hits + misses + false alarms), 0 to 1, best 1 (Wilks 2011, eq. 8.8; Jaccard index)."""
        return ratio(self.hits, self.hits + self.misses + self.false_alarms)

    @property
    def probability_of_detection(self) -> float:
        """POD = hits / (hits + misses), 0 to 1, best 1 (Wilks 2011, eq. 8.12; hit rate, recall)."""
        return ratio(self.hits, self.observed)

    @property
    def false_alarm_ratio(self) -> float:
        """FAR = false alarms / (hits + false alarms), 0 to 1, best 0 (Wilks 2011, eq. 8.11; 1 - precision)."""
        return ratio(self.false_alarms, self.modelled)

    @property
    def area_bias(self) -> float:
        """Modelled over observed area, 0 to infinity, best 1 (Wilks 2011, eq. 8.10)."""
        return ratio(self.modelled, self.observed)

    @property
    def agreement_within_one_cell(self) -> float:
        """(hits + near) / (hits + misses + false alarms), CSI to 1, best 1: CSI of areas whose position is known to one cell."""
        return ratio(self.hits + self.near, self.hits + self.misses + self.false_alarms)


def ratio(part: float, whole: float) -> float:
    """``part`` over ``whole``; NaN where ``whole`` is 0."""
    return float(part / whole) if whole else math.nan


def contingency(modelled: np.ndarray, observed: np.ndarray, cell_area: float = 1.0) -> Contingency:
    """Contingency table of two maps on the same cells.

    Parameters
    ----------
    modelled, observed : ndarray (rows, columns)
        Reached share of each cell [1], 0 to 1, or truth values; NaN where unknown.
    cell_area : float
        Area of a cell [m2].

    Returns
    -------
    Contingency
        A cell counts min(m, o) as hit, o - min as miss, m - min as false alarm. This is exact where one of the two reaches the
        whole cell or none of it, and a map compared with itself has no misses and no false alarms.

    Raises
    ------
    ObservationError
        If the shapes differ, or a share is outside 0 to 1.
    """
    m, o = _shares(modelled, "modelled"), _shares(observed, "observed")
    require_same_shape(m, o)
    known = np.isfinite(m) & np.isfinite(o)
    beside_m, beside_o = (_beside((area > 0) & known)[known] for area in (m, o))
    m, o = m[known], o[known]
    both = np.minimum(m, o)
    hits, misses, alarms = (float(part.sum()) for part in (both, o - both, m - both))
    neither = float((1.0 - np.maximum(m, o)).sum())
    unknown = int(known.size - known.sum())
    near = float((o - both)[beside_m].sum() + (m - both)[beside_o].sum())
    return Contingency(*(cell_area * area for area in (hits, misses, alarms, neither, unknown, near)))


def _beside(area: np.ndarray) -> np.ndarray:
    """Cells of an area and the cells around it."""
    for axis in range(area.ndim):
        grown = area.copy()
        own, to = (np.moveaxis(cells, axis, 0) for cells in (area, grown))
        to[1:] |= own[:-1]
        to[:-1] |= own[1:]
        area = grown
    return area


def reached(values: np.ndarray, threshold: float) -> np.ndarray:
    """Cells (rows, columns) of at least a threshold: 1 or 0, NaN where the value is.

    Both are compared as float32, the type of all maps in files, so that a value written as the threshold reaches it.
    """
    values = np.asarray(values, np.float32)
    return np.where(np.isnan(values), np.nan, values >= np.float32(threshold)).astype(np.float64)


def _shares(values: Any, what: str) -> np.ndarray:
    shares = np.asarray(values, np.float64)
    wrong = (shares < 0.0) | (shares > 1.0)
    if wrong.any():
        raise ObservationError(f"{what}: {shares[wrong][0]:g} is no share of a cell; shares are 0 to 1")
    return shares


def require_same_shape(one: np.ndarray, other: np.ndarray) -> None:
    """Raise ObservationError unless two maps have the same rows and columns."""
    if one.shape != other.shape:
        raise ObservationError(f"the maps have {one.shape} and {other.shape} cells; bring them to one grid with scores.resampled")
