"""A case of the validation, its files, and its maps: data on the cells of a terrain, lines, and outlines for the records."""

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from runout.config.fetch import DATA_FOLDER, RemoteFile, fetch
from runout.errors import InputError
from runout.io.opening import open_raster, open_vector
from runout.model.terrain import Terrain
from runout.scores import Grid, Thalweg, values_at

Outline = list[list[list[float]]]  # rings of points (easting, northing) [m]


@dataclass(frozen=True)
class ValidationCase:
    """One case: ``measure(full)`` runs it, coarse for CI or at the sizes of the documentation."""

    name: str  # name for the command and of the page
    title: str
    measure: Callable[[bool], dict[str, Any]]  # results, ready for JSON


def data_folder(name: str, source: str) -> Path:
    """Folder below RUNOUT_DATA; ``source`` says where its files come from. Raises InputError if it is not there."""
    root = os.environ.get(DATA_FOLDER)
    folder = Path(root).expanduser() / name if root else None
    if folder is None or not folder.is_dir():
        place = folder or f"${DATA_FOLDER}/{name}"
        remedy = f"get the files from {source} and set {DATA_FOLDER} to the folder that holds {name}/"
        raise InputError(f"{place}: is not there; {remedy}")
    return folder


def public_file(url: str, path: str, size: int, sha256: str) -> Path:
    """Path of a checked copy of a public file, below RUNOUT_DATA or in the user's cache; see :func:`runout.config.fetch.fetch`."""
    return fetch(RemoteFile(url=url, path=path, size=size, sha256=sha256))


def on_all_processors(function: Callable[[Any], Any], jobs: Sequence[Any]) -> list[Any]:
    """Results of a function of a module for each of many jobs, in their order, in one process a processor."""
    with ProcessPoolExecutor(os.cpu_count(), multiprocessing.get_context("spawn")) as workers:
        return list(workers.map(function, jobs))


def on_cells(path: Path, terrain: Terrain) -> np.ndarray:
    """Values (rows, columns) of a raster at the cell centres of a terrain, from the nearest cell; NaN where unknown or outside.

    Unlike the mean by area, it keeps the extent of a flow whose grid is shifted by half a cell.
    """
    with open_raster(path, InputError) as data:
        values = data.read(1, masked=True).astype(float).filled(np.nan)
        west, south, east, north = data.bounds
    rows, columns = values.shape
    grid = Grid(west, south, ((east - west) / columns, (north - south) / rows), (rows, columns), source=str(path))
    x, y = np.meshgrid(terrain.easting, terrain.northing)
    return values_at(grid, values, x.ravel(), y.ravel()).reshape(terrain.shape)


def thalweg_of(path: Path) -> Thalweg:
    """The first line of a vector file, in its own coordinates."""
    import shapely

    file = open_vector(path, InputError)
    frame, _ = file.read(file.layers()[0])
    return Thalweg(shapely.get_coordinates(frame.geometry.iloc[0]))


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
