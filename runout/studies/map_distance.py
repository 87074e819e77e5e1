"""Distances between maps of two grids, and areas above a threshold by fractions of cells."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from runout.scores.contingency import contingency
from runout.scores.field_errors import differences


def compared(field: np.ndarray, reference: np.ndarray, thresholds: Sequence[float], cell_area: float = 1.0) -> dict[str, Any]:
    """Differences of two maps on cells of ``cell_area`` [m2]; unknown cells count as dry.

    Returns
    -------
    dict
        ``relative_l1`` [1]; sums over the plan area: ``absolute_sum`` of abs(d), ``net_sum`` of d [unit m2], ``squared_sum`` of
        d^2 [unit^2 m2]; ``reached_area`` where one of them is above 0 [m2]; ``critical_success_index`` by threshold: hits over
        hits, misses and false alarms, 1 where neither map exceeds it.
    """
    a, b = np.nan_to_num(field), np.nan_to_num(reference)
    index, d = {}, a - b
    either = (a > 0) | (b > 0)
    for threshold in thresholds:
        found = contingency(a > threshold, b > threshold).critical_success_index
        index[f"{threshold:g}"] = 1.0 if math.isnan(found) else found
    sums = {"absolute_sum": np.abs(d), "net_sum": d, "squared_sum": d * d, "reached_area": either}
    totals = {name: float(cell_area * values.sum()) for name, values in sums.items()}
    return {"relative_l1": relative_l1(a, b), **totals, "critical_success_index": index}


def common_differences(field: np.ndarray, reference: np.ndarray) -> dict[str, float | None]:
    """Mean and root mean square difference of two maps on the cells that both have; None where there are none.

    And the share [1] of cells that one has alone, among those that either has.
    """
    one, other = np.isfinite(field), np.isfinite(reference)
    bias, rms, _ = differences(field[one & other], reference[one & other])
    alone, either = int((one ^ other).sum()), int((one | other).sum())
    return {"mean": _known(bias), "root_mean_square": _known(rms), "alone": alone / either if either else None}


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def relative_l1(field: np.ndarray, reference: np.ndarray) -> float:
    """Relative L1 distance of two maps [1], 1 where only the reference is empty; unknown cells count as dry."""
    a, b = (np.nan_to_num(np.asarray(one, float)) for one in (field, reference))
    return float(np.abs(a - b).sum() / np.abs(b).sum()) if b.any() else float(a.any())


def area_above(field: np.ndarray, threshold: float, cell_area: float) -> float:
    """Plan area [m2] where a map (rows, columns) exceeds a threshold, by fractions of cells.

    Between the centres of neighbouring cells the map is linear; the mean of all lines east-west and north-south. Ground beyond
    the map is at 0, and unknown cells count as dry.
    """
    padded = np.pad(np.nan_to_num(np.asarray(field, float)), 1)
    lengths = [_length_above(padded, threshold), _length_above(padded.T, threshold)]
    return 0.5 * cell_area * sum(lengths)


def _length_above(field: np.ndarray, threshold: float) -> float:
    """Length [cells] above a threshold along all rows of a map (rows, columns)."""
    low, high = np.minimum(field[:, 1:], field[:, :-1]), np.maximum(field[:, 1:], field[:, :-1])
    rise = high - low
    part = np.divide(high - threshold, rise, out=(high > threshold).astype(float), where=rise > 0)
    return float(np.clip(part, 0.0, 1.0).sum())
