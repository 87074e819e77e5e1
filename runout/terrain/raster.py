"""An elevation raster as its file states it, before it becomes a terrain."""

import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ElevationRaster:
    """Elevations with the georeference that their file states.

    Parameters
    ----------
    values : ndarray (rows, columns)
        Elevation in ``unit``, float64, rows as in the file; NaN where the file marks a cell as unknown.
    transform : tuple of float
        GDAL-like affine map ``(a, b, c, d, e, f)``: ``x = a column + b row + c``, ``y = d column + e row + f``
        from the outer corner of cell (0, 0).
    crs : pyproj.CRS or None
        Horizontal coordinate reference system; None if neither the file nor the caller names one.
    unit : str or None
        Unit of the elevations; None if not stated.
    source : str
        For messages.
    changes : tuple of str
        What was changed so far, one sentence each.
    """

    values: np.ndarray
    transform: tuple[float, float, float, float, float, float]
    crs: Any
    unit: str | None
    source: str
    changes: tuple[str, ...] = ()

    @property
    def cell(self) -> tuple[float, float]:
        """Size of a cell along columns and rows in map units, positive."""
        return abs(self.transform[0]), abs(self.transform[4])

    @property
    def centre(self) -> tuple[float, float]:
        """Map position of the middle of the raster."""
        a, b, c, d, e, f = self.transform
        rows, columns = self.values.shape
        return c + a * columns / 2 + b * rows / 2, f + d * columns / 2 + e * rows / 2

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Outer edges ``(west, south, east, north)`` in map units, for a raster that is not rotated."""
        a, _, c, _, e, f = self.transform
        rows, columns = self.values.shape
        x, y = sorted((c, c + a * columns)), sorted((f, f + e * rows))
        return x[0], y[0], x[1], y[1]

    def changed(self, sentence: str, **fields: Any) -> "ElevationRaster":
        """The raster with other fields, the change recorded and logged as a warning."""
        log.warning("%s: %s", self.source, sentence)
        return replace(self, changes=(*self.changes, sentence), **fields)

    def noted(self, sentence: str, **fields: Any) -> "ElevationRaster":
        """The raster with a remark that an analyst should know; no value differs by it."""
        log.info("%s: %s", self.source, sentence)
        return replace(self, changes=(*self.changes, sentence), **fields)


def moved(transform: tuple[float, ...], rows: int, columns: int) -> tuple[float, ...]:
    """Transform of the part of a raster, north up, that begins so many rows and columns further."""
    a, b, c, d, e, f = transform
    return a, b, c + a * columns, d, e, f + e * rows
