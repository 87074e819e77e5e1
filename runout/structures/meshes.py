"""Bodies from meshes: OBJ, PLY, STL and GLB files through trimesh."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from runout.errors import InputError, StructureError
from runout.model.limits import checked
from runout.model.terrain import Terrain
from runout.structures.facades import face_pairs, mesh_facades
from runout.structures.solid import Solid
from runout.structures.source import Read, StructureSource

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048}
SINGLE = 2.0**-24  # relative rounding of coordinates in float32
FLAT = 1e-9  # volume, of the cube of its length, of a mesh that is no body
UNREADABLE = (ValueError, KeyError, IndexError, TypeError, AttributeError, AssertionError, OSError)  # what readers of meshes raise
COARSE = 0.05  # rounding of coordinates [m] that is reported


def read_meshes(source: StructureSource, terrain: Terrain) -> Read:
    """Bodies of a mesh file, problems, and changes. Bodies that do not touch are structures of their own."""
    solids: list[Solid] = []
    problems: list[str] = []
    changes: list[str] = []
    if isinstance(source.clearance, str):
        problems.append(f"{source.path}: clearance is {source.clearance!r}; a mesh has no attributes, state a number")
    try:
        friction = np.tan(np.radians(checked("basal_friction_angle", source.friction_angle_deg, place=str(source.path))))
        for name, vertices, faces in load_parts(source):
            placed, said = on_terrain(vertices, source, terrain)
            changes += said
            for solid in _bodies(placed, faces, replace(source, name=name), float(friction)):
                found = list(_open(solid, terrain))
                problems += found
                solids += [] if found else [_outward(solid, changes)]
    except InputError as error:
        problems.append(str(error))
    return Read(tuple(solids), tuple(problems), tuple(dict.fromkeys(changes)))


def load_parts(source: StructureSource) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Name, vertices (v, 3) in the units of the file, and faces (f, 3) of each mesh of a file; equal vertices are one.

    Raises
    ------
    StructureError
        If the file is missing or holds no mesh.
    """
    import trimesh

    path = source.path
    if not path.is_file():
        raise StructureError(f"{path}: no such file; check the path")
    try:
        scene = trimesh.load_scene(path)
        parts = [(node, *scene.graph[node]) for node in scene.graph.nodes_geometry]
        meshes = [(node, matrix, scene.geometry[name]) for node, matrix, name in parts]
    except UNREADABLE as cause:
        raise StructureError(f"{path}: cannot be read as a mesh ({cause}); export it again as OBJ, PLY, STL or GLB") from cause
    found = []
    for node, matrix, mesh in meshes:
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            mesh = mesh.copy()
            mesh.apply_transform(matrix)
            mesh.merge_vertices(merge_tex=True, merge_norm=True)
            name = source.name if source.name != "structure" or len(meshes) == 1 else str(node)
            found.append((name, _upright(np.asarray(mesh.vertices, np.float64), path.suffix), np.asarray(mesh.faces, np.int64)))
    if not found:
        raise StructureError(f"{path}: holds no faces; export the structure as a closed mesh of triangles")
    return found


def _upright(vertices: np.ndarray, suffix: str) -> np.ndarray:
    """Vertices with z up: y is up in GLB files (glTF 2.0, 3.3)."""
    return np.column_stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]]) if suffix.lower() == ".glb" else vertices


def on_terrain(vertices: np.ndarray, source: StructureSource, terrain: Terrain) -> tuple[np.ndarray, list[str]]:
    """Local positions [m] of the vertices of a file, and what was assumed.

    Raises
    ------
    StructureError
        If no units are stated.
    ReleaseError
        If the coordinate system is not understood.
    """
    from runout.io.layer_crs import to_terrain

    path = source.path
    if source.units not in UNITS:
        raise StructureError(f"{path}: units is {source.units!r}; state the units of the mesh: {', '.join(UNITS)}")
    metres, said = vertices * UNITS[source.units], []
    rounding = SINGLE * float(np.abs(metres).max())
    if rounding > COARSE and path.suffix.lower() in (".stl", ".glb"):
        said.append(
            f"{path}: its coordinates of up to {np.abs(metres).max():.3g} m are rounded to {rounding:.2g} m by single precision; "
            "export it near the origin and state offset"
        )
    placed = metres + np.asarray(source.offset)
    bounds = [*placed.min(0)[:2], *placed.max(0)[:2]]
    found = to_terrain(path, source.crs or terrain.crs, terrain, bounds, "trimesh")
    if found.forward is not None:
        placed[:, :2] = found.forward(placed[:, :2])
    said += [] if source.crs else [f"{path}: states no crs; its coordinates are taken as the terrain's"]
    return terrain.frame.to_local(placed), [*said, *(found.sentences if source.crs else ())]


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
    volumes = [_volume(vertices, one) for one in parts]
    homes = list(range(count))
    for cavity in (k for k in homes if volumes[k] < 0):
        (low, high) = boxes[cavity]
        around = [k for k in range(count) if volumes[k] > 0 and (boxes[k][0] < low).all() and (high < boxes[k][1]).all()]
        homes[cavity] = around[0] if around else cavity
    return np.array(homes)[part]  # type: ignore[no-any-return]


def _volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Volume [m3] of a closed mesh, negative if its faces are turned inwards."""
    corners = vertices[faces] - vertices[faces[0, 0]]
    return float((corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0)


def _open(solid: Solid, terrain: Terrain) -> Iterator[str]:
    """What makes a body one without inside and outside: holes, edges of three faces, neighbours that are turned against another."""
    faces = solid.faces
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, row, count = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True)
    forward = np.bincount(row.ravel(), ends[:, 0] < ends[:, 1], len(edges))
    faults: tuple[tuple[str, np.ndarray, str], ...] = (
        ("is open", count == 1, "close the hole (MeshLab, Blender: fill holes)"),
        ("has edges of more than two faces", count > 2, "remove inner faces (MeshLab: remove non-manifold edges)"),
        ("has neighbouring faces that are turned against each other", (count == 2) & (forward != 1), "recalculate the normals"),
    )
    for what, edge, remedy in faults:
        if edge.any():
            middles = terrain.frame.to_map(solid.vertices[edges[edge]].mean(1))
            yield f"{solid.place}: the mesh {what} at {_named(middles)}; {remedy}"
            return
    if abs(_volume(solid.vertices, faces)) <= FLAT * np.ptp(solid.box, axis=0).max() ** 3:
        yield f"{solid.place}: the mesh has no volume; export a body, not a surface"


def _named(points: np.ndarray) -> str:
    """Map positions in words, of the first few edges."""
    x, y, z = points.mean(0) if len(points) <= 64 else points[0]
    edges = f"{len(points)} edge{'s' if len(points) > 1 else ''}"
    return f"easting {x:.2f}, northing {y:.2f}, elevation {z:.2f} ({edges})"


def _outward(solid: Solid, changes: list[str]) -> Solid:
    """The body with its faces turned outwards, and with facades."""
    inward = _volume(solid.vertices, solid.faces) < 0
    if inward:
        changes.append(f"{solid.place}: its faces are turned outwards")
    faces = solid.faces[:, ::-1] if inward else solid.faces
    facade, facades = mesh_facades(solid.vertices, faces)
    return replace(solid, faces=faces, facade=facade, facades=facades)
