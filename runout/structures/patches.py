"""Patches that forces are booked on: pieces of a facade in one grid cell, with the area from which contacts are booked on them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from runout.model.structures import CELLS, Patches, StructureField
from runout.physics.structures import lattice_block, lattice_place
from runout.structures.lattice_distance import NODES
from runout.structures.pieces import Pieces, bisected
from runout.structures.solid import normals_and_areas

SMALL = 0.5  # of the median of the areas of a facade, by area: smaller patches join a neighbour
FINE = 0.5  # longest edge of the parts that are measured, in cells of the lattice
ALIKE = 0.7071  # least cosine between the normals of a part and of its patch
CONTACT = 0.25  # distance of contacts from a surface, in cells of the grid
PORTION = 10_000  # pieces that are measured at once


def joined_patches(pieces: Pieces, spacing: Sequence[float], frictions: np.ndarray) -> Patches:
    """Patches of the visible pieces, those of one facade in one grid cell that face the same way along the axes together.

    ``frictions`` (solids,) are the Coulomb coefficients of the bodies; areas of patches are those of their pieces.
    """
    seen = pieces[pieces.visible]
    cells = np.floor(seen.centre / np.asarray(spacing)).astype(np.int64)
    normals, areas = normals_and_areas(seen.corners)
    axis = np.abs(normals).argmax(1)
    facing = 2 * axis + (np.take_along_axis(normals, axis[:, None], 1)[:, 0] > 0)
    _, first, patch = np.unique(np.column_stack([seen.facade, facing, cells]), axis=0, return_index=True, return_inverse=True)
    patch = patch.ravel()
    area = np.bincount(patch, areas, len(first))
    centre, normal = (_sums(patch, areas[:, None] * values, len(first)) for values in (seen.centre, normals))
    return Patches(centre / area[:, None], _unit(normal, normals[first]), area, seen.facade[first], frictions[seen.solid[first]])


def nearest_patches(foot: np.ndarray, normal: np.ndarray, patches: Patches, length: float) -> np.ndarray:
    """Patch nearest to points on the surface among those that face the same way: a turn counts as much as ``length`` [m]."""
    faced = cKDTree(_places(patches, length))
    points = np.concatenate([foot, length * normal], axis=-1)
    return faced.query(points.reshape(-1, 6), workers=-1)[1].reshape(points.shape[:-1]).astype(np.int32)  # type: ignore[no-any-return]


def measured_patches(field: StructureField, pieces: Pieces, spacing: Sequence[float]) -> StructureField:
    """The field with patches as contacts see them: areas are those from which contacts are booked on each.

    Contacts are booked by nodes of the lattice, whose patches end elsewhere than the pieces do. Patches that are smaller than half
    of the others of their facade join the nearest of these: cut at the edge of a facade, they would take the load of few particles
    on hardly any area. The area of each facade stays.
    """
    seen, patches = pieces[pieces.visible], field.patches
    sums = np.zeros((len(patches.area), 7))
    for first in range(0, len(seen.corners), PORTION):
        _measure(seen[np.arange(first, min(first + PORTION, len(seen.corners)))], field, spacing, sums)
    joins = _neighbours(replace(patches, area=sums[:, 0]), max(spacing))
    kept, row = np.unique(joins, return_inverse=True)
    joined = np.zeros((len(kept), 7))
    np.add.at(joined, row.ravel(), sums)
    made = Patches(
        joined[:, 1:4] / joined[:, :1], _unit(joined[:, 4:], patches.normal[kept]), joined[:, 0], patches.facade[kept],
        patches.friction[kept],
    )  # fmt: skip
    return replace(field, patches=made, patch=row.ravel().astype(np.int32)[field.patch])


def _measure(pieces: Pieces, field: StructureField, spacing: Sequence[float], sums: np.ndarray) -> None:
    """Add area [m2], and centre and normal times area, of parts of pieces to the ``sums`` (patches, 7) of their patches."""
    corners, parent = bisected(pieces.corners, FINE * field.spacing)
    normals, areas = normals_and_areas(corners)
    centre, facade, patches = corners.mean(1), pieces.facade[parent], field.patches
    patch = _patch_at(field, centre + CONTACT * min(spacing) * normals)
    strays = (patches.facade[patch] != facade) | ((patches.normal[patch] * normals).sum(1) < ALIKE)  # beside an edge
    for k in np.unique(facade[strays]):
        rows, own = np.flatnonzero(strays & (facade == k)), np.flatnonzero(patches.facade == k)
        places = np.column_stack([centre[rows], max(spacing) * normals[rows]])
        patch[rows] = own[cKDTree(_places(patches, max(spacing))[own]).query(places)[1]]
    np.add.at(sums, patch, areas[:, None] * np.column_stack([np.ones(len(areas)), centre, normals]))


def _patch_at(field: StructureField, points: np.ndarray) -> np.ndarray:
    """Patch of the node of the lattice nearest to points (n, 3) within the band."""
    node = np.floor((points - field.origin) / field.spacing + 0.5).astype(np.int64)
    cell = np.clip(node, 0, CELLS * np.array(field.blocks.shape) - 1)
    row, inner = field.blocks[tuple(lattice_block(cell).T)], lattice_place(*cell.T)
    return field.patch.reshape(len(field.patch), NODES**3)[row, inner]  # type: ignore[no-any-return]


def _neighbours(patches: Patches, length: float) -> np.ndarray:
    """The patch that each one joins: itself, or the nearest that is not small of its facade."""
    found, places = np.arange(len(patches.area)), _places(patches, length)
    order = np.argsort(patches.facade, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(patches.facade[order])) + 1):
        area = np.sort(patches.area[rows])
        median = area[np.searchsorted(np.cumsum(area), 0.5 * area.sum())]
        small = patches.area[rows] < SMALL * median
        if small.any():
            large = rows[~small]
            found[rows[small]] = large[cKDTree(places[large]).query(places[rows[small]])[1]]
    return found


def _places(patches: Patches, length: float) -> np.ndarray:
    """Centres and normals (p, 6), as :func:`nearest_patches` compares them."""
    return np.concatenate([patches.centre, length * patches.normal], axis=1)


def _unit(vectors: np.ndarray, instead: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 3); others in the place of those that vanish."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1.0), instead)  # type: ignore[no-any-return]


def _sums(rows: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Sums (count, 3) of values (n, 3) by their rows (n,)."""
    return np.stack([np.bincount(rows, values[:, k], count) for k in range(3)], axis=1)
