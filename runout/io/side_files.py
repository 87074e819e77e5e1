"""Lists the files that an input depends on: the file, its side files, and the sources of a virtual file.

GDAL lists the side files of a raster (georeference, mask, statistics, header).
Side files of vector formats, and those that GDAL does not list, are in a table here. Overviews are not read and left out.
"""

import os
import re
from html import unescape
from pathlib import Path

from runout.errors import InputError
from runout.io.opening import open_raster
from runout.io.source_kinds import SQLITE, file_in

SIDES = {
    ".shp": (".shx", ".dbf", ".prj", ".cpg", ".cst"),
    ".tab": (".dat", ".map", ".id", ".ind"),
    ".mif": (".mid",),
    ".gml": (".xsd", ".gfs"),
    ".csv": (".csvt", ".prj"),
    ".bt": (".prj",),
}
NOT_YET_WRITTEN_BACK = ("-wal", "-journal")  # journals of SQLite files such as GeoPackage
SOURCE = re.compile(r"<(?:SourceFilename|SourceDataset|SrcDataSource)([^>]*)>([^<]+)<", re.IGNORECASE)
RELATIVE = re.compile(r"relativeToVRT\s*=\s*[\"']\s*1", re.IGNORECASE)
VIRTUAL = (b"<VRTDataset", b"<OGRVRTDataSource", b"<?xml")  # leading bytes of virtual files
OVERVIEWS = ".ovr"
DEEPEST = 8  # nesting levels of virtual files


def files_of(source: Path | str) -> list[Path]:
    """The file and all files that its content depends on, sorted by path; for a folder, all files in it.

    A file that is missing or unreadable is returned alone; its reader reports the error.

    Parameters
    ----------
    source : path or str
        File, folder, or GDAL's name of one raster of several in a file, such as ``NETCDF:"dem.nc":z``.
    """
    path = Path(file_in(str(source)))
    if path.is_dir():
        listed = {_key(p): p for p in (*path.iterdir(), *_raster_files(path)) if p.is_file()}
        return [listed[key] for key in sorted(listed)]
    found: dict[str, Path] = {}
    _collect(path, found, DEEPEST)
    for other in _raster_files(source) if path != Path(source) else ():
        found.setdefault(_key(other), other)
    sides = sorted(other for key, other in found.items() if key != _key(path))
    return [path, *sides]


def _key(path: Path) -> str:
    return os.path.abspath(path)


def _collect(path: Path, found: dict[str, Path], depth: int) -> None:
    """Add a file, its side files and its sources."""
    if _key(path) in found:
        return
    found[_key(path)] = path
    if depth == 0 or not path.is_file():
        return
    sources = _sources(path)
    for other in (*sources, *_raster_files(path), *_unlisted_files(path)):
        if sources and _key(other) != _key(path):
            _collect(other, found, depth - 1)
        elif other.suffix.lower() != OVERVIEWS:
            found.setdefault(_key(other), other)


def _raster_files(source: Path | str) -> list[Path]:
    """Files that GDAL lists for a raster; none for other files."""
    path = Path(file_in(str(source)))
    if _begins(path).startswith(SQLITE):  # opening an SQLite file may write its journal back
        beside = path.with_name(path.name + ".aux.xml")
        return [beside] if beside.is_file() else []
    try:
        with open_raster(source, InputError) as dataset:
            listed = [Path(name) for name in dataset.files]
    except InputError:
        return []
    return [p for p in listed if p.is_file()]


def _unlisted_files(path: Path) -> list[Path]:
    """Side files of :data:`SIDES`, whatever the case of their suffixes, and journals."""
    sides = SIDES.get(path.suffix.lower(), ())
    named = [p for p in path.parent.glob(f"{_literal(path.stem)}.*") if p.suffix.lower() in sides] if sides else []
    real = path.resolve()  # SQLite looks for the journal beside the file, not beside a link to it
    pending = [real.with_name(real.name + end) for end in NOT_YET_WRITTEN_BACK]
    return [p for p in (*named, *pending) if p.is_file() and p.stat().st_size > 0]


def _begins(path: Path) -> bytes:
    """First bytes of a file; empty if it is not a file or cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(200)
    except OSError:
        return b""


def _literal(name: str) -> str:
    """Glob pattern that matches only this name."""
    return re.sub(r"([*?[])", r"[\1]", name)


def _sources(path: Path) -> list[Path]:
    """Existing source files of a virtual raster or vector file."""
    try:
        is_virtual = _begins(path).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(VIRTUAL)
        text = path.read_text(encoding="utf-8", errors="replace") if is_virtual else ""
    except OSError:
        return []
    named = [(unescape(name.strip()), RELATIVE.search(options)) for options, name in SOURCE.findall(text)]
    paths = [path.parent / name if relative else Path(name) for name, relative in named]
    return [p for p in paths if p.is_file()]
