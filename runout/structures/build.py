"""The signed distance field and the patches of structures for the grid of a run.

Forces are booked on patches: pieces of a facade in one grid cell, with the area from which contacts are booked on them.
"""

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from runout.errors import CapacityError
from runout.model.structures import CELLS, Patches, StructureField, Structures
from runout.model.terrain import Terrain
from runout.physics.structures import lattice_block, lattice_place
from runout.structures.lattice_distance import NODES, mark_inside, nearest_in_blocks
from runout.structures.pieces import BESIDE, Pieces, bisected, cut_pieces
from runout.structures.solid import Solid, as_arrays, discs_around, normals_and_areas
from runout.terrain.content_store import ContentStore, content_key

BAND = 3.0  # spacings of the grid that the distance is known for, outside and inside
PER_CELL = 2  # cells of the lattice in one of the grid
GROUP = 4  # blocks along an edge of a group that shares a list of triangles
MOST_BLOCKS = 250_000_000  # of the table of blocks, 1 GB
STORE = ContentStore[Structures](lambda structures: structures.field.nbytes)
SMALL = 0.5  # of the median of the areas of a facade, by area: smaller patches join a neighbour
FINE = 0.5  # longest edge of the parts that are measured, in cells of the lattice
ALIKE = 0.7071  # least cosine between the normals of a part and of its patch
CONTACT = 0.25  # distance of contacts from a surface, in cells of the grid
PORTION = 10_000  # pieces that are measured at once


def build_structures(solids: Sequence[Solid], terrain: Terrain, spacing: tuple[float, float, float]) -> Structures | None:
    """Structures for a grid of ``spacing`` [m]; None without bodies.

    The lattice has half the smallest spacing; one of its nodes lies at local position 0. The distance is exact at its nodes, that
    to the surface of the union of the bodies: walls between bodies that touch are none. Patches are what is above the ground. The
    last few that were made are kept (:mod:`runout.terrain.content_store`). Raises CapacityError if structures lie so far apart that
    the table of blocks does not fit into memory.
    """
    if not solids:
        return None
    names = repr([(s.name, s.facades, s.friction) for s in solids]).encode()
    arrays = [array for s in solids for array in (s.vertices, s.faces, s.facade)]
    key = content_key(np.frombuffer(names, np.uint8), terrain.elevation, np.array([*terrain.cell_size, *spacing]), *arrays)
    return STORE.get(key, lambda: _structures(solids, terrain, spacing))


def _structures(solids: Sequence[Solid], terrain: Terrain, spacing: tuple[float, float, float]) -> Structures:
    lattice, band = min(spacing) / PER_CELL, BAND * max(spacing)
    pieces, surface = cut_pieces(solids, terrain, min(spacing))
    patches = joined_patches(pieces, spacing, np.array([s.friction for s in solids]))
    first, blocks = _blocks_near(pieces, lattice, band)
    low = (first + blocks) * (CELLS * lattice)
    distance, nearest, foot = _nearest(low, lattice, blocks, surface)
    near = (distance < band).any((1, 2, 3))
    low, blocks, distance = low[near], blocks[near], distance[near]
    normals = normals_and_areas(surface)[0][nearest[near]]
    patch = nearest_patches(foot[near], normals, patches, max(spacing))
    inside = _inside(low, lattice, solids, distance, BESIDE * min(spacing))
    table = np.full(blocks.max(0) + 1, -1, np.int32)
    table[tuple(blocks.T)] = np.arange(len(blocks))
    signed = np.where(inside, -distance, distance).astype(np.float32)
    origin = tuple(float(x) for x in first * (CELLS * lattice))
    field = StructureField(lattice, origin, table, signed, patch, band, patches)  # type: ignore[arg-type]
    return _named(solids, measured_patches(field, pieces, spacing))


def _named(solids: Sequence[Solid], field: StructureField) -> Structures:
    """Names of structures and facades; facades without a patch, those in the ground, are left out."""
    owner = np.repeat(np.arange(len(solids)), [len(s.facades) for s in solids])
    names = [name for solid in solids for name in solid.facades]
    facades, row = np.unique(field.patches.facade, return_inverse=True)
    renumbered = replace(field, patches=replace(field.patches, facade=row.ravel()))
    return Structures(tuple(s.name for s in solids), tuple(names[k] for k in facades), owner[facades], renumbered)


