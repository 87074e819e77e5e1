"""Key figures of one member: runout, deposit and energy."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


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


def member_figures(maps: "xr.Dataset", ledger: "xr.Dataset", hazard: "xr.Dataset") -> dict[str, float]:
    """Values of :data:`FIGURES` for one member in SI units; area in km², escaped share in percent."""
    released = hazard["release_thickness"].fillna(0.0).values > 0
    reached = np.isfinite(maps["arrival_time"].values)
    area = abs(float(hazard["x"][1] - hazard["x"][0]) * float(hazard["y"][1] - hazard["y"][0]))
    distance, angle = runout(reached, released, hazard["x"].values, hazard["y"].values, hazard["elevation"].values)
    deposit = maps["deposit_thickness"].fillna(0.0).values
    total = float(ledger["mass"][-1] + ledger["escaped_mass"][-1])
    return {
        "runout_distance": distance,
        "reach_angle_deg": math.degrees(angle),
        "reached_area": float(reached.sum()) * area / 1e6,
        "max_speed": float(maps["max_speed"].max()),
        "deposit_volume": float(deposit[~released].sum()) * area,
        "escaped_fraction": 100.0 * float(ledger["escaped_mass"][-1]) / total,
        "end_time": float(ledger["time"][-1]),
    }


def runout(
    reached: np.ndarray, released: np.ndarray, easting: np.ndarray, northing: np.ndarray, elevation: np.ndarray
) -> tuple[float, float]:
    """Runout distance [m] and angle of reach [rad] of a flow over a raster.

    Parameters
    ----------
    reached, released : ndarray (rows, columns) of bool
        Cells that the flow reaches, and cells of the release.
    easting, northing : ndarray (columns,), (rows,)
        Cell centres [m].
    elevation : ndarray (rows, columns)
        Elevation before the release [m].

    Returns
    -------
    distance : float
        Plan distance from the release to the farthest cell reached [m]; 0 if the flow leaves no cell of it.
    angle : float
        Angle of reach from the highest released cell to that cell [rad]; NaN where the distance is 0.
    """
    from scipy.ndimage import distance_transform_edt

    spacing = (abs(northing[1] - northing[0]), abs(easting[1] - easting[0]))
    away = np.where(reached, distance_transform_edt(~released, sampling=spacing), 0.0)
    if away.max() == 0.0:
        return 0.0, math.nan
    row, column = np.unravel_index(np.argmax(away), away.shape)
    top = np.unravel_index(np.argmax(np.where(released, elevation, -np.inf)), away.shape)
    length = math.hypot(easting[column] - easting[top[1]], northing[row] - northing[top[0]])
    return float(away.max()), math.atan2(float(elevation[top] - elevation[row, column]), length)


def representative(members: "pd.DataFrame") -> int:
    """The valid member with the (lower) median runout distance."""
    ordered = members["runout_distance"].dropna().sort_values()
    return int(ordered.index[(len(ordered) - 1) // 2])
