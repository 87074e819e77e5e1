"""A new site folder: inputs/ and a site.yaml whose comments are the descriptions of the settings."""

import math
import os
import re
import shutil
import tempfile
import textwrap
from collections.abc import Iterator, Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from runout.config.extent import VECTOR_SUFFIXES
from runout.config.friction import BLOCK as FRICTION_BLOCK
from runout.config.material import BLOCK
from runout.config.problems import inner_model
from runout.config.read import FILE_NAME, nearest_file
from runout.config.schema import SiteSettings
from runout.config.thickness_attribute import thickness_of
from runout.errors import InputError

RASTER_SUFFIXES = (".tif", ".tiff", ".asc", ".nc", ".img", ".vrt", ".flt", ".bil")
SIDE_SUFFIXES = (".shx", ".dbf", ".prj", ".cpg", ".tfw", ".hdr", ".aux.xml")
WIDTH = 110
LARGEST_PLAIN = 1e5  # larger numbers are easier to read as 5e7
HEAD = """\
# Settings of a runout site. `runout check` lists every problem of this file and forecasts the run.
# Paths are relative to this folder. Units are SI; angles are in degrees. A line that begins with # is not in force.
"""


def new_site(folder: Path | str, dem: Path | str, release: Path | str, thickness: str | None = None) -> Path:
    """Path of the site.yaml of a new site folder with copies of its inputs.

    Parameters
    ----------
    folder : path
        Folder to make; its name becomes the name of the site.
    dem : path or str
        Elevation raster, or ``matplotlib:jacksboro_fault_dem``.
    release : path
        Polygons (GeoPackage, Shapefile, GeoJSON) or raster of thickness.
    thickness : str, optional
        Attribute of the polygons that holds it, or a number [m]. Default: the attribute whose name means thickness.

    Raises
    ------
    InputError
        If the folder is in use, or an input is missing or cannot be used.
    StorageError
        If the folder cannot be written; nothing is left behind then.
    """
    from runout.io.atomic import storage_error

    folder, release = Path(folder), _existing(Path(release), "release")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: is there already; choose another name or remove it")
    text = commented_yaml(SiteSettings.model_validate(_first_settings(folder, dem, release, thickness)))
    part = None
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".part", dir=folder.parent))
        _fill(part, text, dem, release)
        os.replace(part, folder)
    except OSError as error:
        raise storage_error(folder, error) from error
    finally:
        if part:
            shutil.rmtree(part, ignore_errors=True)
    return folder / FILE_NAME


def commented_yaml(settings: SiteSettings) -> str:
    """Settings as the text of a site.yaml, every key with its description."""
    return HEAD + "\n".join(_block(settings.model_dump(mode="json", exclude_none=True), SiteSettings, "")) + "\n"


def _existing(path: Path, what: str) -> Path:
    if path.is_file():
        return path
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name the {what} file in it")
    near = nearest_file(path)
    raise InputError(f"{path}: there is no such {what} file" + (f"; did you mean {near}?" if near else "; check its path"))


def _first_settings(folder: Path, dem: Path | str, release: Path, thickness: str | None) -> dict[str, Any]:
    """Initial settings: values from the inputs, and common values for the others."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", folder.resolve().name).strip("-") or "site"
    is_sample = str(dem).startswith("matplotlib:")
    cell = _cell_size(str(dem) if is_sample else _existing(Path(dem), "elevation"), release)
    angle = {"distribution": "uniform", "low": 15.0, "high": 25.0}
    return {
        "name": name,
        "title": name,
        "terrain": {"dem": str(dem) if is_sample else f"inputs/{_input_name(Path(dem), 'dem')}"},
        "release": [_first_release(release, thickness)],
        "material": {"density": 2000.0, "friction_angle_deg": 32.0},
        "basal_friction_angle_deg": 20.0,
        "simulation": {"cell_size": cell, "end_time": 120.0},
        "ensemble": {"members": 8, "seed": 1, "parameters": {"basal_friction_angle_deg": angle}},
    }


def _first_release(path: Path, thickness: str | None) -> dict[str, Any]:
    kind = path.suffix.lower()
    place = f"inputs/{_input_name(path, 'release')}"
    if kind in RASTER_SUFFIXES:
        if thickness is not None:
            raise InputError(f"{path}: a raster holds its own thickness; leave --thickness out")
        return {"raster": place}
    if kind not in VECTOR_SUFFIXES:
        known = " ".join((*VECTOR_SUFFIXES, *RASTER_SUFFIXES))
        raise InputError(f"{path}: neither polygons nor a raster by its name; files of these kinds are read: {known}")
    return {"polygons": place, "thickness": thickness_of(path, thickness)}


def _cell_size(dem: Path | str, release: Path) -> float:
    """Grid spacing to start with: the raster's cell, to two digits [m]."""
    from runout.config.extent import extent_around
    from runout.terrain.read import read_terrain

    cell = min(read_terrain(dem, extent=extent_around(dem, release)).cell_size)
    step = 10.0 ** (math.floor(math.log10(cell)) - 1)
    return round(round(cell / step) * step, 6)


