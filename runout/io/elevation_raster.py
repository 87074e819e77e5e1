"""Raster of elevations or of another quantity, with the georeference and units of its file."""

import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from runout.errors import InputError
from runout.io.opening import require_room
from runout.io.window import Bounds, Part, bounds_of, part_of

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Header:
    """Georeference and size of a raster file, read without its values."""

    transform: tuple[float, float, float, float, float, float]  # affine map, as of :class:`ElevationRaster`
    shape: tuple[int, int]  # rows and columns
    crs: Any  # pyproj.CRS or None: as stated
    source: str  # for messages

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.shape[0] * self.shape[1]

    @property
    def bounds(self) -> Bounds:
        """Outer edges in its own coordinates."""
        return bounds_of(self.transform, self.shape)

    def part(self, extent: Bounds | None, error: type[InputError]) -> Part:
        """Part of the raster that covers an extent; an error if it does not fit into the memory."""
        part = part_of(self.transform, self.shape, extent, self.source, error)
        require_room(part.rows, part.columns, self.source, error)
        return part

    def sentences(self, part: Part) -> tuple[str, ...]:
        """Sentence that states the part that is read; empty if it is the whole raster."""
        if (part.rows, part.columns) == self.shape:
            return ()
        edges = ", ".join(f"{edge:.10g}" for edge in bounds_of(part.transform(self.transform), (part.rows, part.columns)))
        return (f"{part.rows} x {part.columns} of its {self.shape[0]} x {self.shape[1]} cells are read, extent [{edges}]",)


@dataclass(frozen=True)
class ElevationRaster:
    """Elevations, or values of another quantity, with the georeference that their file states."""

    values: np.ndarray  # (rows, columns): in `unit`, float64, rows as in the file; NaN where the file marks a cell as unknown
    # GDAL-like affine map `(a, b, c, d, e, f)`: `x = a column + b row + c`, `y = d column + e row + f` from the outer corner of
    # cell (0, 0)
    transform: tuple[float, float, float, float, float, float]
    crs: Any  # pyproj.CRS or None: horizontal coordinate reference system; None if neither the file nor the caller names one
    unit: str | None  # unit of the values; None if not stated
    source: str  # for messages
    changes: tuple[str, ...] = ()  # changes so far, one sentence each
    # sentence on a system that the file does not fully state; a system that the caller names replaces it. Empty if it states one
    assumption: str = ""
    packing: tuple[float, float] = (1.0, 0.0)  # scale and offset by which the numbers in the file became the values
    is_logged: bool = True  # whether changes are logged as they are made; otherwise that is left to the reader of the quantity

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
        return bounds_of(self.transform, (self.values.shape[0], self.values.shape[1]))

    def scaled(self, scale: float, offset: float = 0.0) -> "ElevationRaster":
        """The raster with its values times a scale plus an offset."""
        packing = scale * self.packing[0], scale * self.packing[1] + offset
        return replace(self, values=self.values * scale + offset, packing=packing)

    def stored(self, value: float) -> float:
        """The number in the file that stands for a value."""
        return (value - self.packing[1]) / self.packing[0]

    def changed(self, sentence: str, **fields: Any) -> "ElevationRaster":
        """The raster with other fields; the change is recorded, and logged as a warning."""
        if self.is_logged:
            log.warning("%s: %s", self.source, sentence)
        return replace(self, changes=(*self.changes, sentence), **fields)

    def noted(self, sentence: str, **fields: Any) -> "ElevationRaster":
        """The raster with a recorded remark; its values are unchanged."""
        log.info("%s: %s", self.source, sentence)
        return replace(self, changes=(*self.changes, sentence), **fields)


def moved(transform: tuple[float, ...], rows: int, columns: int) -> tuple[float, ...]:
    """Affine map of the part of a raster that begins at a row and column."""
    a, b, c, d, e, f = transform
    return a, b, c + a * columns, d, e, f + e * rows
