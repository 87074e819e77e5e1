"""Footprints of vector files, extruded to their height."""

from runout.io.polygons import read_frame
from runout.structures.footprints import read_footprints
from runout.structures.readers import StructureReader

READER = StructureReader(
    "footprints", (), ("height", "base", "layer", "top"), read_footprints,
    lambda source: read_frame(source.path, source.layer, "structure"), has_attributes=True,
)  # fmt: skip
