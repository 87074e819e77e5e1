"""Bounds of a release, before the terrain is read."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import ReleaseError
from runout.io.layer_crs import stated_crs
from runout.io.polygons import read_frame
from runout.io.window import LARGEST_WHOLE, Bounds, bounds_of
from runout.terrain.source import THICKNESS, errors_as, open_source


@dataclass(frozen=True)
class Place:
    """West, south, east and north edge, and their coordinate system; None if the file states none."""

    edges: Bounds
    crs: Any


def polygon_bounds(path: Path, layer: str | None, elevations: Any) -> Place:
    """Bounds of the polygons of a layer. GeoJSON outside the range of degrees is taken to be in the system of the ``elevations``.

    Raises ReleaseError if the file cannot be read or has no bounds.
    """
    frame, driver = read_frame(path, layer, "release")
    edges = np.asarray(frame.total_bounds, float)
    if not np.isfinite(edges).all():
        raise ReleaseError(f"{path}: the layer is empty; draw at least one release polygon")
    crs = stated_crs(frame.crs.to_wkt() if frame.crs else None)
    beyond = np.abs(edges[[0, 2]]).max() > 180 or np.abs(edges[[1, 3]]).max() > 90
    if driver == "GeoJSON" and crs is not None and crs.is_geographic and beyond:
        crs = elevations
    return Place((float(edges[0]), float(edges[1]), float(edges[2]), float(edges[3])), crs)


def thickness_bounds(path: Path, remedy: str) -> Place:
    """Bounds of the cells of a raster that hold a thickness.

    Raises ReleaseError if the file cannot be read, holds no thickness, or is so large that its extent must be stated: ``remedy``
    says how.
    """
    with errors_as(ReleaseError), open_source(path, THICKNESS) as source:
        rows, columns = source.header.shape
        if source.header.cells > LARGEST_WHOLE:
            raise ReleaseError(f"{path}: {columns} x {rows} cells are too many to look for the release in; {remedy}")
        raster = source.read(None)
    covered = np.nan_to_num(raster.values) != 0
    if not covered.any():
        raise ReleaseError(f"{path}: the release is empty; the raster is 0 or nodata everywhere")
    used = [np.flatnonzero(covered.any(axis=1 - axis)) for axis in (0, 1)]
    a, b, c, d, e, f = raster.transform
    corner = a, b, c + a * used[1][0], d, e, f + e * used[0][0]
    shape = int(used[0][-1] - used[0][0]) + 1, int(used[1][-1] - used[1][0]) + 1
    return Place(bounds_of(corner, shape), stated_crs(raster.crs))
