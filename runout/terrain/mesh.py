"""Terrain from a triangulated surface: OBJ, PLY or STL, in metres and map coordinates, with z up.

Where the surface overhangs, the ground below is the terrain, and the rock above it a body of columns.
"""

from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import DemError
from runout.io import crs as coordinate_systems
from runout.io.boundary import as_path
from runout.io.elevation_raster import ElevationRaster
from runout.io.mesh_files import read_mesh
from runout.io.references import MESHES
from runout.io.window import LARGEST_WHOLE, Bounds
from runout.model.limits import checked
from runout.model.terrain import Terrain
from runout.terrain import prepare
from runout.terrain.read import real_extent

ASIDE = 1e-6  # of a cell, by which columns pass beside the edges of the mesh
SAME = 1e-9  # of the relief, between crossings of one sheet
BALANCED = 1e-6  # of the area in plan, by which faces up and faces down of a closed body differ
AT_ONCE = 4_000_000  # pairs of triangle and column


@dataclass(frozen=True)
class Overhangs:
    """Rock above open space: columns of cells."""

    # row, column: (n,) of int: cells of the terrain
    row: np.ndarray
    column: np.ndarray
    # bottom, top: (n,): elevation of underside and top [m]
    bottom: np.ndarray
    top: np.ndarray


def terrain_from_mesh(path: str | PathLike[str], cell_size: float, crs: Any = None, extent: Any = None) -> Terrain:
    """Terrain of an open surface mesh; see :meth:`runout.Terrain.from_mesh`."""
    return read_mesh_terrain(as_path(path, DemError), cell_size, crs, real_extent(extent))[0]


def read_mesh_terrain(
    path: Path, resolution: float | None, crs: Any = None, extent: Bounds | None = None
) -> tuple[Terrain, Overhangs]:
    """Terrain of an open surface mesh on cells of ``resolution`` [m], and what overhangs it; see :meth:`runout.Terrain.from_mesh`.

    Raises DemError, with the place, if the file cannot be used, no resolution is stated, or sheets lie one over another that are
    no overhang.
    """
    if resolution is None:
        raise DemError(f"{path}: a mesh has no cells; state terrain.resolution, the size of the cells that are made of it [m]")
    step = checked("resolution", resolution, place=str(path), error=DemError)
    system = None if crs is None else coordinate_systems.parse(crs, str(path))
    if system is not None and system.is_geographic:
        remedy = "export it in a projected system, and state that"
        raise DemError(f"{path}: its crs {system.name} has degrees, a mesh has metres; {remedy}")
    corners, turned = _surface(path)
    first, (rows, columns) = _cells(corners, step, extent, path)
    column, z, up = _crossings(corners, first * step, step, (rows, columns))
    if not len(column):
        raise DemError(f"{path}: none of {rows} x {columns} cells of {step:g} m has its centre on a face; check terrain.extent")
    ground, above = _sorted_crossings(column, z, up, path, first * step, (rows, columns), step)
    transform = (step, 0.0, first[0] * step, 0.0, -step, (first[1] + rows) * step)
    raster = ElevationRaster(ground, transform, None, "m", str(path))
    terrain = prepare.terrain(coordinate_systems.with_stated(raster, crs))
    if terrain.cell_size != (step, step):
        raise DemError(f"{path}: a mesh needs coordinates in metres; transform it to a projected system, state that in terrain.crs")
    sentences = [f"{path}: its faces are turned upwards"] if turned else []
    sentences.append(f"{len(corners)} triangles became {rows} x {columns} cells of {step:g} m, {len(above.row)} of them overhung")
    north_west = first[0] * step, (first[1] + rows) * step
    return replace(terrain, changes=(*sentences, *terrain.changes)), _moved(above, north_west, terrain)


def overhangs_on(path: str | PathLike[str], terrain: Terrain) -> Overhangs:
    """What overhangs a terrain that was made of the mesh of a file, in its cells.

    Raises DemError if the file cannot be used, or the terrain has cells other than those that are made of a mesh.
    """
    file, (east, north) = as_path(path, DemError), terrain.cell_size
    places = np.array(terrain.extent) / east
    if east != north or np.abs(places - np.round(places)).max() > ASIDE:
        raise DemError(f"{file}: the cells of {terrain.source} are not those of a mesh; make it with Terrain.from_mesh")
    read, above = read_mesh_terrain(file, east, terrain.crs, terrain.extent)
    rock = _moved(above, (read.extent[0], read.extent[3]), terrain)
    rows, columns = terrain.shape
    inside = (rock.row >= 0) & (rock.row < rows) & (rock.column >= 0) & (rock.column < columns)
    return Overhangs(rock.row[inside], rock.column[inside], rock.bottom[inside], rock.top[inside])


def _moved(above: Overhangs, north_west: tuple[float, float], terrain: Terrain) -> Overhangs:
    """Overhangs in the cells of a terrain; they count from another north-west corner."""
    step, (west, _, _, north) = terrain.cell_size[0], terrain.extent
    row, column = round((north - north_west[1]) / step), round((north_west[0] - west) / step)
    return replace(above, row=above.row + row, column=above.column + column)


