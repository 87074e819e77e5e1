"""A new site folder: inputs/ and a site.yaml whose comments are the descriptions of the settings.

The thickness of release polygons is found by the usual names of such attributes in several languages.
"""

import logging
import math
import os
import re
import textwrap
import unicodedata
from collections.abc import Callable, Iterator, Mapping
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from runout.config.bed import BLOCK as EROSION_BLOCK
from runout.config.friction import BLOCK as FRICTION_BLOCK
from runout.config.json_schema import SCHEMA_FILE, reason, schema_text
from runout.config.material import BLOCK
from runout.config.problems import inner_model
from runout.config.process_ranges import Process, Variant, process_named, processes
from runout.config.read import FILE_NAME, nearest_file
from runout.config.schema import SiteSettings
from runout.errors import DemError, InputError, ReleaseError
from runout.io.boundary import exists, kind_of, names_in
from runout.io.references import file_in, holds_geometries, is_dataset, with_file
from runout.model.limits import LIMITS, checked, is_number

if TYPE_CHECKING:
    from runout.model.terrain import Terrain

SAMPLES = "matplotlib:"
LAYER_OPTION = "--layer"
Copy = Callable[[str, Path, str], str]  # of a source to a folder under a name; returns the name of the copy
WIDTH = 110
FOR_EDITORS = f"# yaml-language-server: $schema={SCHEMA_FILE}\n"  # completion and checks in VS Code and other editors
PARAMETERS = "\n  parameters:\n"  # of the ensemble, in the text of a site.yaml
LARGEST_PLAIN = 1e5  # larger numbers are easier to read as 5e7
HEAD = """\
# Settings of a runout site. `runout check` lists every problem of this file and forecasts the run.
# Paths are relative to this folder. Units are SI; angles are in degrees. A line that begins with # is not in force.
"""
LOGGER = logging.getLogger(__name__)

ASSUMED = 10.0  # [m], written if no attribute is found
NAMES = (  # lower case, without accents and signs; includes those of AvaFrame and RAMMS
    "thickness", "depth", "height", "thick", "thk", "h", "h0", "d", "d0", "relth", "relthickness", "releasethickness",
    "releasedepth", "releaseheight", "meanthickness", "meandepth", "depthm", "thicknessm", "heightm", "maechtigkeit",
    "machtigkeit", "tiefe", "dicke", "hoehe", "hohe", "anrissmachtigkeit", "anrissmaechtigkeit", "anrisshohe",
    "anrisshoehe", "epaisseur", "profondeur", "hauteur", "spessore", "profondita", "altezza", "espesor", "profundidad",
    "altura", "potencia", "espessura", "profundidade",
)  # fmt: skip
LONGEST = 10  # longest name of an attribute in a shapefile


def new_site(
    folder: Path | str,
    dem: Path | str,
    release: Path | str,
    thickness: str | None = None,
    *,
    crs: str | None = None,
    layer: str | None = None,
    process: str | None = None,
    cell_size: float | None = None,
) -> Path:
    """Path of the site.yaml of a new site folder with copies of its inputs.

    Parameters
    ----------
    folder : path
        Folder to make; its name becomes the name of the site.
    dem : path or str
        Elevation raster, GDAL's name of one raster of several in a file (``NETCDF:"dem.nc":z``), or
        ``matplotlib:jacksboro_fault_dem``.
    release : path or str
        Polygons (GeoPackage, Shapefile, GeoJSON, FlatGeobuf, file geodatabase) or raster of thickness.
    thickness : str, optional
        Attribute of the polygons that holds it, or a number [m]. Default: the attribute whose name means thickness.
    crs : str, optional
        Coordinate reference system of an elevation raster that states none, such as ``EPSG:32632``.
    layer : str, optional
        Layer of the polygons; needed if the file has several.
    process : str, optional
        Name of the process, such as ``debris_flow``, whose published laws, values and ranges are written.
    cell_size : float, optional
        Grid spacing of the simulation [m]. Default: that of the elevations, with two digits.

    Raises
    ------
    InputError
        If there is no such process, the folder is in use, or an input is missing, cannot be used or cannot be copied without a
        change.
    StorageError
        If the folder cannot be written; nothing is left behind then.
    """
    from runout.io.atomic import storage_error
    from runout.io.part import part_folder

    target, dem, release = Path(os.path.abspath(folder)), str(dem), str(release)
    chosen = None if process is None else process_named(process)
    _require_inputs(dem, release)
    require_free(Path(folder), dem, release)
    if cell_size is not None:
        checked("cell_size", cell_size, key="--cell-size")
    cell, mass = cell_and_release(dem, release, thickness, crs, layer)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with part_folder(target) as part:
            (part / target.name / "inputs").mkdir(parents=True)
            _fill(part / target.name, _first_settings(target.name, cell_size or cell, dem, crs), mass, chosen)
            _move(part / target.name, target)
    except OSError as error:
        raise storage_error(folder, error) from error
    return Path(folder) / FILE_NAME


