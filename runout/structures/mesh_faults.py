"""What is wrong with the mesh of a body, with the place: holes, edges of three faces, faces without area, faces that cross."""

import time
from collections.abc import Iterator

import numpy as np

from runout.io.mesh_files import edges_of
from runout.model.terrain import Terrain
from runout.structures.solid import Solid, normals_and_areas

FLAT = 1e-9  # volume of the cube of its length, and area of the square of its edge, below which a body or a face is flat
CROSSED = 1e-6  # of the length of an edge, that lies on either side of a face that it crosses
SEARCH_SECONDS = 30.0  # that the faces of a file are searched for crossings
MOST_FACES = 4_000_000  # of a body whose faces are searched at all: the tree of so many takes several seconds
AT_ONCE, MOST_PAIRS = 4096, 2_000_000  # edges whose neighbours are looked up together, and neighbours that are aimed at


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Volume [m3] of a closed mesh, negative if its faces are turned inwards."""
    corners = vertices[faces] - vertices[faces[0, 0]]
    return float((corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0)


class Search:
    """Search for crossing faces of the bodies of a file, that ends after a time.

    ``seconds``: that it may take in all.
    """

    def __init__(self, seconds: float = SEARCH_SECONDS):
        self.seconds = seconds
        self.left: list[str] = []  # sentences on what was not searched

    def crossings(self, solid: Solid, rounding: float) -> np.ndarray:
        """Places (n, 3) of crossings that were found, see :func:`crossings`."""
        started = time.monotonic()
        points, searched, edges = np.empty((0, 3)), 0, 3 * len(solid.faces) // 2
        if self.seconds > 0 and len(solid.faces) <= MOST_FACES:
            for part in _searched(solid, rounding):
                points, searched, edges = np.concatenate([points, part[0]]), *part[1:]
                if time.monotonic() - started > self.seconds:
                    break
        self.seconds -= time.monotonic() - started
        if searched < edges:
            self.left.append(
                f"{solid.place}: crossing faces were searched at {searched} of its {edges} edges; the search ends after "
                f"{SEARCH_SECONDS:.0f} s and leaves out bodies of more than {MOST_FACES} faces: simplify the mesh, or check it in "
                "MeshLab or Blender"
            )
        return points


def mesh_faults(solid: Solid, terrain: Terrain, rounding: float, search: Search) -> Iterator[str]:
    """What makes a body one without inside and outside; ``rounding`` of its coordinates [m] crosses no faces."""
    fault = _named_fault(solid, terrain)
    if fault:
        yield f"{solid.place}: {fault}"
    elif abs(volume(solid.vertices, solid.faces)) <= FLAT * np.ptp(solid.box, axis=0).max() ** 3:
        yield f"{solid.place}: the mesh has no volume; export a body, not a surface"
    elif len(points := search.crossings(solid, rounding)):
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
    return np.concatenate([np.empty((0, 3)), *(points for points, _, _ in _searched(solid, rounding))])


def _searched(solid: Solid, rounding: float) -> Iterator[tuple[np.ndarray, int, int]]:
    """Crossings (n, 3) of some edges after some others, the number of edges until then, and that of all."""
    import shapely

    corners, faces = solid.corners, solid.faces
    edges, _, _ = edges_of(faces)
    ends = solid.vertices[edges]
    low, high = corners.min(1), corners.max(1)
    tree = shapely.STRtree(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
    start, count = 0, min(AT_ONCE, 1 + MOST_PAIRS // len(faces))
    while start < len(edges):
        part = ends[start : start + count]
        first, last = part.min(1), part.max(1)
        edge, face = tree.query(shapely.box(first[:, 0], first[:, 1], last[:, 0], last[:, 1]))
        pairs = len(edge)
        near = (first[edge, 2] <= high[face, 2]) & (last[edge, 2] >= low[face, 2])
        near &= ~(edges[start + edge][:, :, None] == faces[face][:, None, :]).any((1, 2))
        edge, face = edge[near], face[near]
        start += len(part)
        yield _through(part[edge], corners[face], rounding), start, len(edges)
        count = int(np.clip(count * MOST_PAIRS / max(pairs, 1), max(1, count // 8), min(2 * count, AT_ONCE)))


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
