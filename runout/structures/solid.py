"""A structure as a closed body with named facades, its footprint, and the lines of its facades in plan."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from runout.errors import StructureError
from runout.model.terrain import Terrain

LYING = 1e-3  # plan area of a facade, of its area, from which it is a part of the plan and not a line
GRID = 1e-3  # of the outlines [m]


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed body of triangles, counterclockwise seen from outside."""

    name: str  # of the structure
    vertices: np.ndarray  # (v, 3): local positions [m], float64; z is the elevation
    faces: np.ndarray  # (f, 3) of int: rows of `vertices`
    facade: np.ndarray  # (f,) of int: row of `facades` of each face
    facades: tuple[str, ...]  # names, each once
    friction: float  # Coulomb coefficient of its surfaces [1]; NaN: that of the ground under the mass
    place: str  # file and feature, for messages
    clearance: float | None = None  # height above ground at which it hangs [m]; None for one that stands on the ground
    box: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        if len(self.faces) != len(self.facade) or self.faces.min(initial=0) < 0 or self.faces.max(initial=-1) >= len(self.vertices):
            raise StructureError(f"{self.place}: the faces of the body do not fit to its vertices or facades")
        object.__setattr__(self, "box", np.stack([self.vertices.min(0), self.vertices.max(0)]))

    @property
    def corners(self) -> np.ndarray:
        """Corners (f, 3, 3) of the faces [m]."""
        return self.vertices[self.faces]  # type: ignore[no-any-return]

    def meets(self, other: "Solid", gap: float = 0.0) -> bool:
        """Whether the boxes around both, ``gap`` [m] apart at most, overlap."""
        return bool((self.box[0] <= other.box[1] + gap).all() and (other.box[0] <= self.box[1] + gap).all())


def normals_and_areas(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (n, 3) [1], zero for triangles without area, and areas (n,) [m2] of triangles (n, 3, 3) [m]."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    return np.divide(cross, length[:, None], out=np.zeros_like(cross), where=length[:, None] > 0), 0.5 * length


def pseudo_normals(solid: Solid) -> np.ndarray:
    """Normals (f, 7, 3) of a closed body at the parts of each face: its inside, its corners a, b, c, its edges ab, bc, ca.

    A point is outside where it lies on the side of the normal of the part nearest to it. Normals of corners are weighted by the
    angles of their faces (Baerentzen & Aanaes 2005, eq. 8); those of edges are the sums of two faces.
    """
    corners = solid.corners
    normals, _ = normals_and_areas(corners)
    to_next, to_last = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    lengths = np.linalg.norm(to_next, axis=2) * np.linalg.norm(to_last, axis=2)
    cosine = np.divide((to_next * to_last).sum(2), lengths, out=np.ones_like(lengths), where=lengths > 0)
    angles = np.arccos(np.clip(cosine, -1.0, 1.0))
    at_vertex = np.zeros_like(solid.vertices)
    np.add.at(at_vertex, solid.faces.ravel(), (angles[:, :, None] * normals[:, None, :]).reshape(-1, 3))
    ends = np.sort(np.stack([solid.faces, np.roll(solid.faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, edge = np.unique(ends, axis=0, return_inverse=True)
    at_edge = np.zeros((edge.max() + 1, 3))
    np.add.at(at_edge, edge.ravel(), np.repeat(normals, 3, axis=0))
    edges = at_edge[edge.ravel()].reshape(-1, 3, 3)
    return np.concatenate([normals[:, None, :], at_vertex[solid.faces], edges], axis=1)


def discs_around(corners: np.ndarray) -> np.ndarray:
    """Centre and radius [m], and normal, (n, 7) of a disc around each triangle (n, 3, 3)."""
    centre = corners.mean(1)
    radius = np.linalg.norm(corners - centre[:, None, :], axis=2).max(1, initial=0.0)
    return np.column_stack([centre, radius, normals_and_areas(corners)[0]])


def as_arrays(solid: Solid, gap: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A body as :func:`runout.structures.lattice_distance.mark_inside` takes it, with a box larger by ``gap`` [m]."""
    corners = solid.corners
    return corners, discs_around(corners), pseudo_normals(solid), solid.box + gap * np.array([[-1.0], [1.0]])


def footprint(solid: Solid, terrain: Terrain) -> Any:
    """Outline of a body in map coordinates: shapely polygon or multipolygon."""
    return _on_map(_united(solid.corners), terrain)


def facade_lines(solid: Solid, facade: int, terrain: Terrain) -> Any:
    """A facade in map coordinates: the line of a wall, the border of a top or underside (shapely MultiLineString)."""
    import shapely

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
