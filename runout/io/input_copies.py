"""Lists the files that the content of an input depends on, and copies them. The copy is read and compared with the original.

GDAL lists the side files of a raster (georeference, mask, statistics, header). Side files of vector formats, and those that GDAL
does not list, are in a table here. Overviews are not read and left out.

Files that share the name of the input are renamed with it. Where a name is part of the content (SRTM, parts of an ESRI grid), they
keep their names in a folder of their own. The sources of a virtual raster are copied to a folder beside its copy, which names them.
"""

import errno
import filecmp
import math
import os
import re
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import InputError
from runout.io.opening import NETCDF, open_raster, open_vector
from runout.io.references import SOURCES, SQLITE, file_in, header, is_vrt, with_file
from runout.io.window import LARGEST_WHOLE

CELLS_AT_ONCE = 2**20  # cells of two rasters that are compared at once
MOST_COMPARED = 2**24  # cells; of a larger raster evenly spaced rows are compared, since its files are compared as well
SAME_CORNER = 1e-9  # difference of two corners in cells; a file format may round the last digits
NOT_YET_WRITTEN_BACK = ("-wal", "-journal")  # journals of SQLite files such as GeoPackage
LOCKS = (*NOT_YET_WRITTEN_BACK, "-shm", ".lock")  # files of a program that has the input open
SIDES = {
    ".shp": (".shx", ".dbf", ".prj", ".cpg", ".cst"),
    ".tab": (".dat", ".map", ".id", ".ind"),
    ".mif": (".mid",),
    ".gml": (".xsd", ".gfs"),
    ".csv": (".csvt", ".prj"),
    ".bt": (".prj",),
}
SOURCE = re.compile(r"<(?:SourceFilename|SourceDataset|SrcDataSource)([^>]*)>([^<]+)<", re.IGNORECASE)
RELATIVE = re.compile(r"relativeToVRT\s*=\s*[\"']\s*1", re.IGNORECASE)
VIRTUAL = (b"<VRTDataset", b"<OGRVRTDataSource", b"<?xml")  # leading bytes of virtual files
OVERVIEWS = ".ovr"
DEEPEST = 8  # nesting levels of virtual files

Plan = dict[Path, str]  # files and the names of their copies


def copy_raster(source: str, folder: Path, stem: str) -> str:
    """Name of the copy of a raster in an existing folder, relative to it; ``stem`` is that name without suffix.

    The source is a file, the folder of an ESRI grid, or GDAL's name of one raster of several in a file, such as
    ``NETCDF:"dem.nc":z``. Raises InputError if it cannot be read, or its copy does not read as the original, and OSError if the
    copy cannot be written.
    """
    path = Path(file_in(source))
    if path.is_file() and is_vrt(path):
        return _copied_virtual(path, folder, stem)
    return _copied(source, folder, stem, raster_difference)


def copy_vector(source: str, folder: Path, stem: str, layer: str | None = None) -> str:
    """Name of the copy of a vector file or a file geodatabase in a folder; parameters and errors as of :func:`copy_raster`.

    Of several layers ``layer`` is compared, by default all.
    """
    return _copied(source, folder, stem, partial(vector_difference, layer=layer))


def raster_difference(one: str, other: str) -> str:
    """In what two rasters differ: georeference, bands, mask or values; empty if they are equal."""
    files = Path(file_in(one)), Path(file_in(other))
    if files[0].is_file() and header(files[0]).startswith(NETCDF):  # its reader looks at no other file
        return "" if filecmp.cmp(*files, shallow=False) else "content"
    with open_raster(one, InputError) as first, open_raster(other, InputError) as second:
        for name in ("shape", "dtypes", "crs", "scales", "offsets", "units"):
            if getattr(first, name) != getattr(second, name):
                return name
        if _alpha(first) != _alpha(second):
            return "transparency"
        corners = [np.array([raster.xy(*cell, offset="ul") for cell in ((0, 0), first.shape)]) for raster in (first, second)]
        if np.abs(corners[0] - corners[1]).max() > SAME_CORNER * max(map(abs, first.transform[:2])):
            return "georeference"
        return next((f"values of band {band}" for band in first.indexes if not _equal_band(first, second, band)), "")


