"""Closed meshes: OBJ, PLY, STL and GLB."""

from runout.io.mesh_files import MESHES
from runout.structures.meshes import load_parts, read_meshes
from runout.structures.readers import StructureReader

READER = StructureReader(
    "a mesh", MESHES, ("units", "crs", "offset"), read_meshes, lambda source: load_parts(source, []), has_units=True
)
