"""Bodies from meshes: the parts of OBJ, PLY, STL and GLB files, in the place that is stated for them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from runout.errors import InputError, StructureError
from runout.io.mesh_files import MeshPart, read_mesh
from runout.model.limits import checked
from runout.model.terrain import Terrain
from runout.structures.facades import face_pairs, mesh_facades
from runout.structures.mesh_faults import Search, mesh_faults, volume
from runout.structures.mesh_place import COARSE, on_terrain, rounding_of
from runout.structures.solid import Solid
from runout.structures.source import Read, StructureSource


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
        placed, said = on_terrain(np.concatenate([part.vertices for part in parts]), source, terrain)
        changes += said
        rounding = rounding_of(source, np.concatenate([part.vertices for part in parts]))
        cause = f" (single precision rounds its coordinates to {rounding:.2g} m: export it near the origin and state offset)"
        note = cause if rounding > COARSE else ""
        search, faults = Search(), []
        for part, vertices in zip(parts, np.split(placed, np.cumsum([len(part.vertices) for part in parts])[:-1]), strict=True):
            for solid in _bodies(vertices, part.faces, replace(source, name=part.name), float(friction)):
                found = [fault + note for fault in mesh_faults(solid, terrain, 2.0 * rounding, search)]
                faults += found
                solids += [] if found else [_outward(solid, changes)]
        more = f" (and {len(faults) - 1} more of its bodies have faults)" if len(faults) > 1 else ""
        problems += [fault + more for fault in faults[:1]]
        changes += search.left
    except InputError as error:
        problems.append(str(error))
    return Read(tuple(solids), tuple(problems), tuple(dict.fromkeys(changes)))


def load_parts(source: StructureSource, changes: list[str]) -> list[MeshPart]:
    """Parts of a mesh file, in its units; those that are open are joined where they share vertices, as parts of one material.

    Faces without three corners are left out, which ``changes`` takes.

    Raises
    ------
    StructureError
        If the file is missing or holds no mesh.
    """
    kept = []
    for part in (read.merged() for read in read_mesh(source.path, StructureError)):
        whole = (part.faces != np.roll(part.faces, 1, axis=1)).all(1)
        if not whole.all():
            count = f"{(~whole).sum()} face" + ("s" if (~whole).sum() > 1 else "")
            changes.append(f"{source.path}: {count} with two equal corners left out")
        if whole.any():
            kept.append(replace(part, faces=part.faces[whole]))
    if not kept:
        raise StructureError(f"{source.path}: holds no faces with an area; export the structure as a closed mesh of triangles")
    apart = [part for part in kept if not part.is_closed]
    made = [part for part in kept if part.is_closed] + ([_joined(apart)] if apart else [])
    own = source.name != "structure" or len(made) == 1
    return [replace(part, name=source.name if own or part.name.startswith(source.path.name) else part.name) for part in made]


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