def _cells(corners: np.ndarray, step: float, extent: Bounds | None, path: Path) -> tuple[np.ndarray, tuple[int, int]]:
    """First cell (2,), in cells from the origin of the map, and rows and columns of those on the mesh and in the extent."""
    west, south, east, north = extent or (*corners[:, :, :2].min((0, 1)), *corners[:, :, :2].max((0, 1)))
    first = np.ceil(np.array([west, south]) / step - ASIDE)
    columns, rows = np.maximum(np.floor(np.array([east, north]) / step + ASIDE) - first, 0)
    what = "terrain.extent" if extent else "the mesh"
    spans = f"{path}: {what} spans {east - west:.6g} x {north - south:.6g} m, {rows:.6g} x {columns:.6g} cells of {step:g} m"
    if min(rows, columns) < 3:
        raise DemError(f"{spans}; give a mesh with coordinates in metres, or smaller cells (terrain.resolution)")
    if rows * columns > LARGEST_WHOLE:
        raise DemError(f"{spans}; give a mesh with coordinates in metres, a terrain.extent, or larger cells (terrain.resolution)")
    return first, (int(rows), int(columns))


def _surface(path: Path) -> tuple[np.ndarray, bool]:
    """Corners (n, 3, 3) of the triangles, turned upwards on the whole, and whether they were turned."""
    parts = read_mesh(path, DemError, MESHES)
    corners = np.concatenate([part.vertices[part.faces] for part in parts])
    area = _plan_area(corners)
    if abs(area.sum()) <= BALANCED * np.abs(area).sum() and all(part.merged().is_closed for part in parts):
        raise DemError(f"{path}: is a closed body; a terrain is an open surface: remove the underside and the sides")
    turned = float(area.sum()) < 0
    return (corners[:, ::-1] if turned else corners), turned


def _plan_area(corners: np.ndarray) -> np.ndarray:
    """Twice the area in plan (n,) of triangles, negative where they face down."""
    a, b = corners[:, 1, :2] - corners[:, 0, :2], corners[:, 2, :2] - corners[:, 0, :2]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]  # type: ignore[no-any-return]


def _crossings(
    corners: np.ndarray, origin: np.ndarray, step: float, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Column (its number from the south-west, north first), elevation [m] and side (True: facing up) of every crossing."""
    rows, columns = shape
    local = corners.copy()
    local[:, :, :2] = (local[:, :, :2] - origin) / step - 0.5 - ASIDE * np.array([1.0, np.sqrt(2.0)])
    twice = _plan_area(local)
    low = np.clip(np.ceil(local[:, :, :2].min(1)).astype(int), 0, [columns, rows])
    high = np.clip(np.floor(local[:, :, :2].max(1)).astype(int) + 1, 0, [columns, rows])
    size = np.maximum(high - low, 0)
    count = np.where(twice != 0, size.prod(1), 0)
    crossings = []
    for part in np.array_split(np.arange(len(local)), max(1, int(count.sum()) // AT_ONCE + 1)):
        f = np.repeat(part, count[part])
        k = np.arange(len(f)) - np.repeat(np.cumsum(count[part]) - count[part], count[part])
        x, y = low[f, 0] + k // np.maximum(size[f, 1], 1), low[f, 1] + k % np.maximum(size[f, 1], 1)
        crossings.append(_hits(local, twice, f, x, y, rows))
    return tuple(np.concatenate(parts) for parts in zip(*crossings, strict=True))  # type: ignore[return-value]


def _hits(local: np.ndarray, twice: np.ndarray, f: np.ndarray, x: np.ndarray, y: np.ndarray, rows: int) -> tuple[np.ndarray, ...]:
    """Crossings of columns x, y with triangles f."""
    weights = []
    for k in range(3):
        a, b = local[f, (k + 1) % 3], local[f, (k + 2) % 3]
        weights.append(((b[:, 0] - a[:, 0]) * (y - a[:, 1]) - (b[:, 1] - a[:, 1]) * (x - a[:, 0])) / twice[f])
    hit = np.min(weights, axis=0) >= 0
    z = sum(w * local[f, k, 2] for k, w in enumerate(weights))
    return (x * rows + y)[hit], np.asarray(z)[hit], twice[f][hit] > 0


def _sorted_crossings(
    column: np.ndarray, z: np.ndarray, up: np.ndarray, path: Path, origin: np.ndarray, shape: tuple[int, int], step: float
) -> tuple[np.ndarray, Overhangs]:
    """Lowest ground (rows, columns) [m], NaN where there is none, and the rock above it."""
    order = np.lexsort([z, column])
    column, z, up = column[order], z[order], up[order]
    same = (np.diff(column) == 0) & (np.diff(z) <= SAME * max(np.ptp(z), 1.0)) & (up[1:] == up[:-1])
    is_new = np.concatenate([[True], ~same])
    column, z, up = column[is_new], z[is_new], up[is_new]
    first = np.concatenate([[True], np.diff(column) != 0])
    place = np.arange(len(column)) - np.maximum.accumulate(np.where(first, np.arange(len(column)), 0))
    last = np.concatenate([first[1:], [True]])
    wrong = (up != (place % 2 == 0)) | (last & ~up)
    if wrong.any():
        x, y = origin + step * (np.array(divmod(int(column[wrong.argmax()]), shape[0])) + 0.5)
        at = f"at easting {x:.1f}, northing {y:.1f}, elevation {z[wrong.argmax()]:.1f}"
        raise DemError(
            f"{path}: {at} sheets of the mesh lie one over another "
            "that are not ground, underside and top in turn; remove the sheet, or close the hole beside it"
        )
    ground = np.full(shape, np.nan)
    row = shape[0] - 1 - column % shape[0]
    ground[row[first], column[first] // shape[0]] = z[first]
    under = np.flatnonzero(~up)
    return ground, Overhangs(row[under], column[under] // shape[0], z[under], z[under + 1])
