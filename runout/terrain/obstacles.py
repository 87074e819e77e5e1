"""Dams, walls and basins: polygons that raise or lower the ground."""

import logging
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

from runout.errors import DemError, ReleaseError
from runout.io.polygon_coverage import on_cells
from runout.io.polygons import read_polygons, without_overlap
from runout.model.terrain import Terrain

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Obstacles:
    """Dams, walls and basins of one vector file on a terrain."""

    # polygons in map coordinates without overlap, each with the height [m] by which it raises the ground
    parts: tuple[tuple[Any, float], ...]
    narrowest: float  # width [m] of the narrowest polygon of the file, taken for a strip: twice its area over its circumference

    @property
    def heights(self) -> list[float]:
        """Height [m] of each part."""
        return [height for _, height in self.parts]


def with_obstacles(terrain: Terrain, path: str | PathLike[str], height: float | str, layer: str | None = None) -> Terrain:
    """The terrain of :func:`build`."""
    return build(terrain, path, height, layer)[0]


def build(terrain: Terrain, path: str | PathLike[str], height: float | str, layer: str | None = None) -> tuple[Terrain, Obstacles]:
    """The terrain, raised by ``height`` [m] inside the polygons of a vector file, or lowered where that is negative.

    A cell that a border cuts is raised by the mean over its area, so that the volume of a dam is kept. Its crest is not where the
    dam is narrower than a cell of the raster, or of the grid of a run. Raises DemError with the place, the value and the remedy.
    """
    source = Path(path)
    try:
        polygons = read_polygons(source, terrain, layer, "obstacle")
        heights = polygons.stated(height, "obstacle_height", "height")
        separate, overlaps = without_overlap(polygons, heights, "height")
    except ReleaseError as error:  # the readers of polygons are those of a release, and so are their errors
        raise DemError(str(error)) from error
    _, raised, parts = on_cells(separate, heights, terrain)
    if not parts:
        raise DemError(f"{source}: no obstacle lies on the terrain {terrain.source}; check the coordinate system of both")
    for change in (*polygons.changes, *overlaps):
        log.warning(change)
    obstacles = Obstacles(tuple(parts), min(2.0 * float(p.area / p.length) for p in polygons.polygons))
    area, lowest, highest = sum(part.area for part, _ in parts), min(obstacles.heights), max(obstacles.heights)
    statement = f"{source}: obstacles on {area:.4g} m2 change the ground by {lowest:g} to {highest:g} m"
    changes = (*terrain.changes, *polygons.changes, *overlaps, statement)
    return replace(terrain, elevation=terrain.elevation + raised.T[::-1], changes=changes), obstacles
