"""How far flows reach: distance from the release, run-out, and the member with the median run-out, which stands for all."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from runout.quantities import ALL_QUANTITIES, INFLOW_MAP, QUANTITIES

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from runout.io.member_maps import MemberMaps, StackedMember

    _Maps = MemberMaps | StackedMember

ROUNDING = 1e-9  # of summed weights


@dataclass(frozen=True)
class Reach:
    """Distance from the release, in the part of the raster that any member or the release covers."""

    part: tuple[slice, slice]  # rows and columns of the raster
    # easting, northing (columns,), (rows,): cell centres of the part [m]
    easting: np.ndarray
    northing: np.ndarray
    elevation: np.ndarray  # (rows, columns): elevation before the release [m]
    released: np.ndarray  # (rows, columns) of bool: cells of the release
    distance: np.ndarray  # (rows, columns): plan distance from the release [m]

    @classmethod
    def of(cls, hazard: "xr.Dataset") -> "Reach":
        """Distances on the raster of the hazard maps."""
        released = started_on(hazard)
        covered = released | np.isfinite(hazard["first_arrival_time"].values)
        for quantity in ALL_QUANTITIES.values():
            if quantity.peak in hazard:
                covered |= hazard[quantity.peak].values > 0
        part = _bounds(covered)
        easting, northing = hazard["x"].values[part[1]], hazard["y"].values[part[0]]
        return cls.on(released[part], easting, northing, hazard["elevation"].values[part], part)

    @classmethod
    def on(
        cls, released: np.ndarray, easting: np.ndarray, northing: np.ndarray, elevation: np.ndarray,
        part: tuple[slice, slice] = (slice(None), slice(None)),
    ) -> "Reach":  # fmt: skip
        """Distances on cells given by their centres."""
        from scipy.ndimage import distance_transform_edt

        spacing = (abs(northing[1] - northing[0]), abs(easting[1] - easting[0]))
        return cls(part, easting, northing, elevation, released, distance_transform_edt(~released, sampling=spacing))

    @property
    def cell_area(self) -> float:
        """Area of a cell [m2]."""
        return abs(float(self.easting[1] - self.easting[0]) * float(self.northing[1] - self.northing[0]))

    def runout(self, reached: np.ndarray) -> tuple[float, float]:
        """Runout distance [m] and angle of reach [rad] of a flow.

        Parameters
        ----------
        reached : ndarray (rows, columns) of bool
            Cells that the flow reaches.

        Returns
        -------
        distance : float
            Plan distance from the release to the farthest cell reached [m]; 0 if the flow leaves no cell of it.
        angle : float
            Angle of reach from the highest released cell to that cell [rad]; NaN where the distance is 0.
        """
        away = np.where(reached, self.distance, 0.0)
        if away.max() == 0.0:
            return 0.0, math.nan
        row, column = np.unravel_index(np.argmax(away), away.shape)
        top = np.unravel_index(np.argmax(np.where(self.released, self.elevation, -np.inf)), away.shape)
        length = math.hypot(self.easting[column] - self.easting[top[1]], self.northing[row] - self.northing[top[0]])
        return float(away.max()), math.atan2(float(self.elevation[top] - self.elevation[row, column]), length)


def started_on(hazard: "xr.Dataset") -> np.ndarray:
    """Cells (rows, columns) of bool on which mass starts: those of releases, and of inflows at their lines."""
    released: np.ndarray = hazard["release_thickness"].values > 0
    return released | (hazard[INFLOW_MAP].values > 0) if INFLOW_MAP in hazard else released


def _bounds(cells: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns that hold all cells (rows, columns) of bool, two at least; all if there are none."""
    if not cells.any():
        return slice(0, cells.shape[0]), slice(0, cells.shape[1])
    spans = []
    for axis, size in zip((1, 0), cells.shape, strict=True):
        places = np.flatnonzero(cells.any(axis=axis))
        first = min(int(places[0]), size - 2)
        spans.append(slice(first, max(int(places[-1]) + 1, first + 2)))
    return spans[0], spans[1]


def representative(members: "pd.DataFrame") -> int:
    """The valid member with the (lower) median runout distance, by weight where the members have weights."""
    ordered = members[members["runout_distance"].notna()].sort_values("runout_distance", kind="stable")
    weights = ordered["weight"].to_numpy(np.float64) if "weight" in ordered else np.ones(len(ordered))
    reached = np.cumsum(weights) >= (0.5 - ROUNDING) * weights.sum()
    return int(ordered.index[reached.argmax()])


def representative_of(members: "Iterable[tuple[int, _Maps]]", weights: "pd.Series", reach: Reach, least: float) -> int:
    """Number of the :func:`representative` one of valid members, from their maps of maximum thickness.

    Products, QGIS, the report and ``runout view`` all show this member.

    Parameters
    ----------
    members : iterable
        Number and maps (``within(name, part)``) of each valid member.
    weights : Series
        Weights by number.
    reach : Reach
        Distances on the raster of the maps.
    least : float
        Lowest threshold of thickness [m]; the flow reaches a cell from there on.
    """
    import pandas as pd

    name = QUANTITIES["thickness"].member_map
    thickness = ((number, np.nan_to_num(maps.within(name, reach.part))) for number, maps in members)
    distances = pd.Series({number: reach.runout(values >= np.float32(least))[0] for number, values in thickness})
    return representative(pd.DataFrame({"runout_distance": distances, "weight": weights[distances.index]}))
