"""Outlets of a scar: lines that rise inwards from its rim, and the part of the mass below them."""

import numpy as np

from runout.model.release import Release
from runout.terrain.fill import filled

NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))  # rows, columns
FLATTEST = 1e-9  # slope that replaces 0, since edges of zero weight are absent from a sparse graph
LARGEST = 250_000  # cells; larger windows are averaged over blocks


def rising_from_rim(
    ground: np.ndarray, inside: np.ndarray, cell_size: tuple[float, float], slope: float | np.ndarray
) -> np.ndarray:
    """Lowest elevation (rows, columns) [m] from which ground that falls at ``slope`` [1] leads out of an area.

    For each cell of the area it is the least elevation of a cell beside the area plus ``slope`` times the length of the path from
    there inside the area, over the eight neighbours of each cell. Elsewhere it is the ground.

    Parameters
    ----------
    ground : ndarray (rows, columns)
        Elevation [m] around the area, without gaps.
    inside : ndarray (rows, columns) of bool
        The area; it does not touch the rim of the array.
    cell_size : tuple of float
        East and north [m].
    slope : float or ndarray (rows, columns)
        [1], 0 or more.
    """
    from scipy import sparse
    from scipy.sparse import csgraph

    first, second, length = _edges(ground.shape, cell_size)
    area, z = inside.ravel(), ground.ravel()
    slopes = np.broadcast_to(np.maximum(slope, FLATTEST), ground.shape).ravel()
    within = area[first] & area[second]
    crossing = area[first] != area[second]
    cell = np.where(area[first], first, second)[crossing]
    beside = np.where(area[first], second, first)[crossing]
    base, source = float(z.min()) - 1.0, z.size
    start = np.full(z.size, np.inf)
    np.minimum.at(start, cell, z[beside] + slopes[cell] * length[crossing] - base)
    rim = np.flatnonzero(np.isfinite(start))
    rows = np.concatenate((first[within], np.full(len(rim), source)))
    columns = np.concatenate((second[within], rim))
    weights = np.concatenate((slopes[first[within]] * length[within], start[rim]))
    graph = sparse.csr_array((weights, (rows, columns)), shape=(source + 1, source + 1))
    path = csgraph.dijkstra(graph, directed=False, indices=source)[:-1].reshape(ground.shape)
    return np.where(inside, path + base, ground)


def trapped_share(release: Release, angle: float) -> float:
    """Share [1] of a release that lies below the lines which rise from the rim of its scar at ``angle`` [rad].

    With the basal friction angle: mass that cannot slide out by itself on any path. With 0: mass below the lowest
    outlet.
    """
    thickness, excavation = release.thickness, release.excavation
    rows, columns = np.nonzero(thickness > 0)
    block = int(np.ceil(np.sqrt(np.ptp(rows) * np.ptp(columns) / LARGEST))) or 1
    window = tuple(
        np.clip(np.arange(places.min() - block, places.max() + 2 * block), 0, count - 1)
        for places, count in zip((rows, columns), thickness.shape, strict=True)
    )
    inside = thickness[np.ix_(*window)]
    inside[[0, -1]] = 0.0
    inside[:, [0, -1]] = 0.0
    ground = filled(release.terrain.elevation[np.ix_(*window)], release.terrain.cell_size)
    mass, dug = _blocks(inside, block), _blocks(ground - np.minimum(excavation[np.ix_(*window)], inside), block)
    cell = (block * release.terrain.cell_size[0], block * release.terrain.cell_size[1])
    line = rising_from_rim(dug, mass > 0, cell, float(np.tan(angle)))
    return float(np.clip(line - dug, 0.0, mass).sum() / mass.sum())


def _edges(shape: tuple[int, ...], cell_size: tuple[float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flat indices of neighbouring cells (n,), (n,) and their distance (n,) [m]."""
    cells = np.arange(shape[0] * shape[1]).reshape(shape)
    first, second, length = [], [], []
    for down, right in NEIGHBOURS:
        here = cells[: shape[0] - down, max(0, -right) : shape[1] - max(0, right)]
        there = cells[down:, max(0, right) : shape[1] + min(0, right)]
        first.append(here.ravel())
        second.append(there.ravel())
        length.append(np.full(here.size, np.hypot(down * cell_size[1], right * cell_size[0])))
    return np.concatenate(first), np.concatenate(second), np.concatenate(length)


def _blocks(values: np.ndarray, count: int) -> np.ndarray:
    """Means over blocks of ``count`` by ``count`` cells; incomplete blocks are filled with the last cells."""
    if count == 1:
        return values
    padded = np.pad(values, [(0, -size % count) for size in values.shape], mode="edge")
    rows, columns = (size // count for size in padded.shape)
    return padded.reshape(rows, count, columns, count).mean(axis=(1, 3))
