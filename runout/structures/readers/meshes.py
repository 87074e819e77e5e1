"""Bodies from closed meshes: the parts of OBJ, PLY, STL and GLB files, in the place that site.yaml states for them.

A message on a mesh beyond the terrain names other units, offsets or coordinate systems with which it would lie on it.

What is wrong with a mesh is stated with its place: holes, edges of three faces, faces without area, faces that cross.
"""

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from runout.errors import InputError, ReleaseError, StructureError
from runout.io import crs as coordinate_systems
from runout.io.layer_crs import to_terrain
from runout.io.mesh_files import DECIMALS, MESHES, MeshPart, edges_of, read_mesh
from runout.model.limits import checked
from runout.model.terrain import Terrain
from runout.structures.facades import face_pairs, mesh_facades
from runout.structures.readers import StructureReader
from runout.structures.solid import Solid, normals_and_areas
from runout.structures.source import Read, StructureSource

FLAT = 1e-9  # volume of the cube of its length, and area of the square of its edge, below which a body or a face is flat
CROSSED = 1e-6  # of the length of an edge, that lies on either side of a face that it crosses
SEARCH_SECONDS = 30.0  # that the faces of a file are searched for crossings
MOST_FACES = 4_000_000  # of a body whose faces are searched at all: the tree of so many takes several seconds
AT_ONCE, MOST_PAIRS = 4096, 2_000_000  # edges whose neighbours are looked up together, and neighbours that are aimed at
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048}
SINGLE = 2.0**-24  # relative rounding of coordinates in float32
COARSE = 0.05  # rounding of coordinates [m] that is reported
EARTH = 4.1e7  # circumference [m], beyond which no map has coordinates
LOCAL = 1e5  # coordinates [m] that may count from an origin of the mesh's own


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


def read_meshes(source: StructureSource, terrain: Terrain) -> Read:
    """Bodies of a mesh file, problems, and changes. Bodies that do not touch are structures of their own."""
    solids: list[Solid] = []
    problems: list[str] = []
    changes: list[str] = []
    if isinstance(source.clearance, str):
        problems.append(f"{source.path}: clearance is {source.clearance!r}; a mesh has no attributes, state a number")
    try:
        friction = np.tan(np.radians(checked("basal_friction_angle", source.friction_angle_deg, place=str(source.path))))
        parts = load_parts(source, changes)
        placed, sentences = on_terrain(np.concatenate([part.vertices for part in parts]), source, terrain)
        changes += sentences
        rounding = rounding_of(source, np.concatenate([part.vertices for part in parts]))
        cause = f" (single precision rounds its coordinates to {rounding:.2g} m: export it near the origin and state offset)"
        note = cause if rounding > COARSE else ""
        search, faults = Search(), []
        for part, vertices in zip(parts, np.split(placed, np.cumsum([len(part.vertices) for part in parts])[:-1]), strict=True):
            for solid in _bodies(vertices, part.faces, replace(source, name=part.name), float(friction)):
                own_faults = [fault + note for fault in mesh_faults(solid, terrain, 2.0 * rounding, search)]
                faults += own_faults
                solids += [] if own_faults else [_outward(solid, changes)]
        more = f" (and {len(faults) - 1} more of its bodies have faults)" if len(faults) > 1 else ""
        problems += [fault + more for fault in faults[:1]]
        changes += search.left
    except InputError as error:
        problems.append(str(error))
    return Read(tuple(solids), tuple(problems), tuple(dict.fromkeys(changes)))


def load_parts(source: StructureSource, changes: list[str]) -> list[MeshPart]:
    """Parts of a mesh file, in its units; those that are open are joined where they share vertices, as parts of one material.

    Faces without three corners are left out, which ``changes`` takes. Raises StructureError if the file is missing or holds no
    mesh.
    """
    whole_parts = []
    for part in (read.merged() for read in read_mesh(source.path, StructureError)):
        whole = (part.faces != np.roll(part.faces, 1, axis=1)).all(1)
        if not whole.all():
            count = f"{(~whole).sum()} face" + ("s" if (~whole).sum() > 1 else "")
            changes.append(f"{source.path}: {count} with two equal corners left out")
        if whole.any():
            whole_parts.append(replace(part, faces=part.faces[whole]))
    if not whole_parts:
        raise StructureError(f"{source.path}: holds no faces with an area; export the structure as a closed mesh of triangles")
    apart = [part for part in whole_parts if not part.is_closed]
    bodies = [part for part in whole_parts if part.is_closed] + ([_joined(apart)] if apart else [])
    own = source.name != "structure" or len(bodies) == 1
    return [replace(part, name=source.name if own or part.name.startswith(source.path.name) else part.name) for part in bodies]


