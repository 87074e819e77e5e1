"""Transforms polygons and thickness rasters from another system to the map coordinates of the terrain."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import ReleaseError
from runout.io.layer_crs import ToTerrain, crs_name, stated_crs, to_terrain
from runout.model.terrain import Terrain

PIECES = 128  # points per edge of the extent of a layer: straight edges become curves in another system
FEWEST, MOST = 8, 16  # sampling points of thickness along each side of a terrain cell
LOST_VOLUME = 1e-3  # share of a raster's volume that may fall outside the terrain


def polygons_on_terrain(path: Path, frame: Any, driver: str, terrain: Terrain) -> tuple[Any, tuple[str, ...]]:
    """Frame of polygons in the coordinates of the terrain, and sentences on assumptions and changes.

    GeoJSON without a stated system is in degrees (RFC 7946).
    """
    import shapely

    crs, bounds = frame.crs.to_wkt() if frame.crs else None, frame.total_bounds
    wanted = stated_crs(terrain.crs)
    in_degrees = driver == "GeoJSON" and stated_crs(crs) is not None and stated_crs(crs).is_geographic
    if in_degrees:
        change = f"{path} states no coordinate system; its coordinates are taken as the terrain's."
        if wanted is None:
            return frame.set_crs(None, allow_override=True), (change,)
        if np.abs(bounds[[0, 2]]).max() > 180 or np.abs(bounds[[1, 3]]).max() > 90:
            change = (
                f"{path} states no coordinate system and cannot be in degrees; taken to be in the terrain's, {crs_name(wanted)}."
            )
            return frame.set_crs(wanted, allow_override=True), (change,)
    transformation = to_terrain(path, crs, terrain, bounds, "ogr2ogr")
    if transformation.forward is None:
        return frame, transformation.sentences
    longest = float(max(bounds[2] - bounds[0], bounds[3] - bounds[1])) / PIECES
    drawn = shapely.force_2d(frame.geometry.to_numpy())
    dense = np.where(shapely.is_valid(drawn), shapely.segmentize(drawn, longest), drawn)  # GEOS cuts lobes off where sides cross
    moved = shapely.transform(dense, transformation.forward)
    if not np.isfinite(shapely.get_coordinates(moved)).all():
        raise ReleaseError(
            f"{path}: some of its coordinates have no place in the terrain's system; check the system that it states"
        )
    if in_degrees and _is_exchanged(bounds, transformation.forward, terrain):
        raise ReleaseError(
            f"{path}: its coordinates are latitude, longitude; GeoJSON states the longitude first: exchange the two "
            "(QGIS: Swap X and Y coordinates)"
        )
    sentence = f"{path}: reprojected from longitude and latitude, the system of GeoJSON, to {crs_name(wanted)}."
    return frame.set_geometry(moved).set_crs(None, allow_override=True), (sentence,) if in_degrees else transformation.sentences


def _is_exchanged(bounds: np.ndarray, forward: Callable[[np.ndarray], np.ndarray], terrain: Terrain) -> bool:
    """Whether the middle of bounds [degree] lies on the terrain only with longitude and latitude exchanged."""
    middle = (bounds[:2] + bounds[2:]) / 2.0
    west, south, east, north = terrain.extent
    places = forward(np.stack([middle, middle[::-1]]))
    own, exchanged = (bool(west <= x <= east and south <= y <= north) for x, y in places)
    return exchanged and not own


def raster_on_terrain(
    values: np.ndarray, edges: tuple[np.ndarray, np.ndarray], transformation: ToTerrain, terrain: Terrain, path: Path
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], tuple[str, ...]]:
    """Thickness on the cells of the terrain (nx, ny) [m], their local edges [m], and sentences on changes; the volume is kept.

    Each cell of the terrain is the mean of what lies at points all over it; of a raster that is finer than these points it is the
    sum of the cells whose middles lie in it.

    Parameters
    ----------
    values : ndarray (nx, ny)
        Thickness [m] from the south-west.
    edges : tuple of ndarray
        Ascending edges (x, y) of its cells in its own map coordinates.
    transformation : ToTerrain
        With a transformation.

    Raises
    ------
    ReleaseError
        If part of the volume lies outside the terrain.
    """
    assert transformation.forward is not None
    corners = np.stack(np.meshgrid(*edges, indexing="ij"), axis=-1)
    there = transformation.forward(corners.reshape(-1, 2)).reshape(corners.shape)
    volumes = values * _areas(there)
    _require_inside(there, volumes, terrain, path)
    own = (np.arange(n + 1) * size for n, size in zip(terrain.shape[::-1], terrain.cell_size, strict=True))
    to_edges = next(own), next(own)
    cells = np.zeros((terrain.shape[1], terrain.shape[0]))
    if volumes.any():
        window, points = _window(there, volumes, terrain), _points(there, terrain)
        fine = points > MOST
        cells[window] = (
            _put(there, volumes, terrain, window) if fine else _looked_up(values, edges, transformation, terrain, window, points)
        )
        cells *= np.abs(volumes).sum() / (np.abs(cells).sum() * terrain.cell_area)
    sentence = f"{path}: resampled by area to the cells of the terrain; its {abs(float(volumes.sum())):.6g} m3 are kept."
    return cells, to_edges, (*transformation.sentences, sentence)


def _areas(corners: np.ndarray) -> np.ndarray:
    """Plan areas (nx, ny) of cells from their corners (nx + 1, ny + 1, 2) [m2]."""
    one, other = corners[1:, 1:] - corners[:-1, :-1], corners[:-1, 1:] - corners[1:, :-1]
    return np.abs(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]) / 2.0  # type: ignore[no-any-return]


def _require_inside(corners: np.ndarray, volumes: np.ndarray, terrain: Terrain, path: Path) -> None:
    middle = (corners[1:, 1:] + corners[:-1, :-1]) / 2.0
    west, south, east, north = terrain.extent
    x, y = middle[..., 0], middle[..., 1]
    inside = (x >= west) & (x <= east) & (y >= south) & (y <= north)
    lost, total = np.abs(volumes[~inside]).sum(), np.abs(volumes).sum()
    if not np.isfinite(total) or lost > LOST_VOLUME * total:
        raise ReleaseError(
            f"{path}: {lost / total:.1%} of its {total:.6g} m3 lies outside the terrain {terrain.source}; "
            "use a larger DEM, cut the release, or check the coordinate system of both"
        )


def _window(corners: np.ndarray, volumes: np.ndarray, terrain: Terrain) -> tuple[slice, slice]:
    """Window of terrain cells (east, north from the south-west) around all cells with volume."""
    filled = volumes != 0.0
    near = np.zeros(corners.shape[:2], bool)
    for i in (0, 1):
        for j in (0, 1):
            near[i : i + filled.shape[0], j : j + filled.shape[1]] |= filled
    local = terrain.frame.to_local(corners[near])
    low = np.floor(local.min(axis=0) / terrain.cell_size).astype(np.int64)
    high = np.ceil(local.max(axis=0) / terrain.cell_size).astype(np.int64)
    x, y = (slice(max(int(a), 0), min(int(b), n)) for a, b, n in zip(low, high, terrain.shape[::-1], strict=True))
    return x, y


def _points(corners: np.ndarray, terrain: Terrain) -> int:
    """Points along each side of a cell of the terrain: two in each cell of the raster, within bounds."""
    own = float(np.sqrt(np.median(_areas(corners))))
    return int(max(np.ceil(2.0 * max(terrain.cell_size) / own), FEWEST))


def _put(corners: np.ndarray, volumes: np.ndarray, terrain: Terrain, window: tuple[slice, slice]) -> np.ndarray:
    """Mean thickness [m] of the cells of a window from the volumes (nx, ny) [m3] of much smaller ones."""
    middle = terrain.frame.to_local((corners[1:, 1:] + corners[:-1, :-1]) / 2.0)[volumes != 0.0]
    shape = tuple(w.stop - w.start for w in window)
    place = [
        np.clip(np.floor(middle[:, axis] / size).astype(np.int64) - w.start, 0, n - 1)
        for axis, (size, w, n) in enumerate(zip(terrain.cell_size, window, shape, strict=True))
    ]
    flat = np.ravel_multi_index(place, shape)
    cell_volume = np.bincount(flat, volumes[volumes != 0.0], int(np.prod(shape)))
    return cell_volume.reshape(shape) / terrain.cell_area  # type: ignore[no-any-return]


def _looked_up(
    values: np.ndarray,
    edges: tuple[np.ndarray, np.ndarray],
    transformation: ToTerrain,
    terrain: Terrain,
    window: tuple[slice, slice],
    k: int,
) -> np.ndarray:
    """Mean of the values at k x k points in each cell of a window; between the corners of a cell the transformation is linear."""
    assert transformation.inverse is not None
    lattice = [np.arange(w.start, w.stop + 1) * size for w, size in zip(window, terrain.cell_size, strict=True)]
    corners = np.stack(np.meshgrid(*lattice, indexing="ij"), axis=-1)
    there = transformation.inverse(terrain.frame.to_map(corners.reshape(-1, 2))).reshape(corners.shape)
    south_west, south_east, north_west, north_east = there[:-1, :-1], there[1:, :-1], there[:-1, 1:], there[1:, 1:]
    total = np.zeros(south_west.shape[:2])
    for u in (np.arange(k) + 0.5) / k:
        south, north = (1 - u) * south_west + u * south_east, (1 - u) * north_west + u * north_east
        for v in (np.arange(k) + 0.5) / k:
            total += _at(values, edges, (1 - v) * south + v * north)
    return total / k**2


def _at(values: np.ndarray, edges: tuple[np.ndarray, np.ndarray], points: np.ndarray) -> np.ndarray:
    """Values of the cells that hold points (..., 2); 0 outside."""
    i, j = (np.searchsorted(e, points[..., axis], "right") - 1 for axis, e in enumerate(edges))
    inside = (i >= 0) & (i < values.shape[0]) & (j >= 0) & (j < values.shape[1])
    return np.where(inside, values[np.where(inside, i, 0), np.where(inside, j, 0)], 0.0)  # type: ignore[no-any-return]
