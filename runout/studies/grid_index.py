"""Grid convergence index of one quantity over three grids (Roache 1994, J. Fluids Eng. 116:405), and distances between maps."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from runout.scores.contingency import contingency
from runout.scores.field_errors import differences

SAFETY = 1.25  # for three grids
LOWEST_ORDER, HIGHEST_ORDER = 0.5, 2.0  # range of trusted orders; outside, the three grids do not converge


@dataclass(frozen=True)
class GridIndex:
    """One quantity on a coarse, a middle and a fine grid.

    Attributes
    ----------
    coarse, middle, fine : float
        Means over the shifts of each grid.
    spread : float
        Standard deviation over the shifts of the middle grid.
    order : float or None
        Observed order; None where the differences are within the spread, or no order fits.
    extrapolated : float or None
        Richardson's limit.
    error : float
        Bar around the fine value, in its unit: the whole range of the three means or the index of convergence, whichever is
        more, plus two spreads. Without an order that is trusted the index is that of the lowest such order and of the larger
        difference.
    converging : bool
        Whether an order between the bounds was observed, beyond the spread.
    """

    coarse: float
    middle: float
    fine: float
    spread: float
    order: float | None
    extrapolated: float | None
    error: float
    converging: bool

    @classmethod
    def of(cls, values: Sequence[Sequence[float]], ratio: float) -> "GridIndex":
        """Index from the values on the three grids, coarse first, one per shift; ``ratio`` between neighbouring cells."""
        coarse, middle, fine = (float(np.mean(v)) for v in values)
        spread = float(np.std(values[1], ddof=1)) if len(values[1]) > 1 else 0.0
        return cls.of_means(coarse, middle, fine, spread, ratio)

    @classmethod
    def of_means(cls, coarse: float, middle: float, fine: float, spread: float, ratio: float) -> "GridIndex":
        """Index from the means of the three grids and the spread of the middle one."""
        first, second = middle - coarse, fine - middle
        whole, largest = float(np.ptp([coarse, middle, fine])), max(abs(first), abs(second))
        order = float(np.log(first / second) / np.log(ratio)) if first * second > 0 else None
        seen = order is not None and LOWEST_ORDER <= order <= HIGHEST_ORDER and min(abs(first), abs(second)) > 2 * spread
        if order is None or not seen:
            error = SAFETY * largest / (ratio**LOWEST_ORDER - 1) + 2 * spread
            return cls(coarse, middle, fine, spread, order, None, max(error, whole + 2 * spread), False)
        left = second / (ratio**order - 1)
        return cls(coarse, middle, fine, spread, order, fine + left, max(SAFETY * abs(left), whole) + 2 * spread, True)

    @property
    def relative(self) -> float:
        """Error over the fine value [1]; infinite where that is zero."""
        return self.error / abs(self.fine) if self.fine else float("inf")

    def as_dict(self) -> dict[str, Any]:
        """Plain values, the relative error among them."""
        return {**asdict(self), "relative_error": self.relative}


def restricted(field: np.ndarray, block: int) -> np.ndarray:
    """Means of a map (rows, columns) over blocks of ``block`` x ``block`` cells; what does not fill a block counts as dry."""
    rows, columns = (-(-n // block) * block for n in field.shape)
    padded = np.zeros((rows, columns))
    padded[: field.shape[0], : field.shape[1]] = field
    return padded.reshape(rows // block, block, columns // block, block).mean(axis=(1, 3))


def compared(
    field: np.ndarray, reference: np.ndarray, block: int, thresholds: Sequence[float], cell_area: float = 1.0
) -> dict[str, Any]:
    """Differences of two maps, both restricted to blocks of cells of ``cell_area`` [m2].

    Returns
    -------
    dict
        ``relative_l1`` [1]; sums over the plan area: ``absolute_sum`` of abs(d), ``net_sum`` of d [unit m2], ``squared_sum`` of
        d^2 [unit^2 m2]; ``reached_area`` where one of them is above 0 [m2]; ``critical_success_index`` by threshold: hits over
        hits, misses and false alarms, 1 where neither map exceeds it.
    """
    a, b = restricted(np.nan_to_num(field), block), restricted(np.nan_to_num(reference), block)
    index, d, area = {}, a - b, cell_area * block**2
    either = (a > 0) | (b > 0)
    for threshold in thresholds:
        found = contingency(a > threshold, b > threshold).critical_success_index
        index[f"{threshold:g}"] = 1.0 if math.isnan(found) else found
    sums = {"absolute_sum": np.abs(d), "net_sum": d, "squared_sum": d * d, "reached_area": either}
    totals = {name: float(area * values.sum()) for name, values in sums.items()}
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
