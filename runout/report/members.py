"""Key figures of one member: runout, deposit and energy."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runout.hazard.order import weighted_percentiles
from runout.quantities import ALL_QUANTITIES, ARRIVAL, CHANGE, DEPOSIT, ERODED, INFLOW_MAP, QUANTITIES

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from runout.io.member_maps import MemberMaps, StackedMember

ROUNDING = 1e-9  # of summed weights


@dataclass(frozen=True)
class Column:
    """Heading, unit and meaning of a column of the table of members."""

    heading: str
    units: str
    meaning: str = ""


FIGURES = {
    "runout_distance": Column("Runout", "m", "plan distance from the release to the farthest cell that the flow reaches"),
    "reach_angle_deg": Column("Angle of reach", "°", "slope of the line from the highest released cell to that farthest cell"),
    "reached_area": Column("Area reached", "km²", "area of all cells that the flow reaches"),
    "max_speed": Column("Peak speed", "m s⁻¹", "largest of the map of maximum speed"),
    "deposit_volume": Column("Deposit beyond", "m³", "volume that lies outside the release area at the end"),
    "escaped_fraction": Column("Escaped", "%", "share of the mass that left the elevation raster"),
    "end_time": Column("End", "s", "time at which the run stopped"),
}


VOLUMES = {  # of members with an erodible bed
    "released_volume": Column("Released", "m³", "volume of the release"),
    "eroded_volume": Column("Eroded", "m³", "volume of the bed that the flow took up"),
    "whole_deposit_volume": Column("Deposited", "m³", "volume of the deposit on the raster at the end"),
    "left_volume": Column("Left the site", "m³", "volume of the mass that left the elevation raster"),
    "lowered_volume": Column("Net erosion", "m³", "volume by which the ground is lower than before the failure"),
    "raised_volume": Column("Net deposition", "m³", "volume by which the ground is higher than before the failure"),
}


Ledger = Mapping[str, np.ndarray]  # mass and energy, each (time,), by name


@dataclass(frozen=True)
class Reach:
    """Distance from the release, in the part of the raster that any member or the release covers.

    Attributes
    ----------
    part : tuple of slice
        Rows and columns of the raster.
    easting, northing : ndarray (columns,), (rows,)
        Cell centres of the part [m].
    elevation : ndarray (rows, columns)
        Elevation before the release [m].
    released : ndarray (rows, columns) of bool
        Cells of the release.
    distance : ndarray (rows, columns)
        Plan distance from the release [m].
    """

    part: tuple[slice, slice]
    easting: np.ndarray
    northing: np.ndarray
    elevation: np.ndarray
    released: np.ndarray
    distance: np.ndarray

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


def member_figures(
    member: "MemberMaps | StackedMember", ledger: Ledger, reach: Reach, least: float | None = None
) -> dict[str, float]:
    """Values of :data:`FIGURES` for one member in SI units; area in km², escaped share in percent.

    The flow reaches cells in which it is ``least`` [m] thick or more at any time; None: those with a time of arrival.
    """
    thickness = QUANTITIES["thickness"].member_map
    decides = ARRIVAL if least is None else thickness
    maps = {name: member.within(name, reach.part) for name in (decides, "max_speed", "deposit_thickness")}
    reached = np.isfinite(maps[ARRIVAL]) if least is None else np.nan_to_num(maps[thickness]) >= np.float32(least)
    distance, angle = reach.runout(reached)
    deposit = np.nan_to_num(maps["deposit_thickness"][~reach.released])
    total = float(ledger["mass"][-1] + ledger["escaped_mass"][-1])
    of_bed = _volumes(member, float(ledger["escaped_mass"][-1]) / total, reach) if CHANGE in member.held() else {}
    return {
        "runout_distance": distance,
        "reach_angle_deg": math.degrees(angle),
        "reached_area": float(reached.sum()) * reach.cell_area / 1e6,
        "max_speed": float(np.nanmax(maps["max_speed"])),
        "deposit_volume": float(deposit.sum(dtype=np.float64)) * reach.cell_area,
        "escaped_fraction": 100.0 * float(ledger["escaped_mass"][-1]) / total,
        "end_time": float(ledger["time"][-1]),
        **of_bed,
    }


def _volumes(member: "MemberMaps | StackedMember", escaped: float, reach: Reach) -> dict[str, float]:
    """Values of :data:`VOLUMES` [m3] for a member of which the share ``escaped`` [1] of all mass left the raster.

    The change of elevation is the deposit less release and eroded depth: so the release is what they leave.
    """
    eroded, change, deposit = (
        np.nan_to_num(member.within(name, reach.part)).astype(np.float64) * reach.cell_area
        for name in (ERODED, CHANGE, QUANTITIES[DEPOSIT].member_map)
    )
    released = float((deposit - change - eroded).sum())
    return {
        "released_volume": released,
        "eroded_volume": float(eroded.sum()),
        "whole_deposit_volume": float(deposit.sum()),
        "left_volume": escaped * (released + float(eroded.sum())),
        "lowered_volume": float(np.maximum(-change, 0.0).sum()),
        "raised_volume": float(np.maximum(change, 0.0).sum()),
    }


def has_volumes(members: "pd.DataFrame") -> bool:
    """Whether the valid members have an erodible bed."""
    return "eroded_volume" in members and bool(members["eroded_volume"].notna().any())


def representative_of(path: Path, members: "pd.DataFrame", hazard: "xr.Dataset") -> int:
    """The :func:`representative` one of valid members (``weight`` by number) of a ``members.nc`` with the maps of ``hazard``."""
    from runout.io.member_maps import MembersFile

    reach, least = Reach.of(hazard), np.float32(hazard["thickness_threshold"].min())
    name = QUANTITIES["thickness"].member_map
    with MembersFile(path) as stack:
        maps = (stack.member(int(number)).within(name, reach.part) for number in members.index)
        distances = [reach.runout(np.nan_to_num(values) >= least)[0] for values in maps]
    return representative(members.assign(runout_distance=distances))


def percentiles_of(members: "pd.DataFrame", figure: str) -> tuple[float, float, float]:
    """Percentiles 5, 50 and 95 of a figure over the valid members, by weight."""
    known = members[members[figure].notna()]
    weights = known["weight"].to_numpy(np.float64)
    low, middle, high = weighted_percentiles(known[[figure]].to_numpy(np.float64), weights / weights.sum(), (5.0, 50.0, 95.0))
    return float(low[0]), float(middle[0]), float(high[0])


def representative(members: "pd.DataFrame") -> int:
    """The valid member with the (lower) median runout distance, by weight where the members have weights."""
    ordered = members[members["runout_distance"].notna()].sort_values("runout_distance")
    weights = ordered["weight"].to_numpy(np.float64) if "weight" in ordered else np.ones(len(ordered))
    reached = np.cumsum(weights) >= (0.5 - ROUNDING) * weights.sum()
    return int(ordered.index[reached.argmax()])
