"""Meshes of formats that are known and not read: refused with the remedy, unless another file of this folder reads them."""

from runout.errors import StructureError
from runout.io.mesh_files import OTHER_MESHES
from runout.model.terrain import Terrain
from runout.structures.readers import StructureReader
from runout.structures.source import Read, StructureSource

FAULT, REMEDY = "{0}: meshes of {0.suffix} are not read", "export it as OBJ, PLY, STL or GLB"


def read(source: StructureSource, terrain: Terrain) -> Read:
    """No bodies, and the problem."""
    return Read((), (f"{FAULT.format(source.path)}; {REMEDY}",))


def require_readable(source: StructureSource) -> None:
    """Raise StructureError."""
    raise StructureError(f"{FAULT.format(source.path)}; {REMEDY}")


READER = StructureReader("a mesh", OTHER_MESHES, (), read, require_readable, is_refused=True)