def vector_difference(one: str, other: str, layer: str | None = None) -> str:
    """In what two vector files differ: layers, coordinate system, geometries or attributes; empty if they are equal."""
    first, second = (open_vector(Path(name), InputError) for name in (one, other))
    layers = first.layers(), second.layers()
    if layers[0] != layers[1] and max(map(len, layers)) > 1:  # the only layer of a shapefile is named as the file
        return "layers"
    for names in zip(*layers, strict=True) if layer is None else [(layer, layer)]:
        (a, _), (b, _) = first.read(names[0]), second.read(names[1])
        if a.crs != b.crs:
            return "coordinate system"
        if list(a.geometry.to_wkb()) != list(b.geometry.to_wkb()):
            return "geometries"
        if not a.drop(columns=a.geometry.name).equals(b.drop(columns=b.geometry.name)):
            return "attributes"
    return ""


def _copied(source: str, folder: Path, stem: str, difference: Callable[[str, str], str]) -> str:
    """Name of the first copy that reads as the original."""
    path, reason = Path(file_in(source)), ""
    files = [p for p in files_of(source) if not p.name.endswith(LOCKS) and p.suffix.lower() != OVERVIEWS]
    for plan in _plans(path, files, stem):
        for file, name in plan.items():
            _copy_file(file, folder / name)
        first = Path(next(iter(plan.values())))
        name = str(first.parent) if path.is_dir() else str(first)
        reason = _reason(source, with_file(source, folder / name), difference)
        if not reason:
            return with_file(source, name)
        for name in plan.values():
            (folder / name).unlink()
    raise InputError(
        f"{source}: its copy has another content than the file ({reason or 'its files lie in several folders'}); close it in other "
        "programs, or write it in one file (rasters: `gdal_translate`, to GeoTIFF; polygons: `ogr2ogr`, to GeoPackage)"
    )


def _reason(source: str, copy: str, difference: Callable[[str, str], str]) -> str:
    """In what a copy differs from the original; empty if it is equal."""
    try:
        return difference(source, copy)
    except InputError as error:
        if file_in(copy) in str(error):
            return "it cannot be read"
        raise


def _plans(path: Path, files: list[Path], stem: str) -> Iterator[Plan]:
    """Names of the copies: all files renamed, then all in a folder with the names that they have."""
    parent = path if path.is_dir() else path.parent
    if any(Path(os.path.abspath(file)).parent != Path(os.path.abspath(parent)) for file in files):
        return
    begin = path.stem.lower()
    if not path.is_dir() and all(file.name.lower().startswith(begin) for file in files):
        renamed = {file: stem + file.name[len(begin) :].lower() for file in files}
        if len(set(renamed.values())) == len(files):
            yield renamed
    inner = stem + path.suffix.lower() if path.is_dir() else stem
    yield {file: f"{inner}/{file.name}" for file in files}


def _copy_file(source: Path, target: Path) -> None:
    """Copy a file. Of an SQLite file the state after its last transaction is copied, with what its journal holds."""
    target.parent.mkdir(exist_ok=True)
    try:
        if header(source).startswith(SQLITE):
            _copy_database(source, target)
        else:
            shutil.copyfile(source, target)
            if not filecmp.cmp(source, target, shallow=False):
                raise InputError(f"{source}: changed while it was copied; close it in other programs and try again")
    except OSError as cause:
        if cause.filename is not None and Path(cause.filename) == source:
            raise InputError(f"{source}: cannot be read ({cause.strerror}); check its permissions") from cause
        raise


def _copy_database(source: Path, target: Path) -> None:
    try:
        with (
            closing(sqlite3.connect(f"{source.absolute().as_uri()}?mode=ro", uri=True)) as original,
            closing(sqlite3.connect(target)) as copy,
        ):
            original.execute("BEGIN").execute("SELECT name FROM sqlite_master")  # refused if locked, where a backup waits for ever
            original.backup(copy)
            copy.execute("PRAGMA journal_mode = DELETE")  # the copy is one file
    except sqlite3.Error as cause:
        if cause.sqlite_errorcode == sqlite3.SQLITE_FULL:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(target)) from cause
        remedy = "save and close it in the program that has it open, or copy it with its -wal file to a folder that you can write"
        raise InputError(f"{source}: cannot be copied ({cause}); {remedy}") from cause


