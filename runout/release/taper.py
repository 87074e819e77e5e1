"""Tapered releases: thickness and sliding surface of a mass from its outline and volume.

Each part of the outline has a bowl-shaped thickness, with constant curvature for a constant stated thickness, as in the sloping
local base level (Jaboyedoff et al. 2020, Eng. Geol. 267:105478). An excavated mass is cut at a surface that falls to
the rim as steeply as the volume allows: the mass lies on a plane that leads out of its scar, not in a pit.

The planes start at the outlets of the scar: lines that rise inwards from its rim.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from runout.errors import ReleaseError
from runout.io.polygon_coverage import covered_window
from runout.model.release import Release
from runout.model.terrain import Terrain
from runout.terrain.open_edge import filled

NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))  # rows, columns
FLATTEST = 1e-9  # slope that replaces 0, since edges of zero weight are absent from a sparse graph
LARGEST = 250_000  # cells; larger windows are averaged over blocks
FINEST, COARSEST = 96, 10  # nodes across a part
MOST_PARTS = 5000
NODES = 400_000  # of all parts together
SHEET = 30_000  # nodes of the lattices that are solved together
DEEPEST = 2.0  # largest depth of the bowl above the plane, relative to the bowl of the volume
SLOPES, FEW_SLOPES = 13, 5  # planes, from level to as steep as the ground; few where many parts have coarse lattices
THINNEST = 1e-3  # least thickness inside the outline, as a share of the mean
LEAST_CORE = 0.1  # share of a part that lies farther than one node from its outline
HALVINGS = 50  # share of the interval of planes, at round-off


def rising_from_rim(
    ground: np.ndarray, inside: np.ndarray, cell_size: tuple[float, float], slope: float | np.ndarray
) -> np.ndarray:
    """Lowest elevation (rows, columns) [m] from which ground that falls at ``slope`` [1] leads out of an area.

    For each cell of the area it is the least elevation of a cell beside the area plus ``slope`` times the length of the path from
    there inside the area, over the eight neighbours of each cell. Elsewhere it is the ground.

    Parameters
    ----------
    ground : ndarray (rows, columns)
        Elevation [m] around the area, without gaps.
    inside : ndarray (rows, columns) of bool
        The area; it does not touch the rim of the array.
    cell_size : tuple of float
        East and north [m].
    slope : float or ndarray (rows, columns)
        [1], 0 or more.
    """
    from scipy import sparse
    from scipy.sparse import csgraph

    first, second, length = _edges(ground.shape, cell_size)
    area, z = inside.ravel(), ground.ravel()
    slopes = np.broadcast_to(np.maximum(slope, FLATTEST), ground.shape).ravel()
    within = area[first] & area[second]
    crossing = area[first] != area[second]
    cell = np.where(area[first], first, second)[crossing]
    beside = np.where(area[first], second, first)[crossing]
    base, source = float(z.min()) - 1.0, z.size
    start = np.full(z.size, np.inf)
    np.minimum.at(start, cell, z[beside] + slopes[cell] * length[crossing] - base)
    rim = np.flatnonzero(np.isfinite(start))
    rows = np.concatenate((first[within], np.full(len(rim), source)))
    columns = np.concatenate((second[within], rim))
    weights = np.concatenate((slopes[first[within]] * length[within], start[rim]))
    graph = sparse.csr_array((weights, (rows, columns)), shape=(source + 1, source + 1))
    path = csgraph.dijkstra(graph, directed=False, indices=source)[:-1].reshape(ground.shape)
    return np.where(inside, path + base, ground)


def trapped_share(release: Release, angle: float) -> float:
    """Share [1] of a release that lies below the lines which rise from the rim of its scar at ``angle`` [rad].

    With the basal friction angle: mass that cannot slide out by itself on any path. With 0: mass below the lowest
    outlet.
    """
    thickness, excavation = release.thickness, release.excavation
    rows, columns = np.nonzero(thickness > 0)
    block = int(np.ceil(np.sqrt(np.ptp(rows) * np.ptp(columns) / LARGEST))) or 1
    window = tuple(
        np.clip(np.arange(places.min() - block, places.max() + 2 * block), 0, count - 1)
        for places, count in zip((rows, columns), thickness.shape, strict=True)
    )
    inside = thickness[np.ix_(*window)]
    inside[[0, -1]] = 0.0
    inside[:, [0, -1]] = 0.0
    ground = filled(release.terrain.elevation[np.ix_(*window)], release.terrain.cell_size)
    mass, dug = _blocks(inside, block), _blocks(ground - np.minimum(excavation[np.ix_(*window)], inside), block)
    cell = (block * release.terrain.cell_size[0], block * release.terrain.cell_size[1])
    line = rising_from_rim(dug, mass > 0, cell, float(np.tan(angle)))
    return float(np.clip(line - dug, 0.0, mass).sum() / mass.sum())


def _edges(shape: tuple[int, ...], cell_size: tuple[float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flat indices of neighbouring cells (n,), (n,) and their distance (n,) [m]."""
    cells = np.arange(shape[0] * shape[1]).reshape(shape)
    first, second, length = [], [], []
    for down, right in NEIGHBOURS:
        here = cells[: shape[0] - down, max(0, -right) : shape[1] - max(0, right)]
        there = cells[down:, max(0, right) : shape[1] + min(0, right)]
        first.append(here.ravel())
        second.append(there.ravel())
        length.append(np.full(here.size, np.hypot(down * cell_size[1], right * cell_size[0])))
    return np.concatenate(first), np.concatenate(second), np.concatenate(length)


