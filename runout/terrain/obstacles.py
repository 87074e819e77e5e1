"""Dams, walls and basins: polygons that raise or lower the ground."""

import logging
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from runout.errors import DemError, ReleaseError
from runout.io.polygons import read_drawn, read_polygons, without_overlap
from runout.model.terrain import Terrain
from runout.terrain.overlay import on_cells

log = logging.getLogger(__name__)


def with_obstacles(terrain: Terrain, path: str | PathLike[str], height: float | str, layer: str | None = None) -> Terrain:
    """The terrain, raised by ``height`` [m] inside the polygons of a vector file, or lowered where that is negative.

    A cell that a border cuts is raised by the mean over its area, so that the volume of a dam is kept. Its crest is not where the
    dam is narrower than a cell of the raster, or of the grid of a run.

    Raises
    ------
    DemError
        With the place, the value and the remedy.
    """
    source = Path(path)
    parts, heights, said_before = _parts(terrain, source, height, layer)
    _, raised, kept = on_cells(parts, heights, terrain)
    if not kept:
        raise DemError(f"{source}: no obstacle lies on the terrain {terrain.source}; check the coordinate system of both")
    for change in said_before:
        log.warning(change)
    area, lowest, highest = sum(part.area for part, _ in kept), min(h for _, h in kept), max(h for _, h in kept)
    said = f"{source}: obstacles on {area:.4g} m2 change the ground by {lowest:g} to {highest:g} m"
    changes = (*terrain.changes, *said_before, said)
    return replace(terrain, elevation=terrain.elevation + raised.T[::-1], changes=changes)


def obstacle_parts(
    terrain: Terrain, path: str | PathLike[str], height: float | str, layer: str | None = None
) -> list[tuple[Any, float]]:
    """Polygons (shapely, map coordinates) of the obstacles that :func:`with_obstacles` builds, each with its height [m].

    Raises
    ------
    DemError
        With the place, the value and the remedy.
    """
    parts, heights, _ = _parts(terrain, Path(path), height, layer)
    return on_cells(parts, heights, terrain)[2]


def _parts(terrain: Terrain, source: Path, height: float | str, layer: str | None) -> tuple[Any, Any, tuple[str, ...]]:
    """Polygons without overlap, their heights [m], and what was changed on the way in."""
    try:
        polygons = read_polygons(source, terrain, layer, "obstacle")
        heights = polygons.stated(height, "obstacle_height", "height")
        parts, overlaps = without_overlap(polygons, heights, "height")
    except ReleaseError as error:  # the readers of polygons are those of a release, and so are their errors
        raise DemError(str(error)) from error
    return parts, heights, (*polygons.changes, *overlaps)


def narrowest(terrain: Terrain, path: str | PathLike[str], layer: str | None = None) -> float:
    """Width [m] of the narrowest polygon of a vector file, taken for a strip: twice its area over its circumference."""
    polygons = read_drawn(Path(path), terrain, layer, "obstacle").polygons
    return float(min(2.0 * polygon.area / polygon.length for polygon in polygons))
