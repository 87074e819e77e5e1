"""Outlines of maps and figures of the validation."""

from collections.abc import Sequence
from typing import Any

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


def draw_outline(axes: Any, outline: Outline, **style: Any) -> None:
    """Draw rings; only the first has the label."""
    label = style.pop("label", None)
    for number, ring in enumerate(outline):
        x, y = np.array(ring).T
        axes.plot(x, y, label=label if number == 0 else None, **style)


def along(values: Sequence[float | None]) -> np.ndarray:
    """Numbers of a record; None is NaN."""
    return np.array([np.nan if v is None else v for v in values], float)


def rounded(values: np.ndarray, digits: int) -> list[float | None]:
    """Numbers for a record; NaN is None."""
    return [None if not np.isfinite(v) else round(float(v), digits) for v in values]
