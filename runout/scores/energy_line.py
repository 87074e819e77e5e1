"""Angle of the energy line from a release to the front of its flow."""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from runout.errors import ObservationError, member_of
from runout.scores.thalweg import Thalweg


class Start(StrEnum):
    """Upper end of an energy line."""

    TOP = "top"  # highest released cell: angle of reach, Fahrböschung
    CENTRE_OF_MASS = "centre_of_mass"  # of the release


@dataclass(frozen=True)
class ReleasePoint:
    """Upper end of the energy line: map coordinates and elevation [m]."""

    easting: float
    northing: float
    elevation: float


def release_point(
    easting: np.ndarray, northing: np.ndarray, elevation: np.ndarray, thickness: np.ndarray, start: Start | str = Start.TOP
) -> ReleasePoint:
    """Upper end of the energy line of a release.

    Parameters
    ----------
    easting, northing : ndarray (columns,), (rows,)
        Cell centres [m].
    elevation : ndarray (rows, columns)
        Elevation before the release [m].
    thickness : ndarray (rows, columns)
        Vertical thickness of the release [m].
    start : Start
        "top": the highest released cell (Heim 1932); "centre_of_mass": mean of the cells, weighted by thickness, at the
        elevation of the ground (Scheidegger 1973, Rock Mechanics 5:231 discusses both).

    Raises
    ------
    ObservationError
        If no cell with an elevation is released.
    """
    start = member_of(Start, start, "start of the energy line", ObservationError)
    mass = np.where(np.isfinite(elevation), np.nan_to_num(thickness), 0.0)
    rows, columns = np.nonzero(mass > 0)
    if not rows.size:
        raise ObservationError("energy line: no cell with an elevation is released; state the release of the flow")
    x, y, z = easting[columns], northing[rows], elevation[rows, columns]
    if start is Start.TOP:
        k = int(np.argmax(z))
        return ReleasePoint(float(x[k]), float(y[k]), float(z[k]))
    share = mass[rows, columns] / mass.sum()
    return ReleasePoint(float(share @ x), float(share @ y), float(share @ z))


def energy_line_angle(start: ReleasePoint, front: ReleasePoint, thalweg: Thalweg | None = None) -> float:
    """Angle of the line from the start to the front [rad]: atan(drop / length), -pi/2 to pi/2.

    Without a thalweg the length is the straight distance in plan (Heim 1932, Bergsturz und Menschenleben; angle of reach,
    Corominas 1996, Can. Geotech. J. 33:260). With one it is the difference of their s, the length of the path in plan.
    NaN if start and front are in one place.
    """
    if thalweg is None:
        length = math.hypot(front.easting - start.easting, front.northing - start.northing)
    else:
        s, _ = thalweg.coordinates([start.easting, front.easting], [start.northing, front.northing])
        length = float(s[1] - s[0])
    drop = start.elevation - front.elevation
    return math.atan(drop / length) if length > 0 else math.nan
