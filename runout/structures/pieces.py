"""Cuts the surfaces of bodies into pieces of about a grid cell."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runout.errors import StructureError
from runout.model.terrain import Terrain
from runout.structures.ground import elevation_at
from runout.structures.lattice_distance import points_inside
from runout.structures.solid import Solid, as_arrays, normals_and_areas

DIAGONAL = 2.0**0.5  # longest edge of a piece, in cells: halves of a square cell
MOST_PIECES = 5_000_000  # each takes some hundred bytes while they are measured
BESIDE = 0.125  # cells of the grid within which a surface beside another body counts as covered by it


@dataclass(frozen=True)
class Pieces:
    """Triangles that the surfaces of bodies are cut into."""

    corners: np.ndarray  # (n, 3, 3): local positions [m]
    # solid, facade: (n,) of int: row of the body, and of its facade among those of all bodies
    solid: np.ndarray
    facade: np.ndarray
    visible: np.ndarray  # (n,) of bool: above the ground

    def __getitem__(self, chosen: np.ndarray) -> "Pieces":
        return Pieces(*(values[chosen] for values in vars(self).values()))

    @property
    def centre(self) -> np.ndarray:
        """Centroids (n, 3) [m]."""
        return self.corners.mean(1)  # type: ignore[no-any-return]


def bisected(corners: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (m, 3, 3) with edges of ``longest`` [m] at most, and the row (m,) of the triangle that each is part of.

    The longest edge is halved again and again (Rivara 1984): areas add up exactly, and no angle gets smaller than half of the
    smallest one of its triangle. Raises StructureError if there would be more than :data:`MOST_PIECES`.
    """
    expected = 2.0 * float(normals_and_areas(corners)[1].sum()) / longest**2
    if expected > MOST_PIECES:
        told = f"its faces are cut into pieces of {longest:.3g} m, about {expected:.2g} of them, more than {MOST_PIECES:.2g}"
        raise StructureError(f"structures: {told}; use a larger simulation.cell_size")
    parent, done, parents = np.arange(len(corners)), [], []
    while len(corners):
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        long = lengths.max(1) > longest
        done.append(corners[~long])
        parents.append(parent[~long])
        first, rows = lengths[long].argmax(1), np.arange(long.sum())
        a, b, c = (corners[long][rows, (first + k) % 3] for k in range(3))
        middle = 0.5 * (a + b)
        corners = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
        parent = np.tile(parent[long], 2)
    return np.concatenate([*done, np.zeros((0, 3, 3))]), np.concatenate([*parents, np.zeros(0, int)]).astype(int)


def cut_pieces(solids: Sequence[Solid], terrain: Terrain, cell: float) -> tuple[Pieces, np.ndarray]:
    """Pieces of all bodies for a grid of ``cell`` [m], and triangles (n, 3, 3) of the surface of their union.

    Pieces that lie on or in another body are left out. The triangles are faces, or the pieces of faces that are partly covered.
    """
    pieces, surface, first = [], [], 0
    for row, solid in enumerate(solids):
        faces = solid.corners
        corners, parent = _cut_at_ground(faces, terrain, cell)
        visible = corners[..., 2].mean(1) > elevation_at(terrain, corners.mean(1))
        piece = Pieces(corners, np.full(len(corners), row), first + solid.facade[parent], visible)
        covered = _covered(piece, row, solids, cell)
        whole = np.bincount(parent[covered], minlength=len(faces)) == 0
        surface += [faces[whole], corners[~covered & ~whole[parent]]]
        pieces.append(piece[~covered])
        first += len(solid.facades)
    joined = [np.concatenate([vars(p)[name] for p in pieces]) for name in vars(pieces[0])]
    return Pieces(*joined), np.concatenate(surface)


def _cut_at_ground(corners: np.ndarray, terrain: Terrain, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Pieces and the faces that they are of, cut where the ground, linear within a piece, cuts them."""
    pieces, parent = bisected(corners, DIAGONAL * cell)
    height = pieces[..., 2] - elevation_at(terrain, pieces)
    above = height > 0
    cuts = (above.sum(1) % 3 != 0) & np.isfinite(height).all(1)
    alone = np.where(above[cuts].sum(1) == 1, above[cuts].argmax(1), above[cuts].argmin(1))  # the corner on the other side
    rows = np.arange(len(alone))
    (a, b, c), (h_a, h_b, h_c) = (
        [values[cuts][rows, (alone + k) % 3] for k in range(3)] for values in (pieces, height)
    )  # fmt: skip
    p, q = (a + (h_a / (h_a - h))[:, None] * (end - a) for end, h in ((b, h_b), (c, h_c)))
    parts = np.concatenate([np.stack(part, 1) for part in ((a, p, q), (p, b, c), (p, c, q))])
    has_area = normals_and_areas(parts)[1] > 0
    return np.concatenate([pieces[~cuts], parts[has_area]]), np.concatenate([parent[~cuts], np.tile(parent[cuts], 3)[has_area]])


def _covered(pieces: Pieces, row: int, solids: Sequence[Solid], cell: float) -> np.ndarray:
    """Whether each piece of a body lies on or in another one with its centre and its corners (n,)."""
    covered = np.zeros(len(pieces.corners), bool)
    normals, _ = normals_and_areas(pieces.corners)
    centre = pieces.corners.mean(1, keepdims=True)
    inner = np.concatenate([centre, centre + 0.98 * (pieces.corners - centre)], axis=1) + BESIDE * cell * normals[:, None, :]
    boxes, gap = np.stack([solid.box for solid in solids]), BESIDE * cell
    meets = (boxes[:, 0] <= boxes[row, 1] + gap).all(1) & (boxes[row, 0] <= boxes[:, 1] + gap).all(1)
    for other in np.flatnonzero(meets).tolist():
        if other != row:
            covered |= points_inside(inner.reshape(-1, 3), as_arrays(solids[other])).reshape(-1, 4).all(1)
    return covered