def _blocks(values: np.ndarray, count: int) -> np.ndarray:
    """Means over blocks of ``count`` by ``count`` cells; incomplete blocks are filled with the last cells."""
    if count == 1:
        return values
    padded = np.pad(values, [(0, -size % count) for size in values.shape], mode="edge")
    rows, columns = (size // count for size in padded.shape)
    return padded.reshape(rows, count, columns, count).mean(axis=(1, 3))


@dataclass(frozen=True)
class Part:
    """One connected part of a tapered release on its own square lattice."""

    window: tuple[slice, slice]  # rows and columns of the terrain that hold it
    covered: np.ndarray  # (rows, columns): area of each of these cells inside the outline [m2]
    volume: float  # [m3]
    bowl: np.ndarray  # (n,): thickness [m] at the nodes
    # (m, n): thickness [m] above surfaces that fall to the rim, level first; None for a mass on the ground
    planes: np.ndarray | None
    # scipy sparse array (rows * columns, n): contribution of each node to the volume of each cell of the window, per thickness [m2]
    cells: Any

    def volumes(self, factor: float) -> np.ndarray:
        """Volume (rows, columns) [m3] in each cell of the window, for ``factor`` times the volume; their sum is exact."""
        wanted = factor * self.volume
        cell_volumes = np.asarray(self.cells @ self._thickness(factor)).reshape(self.covered.shape)
        cell_volumes = np.where(
            self.covered > 0, np.maximum(cell_volumes, self.covered * (THINNEST * wanted / self.covered.sum())), 0.0
        )
        return cell_volumes * (wanted / cell_volumes.sum())

    def _thickness(self, factor: float) -> np.ndarray:
        """Thickness (n,) [m] at the nodes: the deeper bowl, cut at the plane for which the volume is right."""
        bowl = factor * self.bowl
        if self.planes is None:
            return bowl
        size = self.cells.sum(axis=0)
        wanted, deep = float(bowl @ size), DEEPEST * bowl
        level = np.minimum(deep, self.planes[0])
        level_volume = float(level @ size)
        if level_volume <= wanted:  # the volume does not fit above a level floor: the rest is excavated below the outlet
            return level + (deep - level) * (wanted - level_volume) / (DEEPEST * wanted - level_volume)
        low, high = 0.0, len(self.planes) - 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            below = min(int(middle), len(self.planes) - 2)
            plane = (below + 1 - middle) * self.planes[below] + (middle - below) * self.planes[below + 1]
            thickness = np.minimum(deep, plane)
            low, high = (middle, high) if float(thickness @ size) > wanted else (low, middle)
        return thickness


@dataclass(frozen=True)
class TaperedMass:
    """A mass that thins out to its rim and can be scaled within its outline.

    A smaller mass has its own sliding surface; a larger one has the shape of the stated one, thicker in proportion.
    """

    parts: tuple[Part, ...]
    terrain: Terrain
    factor: float = 1.0  # volume relative to that of the parts

    def scaled(self, factor: float) -> "TaperedMass":
        """Mass with the same outline and ``factor`` times the volume."""
        return replace(self, factor=self.factor * factor)

    def thickness(self) -> np.ndarray:
        """Mean thickness (rows, columns) [m] over the cells of the terrain; its volume is exact."""
        volume = np.zeros(self.terrain.shape)
        for part in self.parts:
            volume[part.window] += part.volumes(min(self.factor, 1.0))
        return volume * (max(self.factor, 1.0) / self.terrain.cell_area)


def tapered(polygons: np.ndarray, depths: np.ndarray, outline: Any, terrain: Terrain, *, excavated: bool) -> TaperedMass:
    """Mass that thins out to its outline.

    Parts too narrow for a lattice of :data:`FINEST` nodes keep a vertical edge.

    Parameters
    ----------
    polygons, depths : ndarray (n,)
        Polygons that do not overlap, and the mean thickness [m] of each; of those that touch it is smoothed into one another.
    outline : shapely geometry
        Of all of them, in map coordinates.
    excavated : bool
        Whether the mass is part of the ground, so that its lower side is the sliding surface.
    """
    import shapely

    pieces = shapely.get_parts(outline)
    pieces = pieces[shapely.area(pieces) > 0]
    finest = int(np.clip(np.sqrt(NODES / len(pieces)), COARSEST, FINEST))
    tree = shapely.STRtree(polygons)
    outlined = [_outlined(piece, tree, polygons, depths, terrain, finest) for piece in pieces]
    shaped = [one for one in outlined if one.lattice is not None]
    ground = filled(terrain.elevation, terrain.cell_size) if excavated else None
    count = SLOPES if finest == FINEST else FEW_SLOPES
    parts = [_with_vertical_edge(one) for one in outlined if one.lattice is None]
    for group in _groups(shaped):
        parts += _shaped(group, terrain, ground, count)
    return TaperedMass(tuple(parts), terrain)


@dataclass(frozen=True)
class _Outlined:
    """One connected part before it is shaped: cells as in :class:`Part`; lattice and stated thickness if it is tapered."""

    window: tuple[slice, slice]
    covered: np.ndarray
    volume: float
    lattice: "_Lattice | None"
    depth: np.ndarray  # (ny, nx) stated thickness [m] at the nodes of the lattice


def _outlined(piece: Any, tree: Any, polygons: np.ndarray, depths: np.ndarray, terrain: Terrain, finest: int) -> _Outlined:
    import shapely

    own = tree.query(piece, predicate="intersects")
    (rows, columns), (dx, dy) = terrain.shape, terrain.cell_size
    local = shapely.transform(piece, terrain.frame.to_local)
    (x, y), area = covered_window(local, (np.arange(columns + 1) * dx, np.arange(rows + 1) * dy))
    window, covered = (slice(rows - y.stop, rows - y.start), x), np.ascontiguousarray(area.T[::-1])
    common = shapely.area(shapely.intersection(polygons[own], piece)) if len(own) > 1 else piece.area  # slow for many points
    volume = float(np.sum(depths[own] * common))
    lattice = _Lattice.over(piece, terrain, finest)
    if not lattice.resolves(piece):
        return _Outlined(window, covered, volume, None, np.zeros((0, 0)))
    return _Outlined(window, covered, volume, lattice, lattice.stated(polygons[own], depths[own]))


def _with_vertical_edge(one: _Outlined) -> Part:
    from scipy import sparse

    return Part(one.window, one.covered, one.volume, np.ones(1), None, sparse.csr_array(one.covered.reshape(-1, 1)))


def _groups(outlined: list[_Outlined]) -> Iterator[list[_Outlined]]:
    """Groups of parts whose lattices fit into one sheet of :data:`SHEET` nodes, which is solved about as fast as one such part."""
    group: list[_Outlined] = []
    for one in outlined:
        rows, columns = zip(*(other.depth.shape for other in (*group, one)), strict=True)
        if group and sum(rows) * max(columns) > SHEET:
            yield group
            group = []
        group.append(one)
    if group:
        yield group


def _shaped(group: list[_Outlined], terrain: Terrain, ground: np.ndarray | None, count: int) -> Iterator[Part]:
    """Parts of a group. Their lattices are stacked in one sheet and separated by the nodes around each."""
    lattices = [one.lattice for one in group if one.lattice is not None]
    inside = _stacked([lattice.inside for lattice in lattices])
    ends = np.cumsum([int(lattice.inside.sum()) for lattice in lattices])[:-1]
    bowls = np.split(_bowl(inside, _stacked([one.depth for one in group])), ends)
    planes: list[Any] = [None] * len(group)
    if ground is not None:
        natural = [_at(ground, terrain, *lattice.places) for lattice in lattices]
        planes = np.split(_planes(natural, lattices, inside, count), ends, axis=1)
    for one, lattice, bowl, above in zip(group, lattices, bowls, planes, strict=True):
        thickness = bowl * (one.volume / (bowl.sum() * lattice.size**2))
        yield Part(one.window, one.covered, one.volume, thickness, above, _to_cells(lattice, terrain, one.window))


def _stacked(arrays: list[np.ndarray]) -> np.ndarray:
    """Arrays (rows, columns) stacked by rows; last columns are repeated up to the width of the widest."""
    widest = max(array.shape[1] for array in arrays)
    return np.concatenate([np.pad(array, ((0, 0), (0, widest - array.shape[1])), mode="edge") for array in arrays])


@dataclass(frozen=True)
class _Lattice:
    """Square lattice over a polygon with one more node on each side; rows from the north."""

    x: np.ndarray  # (nx,) easting [m]
    y: np.ndarray  # (ny,) northing [m]
    size: float  # [m]
    inside: np.ndarray  # (ny, nx)

    @classmethod
    def over(cls, piece: Any, terrain: Terrain, finest: int) -> "_Lattice":
        """Lattice with two nodes per cell of the terrain, but at least ten and at most ``finest`` nodes across the polygon."""
        import shapely

        west, south, east, north = piece.bounds
        across = max(east - west, north - south)
        size = across / int(np.clip(np.ceil(2.0 * across / min(terrain.cell_size)), COARSEST, finest))
        x = west + (np.arange(-1, np.ceil((east - west) / size) + 1) + 0.5) * size
        y = north - (np.arange(-1, np.ceil((north - south) / size) + 1) + 0.5) * size
        shapely.prepare(piece)
        return cls(x, y, size, shapely.contains_xy(piece, *np.meshgrid(x, y)))

    def resolves(self, piece: Any) -> bool:
        """Whether a large enough share of a polygon lies more than one node from its outline."""
        core = piece.simplify(0.5 * self.size).buffer(-self.size)
        return bool(self.inside.any() and core.area > LEAST_CORE * piece.area)

    @property
    def places(self) -> tuple[np.ndarray, np.ndarray]:
        """Easting and northing (ny, nx) [m]."""
        x, y = np.meshgrid(self.x, self.y)
        return x, y

    def stated(self, polygons: np.ndarray, depths: np.ndarray) -> np.ndarray:
        """Thickness (ny, nx) [m] that polygons state at the nodes."""
        import shapely

        depth = np.full(self.inside.shape, depths.mean())
        for polygon, own in zip(polygons, depths, strict=True) if np.ptp(depths) > 0 else ():
            shapely.prepare(polygon)
            depth[shapely.contains_xy(polygon, *self.places)] = own
        return depth


def _bowl(inside: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Solution (n,) of the Poisson equation with a source, 0 outside."""
    from scipy import sparse
    from scipy.sparse.linalg import spsolve

    count = int(inside.sum())
    number = np.full(inside.shape, -1)
    number[inside] = np.arange(count)
    rows, columns = [], []
    for axis in (0, 1):
        one, other = (number.take(range(*span), axis).ravel() for span in ((0, inside.shape[axis] - 1), (1, inside.shape[axis])))
        both = (one >= 0) & (other >= 0)
        rows += [one[both], other[both]]
        columns += [other[both], one[both]]
    beside = np.concatenate(rows), np.concatenate(columns)
    coupling = sparse.csc_array((np.ones(len(beside[0])), beside), shape=(count, count))
    solution = np.asarray(spsolve(4.0 * sparse.eye_array(count, format="csc") - coupling, source[inside]))
    if not np.isfinite(solution).all() or solution.min() <= 0:
        raise ReleaseError("the outline is too intricate to be tapered; simplify it, or state edge: vertical")
    return solution


def _planes(ground: list[np.ndarray], lattices: list[_Lattice], inside: np.ndarray, count: int) -> np.ndarray:
    """Thickness (m, n) [m] above ``count`` surfaces that fall to the rim of each lattice, from level to as steep as its ground."""
    rises = []  # largest drop of the ground between nodes of each lattice [m]
    for z, lattice in zip(ground, lattices, strict=True):
        south, east = np.gradient(z, lattice.size)
        rises.append(max(float(np.hypot(south, east)[lattice.inside].max()), 1e-3) * lattice.size)
    natural, steepest = _stacked(ground), np.repeat(rises, [len(z) for z in ground])[:, None]
    surfaces = [rising_from_rim(natural, inside, (1.0, 1.0), share * steepest)[inside] for share in np.linspace(0.0, 1.0, count)]
    return np.maximum(natural[inside] - np.array(surfaces), 0.0)


def _at(values: np.ndarray, terrain: Terrain, easting: np.ndarray, northing: np.ndarray) -> np.ndarray:
    """Bilinear values of cells (rows, columns) at map coordinates; beyond the terrain, those of its rim."""
    from scipy import ndimage

    dx, dy = terrain.cell_size
    row, column = (terrain.northing[0] - northing) / dy, (easting - terrain.easting[0]) / dx
    return np.asarray(ndimage.map_coordinates(values, [row, column], order=1, mode="nearest"))


def _to_cells(lattice: _Lattice, terrain: Terrain, window: tuple[slice, slice]) -> Any:
    """Integrals [m2] over each cell of a window of the bilinear weights of nodes inside, as a sparse array (cells, n)."""
    from scipy import sparse

    (dx, dy), (rows, columns) = terrain.cell_size, window
    along = _integrals(lattice.x - (terrain.west + columns.start * dx), lattice.size, dx, columns.stop - columns.start)
    southern = terrain.south + (terrain.shape[0] - rows.stop) * dy
    across = _integrals(lattice.y - southern, lattice.size, dy, rows.stop - rows.start)[::-1]
    weights = sparse.kron(sparse.csr_array(across), sparse.csr_array(along), format="csc")
    row, column = np.nonzero(lattice.inside)
    return sparse.csr_array(weights[:, row * len(lattice.x) + column])


def _integrals(centre: np.ndarray, size: float, cell: float, count: int) -> np.ndarray:
    """Integrals (count, n) [m] over cells of the linear weights, of half width ``size`` [m], around centres."""
    place = np.clip((np.arange(count + 1)[:, None] * cell - centre) / size, -1.0, 1.0)
    return np.diff(size * np.where(place < 0, 0.5 * (1.0 + place) ** 2, 1.0 - 0.5 * (1.0 - place) ** 2), axis=0)
