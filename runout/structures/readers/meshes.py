"""Closed meshes: OBJ, PLY, STL and GLB."""

from typing import TYPE_CHECKING

from runout.io.mesh_files import MESHES
from runout.structures.readers import StructureReader

if TYPE_CHECKING:
    from runout.model.terrain import Terrain
    from runout.structures.source import Read, StructureSource


def read(source: "StructureSource", terrain: "Terrain") -> "Read":
    """Bodies of the parts of a mesh, problems and changes."""
    from runout.structures.meshes import read_meshes

    return read_meshes(source, terrain)


def require_readable(source: "StructureSource") -> None:
    """Raise InputError if the file holds no mesh."""
    from runout.structures.meshes import load_parts

    load_parts(source, [])


READER = StructureReader("a mesh", MESHES, ("units", "crs", "offset"), read, require_readable, has_units=True)
