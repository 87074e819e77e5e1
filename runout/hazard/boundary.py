"""Position of the boundary of the flow over the members: mean and spread of the signed distance to it, in metres.

The signed distance of a cell to the boundary of a member is positive inside. Its mean over the members is 0 at the mean position of
the boundary; its standard deviation there is how far the boundary moves from member to member. A probability alone says how often a
cell is reached, not by how many metres the edge of the map may be off (compare Hyman et al. 2019).
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from runout.io import netcdf
from runout.io.member_maps import MemberMaps
from runout.io.vector import reaches
from runout.model.arrays import window_of
from runout.quantities import QUANTITIES

if TYPE_CHECKING:
    import xarray as xr

MEAN, DEVIATION = "boundary_distance_mean", "boundary_distance_deviation"
LOW, MIDDLE, HIGH = 0.05, 0.5, 0.95  # probabilities of the outlines
_THICKNESS = QUANTITIES["thickness"].member_map
_BESIDE = 1  # cells around what is reached, which no member reaches


class BoundaryMaps:
    """Reached cells of members, each taken once; one bit a cell is kept within the part that a member reaches.

    Parameters
    ----------
    weights : sequence of float
        Of the members; their sum is 1.
    threshold : float
        Thickness from which a cell is reached [m]: the lowest threshold of inundation.
    """

    def __init__(self, weights: Sequence[float] | np.ndarray, threshold: float):
        self.weights, self.threshold = weights, np.float32(threshold)
        self.reached: list[tuple[float, tuple[slice, slice], np.ndarray]] = []  # weight, place, packed bits

    def take(self, number: int, member: MemberMaps) -> None:
        """Keep the cells that the member at a place among the weights reaches."""
        mask = member.within(_THICKNESS, member.part.slices) >= self.threshold
        if mask.any():
            rows, columns = window_of(mask)
            place = _moved(rows, member.part.row), _moved(columns, member.part.column)
            self.reached.append((float(self.weights[number]), place, np.packbits(mask[rows, columns])))

    def add_to(self, dataset: "xr.Dataset") -> None:
        """Put the maps into a dataset on the raster; undefined where fewer than 5 % or more than 95 % of the weight arrives.

        Members that reach no cell have no boundary, and the weights of the others count.
        """
        probability = dataset["inundation_probability"].values
        between = reaches(probability, LOW) & ~reaches(probability, HIGH)
        if not between.any() or not self.reached:
            return
        dx, dy = (abs(float(dataset[axis][1] - dataset[axis][0])) for axis in ("x", "y"))
        window = _window([place for _, place, _ in self.reached], probability.shape)
        mean, deviation = self._moments(window, (dy, dx))
        for name, values in ((MEAN, mean), (DEVIATION, deviation)):
            whole = np.full(probability.shape, np.nan)
            whole[window] = np.where(between[window], values, np.nan)
            netcdf.add_map(dataset, name, whole)
        if text := width_statement(probability, (dy, dx)):
            dataset[DEVIATION].attrs["along_the_median_outline"] = text

    def _moments(self, window: tuple[slice, slice], size: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation of the signed distance [m] in a window."""
        total, mean, squares = 0.0, np.zeros(()), np.zeros(())
        for weight, place, bits in self.reached:
            if weight <= 0:
                continue
            distance = signed_distance(_unpacked(place, bits, window), size)
            total += weight
            step = distance - mean
            mean = mean + step * (weight / total)
            squares = squares + weight * step * (distance - mean)
        return mean, np.sqrt(np.maximum(squares / max(total, 1e-300), 0.0))


def signed_distance(inside: np.ndarray, size: tuple[float, float]) -> np.ndarray:
    """Distance [m] of cell centres to the edge of a mask (rows, columns), positive inside; ``size`` of a cell is north, east [m].

    The edge lies half a cell from the centres on either side of it. Cells beyond the array count as outside.
    """
    from scipy.ndimage import distance_transform_edt

    padded = np.pad(inside, 1)
    half = 0.5 * float(np.mean(size))
    to_outside, to_inside = (distance_transform_edt(mask, sampling=size)[1:-1, 1:-1] for mask in (padded, ~padded))
    distance: np.ndarray = np.where(inside, to_outside - half, half - to_inside)
    return distance


def width_statement(probability: np.ndarray, size: tuple[float, float]) -> str:
    """Sentence on the distance between the outlines of 5 % and 95 % along that of 50 %; empty where one of them is missing."""
    from scipy.ndimage import binary_erosion

    outer, median, inner = (reaches(np.nan_to_num(probability), level) for level in (LOW, MIDDLE, HIGH))
    edge = median & ~binary_erosion(median)
    if not edge.any() or not inner.any():
        return ""
    width = (signed_distance(outer, size) - signed_distance(inner, size))[edge]
    low, middle, high = np.percentile(width, [5, 50, 95])
    return (
        f"along the outline of 50 %, those of 5 % and 95 % are {middle:.3g} m apart (median; {low:.3g} to {high:.3g} m on 90 % of "
        "its length)"
    )


def _moved(span: slice, by: int) -> slice:
    return slice(span.start + by, span.stop + by)


def _window(places: Sequence[tuple[slice, slice]], shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of all places, with those beside them."""
    ends = [(min(p[axis].start for p in places), max(p[axis].stop for p in places)) for axis in (0, 1)]
    (top, bottom), (left, right) = ends
    rows = slice(max(0, top - _BESIDE), min(shape[0], bottom + _BESIDE))
    return rows, slice(max(0, left - _BESIDE), min(shape[1], right + _BESIDE))


def _unpacked(place: tuple[slice, slice], bits: np.ndarray, window: tuple[slice, slice]) -> np.ndarray:
    """Mask in a window of cells that were packed at a place."""
    rows, columns = (span.stop - span.start for span in place)
    mask = np.zeros(tuple(span.stop - span.start for span in window), bool)
    top, left = place[0].start - window[0].start, place[1].start - window[1].start
    mask[top : top + rows, left : left + columns] = np.unpackbits(bits, count=rows * columns).reshape(rows, columns)
    return mask
