"""Part of a raster that is read: whole cells around a stated extent. Memory does not depend on the size of the raster."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from runout.errors import InputError

LARGEST_WHOLE = 100_000_000  # cells; of larger rasters a site reads only the part that it needs
NEVER_BELOW = 3  # cells along a side

Bounds = tuple[float, float, float, float]  # west, south, east, north, in the coordinates of the raster's own file


@dataclass(frozen=True)
class Part:
    """Rows and columns of a raster."""

    # row, column: first row and column, counted as in the file
    row: int
    column: int
    # rows, columns: number of rows and columns
    rows: int
    columns: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Slices of an array."""
        return slice(self.row, self.row + self.rows), slice(self.column, self.column + self.columns)

    @property
    def window(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Window of rasterio."""
        return (self.row, self.row + self.rows), (self.column, self.column + self.columns)

    def transform(self, whole: Sequence[float]) -> tuple[float, float, float, float, float, float]:
        """Affine map ``(a, b, c, d, e, f)`` of the part of a raster."""
        a, b, c, d, e, f = whole
        return a, b, c + a * self.column + b * self.row, d, e, f + d * self.column + e * self.row


def bounds_of(transform: Sequence[float], shape: tuple[int, int]) -> Bounds:
    """Outer edges of a raster that is not rotated."""
    a, _, c, _, e, f = transform
    x, y = sorted((c, c + a * shape[1])), sorted((f, f + e * shape[0]))
    return x[0], y[0], x[1], y[1]


def part_of(
    transform: Sequence[float], shape: tuple[int, int], extent: Bounds | None, source: Path | str, error: type[InputError]
) -> Part:
    """Whole cells that an extent touches; all cells if the extent is None or the raster is rotated.

    Raises InputError of the given kind if the extent lies beside the raster, or covers less than three cells along a side.
    """
    a, b, c, d, e, f = transform
    if extent is None or b != 0 or d != 0:
        return Part(0, 0, *shape)
    west, south, east, north = extent
    columns = _span((west - c) / a, (east - c) / a, shape[1])
    rows = _span((south - f) / e, (north - f) / e, shape[0])
    if columns[1] < min(NEVER_BELOW, shape[1]) or rows[1] < min(NEVER_BELOW, shape[0]):
        wanted, covered = (f"{', '.join(f'{edge:.10g}' for edge in edges)}" for edges in (extent, bounds_of(transform, shape)))
        raise error(
            f"{source}: the extent [{wanted}] covers {max(columns[1], 0)} x {max(rows[1], 0)} cells of the raster, which spans "
            f"[{covered}] (west, south, east, north in its own coordinates); state one that it covers"
        )
    return Part(rows[0], columns[0], rows[1], columns[1])


def _span(one: float, other: float, count: int) -> tuple[int, int]:
    """First cell and number of cells between two positions [cells] on an axis; overlaps below 1e-6 cells do not count."""
    low, high = sorted((one, other))
    first, last = max(math.floor(min(low, count) + 1e-6), 0), math.ceil(min(max(high, 0.0), count) - 1e-6)
    return first, last - first