def _blocks_near(pieces: Pieces, lattice: float, band: float) -> tuple[np.ndarray, np.ndarray]:
    """First block of the lattice (3,), and coordinates (n, 3) from there of the blocks that may lie within the band, in groups."""
    edge, discs = CELLS * lattice, discs_around(pieces.corners)
    reach = discs[:, 3:4] + band
    low, high = (np.floor((discs[:, :3] + sign * reach) / edge).astype(np.int64) for sign in (-1, 1))
    first = low.min(0)
    count = high.max(0) - first + 1
    if math.prod(count.tolist()) > MOST_BLOCKS:
        span = " x ".join(f"{n * edge:.4g}" for n in count)
        raise CapacityError(
            f"structures: they span {span} m, which is {math.prod(count.tolist()):.3g} blocks of {edge:.3g} m; "
            "leave out structures that the flow cannot reach, or use larger cells"
        )
    keys = np.unique(np.ravel_multi_index(tuple((low - first).T), count))  # type: ignore[call-overload]
    steps = (high - low).max(0) + 1
    for step in np.ndindex(*steps.tolist()):
        at = low + np.array(step)
        fits = (at <= high).all(1)
        keys = np.union1d(keys, np.ravel_multi_index(tuple((at[fits] - first).T), count))  # type: ignore[call-overload]
    blocks = np.stack(np.unravel_index(keys, count), axis=1)
    away, _ = cKDTree(discs[:, :3]).query((first + blocks + 0.5) * edge)
    blocks = blocks[away <= band + discs[:, 3].max() + 0.5 * edge * math.sqrt(3.0)]
    return first, blocks[np.lexsort((blocks // GROUP).T)]


def _nearest(low: np.ndarray, lattice: float, blocks: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance [m] to the nearest triangle, its row, and its nearest point at the nodes of blocks (n, 9, 9, 9)."""
    nodes = len(low), *(NODES,) * 3
    distance, index, foot = np.empty(nodes), np.empty(nodes, np.int32), np.empty((*nodes, 3))
    change = np.flatnonzero((np.diff(blocks // GROUP, axis=0) != 0).any(1)) + 1
    groups = np.stack([np.concatenate([[0], change]), np.concatenate([change, [len(low)]])], axis=1)
    discs = discs_around(corners)
    _in_threads(lambda part: nearest_in_blocks(part, low, lattice, corners, discs, distance, index, foot), groups)
    return distance, index, foot


def _inside(low: np.ndarray, lattice: float, solids: Sequence[Solid], distance: np.ndarray, gap: float) -> np.ndarray:
    """Whether the nodes of blocks lie in a body, or in a ``gap`` [m] between bodies (n, 9, 9, 9)."""
    inside, high = np.zeros(distance.shape, bool), low + CELLS * lattice
    for solid in solids:
        body = as_arrays(solid, gap)
        rows = np.flatnonzero((high >= body[-1][0]).all(1) & (low <= body[-1][1]).all(1))
        _in_threads(lambda part, body=body: mark_inside(part, low, lattice, body, distance, gap, inside), rows)  # type: ignore[misc]
    return inside


def _in_threads(work: Callable[[np.ndarray], None], rows: np.ndarray) -> None:
    """Call a kernel for parts of some rows in threads; each part writes to places of its own."""
    count = min(len(rows), os.process_cpu_count() if hasattr(os, "process_cpu_count") else len(os.sched_getaffinity(0)))
    if count <= 1:
        if len(rows):
            work(rows)
        return
    with ThreadPoolExecutor(count) as threads:
        list(threads.map(work, (rows[k::count] for k in range(count))))


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
    remaining, row = np.unique(joins, return_inverse=True)
    joined = np.zeros((len(remaining), 7))
    np.add.at(joined, row.ravel(), sums)
    merged = Patches(
        joined[:, 1:4] / joined[:, :1], _unit(joined[:, 4:], patches.normal[remaining]), joined[:, 0], patches.facade[remaining],
        patches.friction[remaining],
    )  # fmt: skip
    return replace(field, patches=merged, patch=row.ravel().astype(np.int32)[field.patch])


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
    neighbours, places = np.arange(len(patches.area)), _places(patches, length)
    order = np.argsort(patches.facade, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(patches.facade[order])) + 1):
        area = np.sort(patches.area[rows])
        median = area[np.searchsorted(np.cumsum(area), 0.5 * area.sum())]
        small = patches.area[rows] < SMALL * median
        if small.any():
            large = rows[~small]
            neighbours[rows[small]] = large[cKDTree(places[large]).query(places[rows[small]])[1]]
    return neighbours


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
