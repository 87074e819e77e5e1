"""Kinds of input sources: meshes, samples of matplotlib, rasters within a file, vector files. No library is imported for it."""

import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from runout.errors import InputError
from runout.io.references import header

MESHES = (".obj", ".ply", ".stl")
PARTS = re.compile(r'^(NETCDF|GPKG|GTIFF_DIR):(?:\d+:)?"?(/?[^":]+)"?(?::[^:]*)?$')  # name of one raster among several in a file
SQLITE = b"SQLite format 3\0"
SHAPEFILE, FLATGEOBUF = b"\0\0\x27\x0a", b"fgb\3"
GEODATABASE = "*.gdbtable"  # files of the folder of a file geodatabase


def is_mesh(path: Any) -> bool:
    """Whether a file of elevations is a mesh."""
    return isinstance(path, str | Path) and str(path).lower().endswith(MESHES)


def sample_path(source: str) -> Path | None:
    """File of a sample with a name such as ``matplotlib:jacksboro_fault_dem``; None if matplotlib is not installed."""
    package = find_spec("matplotlib")
    if package is None or package.origin is None:
        return None
    return Path(package.origin).with_name("mpl-data") / "sample_data" / f"{source.partition(':')[2]}.npz"


def file_in(name: str) -> str:
    """Path of the file in GDAL's name of one raster of several, such as ``NETCDF:"dem.nc":z``; of other names the name itself."""
    part = PARTS.match(name)
    return part[2] if part else name


def with_file(name: str, path: Path | str) -> str:
    """GDAL's name of the same raster in another file; for other names the path."""
    part = PARTS.match(name)
    return f"{name[: part.start(2)]}{path}{name[part.end(2) :]}" if part else str(path)


def is_json(first: bytes) -> bool:
    """Whether the first bytes of a file are those of a JSON object."""
    return first.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] == b"{"


def is_dataset(folder: Path) -> bool:
    """Whether a folder is an ESRI grid or a file geodatabase."""
    return (folder / "hdr.adf").is_file() or any(folder.glob(GEODATABASE))


def holds_geometries(path: Path) -> bool:
    """Whether a file or folder is a vector source by its content, whatever its name.

    Raises InputError if it is a GeoPackage that cannot be read.
    """
    if path.is_dir():
        return any(path.glob(GEODATABASE))
    first = header(path)
    if not first.startswith(SQLITE):
        return first.startswith((SHAPEFILE, FLATGEOBUF)) or is_json(first)
    from runout.io.opening import open_vector

    return bool(open_vector(path, InputError).layers())