def commented_yaml(settings: SiteSettings) -> str:
    """Settings as the text of a site.yaml, every key with its description."""
    return HEAD + "\n".join(_block(settings.model_dump(mode="json", exclude_none=True), SiteSettings, "")) + "\n"


def _require_inputs(dem: str, release: str) -> None:
    """Raise an error that lists all inputs that are missing."""
    faults = [missing(dem, "elevation")] if not dem.startswith(SAMPLES) else []
    faults = [fault for fault in (*faults, missing(release, "release")) if fault]
    if faults:
        raise InputError("\n".join(faults))


def missing(source: str, what: str) -> str:
    """Message on an input that is no file of this machine; empty if it is one."""
    path = Path(file_in(source))
    if source.startswith("/vsi") or "://" in source:
        return f"{source}: is no file on this machine; download or unpack it, and name the file"
    if kind_of(path):
        return f"{path}: is {kind_of(path)}, not a file; copy its content to a file and name that"
    if exists(path) and not os.access(path, os.R_OK):
        return f"{path}: cannot be read; check its permissions"
    if exists(path):
        return f"{path}: is a folder; name the {what} file in it" if path.is_dir() and not is_dataset(path) else ""
    near = nearest_file(path)
    return f"{path}: there is no such {what} file" + (f"; did you mean {near}?" if near else "; check its path")


def require_free(folder: Path, *sources: str) -> None:
    """Raise an error if a folder is in use."""
    if not exists(folder) or (folder.is_dir() and not names_in(folder)):
        return
    within = [source for source in sources if Path(os.path.abspath(file_in(source))).is_relative_to(os.path.abspath(folder))]
    first = f"; move {within[0]} elsewhere before, since it is copied from there" if within else ""
    raise InputError(f"{folder}: is there already; choose another name or remove it{first}")


def cell_and_release(
    dem: str, release: str, thickness: str | None, crs: str | None, layer: str | None
) -> tuple[float, dict[str, Any]]:
    """Grid spacing to start with, that of the elevations [m], and settings of the release. Both inputs are read.

    InputError says what is wrong with them, or with the stated thickness.
    """
    from runout.config.extent import extent_around
    from runout.terrain.read import read_header, read_terrain

    states_no_system = not read_header(dem, crs).crs
    try:
        terrain = read_terrain(dem, crs, extent_around(dem, Path(release), crs))
        cell = checked("cell_size", _two_digits(min(terrain.cell_size)), place=dem, key="size of the cells", error=DemError)
        return cell, _first_release(release, terrain, thickness, layer)
    except InputError as error:
        if states_no_system and "crs" in str(error):  # the message names the key of site.yaml
            error.args = (f"{error}; `runout new --crs EPSG:CODE` states it",)
        raise


def _first_release(source: str, terrain: "Terrain", thickness: str | None, layer: str | None) -> dict[str, Any]:
    """Settings of the release, with the source as it is stated."""
    path = Path(source)
    if source == file_in(source) and holds_geometries(path):
        from runout.io.polygons import read_polygons

        polygons = read_polygons(path, terrain, layer, key=LAYER_OPTION)
        settings = {"polygons": source, "layer": layer, "thickness": thickness_of(path, polygons.attributes, thickness)}
        return {key: value for key, value in settings.items() if value is not None}
    _require_raster(source)
    for option, value in {"--thickness": thickness, LAYER_OPTION: layer}.items():
        if value is not None:
            raise InputError(f"{source}: is a raster, which holds its own thickness and has no layers; leave {option} out")
    return {"raster": source}


def _require_raster(source: str) -> None:
    """Raise an error if a release that is no vector file is no raster either."""
    from runout.terrain.source import THICKNESS, open_source

    try:
        with open_source(source, THICKNESS):
            pass
    except ReleaseError as cause:
        kinds = (
            "polygons (GeoPackage, Shapefile, GeoJSON, FlatGeobuf, file geodatabase), or a raster in the forms of the elevations"
        )
        raise InputError(f"{cause}; a release is {kinds}") from cause


