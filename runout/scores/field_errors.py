"""Errors of a map of thickness, speed or another quantity against another map on the same cells."""

from dataclasses import dataclass

import numpy as np

from runout.scores.contingency import ratio, require_same_shape


@dataclass(frozen=True)
class FieldErrors:
    """Differences of two maps, modelled minus observed, in the unit of the map.

    Attributes
    ----------
    cells, unknown : int
        Number of cells that are scored, and of cells that one of the maps does not know.
    bias, rmse, mean_absolute_error : float
        Mean, root of the mean square, and mean absolute difference over the scored cells; NaN if there are none. 0 is best.
    modelled_sum, observed_sum : float
        Sums over all known cells times the cell's area: volumes [m3] of maps of thickness [m].
    relative_l1 : float
        Sum of absolute differences over the sum of the observed absolute values, all known cells [1]; 0 is best.
    scored_area : float
        Area of the scored cells [m2].
    observed_absolute_sum : float
        Sum of the observed absolute values over all known cells times the cell's area.

    Notes
    -----
    Wilks 2011, Statistical Methods in the Atmospheric Sciences, section 8.3. Scored are known cells in which one of the maps at
    least reaches the threshold, so that the scores do not depend on how much dry ground the map shows.
    """

    cells: int
    unknown: int
    bias: float
    rmse: float
    mean_absolute_error: float
    modelled_sum: float
    observed_sum: float
    relative_l1: float
    scored_area: float = np.nan
    observed_absolute_sum: float = np.nan

    @property
    def volume_bias(self) -> float:
        """Modelled over observed volume of maps of thickness [1], 0 to infinity, best 1."""
        return ratio(self.modelled_sum, self.observed_sum)


def field_errors(
    modelled: np.ndarray, observed: np.ndarray, cell_area: float | np.ndarray = 1.0, threshold: float = 0.0
) -> FieldErrors:
    """Errors of a map against another on the same cells.

    Parameters
    ----------
    modelled, observed : ndarray (rows, columns)
        NaN where unknown.
    cell_area : float or ndarray (rows, columns)
        Area of a cell, or of each one [m2]; cells of unknown area (NaN) are unknown.
    threshold : float
        Absolute value that one of the maps has to reach in a cell that is scored; with 0 it has to be above 0.

    Raises
    ------
    ObservationError
        If the shapes differ.
    """
    m, o = np.asarray(modelled, np.float64), np.asarray(observed, np.float64)
    require_same_shape(m, o)
    area = np.broadcast_to(np.asarray(cell_area, np.float64), m.shape)
    known = np.isfinite(m) & np.isfinite(o) & np.isfinite(area)
    m, o, area = m[known], o[known], area[known]
    largest = np.maximum(np.abs(m), np.abs(o))
    scored = (largest >= threshold) & (largest > 0.0)
    bias, rmse, absolute = differences(m[scored], o[scored])
    return FieldErrors(
        int(scored.sum()),
        int(known.size - known.sum()),
        bias,
        rmse,
        absolute,
        float((m * area).sum()),
        float((o * area).sum()),
        ratio(float(np.abs(m - o).sum()), float(np.abs(o).sum())),
        float(area[scored].sum()),
        float((np.abs(o) * area).sum()),
    )


def differences(modelled: np.ndarray, observed: np.ndarray) -> tuple[float, float, float]:
    """Mean, root mean square and mean absolute difference of known values (n,); NaN if there are none."""
    d = np.asarray(modelled, np.float64) - np.asarray(observed, np.float64)
    if not d.size:
        return np.nan, np.nan, np.nan
    return float(d.mean()), float(np.sqrt((d * d).mean())), float(np.abs(d).mean())
