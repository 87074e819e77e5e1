"""What is wrong with structures on a terrain, for a grid: floating, buried, thinner than two cells, in a release."""

from collections.abc import Iterator, Sequence

import numpy as np

from runout.model.release import Release
from runout.model.terrain import Terrain
from runout.structures.ground import elevation_at
from runout.structures.pieces import bisected
from runout.structures.solid import Solid, normals_and_areas

FEWEST_CELLS = 2.0  # of the grid through a wall
OPPOSITE = -0.8  # cosine of the angle between the two sides of a wall
NEAR_CORNER = 0.95  # of the way from the middle of a triangle to its highest corner
ON_EDGE = 1e-6  # of a triangle, beyond which a line misses it
ROUNDING = 0.01  # share of a thickness or height that drawing and projection may take
FEW, ROWS = 4000, 256  # pieces that are all measured; pieces whose surroundings are looked at together
HIGHEST, DEEPEST = 2000.0, 10_000.0  # that a structure may reach above and below the ground [m]
SAME = 4  # decimals of positions [m] that agree in equal bodies
LOW = (
    "is {height:.3g} m high, less than one cell of {cell:.3g} m; whether the flow overtops it, and its force, are not resolved: "
    "use a cell size of half its height or less"
)
APART = 0.25  # cells of the grid between a structure and what bears it


def placement_problems(solids: Sequence[Solid], terrain: Terrain) -> list[str]:
    """Structures beyond the terrain, in the air or in the ground."""
    heights = [_heights(solid, terrain) for solid in solids]
    tolerance = APART * min(terrain.cell_size)
    standing = [bool(np.nanmin(h, initial=np.inf) <= tolerance) for h in heights]
    for _ in solids:  # what stands bears what it touches
        borne = [s or any(t and a.meets(b, tolerance) for b, t in zip(solids, standing, strict=True)) for a, s in
                 zip(solids, standing, strict=True)]  # fmt: skip
        if borne == standing:
            break
        standing = borne
    problems: list[str] = []
    for solid, height, stands in zip(solids, heights, standing, strict=True):
        problems += _placed(solid, height, stands, terrain)
    return problems


def repeated_bodies(solids: Sequence[Solid]) -> list[str]:
    """Structures that are the same body as another before them."""
    known: dict[bytes, str] = {}
    problems = []
    for solid in solids:
        corners = np.round(solid.corners.reshape(-1, 3), SAME) + 0.0
        key = corners[np.lexsort(corners.T)].tobytes()
        if key in known:
            problems.append(f"{solid.place}: is the same body as {known[key]}; remove one of the two")
        known.setdefault(key, solid.place)
    return problems


def _heights(solid: Solid, terrain: Terrain) -> np.ndarray:
    """Heights above ground [m] of points all over a body, NaN beyond the terrain."""
    pieces, _ = bisected(solid.corners, max(2 * min(terrain.cell_size), float(np.ptp(solid.box, axis=0).max()) / 64))
    points = pieces.reshape(-1, 3)
    return points[:, 2] - elevation_at(terrain, points)  # type: ignore[no-any-return]


def _placed(solid: Solid, height: np.ndarray, stands: bool, terrain: Terrain) -> Iterator[str]:
    at = _map_place(solid.box.mean(0), terrain)
    if np.isnan(height).any():
        beyond = "wholly" if np.isnan(height).all() else "partly"
        where = f"lies {beyond} beyond the terrain {terrain.source} or its known cells, {at}"
        yield f"{solid.place}: {where}; move it, or use a larger DEM"
    elif height.max() > HIGHEST or height.min() < -DEEPEST:
        above, limit = (height.max(), HIGHEST) if height.max() > HIGHEST else (height.min(), DEEPEST)
        reach = f"reaches {abs(above):.4g} m {'above' if above > 0 else 'below'} the ground, {at}"
        yield f"{solid.place}: {reach}, and may reach {limit:.0f} m; check its elevation, units, offset and base"
    elif height.max() <= 0:
        yield f"{solid.place}: is buried, its top lies {-height.max():.3g} m below the ground, {at}; raise it, or remove it"
    elif solid.clearance is None and not stands:
        yield f"{solid.place}: floats {height.min():.3g} m above the ground, {at}; lower it, or state clearance if it hangs"


