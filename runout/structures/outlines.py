"""Structures in plan: footprints, and lines of facades."""

from typing import Any

import numpy as np

from runout.model.terrain import Terrain
from runout.structures.solid import Solid

LYING = 1e-3  # plan area of a facade, of its area, from which it is a part of the plan and not a line
GRID = 1e-3  # of the outlines [m]


def footprint(solid: Solid, terrain: Terrain) -> Any:
    """Outline of a body in map coordinates: shapely polygon or multipolygon."""
    return _on_map(_united(solid.corners), terrain)


def facade_lines(solid: Solid, facade: int, terrain: Terrain) -> Any:
    """A facade in map coordinates: the line of a wall, the border of a top or underside (shapely MultiLineString)."""
    import shapely

    from runout.structures.solid import normals_and_areas

    corners = solid.corners[solid.facade == facade]
    normals, areas = normals_and_areas(corners)
    if (np.abs(normals[:, 2]) * areas).sum() > LYING * areas.sum():
        lines = _united(corners).boundary
    else:
        plan = shapely.linestrings(np.concatenate([corners[:, [0, 1], :2], corners[:, [1, 2], :2], corners[:, [2, 0], :2]]))
        apart = shapely.length(plan) > GRID
        lines = shapely.line_merge(shapely.union_all(plan[apart], grid_size=GRID)).simplify(GRID)
    return _on_map(shapely.MultiLineString([part for part in shapely.get_parts(lines) if part.length > 0]), terrain)


def _united(corners: np.ndarray) -> Any:
    """Area (shapely) under triangles (n, 3, 3)."""
    import shapely

    plan = shapely.polygons(corners[:, :, :2])
    return shapely.union_all(plan[shapely.area(plan) > GRID**2], grid_size=GRID)


def _on_map(geometry: Any, terrain: Terrain) -> Any:
    import shapely

    return shapely.transform(geometry, terrain.frame.to_map)
