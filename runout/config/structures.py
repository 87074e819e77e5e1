"""Buildings, dams, galleries and piers that the flow meets: their settings in site.yaml, and the readers of their files."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from runout.config.distributions import Settings, limited, quantity, refuse, shape
from runout.config.document import Document, read_document
from runout.config.fetch import locate
from runout.config.quantities import Degrees, Text, within
from runout.config.stated_at import within_site
from runout.errors import InputError, StructureError
from runout.io.references import is_mesh
from runout.structures.readers import other_meshes, reader_of

if TYPE_CHECKING:
    from runout.config.schema import SiteSettings
    from runout.model.terrain import Terrain
    from runout.structures.read import Bodies
    from runout.structures.source import StructureSource

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


def structure_conflicts(block: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Conflicts between keys of a structure: key, what is wrong, remedy."""
    file = block.get("file")
    if not isinstance(file, str) or not file:
        return
    reader = reader_of(file)
    if reader.is_refused:
        yield "file", other_meshes.FAULT.format(PurePath(file)), other_meshes.REMEDY
    for key in reader.foreign_keys():
        if key in block:
            yield key, f"has no meaning with {reader.kind} ({file})", "remove it"
    if reader.has_units and "units" not in block:
        yield "units", f"required key is missing for {reader.kind}", "add units: m, cm, mm or ft"
    if "protects_layer" in block and "protects" not in block:
        yield "protects_layer", "has no meaning without protects", "add protects, or remove it"
    if not (reader.has_attributes or reader.is_refused) and isinstance(block.get("clearance"), str):
        yield "clearance", f"{block['clearance']!r} is no number, and {reader.kind} has no attributes", "give a number in m"


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
    friction_angle_deg: Degrees = limited(
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
PROTECTED = COMPUTED_WITHOUT = ("protects", "protects_layer")  # keys that change no member


def read_bodies(settings: "SiteSettings", file: Path, terrain: "Terrain") -> "Bodies":
    """Bodies of the structures, and of the overhangs of a terrain that is a mesh.

    Raises StructureError with all problems of all files.
    """
    from runout.structures import read

    sources, ground = _sources(settings, file), settings.terrain
    try:
        bodies = read.read_bodies(sources, terrain, [f"structures[{k}].file" for k in range(len(sources))])
    except StructureError as error:
        raise_placed(error.problems, settings, file)
        raise
    if not is_mesh(ground.dem):
        return bodies
    from runout.structures.read import read_overhangs

    mesh = Path(locate(ground.dem, file.parent))
    return bodies.and_more(read_overhangs(mesh, terrain, ground.overhang_friction_angle_deg))


def require_readable(settings: "SiteSettings", file: Path) -> None:
    """Raise StructureError with all files of structures that cannot be read, wherever their structures stand."""
    from runout.structures import read

    problems = []
    for number, source in enumerate(_sources(settings, file)):
        try:
            read.require_readable(source)
        except InputError as error:
            problems.append(f"structures[{number}].file: {error}")
    raise_placed(problems, settings, file)


def _sources(settings: "SiteSettings", file: Path) -> "list[StructureSource]":
    """What site.yaml says of each file."""
    from runout.structures.source import StructureSource, Top

    sources = []
    for entry in settings.structures or ():
        choices = entry.model_dump(exclude_none=True, exclude={"file", "top", "offset", *PROTECTED})
        offset = tuple(entry.offset or (0.0, 0.0, 0.0))
        path = Path(locate(entry.file, file.parent))
        sources.append(StructureSource(path, **choices, top=Top(entry.top or "flat"), offset=offset))  # type: ignore[arg-type]
    return sources


def read_protected_areas(settings: "SiteSettings", file: Path, terrain: "Terrain") -> "dict[str, np.ndarray]":
    """Covered area (rows, columns) [m2] of each cell behind each dam, by the name of its structures.

    Raises StructureError with all polygons that cannot be used, or lie beyond the terrain.
    """
    areas: dict[str, np.ndarray] = {}
    problems: list[str] = []
    for number, entry in enumerate(settings.structures or ()):
        if entry.protects:
            name = f"{entry.name} {len(areas) + 1}" if entry.name in areas else entry.name
            try:
                areas[name] = _protected_area(Path(locate(entry.protects, file.parent)), entry.protects_layer, terrain)
            except InputError as error:
                problems.append(f"structures[{number}].protects: {error}")
    raise_placed(problems, settings, file)
    return areas


def raise_placed(problems: Sequence[str], settings: "SiteSettings", file: Path) -> None:
    """Raise StructureError with all problems, if any; those that begin with a key of the structures get its line."""
    if problems:
        document = read_document(file) if file.is_file() else Document(file.name)
        raise StructureError([_placed(problem, settings, file, document) for problem in problems])


def _placed(problem: str, settings: "SiteSettings", file: Path, document: Document) -> str:
    problem = within_site(problem, file.parent)
    begins = re.match(r"structures\[(\d+)\]\.(\w+): ", problem)
    if begins is None or settings.structures is None:
        return problem
    number, blocks = int(begins[1]), document.value(("structures",))
    entry = settings.structures[number].model_dump(exclude_unset=True)
    same = [k for k, block in enumerate(blocks or ()) if block == entry]
    if same and number not in same:  # blocks with wrong keys are not among the settings
        number = same[0]
    return str(document.problem(("structures", number, begins[2]), "")) + problem[begins.end() :]


def _protected_area(path: Path, layer: str | None, terrain: "Terrain") -> np.ndarray:
    """Covered area (rows, columns) [m2] of each cell in the polygons of a file."""
    import shapely

    from runout.io.polygon_coverage import on_cells
    from runout.io.polygons import read_polygons

    parts = read_polygons(path, terrain, layer, "protected area", key="protects_layer").polygons
    covered, _, _ = on_cells(np.array([shapely.union_all(parts)]), np.ones(1), terrain)
    if not covered.any():
        x, y = shapely.union_all(parts).representative_point().coords[0]
        at = f"at easting {x:.1f}, northing {y:.1f}"
        raise StructureError(f"{path}: the protected area {at} lies beyond the terrain {terrain.source}; move it")
    return covered.T[::-1] * terrain.cell_area