def thin_walls(solids: Sequence[Solid], terrain: Terrain, spacing: Sequence[float]) -> list[str]:
    """Structures with a wall, roof or slab above ground that is thinner than two cells of the grid."""
    problems = []
    for solid in solids:
        thickness, centres, cells = wall_thickness(solid, terrain, spacing)
        if not (thin := thickness < FEWEST_CELLS * cells * (1 - ROUNDING)).any():
            continue
        least = np.argmin(np.where(thin, thickness / cells, np.inf))
        finer = thickness[least] / FEWEST_CELLS * min(1.0, min(spacing) / cells[least])
        problems.append(
            f"{solid.place}: a wall is {thickness[least]:.3g} m thick, less than two cells of {cells[least]:.3g} m, "
            f"{_map_place(centres[least], terrain)}; material would pass through it: draw it thicker, or set "
            f"simulation.cell_size to {finer:.2g} or less"
        )
    return problems


def wall_thickness(solid: Solid, terrain: Terrain, spacing: Sequence[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Thickness [m] of the walls behind pieces of a body above ground, their centres (n, 3) [m], and the spacing across [m].

    The thickness is the way inwards to a surface that faces the other way; edges of a body that runs out have none (inf). A way
    that ends on or in the ground has none either: behind it is ground, and nothing can pass.
    """
    from scipy.spatial import cKDTree

    pieces, _ = bisected(solid.corners, 2.0 * min(spacing))
    normals, areas = normals_and_areas(pieces)
    centres = _above_ground(pieces, terrain)
    across = np.linalg.norm(normals * np.asarray(spacing), axis=1)
    reach = FEWEST_CELLS * max(spacing)
    radius = np.linalg.norm(pieces - centres[:, None], axis=2).max()
    measured = _spread(centres, normals, areas, min(spacing))
    tree, thickness = cKDTree(centres), np.full(len(pieces), np.inf)
    for rows in np.array_split(measured, 1 + len(measured) // ROWS):
        half_way = cKDTree(centres[rows] - 0.5 * reach * normals[rows])
        near = half_way.sparse_distance_matrix(tree, 0.5 * reach + radius, output_type="ndarray")
        start, end = rows[near["i"]], near["j"]
        apart = np.einsum("ij,ij->i", normals[start], normals[end]) < OPPOSITE
        start, end = start[apart], end[apart]
        np.minimum.at(thickness, start, _way_to(centres[start], -normals[start], pieces[end]))
    thickness[_into_ground(solid, terrain, centres - np.minimum(thickness, HIGHEST)[:, None] * normals, normals)] = np.inf
    seen = measured[(centres[measured, 2] > elevation_at(terrain, centres[measured])) & (areas[measured] > 0)]
    return thickness[seen], centres[seen], across[seen]


def _above_ground(pieces: np.ndarray, terrain: Terrain) -> np.ndarray:
    """A place (n, 3) in each triangle: its middle, or if that lies in the ground and a corner does not, near the highest corner."""
    middle = pieces.mean(1)
    heights = pieces[..., 2] - elevation_at(terrain, pieces.reshape(-1, 3)).reshape(pieces.shape[:2])
    highest = heights.argmax(1)
    corner = np.take_along_axis(pieces, highest[:, None, None], axis=1)[:, 0]
    stands_out = (middle[:, 2] <= elevation_at(terrain, middle)) & (heights.max(1) > 0)
    return np.where(stands_out[:, None], (1 - NEAR_CORNER) * middle + NEAR_CORNER * corner, middle)


def _into_ground(solid: Solid, terrain: Terrain, ends: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Whether places (n, 3) [m] at the end of ways against ``normals`` lie in the ground, or under what stands on it."""
    tolerance = APART * min(terrain.cell_size) if solid.clearance is None else 0.0
    return ends[:, 2] - elevation_at(terrain, ends) <= tolerance * np.abs(normals[:, 2])  # type: ignore[no-any-return]


def low_structures(solids: Sequence[Solid], terrain: Terrain, spacing: Sequence[float]) -> list[str]:
    """Warnings of structures whose top stands less than one cell of the grid above the ground."""
    warnings = []
    for solid in solids:
        height = float(_heights(solid, terrain).max())
        if height < spacing[2] * (1 - ROUNDING):
            warnings.append(f"{solid.place}: the structure {solid.name!r} {LOW.format(height=height, cell=spacing[2])}")
    return warnings


def _spread(centres: np.ndarray, normals: np.ndarray, areas: np.ndarray, size: float) -> np.ndarray:
    """Rows of the pieces that are measured: of a fine mesh the largest that face the same way in each cube of ``size`` [m]."""
    if len(centres) <= FEW:
        return np.arange(len(centres))
    axis = np.abs(normals).argmax(1)
    facing = 2 * axis + (np.take_along_axis(normals, axis[:, None], 1)[:, 0] > 0)
    order = np.argsort(-areas, kind="stable")
    groups = np.column_stack([np.floor(centres / size).astype(np.int64), facing])[order]
    return np.sort(order[np.unique(groups, axis=0, return_index=True)[1]])


def _way_to(start: np.ndarray, direction: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Way (n,) along directions to triangles (n, 3, 3); inf where it misses them (Moeller & Trumbore 1997)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(direction, second)
    scale = (first * p).sum(1)
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = start - corners[:, 0]
        u = (offset * p).sum(1) / scale
        q = np.cross(offset, first)
        v = (direction * q).sum(1) / scale
        way = (second * q).sum(1) / scale
        beside = u + v
    hit = (u >= -ON_EDGE) & (v >= -ON_EDGE) & (beside <= 1 + ON_EDGE) & (way > 0)
    return np.where(hit, way, np.inf)


def release_overlaps(solids: Sequence[Solid], releases: Sequence[Release], inflows: Sequence[Release] = ()) -> list[str]:
    """Structures in the mass of a release, or in that which stands for an inflow at its line."""
    masses = [*(("release", release) for release in releases), *(("inflow", inflow) for inflow in inflows)]
    return [
        f"{solid.place}: the structure {solid.name!r} overlaps {kind} {mass.name} on {count} cells, "
        f"{_map_place(solid.box.mean(0), mass.terrain)}; move one of them, or cut the {kind} back"
        for solid in solids
        for kind, mass in masses
        if (count := _shared_cells(solid, mass))
    ]


def _shared_cells(solid: Solid, release: Release) -> int:
    """Cells whose middle has mass at the height of the body."""
    terrain = release.terrain
    rows, columns = np.nonzero(release.thickness > 0)
    x, y = (columns + 0.5) * terrain.cell_size[0], (terrain.shape[0] - rows - 0.5) * terrain.cell_size[1]
    low, high = solid.box
    within = (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])
    if not within.any():
        return 0
    span = vertical_span(solid, np.column_stack([x, y])[within])
    ground, thickness = (one[rows[within], columns[within]] for one in (terrain.elevation, release.thickness))
    top = ground + (release.heap[rows[within], columns[within]] if np.any(release.heap) else 0.0)
    return int(((span[:, 0] < top) & (span[:, 1] > top - thickness)).sum())


def vertical_span(solid: Solid, points: np.ndarray) -> np.ndarray:
    """Lowest and highest elevation (n, 2) [m] of a body over positions (n, 2); inf and -inf where it is not."""
    span = np.tile([np.inf, -np.inf], (len(points), 1))
    start = np.column_stack([points, np.full(len(points), solid.box[0, 2] - 1.0)])
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    for corners in solid.corners:
        way = _way_to(start, up, np.broadcast_to(corners, (len(points), 3, 3)))
        hit = np.isfinite(way)
        z = start[hit, 2] + way[hit]
        span[hit, 0], span[hit, 1] = np.minimum(span[hit, 0], z), np.maximum(span[hit, 1], z)
    return span


def _map_place(point: np.ndarray, terrain: Terrain) -> str:
    x, y = terrain.frame.to_map(point)[:2]
    return f"at easting {x:.1f}, northing {y:.1f}"