def _fill(folder: Path, settings: dict[str, Any], release: dict[str, Any], process: Process | None) -> None:
    """Copy the inputs to ``inputs/`` and write a site.yaml that names the copies, with the published values of a process."""
    from runout.io.input_copies import copy_raster, copy_vector

    def copied(copy: Copy, source: str, stem: str) -> str:
        name = copy(source, folder / "inputs", stem)
        return with_file(name, f"inputs/{file_in(name)}")

    if process:
        settings = process.applied({**settings, "release": release})
        release = settings.pop("release")
    layer = release.get("layer")
    copies: dict[str, Copy] = {"polygons": partial(copy_vector, layer=layer), "raster": copy_raster}
    if not settings["terrain"]["dem"].startswith(SAMPLES):
        settings["terrain"]["dem"] = copied(copy_raster, settings["terrain"]["dem"], "dem")
    for key in release.keys() & copies:
        settings["release"] = [release | {key: copied(copies[key], release[key], "release")}]
    text = commented_yaml(SiteSettings.model_validate(settings))
    text = _with_sources(text, process) if process else _with_processes(text)
    (folder / FILE_NAME).write_text(f"{FOR_EDITORS}{text}", encoding="utf-8")
    (folder / SCHEMA_FILE).write_text(schema_text(), encoding="utf-8")


def _move(made: Path, folder: Path) -> None:
    """Move what was made to its folder. An empty folder stays the same folder, since a shell may stand in it."""
    if not folder.is_dir():
        os.replace(made, folder)
        return
    for name in names_in(made):
        os.replace(made / name, folder / name)


