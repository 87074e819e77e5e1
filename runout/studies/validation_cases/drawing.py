"""Outlines and numbers of maps, ready for the records of the validation."""

import numpy as np

Outline = list[list[list[float]]]  # rings of points (easting, northing) [m]


def outline_of(values: np.ndarray, threshold: float, easting: np.ndarray, northing: np.ndarray, tolerance: float) -> Outline:
    """Rings around the cells (rows, columns) of more than a threshold, simplified by up to ``tolerance`` [m].

    Lines between cell centres, so that the outline of a map does not depend on the order of its cells.
    """
    from matplotlib.figure import Figure
    from shapely import LineString

    padded = np.pad(np.nan_to_num(values), 1)
    x = np.concatenate([[2 * easting[0] - easting[1]], easting, [2 * easting[-1] - easting[-2]]])
    y = np.concatenate([[2 * northing[0] - northing[1]], northing, [2 * northing[-1] - northing[-2]]])
    lines = Figure().add_subplot().contour(x, y, padded, levels=[threshold]).allsegs[0]
    rings = (LineString(line).simplify(tolerance) for line in lines if len(line) > 3)
    return [[[round(px, 1), round(py, 1)] for px, py in ring.coords] for ring in rings if ring.length > 8 * tolerance]


def rounded(values: np.ndarray, digits: int) -> list[float | None]:
    """Numbers for a record; NaN is None."""
    return [None if not np.isfinite(v) else round(float(v), digits) for v in values]
