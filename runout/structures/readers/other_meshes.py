"""Meshes of formats that are known and not read: refused with the remedy, unless another file of this folder reads them."""

from pathlib import PurePath
from typing import TYPE_CHECKING

from runout.errors import StructureError
from runout.io.mesh_files import OTHER_MESHES
from runout.structures.readers import StructureReader

if TYPE_CHECKING:
    from runout.model.terrain import Terrain
    from runout.structures.source import Read, StructureSource

REMEDY = "export it as OBJ, PLY, STL or GLB"


def fault(path: PurePath | str) -> str:
    """What is wrong with a file."""
    return f"{path}: meshes of {PurePath(path).suffix.lower()} are not read"


def read(source: "StructureSource", terrain: "Terrain") -> "Read":
    """No bodies, and the problem."""
    from runout.structures.source import Read

    return Read((), (f"{fault(source.path)}; {REMEDY}",))


def require_readable(source: "StructureSource") -> None:
    """Raise StructureError."""
    raise StructureError(f"{fault(source.path)}; {REMEDY}")


READER = StructureReader("a mesh", OTHER_MESHES, (), read, require_readable, is_refused=True)
