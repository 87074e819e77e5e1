"""What is wrong with the mesh of a body, with the place: holes, edges of three faces, faces without area, faces that cross."""

from collections.abc import Iterator

import numpy as np

from runout.io.mesh_files import edges_of
from runout.model.terrain import Terrain
from runout.structures.solid import Solid, normals_and_areas

FLAT = 1e-9  # volume of the cube of its length, and area of the square of its edge, below which a body or a face is flat
CROSSED = 1e-6  # of the length of an edge, that lies on either side of a face that it crosses
MOST_FACES = 200_000  # of a body whose faces are searched for crossings
AT_ONCE = 4096  # faces whose neighbours are looked up together


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Volume [m3] of a closed mesh, negative if its faces are turned inwards."""
    corners = vertices[faces] - vertices[faces[0, 0]]
    return float((corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0)


def mesh_faults(solid: Solid, terrain: Terrain, rounding: float) -> Iterator[str]:
    """What makes a body one without inside and outside; ``rounding`` of its coordinates [m] crosses no faces."""
    found = _named_fault(solid, terrain)
    if found:
        yield f"{solid.place}: {found}"
    elif abs(volume(solid.vertices, solid.faces)) <= FLAT * np.ptp(solid.box, axis=0).max() ** 3:
        yield f"{solid.place}: the mesh has no volume; export a body, not a surface"
    elif len(solid.faces) <= MOST_FACES and len(points := crossings(solid, rounding)):
        where = _place(points, terrain, "place")
        yield f"{solid.place}: faces of the mesh cross each other at {where}; move them apart, or cut them there (MeshLab, Blender)"


def _named_fault(solid: Solid, terrain: Terrain) -> str:
    """The first of: faces that occur twice, and edges that do not have two faces on their two sides."""
    faces = solid.faces
    edges, row, count = edges_of(faces)
    forward = np.bincount(row, (faces < np.roll(faces, -1, axis=1)).ravel(), len(edges))
    turned = (count == 2) & (forward != 1)
    if not ((count != 2) | turned).any():
        return ""
    order = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]
    twice = np.setdiff1d(np.arange(len(faces)), order)
    if len(twice):
        return f"the mesh has faces twice at {_place(solid.corners[twice].mean(1), terrain, 'face')}; remove duplicate faces"
    at_fault = (count != 2)[row].reshape(-1, 3).any(1) & _flat(solid.corners)
    if at_fault.any():
        where = _place(solid.corners[at_fault].mean(1), terrain, "face")
        return f"the mesh has faces without area at {where}; remove them (MeshLab: remove zero area faces)"
    faults: tuple[tuple[str, np.ndarray, str], ...] = (
        ("is open", count == 1, "close the hole (MeshLab, Blender: fill holes)"),
        ("has edges of more than two faces", count > 2, "remove inner faces (MeshLab: remove non-manifold edges)"),
        ("has neighbouring faces that are turned against each other", turned, "recalculate the normals"),
    )
    what, edge, remedy = next(fault for fault in faults if fault[1].any())
    return f"the mesh {what} at {_place(solid.vertices[edges[edge]].mean(1), terrain, 'edge')}; {remedy}"


def _flat(corners: np.ndarray) -> np.ndarray:
    """Whether triangles (n, 3, 3) have no area."""
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    return normals_and_areas(corners)[1] <= FLAT * longest**2  # type: ignore[no-any-return]


def crossings(solid: Solid, rounding: float = 0.0) -> np.ndarray:
    """Places (n, 3) where edges of a closed body run through a face that is none of theirs, by more than ``rounding`` [m]."""
    import shapely

    corners, faces = solid.corners, solid.faces
    edges, _, _ = edges_of(faces)
    ends = solid.vertices[edges]
    low, high = corners.min(1), corners.max(1)
    tree = shapely.STRtree(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
    found = [np.empty((0, 3))]
    for start in range(0, len(edges), AT_ONCE):
        part = ends[start : start + AT_ONCE]
        first, last = part.min(1), part.max(1)
        edge, face = tree.query(shapely.box(first[:, 0], first[:, 1], last[:, 0], last[:, 1]))
        near = (first[edge, 2] <= high[face, 2]) & (last[edge, 2] >= low[face, 2])
        near &= ~(edges[start + edge][:, :, None] == faces[face][:, None, :]).any((1, 2))
        edge, face = edge[near], face[near]
        found.append(_through(part[edge], corners[face], rounding))
    return np.concatenate(found)


def _through(ends: np.ndarray, corners: np.ndarray, rounding: float) -> np.ndarray:
    """Places (k, 3) where edges (n, 2, 3) run through the inside of triangles (n, 3, 3)."""
    normal, area = normals_and_areas(corners)
    above = ((ends - corners[:, :1]) * normal[:, None]).sum(2)
    least = np.maximum(CROSSED * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), rounding)
    apart = (above.min(1) < -least) & (above.max(1) > least) & (area > 0)
    ends, corners, normal, above, least = ends[apart], corners[apart], normal[apart], above[apart], least[apart]
    share = above[:, 0] / (above[:, 0] - above[:, 1])
    point = ends[:, 0] + share[:, None] * (ends[:, 1] - ends[:, 0])
    side = np.roll(corners, -1, axis=1) - corners
    inward = np.cross(normal[:, None], side) / np.linalg.norm(side, axis=2)[:, :, None]
    inside = ((point[:, None] - corners) * inward).sum(2).min(1) > least
    return point[inside]  # type: ignore[no-any-return]


def _place(points: np.ndarray, terrain: Terrain, what: str) -> str:
    """Map position in words: the mean of a few local points (n, 3), or the first of many."""
    x, y, z = terrain.frame.to_map(points.mean(0) if len(points) <= 64 else points[0])
    number = f"{len(points)} {what}{'s' if len(points) > 1 else ''}"
    return f"easting {x:.2f}, northing {y:.2f}, elevation {z:.2f} ({number})"