def _copied_virtual(path: Path, folder: Path, stem: str) -> str:
    """Name of a copy of a virtual raster whose sources are copies in the folder ``stem`` beside it."""
    from xml.etree import ElementTree

    with open_raster(path, InputError) as dataset:  # refuses what is no plain copy of bands of files in its folder
        rows, columns = dataset.shape
    if rows * columns > LARGEST_WHOLE:
        size = f"the VRT has {columns} x {rows} cells, more than are copied for a site ({LARGEST_WHOLE:,})"
        remedy = f"cut it: `gdal_translate -projwin WEST NORTH EAST SOUTH {path} cropped.tif`"
        raise InputError(f"{path}: {size}; {remedy}")
    (folder / stem).mkdir()
    tree, copies = ElementTree.parse(path), dict[Path, str]()
    for element in (element for element in tree.iter() if element.tag in SOURCES):
        relative = element.get("relativeToVRT", "0").strip() == "1"
        source = Path(os.path.abspath(path.parent / str(element.text) if relative else str(element.text)))
        if source not in copies:
            copies[source] = f"{stem}/{copy_raster(str(source), folder / stem, str(len(copies) + 1))}"
        element.text = copies[source]
        element.set("relativeToVRT", "1")
    target = folder / f"{stem}.vrt"
    tree.write(target, encoding="utf-8")
    for side in (file for file in files_of(path) if file.parent == path.parent and file.name.startswith(f"{path.name}.")):
        _copy_file(side, folder / f"{target.name}{side.name[len(path.name) :]}")
    reason = raster_difference(str(path), str(target))
    if reason:
        raise InputError(f"{path}: the copy of the VRT has other {reason}; write it as GeoTIFF with `gdal_translate` and name that")
    return target.name


def _alpha(raster: Any) -> list[bool]:
    """Which bands of an open raster are transparency."""
    return [meaning.name == "alpha" for meaning in raster.colorinterp]


def _equal_band(first: Any, second: Any, band: int) -> bool:
    """Whether a band of two open rasters has the same mask, and the same values where it is valid."""
    rows = max(1, CELLS_AT_ONCE // first.width)
    step = rows * math.ceil(first.width * first.height / MOST_COMPARED)
    for row in range(0, first.height, step):
        window = (row, min(row + rows, first.height)), (0, first.width)
        a, b = (dataset.read(band, window=window, masked=True) for dataset in (first, second))
        masks = np.ma.getmaskarray(a), np.ma.getmaskarray(b)
        if not (np.array_equal(*masks) and np.array_equal(a.data[~masks[0]], b.data[~masks[0]], equal_nan=True)):
            return False
    return True


def files_of(source: Path | str) -> list[Path]:
    """The file and all files that its content depends on, sorted by path; for a folder, all files in it.

    A file that is missing or unreadable is returned alone; its reader reports the error.

    ``source``: file, folder, or GDAL's name of one raster of several in a file, such as ``NETCDF:"dem.nc":z``.
    """
    path = Path(file_in(str(source)))
    if path.is_dir():
        listed = {_key(p): p for p in (*path.iterdir(), *_raster_files(path)) if p.is_file()}
        return [listed[key] for key in sorted(listed)]
    files: dict[str, Path] = {}
    _collect(path, files, DEEPEST)
    for other in _raster_files(source) if path != Path(source) else ():
        files.setdefault(_key(other), other)
    sides = sorted(other for key, other in files.items() if key != _key(path))
    return [path, *sides]


def _key(path: Path) -> str:
    return os.path.abspath(path)


def _collect(path: Path, files: dict[str, Path], depth: int) -> None:
    """Add a file, its side files and its sources."""
    if _key(path) in files:
        return
    files[_key(path)] = path
    if depth == 0 or not path.is_file():
        return
    sources = _sources(path)
    for other in (*sources, *_raster_files(path), *_unlisted_files(path)):
        if sources and _key(other) != _key(path):
            _collect(other, files, depth - 1)
        elif other.suffix.lower() != OVERVIEWS:
            files.setdefault(_key(other), other)


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
