"""Footprints of vector files, extruded to their height."""

from typing import TYPE_CHECKING

from runout.structures.readers import StructureReader

if TYPE_CHECKING:
    from runout.model.terrain import Terrain
    from runout.structures.source import Read, StructureSource


def read(source: "StructureSource", terrain: "Terrain") -> "Read":
    """Bodies of polygons, problems and changes."""
    from runout.structures.footprints import read_footprints

    return read_footprints(source, terrain)


def require_readable(source: "StructureSource") -> None:
    """Raise InputError if the file has no polygons."""
    from runout.io.polygons import read_frame

    read_frame(source.path, source.layer, "structure")


READER = StructureReader("footprints", (), ("height", "base", "layer", "top"), read, require_readable, has_attributes=True)