def _input_name(path: Path, stem: str) -> str:
    return stem + path.suffix.lower()


def _fill(folder: Path, text: str, dem: Path | str, release: Path) -> None:
    (folder / "inputs").mkdir()
    if not str(dem).startswith("matplotlib:"):
        _copy(Path(dem), folder / "inputs", "dem")
    _copy(release, folder / "inputs", "release")
    (folder / FILE_NAME).write_text(text, encoding="utf-8")
    folder.chmod(0o755)  # a temporary folder is readable by its owner only


def _copy(path: Path, folder: Path, stem: str) -> None:
    """Copy a file and what belongs to it (the parts of a shapefile, projection files) under a new stem."""
    shutil.copyfile(path, folder / _input_name(path, stem))
    for beside in path.parent.iterdir():
        end = beside.name.removeprefix(path.stem).lower()
        if beside.name.startswith(path.stem + ".") and end.endswith(SIDE_SUFFIXES) and beside.is_file() and beside != path:
            shutil.copyfile(beside, folder / (stem + end))


def _block(values: Mapping[str, Any], model: type[BaseModel], indent: str) -> Iterator[str]:
    for name, field in model.model_fields.items():
        if not indent:
            yield ""
        yield from _comment(field, indent)
        value = values.get(name)
        block = {"material": BLOCK, "basal_friction": FRICTION_BLOCK}.get(name)
        named = block and isinstance(value, dict) and "law" in value
        inner = block.settings_of(block.known_law(value)) if block and named else inner_model(field.annotation)  # type: ignore[attr-defined]
        if value is None:
            yield f"{indent}# {name}: {_example(field)}".rstrip()
        elif name == "parameters":
            yield from (f"{indent}{name}:", *(f"{indent}  {key}: {_flow(item)}" for key, item in value.items()))
        elif inner and isinstance(value, dict):
            yield from (f"{indent}{name}:", *_block(value, inner, indent + "  "))
        elif inner and isinstance(value, list):
            yield f"{indent}{name}:"
            for item in value:
                yield from _item(item, inner, indent + "  ")
        else:
            yield f"{indent}{name}: {_flow(value)}"


def _item(values: Mapping[str, Any], model: type[BaseModel], indent: str) -> Iterator[str]:
    """An item of a list: its first key carries the dash."""
    lines = list(_block(values, model, indent + "  "))
    first = next(i for i, line in enumerate(lines) if not line.lstrip().startswith("#"))
    lines[first] = f"{indent}- {lines[first].lstrip()}"
    yield from lines


def _comment(field: FieldInfo, indent: str) -> Iterator[str]:
    extra = field.json_schema_extra
    unit = extra.get("unit") if isinstance(extra, dict) else None
    text = f"{field.description} [{unit}]" if unit else str(field.description)
    yield from textwrap.wrap(text, WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# ")


def _example(field: FieldInfo) -> str:
    return _flow(field.examples[0]) if field.examples else ""


def _flow(value: Any) -> str:
    """A value on one line of YAML."""
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
