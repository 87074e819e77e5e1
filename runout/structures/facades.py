"""Names of facades: walls by the side that they face, top, underside."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from runout.structures.solid import normals_and_areas

SIDES = ("east", "northeast", "north", "northwest", "west", "southwest", "south", "southeast")
STRAIGHT = np.radians(20.0)  # turns between neighbours that belong to one wall or facade
LARGE = 0.02  # of the surface of a body: smaller groups of faces are one facade together
MOST = 24  # facades of a mesh
STEEP = 0.7071  # vertical part of a unit normal from which a facade is top or underside


def side_of(normal: np.ndarray) -> str:
    """The side of eight that a horizontal direction (2,) faces."""
    return SIDES[round(np.arctan2(normal[1], normal[0]) / (np.pi / 4)) % 8]


def numbered(names: Sequence[str]) -> list[str]:
    """Names, each once: those that occur several times get a number."""
    total, seen = Counter(names), Counter[str]()
    unique_names = []
    for name in names:
        seen[name] += 1
        unique_names.append(f"{name} {seen[name]}" if total[name] > 1 else name)
    return unique_names


def walls_of(ring: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Wall of each side (n,) of a ring of points (n, 2), the body on its left, and the side that each wall faces.

    A wall is a row of sides that face the same of eight directions. Sides that turn by less than 20 degrees from each to the next
    count as one straight line unless they turn by more than 40 degrees together.
    """
    along, rows = np.roll(ring, -1, axis=0) - ring, np.arange(len(ring))
    turn = _turns(along)
    corner = np.abs(turn) > STRAIGHT
    run = np.searchsorted(np.flatnonzero(corner), rows, "right") % max(corner.sum(), 1)
    names = [""] * len(ring)
    for one in np.unique(run):
        members = np.flatnonzero(run == one)
        straight = abs(turn[members[~corner[members]]].sum()) < 2 * STRAIGHT
        for k in members:
            east, north = along[members].sum(0) if straight else along[k]
            names[k] = side_of(np.array([north, -east]))
    first = [k for k in rows.tolist() if names[k] != names[k - 1]]
    return (np.searchsorted(first, rows, "right") - 1) % len(first), [names[k] for k in first]


def _turns(along: np.ndarray) -> np.ndarray:
    """Angle [rad] by which the direction turns (n,) between each side of a ring and the one before."""
    before = np.roll(along, 1, axis=0)
    cross = before[:, 0] * along[:, 1] - before[:, 1] * along[:, 0]
    return np.arctan2(cross, (before * along).sum(1))  # type: ignore[no-any-return]


def mesh_facades(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Facade of each face (f,), and the names of the facades: neighbours that turn by less than 20 degrees are one.

    Groups of less than 2 % of the surface are the facade "rest"; a body without larger groups, or with more than 24, is one facade.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    normals, areas = normals_and_areas(vertices[faces])
    pairs = face_pairs(faces)
    flat = (normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(1) > np.cos(STRAIGHT)
    joined = coo_array((np.ones(flat.sum()), tuple(pairs[flat].T)), (len(faces),) * 2)
    count, group = connected_components(joined, directed=False)
    area = np.bincount(group, areas, count)
    large = np.flatnonzero(area > LARGE * areas.sum())
    if not 1 <= len(large) <= MOST:
        return np.zeros(len(faces), int), ("surface",)
    names = [_name(normals[group == g], areas[group == g]) for g in large]
    row = np.full(count, len(large))
    row[large] = np.arange(len(large))
    return row[group], tuple(numbered([*names, *(["rest"] if (row == len(large)).any() else [])]))


def _name(normals: np.ndarray, areas: np.ndarray) -> str:
    mean = (areas[:, None] * normals).sum(0) / areas.sum()
    if np.linalg.norm(mean) < np.cos(2 * STRAIGHT):
        return "surface"
    if abs(mean[2]) > STEEP:
        return "top" if mean[2] > 0 else "underside"
    return side_of(mean[:2])


def face_pairs(faces: np.ndarray) -> np.ndarray:
    """Rows (n, 2) of the faces that share each inner edge of a mesh."""
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2))
    order = np.lexsort(ends.T)
    same = (ends[order[1:]] == ends[order[:-1]]).all(1)
    return np.stack([order[:-1][same] // 3, order[1:][same] // 3], axis=1)