def _joined(parts: list[MeshPart]) -> MeshPart:
    """Parts as one, with the name of the largest; vertices that lie in one place are one."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)])
    name = max(parts, key=lambda part: len(part.faces)).name
    return MeshPart(name, np.concatenate([part.vertices for part in parts]), faces).merged()


def _bodies(vertices: np.ndarray, faces: np.ndarray, source: StructureSource, friction: float) -> Iterator[Solid]:
    """Each connected part of a mesh as a body with one facade; a cavity goes with the body around it."""
    homes = _homes(vertices, faces)
    clearance = source.clearance if isinstance(source.clearance, int | float) else None
    for number, home in enumerate(np.unique(homes), 1):
        used, rows = np.unique(faces[homes == home], return_inverse=True)
        place = f"{source.path}: body {source.name!r}" + (f" {number}" if len(np.unique(homes)) > 1 else "")
        triangles = rows.reshape(-1, 3)
        yield Solid(source.name, vertices[used], triangles, np.zeros(len(triangles), int), ("surface",), friction, place, clearance)


def _homes(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Number of the body that each face (f,) belongs to."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = face_pairs(faces)
    joined = coo_array((np.ones(len(pairs)), tuple(pairs.T)), (len(faces),) * 2)
    count, part = connected_components(joined, directed=False)
    parts = [faces[part == k] for k in range(count)]
    boxes = [(vertices[one].min((0, 1)), vertices[one].max((0, 1))) for one in parts]
    volumes = [volume(vertices, one) for one in parts]
    homes = list(range(count))
    for cavity in (k for k in homes if volumes[k] < 0):
        (low, high) = boxes[cavity]
        around = [k for k in range(count) if volumes[k] > 0 and (boxes[k][0] < low).all() and (high < boxes[k][1]).all()]
        homes[cavity] = around[0] if around else cavity
    return np.array(homes)[part]  # type: ignore[no-any-return]


def _outward(solid: Solid, changes: list[str]) -> Solid:
    """The body with its faces turned outwards, and with facades."""
    inward = volume(solid.vertices, solid.faces) < 0
    if inward:
        changes.append(f"{solid.place}: its faces are turned outwards")
    faces = solid.faces[:, ::-1] if inward else solid.faces
    facade, facades = mesh_facades(solid.vertices, faces)
    return replace(solid, faces=faces, facade=facade, facades=facades)


def rounding_of(source: StructureSource, vertices: np.ndarray) -> float:
    """Rounding [m] of vertices (v, 3) in the units of a file that holds them in single precision; 0 for another file."""
    with np.errstate(over="ignore"):
        apart = np.abs(vertices - vertices.astype(np.float32))
    single = source.path.suffix.lower() != ".obj" and bool((apart <= 0.1**DECIMALS).all())
    whole = source.path.suffix.lower() == ".ply" and bool((vertices == np.round(vertices)).all())  # maybe in double precision
    return SINGLE * float(np.abs(vertices).max()) * UNITS[source.units or "m"] if single and not whole else 0.0


def on_terrain(vertices: np.ndarray, source: StructureSource, terrain: Terrain) -> tuple[np.ndarray, list[str]]:
    """Local positions [m] of the vertices of a file, and what was assumed.

    Raises StructureError if no units are stated, or all vertices lie beyond the terrain. Raises InputError if the coordinate system
    is not understood.
    """
    path = source.path
    if source.units not in UNITS:
        raise StructureError(f"{path}: units is {source.units!r}; state the units of the mesh: {', '.join(UNITS)}")
    metres, notes = vertices * UNITS[source.units], []
    rounding = rounding_of(source, vertices)
    if rounding > COARSE:
        notes.append(
            f"{path}: its coordinates of up to {np.abs(metres).max():.3g} m are rounded to {rounding:.2g} m by single precision; "
            "export it near the origin and state offset"
        )
    if source.crs is not None:
        coordinate_systems.parse(source.crs, str(path))  # named as an option here, not as that of the file
    placed, sentences = _moved(metres + np.asarray(source.offset), source, source.crs or terrain.crs, terrain)
    if not _meets(placed, terrain):
        raise StructureError(f"{path}: {_beyond(placed, terrain)}; {_remedy(vertices, source, terrain)}")
    lost = np.abs(placed).max(1) > EARTH
    if lost.any():
        x, y, z = placed[lost.argmax()]
        remedy = "remove what is there, or check units and offset of the mesh"
        where = f"the first at easting {x:.8g}, northing {y:.8g}, elevation {z:.8g}"
        raise StructureError(f"{path}: {lost.sum()} of {len(placed)} vertices lie beyond the Earth, {where}; {remedy}")
    notes += [] if source.crs else [f"{path}: states no crs; its coordinates are taken as the terrain's"]
    return terrain.frame.to_local(placed), [*notes, *(sentences if source.crs else ())]


def _moved(points: np.ndarray, source: StructureSource, crs: str | None, terrain: Terrain) -> tuple[np.ndarray, tuple[str, ...]]:
    """Map positions (v, 3) of points of a coordinate system, and what was assumed."""
    bounds = [*points.min(0)[:2], *points.max(0)[:2]]
    change = to_terrain(source.path, crs, terrain, bounds, "trimesh")
    if change.forward is None:
        return points, change.sentences
    return np.column_stack([change.forward(points[:, :2]), points[:, 2]]), change.sentences


def _meets(placed: np.ndarray, terrain: Terrain) -> bool:
    """Whether the box around map positions meets the terrain."""
    west, south, east, north = terrain.extent
    (x0, y0), (x1, y1) = placed[:, :2].min(0), placed[:, :2].max(0)
    return bool(x0 <= east and x1 >= west and y0 <= north and y1 >= south)


def _beyond(placed: np.ndarray, terrain: Terrain) -> str:
    low, high = placed.min(0), placed.max(0)
    west, south, east, north = terrain.extent
    return (
        f"lies beyond the terrain {terrain.source}, at easting {low[0]:.8g} to {high[0]:.8g}, northing {low[1]:.8g} to "
        f"{high[1]:.8g}; the terrain has easting {west:.8g} to {east:.8g}, northing {south:.8g} to {north:.8g}"
    )


def _remedy(vertices: np.ndarray, source: StructureSource, terrain: Terrain) -> str:
    """What would place the mesh on the terrain."""
    for remedy, placed in _elsewhere(vertices, source, terrain):
        if np.isfinite(placed).all() and _meets(placed, terrain):
            return remedy
    assert source.units is not None  # else it was refused
    if np.abs(vertices).max() * UNITS[source.units] < LOCAL and not any(source.offset):
        return "its coordinates count from an origin of its own: state offset, [easting, northing, elevation] of that origin"
    return "check units, offset and crs of the mesh"


def _elsewhere(vertices: np.ndarray, source: StructureSource, terrain: Terrain) -> Iterator[tuple[str, np.ndarray]]:
    """Common mistakes: the remedy, and the map positions with it."""
    offset, scale = np.asarray(source.offset), UNITS[source.units or "m"]
    if any(source.offset):
        yield "it lies there without offset: remove offset", scale * vertices
    for units, factor in UNITS.items():
        yield f"its coordinates fit with units: {units}", factor * vertices + offset
    yield "its coordinates fit in kilometres: export it in metres", 1000.0 * vertices + offset
    metres = scale * vertices
    yield "easting and northing are swapped: export it with x to the east", metres[:, [1, 0, 2]] + offset
    glb = source.path.suffix.lower() == ".glb"
    for sign in (-1.0, 1.0):
        up = "z is up in it: export it with y up, as GLB files have it" if glb else "y is up in it: export it with z up"
        yield up, np.column_stack([metres[:, 0], sign * metres[:, 2], metres[:, 1]]) + offset
    if terrain.crs is not None and np.abs(vertices[:, 0]).max() <= 180.0 and np.abs(vertices[:, 1]).max() <= 90.0:
        try:
            yield "its coordinates are degrees: state crs, for example EPSG:4326", _moved(vertices, source, "EPSG:4326", terrain)[0]
        except ReleaseError:
            return


READER = StructureReader(
    "a mesh", MESHES, ("units", "crs", "offset"), read_meshes, lambda source: load_parts(source, []), has_units=True
)
