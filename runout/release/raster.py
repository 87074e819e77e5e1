"""Reads thickness rasters as arrays with local edges."""

from pathlib import Path

import numpy as np

from runout.errors import ReleaseError
from runout.io.elevation_raster import ElevationRaster, Header
from runout.io.layer_crs import ToTerrain, to_terrain
from runout.io.polygon_reproject import raster_on_terrain
from runout.io.window import LARGEST_WHOLE, Bounds
from runout.model.limits import LIMITS
from runout.model.terrain import Terrain
from runout.terrain.source import THICKNESS, errors_as, north_up_in_unit_of, open_source, require_straight

MARGIN = 8  # cells of a huge raster that are read around the terrain, to detect a release that extends beyond it
EDGE_POINTS = 33  # points along each side of the terrain: straight edges become curves in another system


def read_thickness(path: Path, terrain: Terrain) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], tuple[str, ...]]:
    """Values (nx, ny) from the south-west, 0 for nodata; local edges ``(x, y)`` [m]; sentences on assumptions.

    Raises
    ------
    ReleaseError
        If the file cannot be read as one of elevations could be, or its system has no known transformation.
    """
    with errors_as(ReleaseError), open_source(path, THICKNESS) as source:
        header = source.header
        require_straight(header.transform, header.source, THICKNESS.name)
        placed = to_terrain(path, header.crs, terrain, header.bounds, "gdalwarp")
        extent, sentences = _needed(path, header, placed, terrain)
        raster = north_up_in_unit_of(source.read(extent), THICKNESS)
    values = _values(path, raster)[::-1]
    changes = (*(f"{path}: {change}." for change in raster.changes), *sentences)
    a, _, c, _, e, f = raster.transform
    x, y = c + np.arange(values.shape[1] + 1) * a, f + np.arange(values.shape[0], -1, -1) * e
    if placed.forward is not None:
        values, edges, said = raster_on_terrain(np.ascontiguousarray(values.T), (x, y), placed, terrain, path)
        return values, edges, (*changes, *said)
    return np.ascontiguousarray(values.T), (x - terrain.west, y - terrain.south), (*changes, *placed.sentences)


def _needed(path: Path, header: Header, placed: ToTerrain, terrain: Terrain) -> tuple[Bounds | None, tuple[str, ...]]:
    """Extent of a raster that is read, and a sentence unless it is all: of huge rasters only the cells on and near the terrain."""
    if header.cells <= LARGEST_WHOLE:
        return None, ()
    said = f"{path}: the cells on and near the terrain are read; releases elsewhere are left out."
    return _around(terrain, placed, header.transform), (said,)


def _around(terrain: Terrain, placed: ToTerrain, transform: tuple[float, ...]) -> Bounds:
    """Extent of a terrain and :data:`MARGIN` cells around it, in the coordinates of a raster."""
    west, south, east, north = terrain.extent
    along = np.linspace(0.0, 1.0, EDGE_POINTS)
    x, y = west + along * (east - west), south + along * (north - south)
    rim = np.concatenate([np.column_stack((x, np.full_like(x, edge))) for edge in (south, north)])
    rim = np.concatenate([rim, *(np.column_stack((np.full_like(y, edge), y)) for edge in (west, east))])
    there = rim if placed.inverse is None else placed.inverse(rim)
    more = MARGIN * np.abs([transform[0], transform[4]])
    low, high = there.min(axis=0) - more, there.max(axis=0) + more
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _values(path: Path, raster: ElevationRaster) -> np.ndarray:
    """Thickness (rows, columns) [m], north up, 0 where the raster holds none.

    Raises
    ------
    ReleaseError
        If a cell is infinite, or its absolute value exceeds the largest thickness: often it marks missing values.
    """
    values = np.where(np.isnan(raster.values), 0.0, raster.values)
    if np.isinf(values).any():
        raise ReleaseError(f"{path}: {int(np.isinf(values).sum())} cells are infinite; mark them as nodata")
    valid = LIMITS["thickness"]
    beyond = np.argwhere(np.abs(values) > valid.high)
    if not len(beyond):
        return values
    row, column = beyond[0]
    value, number = float(values[row, column]), raster.stored(float(values[row, column]))
    a, _, c, _, e, f = raster.transform
    east, north = c + (column + 0.5) * a, f + (row + 0.5) * e
    raise ReleaseError(
        f"{path}: thickness is {value:g} m at easting {east:.2f}, northing {north:.2f}, {len(beyond)} cells in all; "
        f"{valid.allowed()}; if {number:g} marks cells without a release, declare it: gdal_edit.py -a_nodata {number:.9g} {path}"
    )
