"""Structures of site.yaml: buildings, dams, galleries and piers that the flow meets."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from runout.config.distributions import Settings, limited, quantity, refuse, shape
from runout.config.quantities import Text, within
from runout.structures.readers import other_meshes, reader_of

Height = Annotated[Text | Annotated[float, within("structure_height"), Tag("<number>")], Discriminator(shape)]
Clearance = Annotated[Text | Annotated[float, within("structure_clearance"), Tag("<number>")], Discriminator(shape)]
Elevation = Annotated[Text | Annotated[float, within("elevation"), Tag("<number>")], Discriminator(shape)]
Position = Annotated[list[Annotated[float, Field(allow_inf_nan=False)]], Field(min_length=3, max_length=3)]


def repeated_structures(blocks: Sequence[Mapping[str, Any]]) -> Iterator[tuple[int, int]]:
    """Numbers of blocks that state the same bodies as an earlier one, and of that."""
    told: dict[tuple[str, ...], int] = {}
    for number, block in enumerate(blocks):
        bodies = tuple(str(block.get(key)) for key in ("file", "layer", "offset", "base", "clearance"))
        first = told.setdefault(bodies, number)
        if block.get("file") and first != number:
            yield number, first


def structure_conflicts(given: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Conflicts between keys of a structure: key, what is wrong, remedy."""
    file = given.get("file")
    if not isinstance(file, str) or not file:
        return
    reader = reader_of(file)
    if reader.is_refused:
        yield "file", other_meshes.FAULT.format(PurePath(file)), other_meshes.REMEDY
    for key in reader.foreign_keys():
        if key in given:
            yield key, f"has no meaning with {reader.kind} ({file})", "remove it"
    if reader.has_units and "units" not in given:
        yield "units", f"required key is missing for {reader.kind}", "add units: m, cm, mm or ft"
    if "protects_layer" in given and "protects" not in given:
        yield "protects_layer", "has no meaning without protects", "add protects, or remove it"
    if not (reader.has_attributes or reader.is_refused) and isinstance(given.get("clearance"), str):
        yield "clearance", f"{given['clearance']!r} is no number, and {reader.kind} has no attributes", "give a number in m"


class StructureSettings(Settings):
    """Structures of one file: footprints with a height, or meshes."""

    file: str = quantity(
        "footprints (GeoPackage, Shapefile, GeoJSON) or a closed mesh (OBJ, PLY, STL, GLB), relative to this folder",
        min_length=1,
        examples=["inputs/buildings.gpkg"],
    )
    layer: str | None = quantity("layer of the GeoPackage; not needed when it has one only", None, examples=["buildings"])
    name: str = quantity("name of structures without an attribute name", "structure", min_length=1)
    height: Height | None = quantity(
        "height of the top above the mean ground under a footprint; a number or the attribute that holds it, by default `height`",
        None,
        unit="m",
        examples=[8.0],
    )
    base: Elevation | None = quantity(
        "elevation that heights count from instead of the ground; a number or an attribute, by default `base` if there is one",
        None,
        unit="m",
        examples=[1204.5],
    )
    clearance: Clearance | None = quantity(
        "height of the underside above the ground, for galleries and bridges; a number or an attribute, by default `clearance` if "
        "there is one; a mesh that states it may hang above the ground",
        None,
        unit="m",
        examples=[5.0],
    )
    top: Literal["flat", "along_ground"] | None = quantity(
        "flat (default), or along_ground: the top follows the ground, as that of a dam down a slope",
        None,
        examples=["along_ground"],
    )
    friction_angle_deg: float = limited(
        "basal_friction_angle", "friction angle of the surfaces; an attribute `friction_deg` replaces it", 20.0
    )
    units: Literal["m", "cm", "mm", "ft"] | None = quantity("units of a mesh: m, cm, mm or ft", None, examples=["m"])
    crs: str | None = quantity(
        "coordinate system of a mesh, by default that of the terrain", None, hint="for example EPSG:32632", examples=["EPSG:32632"]
    )
    offset: Position | None = quantity(
        "added to the coordinates of a mesh, [easting, northing, elevation]", None, unit="m", examples=[[500000, 5000000, 0]]
    )
    protects: str | None = quantity(
        "polygons of the area behind a dam: the volume that lies there at the end is reported as overtopping",
        None,
        min_length=1,
        examples=["inputs/behind_dam.gpkg"],
    )

    protects_layer: str | None = quantity(
        "layer of the GeoPackage of protects; not needed when it has one only", None, min_length=1, examples=["behind_dam"]
    )

    @model_validator(mode="after")
    def _complete(self) -> "StructureSettings":
        for key, message, fix in structure_conflicts(self.model_dump(exclude_none=True)):
            raise refuse(message, fix, key)
        return self


STRUCTURES = quantity(
    "list of buildings, dams, galleries and piers that the flow meets: footprints with a height, or meshes; forces are reported",
    None,
    min_length=1,
    examples=[[{"file": "inputs/buildings.gpkg", "height": 8.0}]],
)
FILE_KEYS = ("file", "protects")
PROTECTED = COMPUTED_WITHOUT = ("protects", "protects_layer")  # keys that change no member