def _first_settings(name: str, cell: float, dem: str, crs: str | None) -> dict[str, Any]:
    """Initial settings without the release: those of the inputs, and common values for the others."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-_") or "site"
    angle = {"distribution": "uniform", "low": 15.0, "high": 25.0}
    return {
        "name": plain,
        "title": plain,
        "terrain": {"dem": dem} if crs is None else {"dem": dem, "crs": crs},
        "material": {"density": 2000.0, "friction_angle_deg": 32.0},
        "basal_friction_angle_deg": 20.0,
        "simulation": {"cell_size": cell, "end_time": 120.0},
        "ensemble": {"members": 8, "seed": 1, "parameters": {"basal_friction_angle_deg": angle}},
    }


def _with_sources(text: str, process: Process) -> str:
    """Text of a site.yaml with the source of each value of a process, and with its other laws as comments."""
    head, tail = text.split(PARAMETERS, 1)
    lines = tail.split("\n")
    sampled = {r.key: lines.pop(0) for r in process.variant.ranges if r.distribution}
    note = "Values of other events, not calibrated to this site. Check what is cited from memory before you rely on it."
    made = _wrapped(note, "    ")
    for r in process.variant.ranges:
        made += [*_wrapped(r.words(), "    "), *([sampled[r.key]] if r.distribution else [])]
    offered = [line for other in process.others for line in _offered(other)]
    return head + PARAMETERS + "\n".join(made + offered + lines)


def _with_processes(text: str) -> str:
    """Text of a site.yaml with the published ranges of basal friction of every process as comments."""
    head, tail = text.split(PARAMETERS, 1)
    note = (
        "No process was chosen: this range is a start for the first run, and describes no event. Published ranges, which "
        "`runout new --process` writes with laws and sources; choose one, or calibrate:"
    )
    lines = _wrapped(note, "    ")
    for process in processes().values():
        lines += _wrapped(f"{process.name}: {'; '.join(r.stated() for r in process.of_friction)}", "    ")
    return head + PARAMETERS + "\n".join(lines) + f"\n{tail}"


def _offered(other: Variant) -> Iterator[str]:
    """Comment lines of another law or an added part: its settings, and the distributions that fit them."""
    settings = other.applied({})
    sampled = settings.pop("ensemble")["parameters"]
    yield from _wrapped(f"Or, with {'; '.join(f'{key}: {_flow(value)}' for key, value in settings.items())}:", "    ")
    for r in other.ranges:
        yield from _wrapped(r.words(), "    ")
        if r.key in sampled:
            yield f"    # {r.key}: {_flow(sampled[r.key])}"


def _two_digits(cell: float) -> float:
    step = 10.0 ** (math.floor(math.log10(cell)) - 1)
    return round(round(cell / step) * step, 6)


def _block(values: Mapping[str, Any], model: type[BaseModel], indent: str, section: str = "site") -> Iterator[str]:
    for name, field in model.model_fields.items():
        if not indent:
            yield ""
        yield from _comment(field, section, name, indent)
        value = values.get(name)
        block = {"material": BLOCK, "basal_friction": FRICTION_BLOCK, "erosion": EROSION_BLOCK}.get(name)
        named = block and isinstance(value, dict) and "law" in value
        inner: Any = None if block else inner_model(field.annotation)  # a block without a law holds some parameters
        if block and named:
            inner = block.settings_of(block.known_law(value))  # type: ignore[attr-defined]
        if value is None:
            yield f"{indent}# {name}: {_example(field)}".rstrip()
        elif name == "parameters" and not value:
            yield f"{indent}{name}: {{}}"
        elif name == "parameters":
            yield from (f"{indent}{name}:", *(f"{indent}  {key}: {_flow(item)}" for key, item in value.items()))
        elif inner and isinstance(value, dict):
            yield from (f"{indent}{name}:", *_block(value, inner, indent + "  ", name))
        elif inner and isinstance(value, list):
            yield f"{indent}{name}:"
            for item in value:
                yield from _item(item, inner, indent + "  ", name)
        else:
            yield f"{indent}{name}: {_flow(value)}"


def _item(values: Mapping[str, Any], model: type[BaseModel], indent: str, section: str) -> Iterator[str]:
    """An item of a list: its first key carries the dash."""
    lines = list(_block(values, model, indent + "  ", section))
    first = next(i for i, line in enumerate(lines) if not line.lstrip().startswith("#"))
    lines[first] = f"{indent}- {lines[first].lstrip()}"
    yield from lines


def _comment(field: FieldInfo, section: str, name: str, indent: str) -> Iterator[str]:
    """What a key is, and one line that says why one would change it."""
    extra = field.json_schema_extra
    unit = extra.get("unit") if isinstance(extra, dict) else None
    yield from _wrapped(f"{field.description} [{unit}]" if unit else str(field.description), indent)
    if why := reason(section, name):
        yield f"{indent}# Why change it: {why}"


def _wrapped(text: str, indent: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# ")


def _example(field: FieldInfo) -> str:
    return _flow(field.examples[0]) if field.examples else ""


def _flow(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items() if item is not None) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        text = f"{value:.10g}" if abs(value) < LARGEST_PLAIN else f"{Decimal(str(value)).normalize():e}"
        return text.replace("e+", "e")
    return str(value) if re.fullmatch(r"[A-Za-z][\w./:-]*", value) and value.lower() not in WORDS else _quoted(value)


WORDS = ("true", "false", "null", "yes", "no", "on", "off", "y", "n")  # text that some YAML readers take for something else


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'


def thickness_of(path: Path, table: Any, choice: str | None = None) -> float | str:
    """Thickness of release polygons for a new site.yaml: name of an attribute of their table, or a number [m].

    The choice is logged. A stated ``choice`` overrides the search. Raises InputError if there is no such attribute, or several may
    be the thickness.
    """
    if choice is not None:
        return _stated(path, table, choice)
    named = [name for name in table.columns if _is_thickness(str(name))]
    usable = [name for name in named if _usable(table[name])]
    for name in named:
        if name not in usable:
            LOGGER.warning("%s: attribute %r is not taken for the thickness: not every value is a thickness in m", path, name)
    if not usable:
        known = ", ".join(map(repr, table.columns)) or "none"
        LOGGER.warning(
            "%s: no attribute is taken for the thickness (attributes: %s); site.yaml states %g m: edit it, or make the site anew "
            "with --thickness", path, known, ASSUMED,
        )  # fmt: skip
        return ASSUMED
    if len(usable) > 1 and "thickness" not in usable:
        raise InputError(
            f"{path}: {len(usable)} attributes may hold the thickness: {', '.join(map(repr, usable))}; name the one that does, for "
            f"example --thickness {usable[0]}, or give a number in m"
        )
    attribute = "thickness" if "thickness" in usable else str(usable[0])
    values = table[attribute].astype(float)
    LOGGER.info("%s: thickness from the attribute %r, %g to %g m", path, attribute, values.min(), values.max())
    return attribute


def _stated(path: Path, table: Any, choice: str) -> float | str:
    if choice in table:
        return choice
    valid = LIMITS["thickness"]
    try:
        number = float(choice)
    except ValueError:
        known = ", ".join(map(repr, table.columns)) or "none"
        raise InputError(f"{path}: no attribute {choice!r} for the thickness; attributes: {known}; or give a number in m") from None
    if not valid.holds(number):
        raise InputError(f"thickness is {number:g} m; {valid.allowed()}; {valid.hint}")
    return number


def _is_thickness(name: str) -> bool:
    plain = unicodedata.normalize("NFKD", name.casefold())
    letters = "".join(letter for letter in plain if letter.isascii() and letter.isalnum())
    cut = len(name) >= LONGEST - 1 and any(known.startswith(letters) for known in NAMES)
    return letters in NAMES or cut


def _usable(values: Any) -> bool:
    """Whether every value is a valid thickness; numbers stored as text are accepted."""

    def number(value: Any) -> float:
        try:
            return float(value) if is_number(value) or isinstance(value, str) else float("nan")
        except ValueError:
            return float("nan")

    return len(values) > 0 and all(LIMITS["thickness"].holds(number(value)) for value in values)
