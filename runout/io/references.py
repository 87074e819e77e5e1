"""Checks the references of an input file to other files and network addresses, which a library would open on its own.

The kind of a source is told without a library: mesh, sample of matplotlib, raster within a file, vector file.
"""

import json
import os
import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runout.errors import InputError
from runout.io.boundary import LARGEST_TEXT, require_regular, root_of

if TYPE_CHECKING:
    from xml.etree import ElementTree

HEADER = 4096  # leading bytes from which GDAL recognises formats
VRT_MARK = b"<VRTDataset"
DEEPEST = 5  # nesting levels of VRTs
MOST_SOURCES = 20_000
TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
FOREIGN = re.compile(rb"<GDAL(?!Metadata>)|stac_extensions")  # of formats that read other files; a GeoTIFF has metadata of its own
SYSTEM = re.compile(r"\s*(\w+\s*\[|[A-Za-z]+:\d+|\+proj=|\{|urn:ogc:|$)", re.ASCII)  # start of WKT, code, PROJ, JSON
ADDRESS = re.compile(r"^(/vsi|<|\w{2,}:)|://", re.ASCII)
SYSTEMS = ("SRS", "SourceSRS", "TargetSRS", "SourceCRS", "TargetCRS", "GCPList")
SOURCES = ("SourceFilename", "SourceDataset")
BANDS = (None, "VRTSourcedRasterBand", "VRTWarpedRasterBand")
KNOWN = frozenset(
    re.findall(
        r"\w+",
        """
    VRTDataset SRS GeoTransform Metadata MDI VRTRasterBand Description UnitType Offset Scale NoDataValue HideNoDataValue ColorInterp
    ColorTable Entry CategoryNames Category Histograms HistItem HistMin HistMax BucketCount IncludeOutOfRange Approximate HistCounts
    GDALRasterAttributeTable FieldDefn Name Type Usage Row F GCPList GCP MaskBand OverviewList BlockXSize BlockYSize
    SimpleSource ComplexSource AveragedSource KernelFilteredSource SourceFilename SourceBand SourceProperties SrcRect DstRect
    NODATA UseMaskBand ScaleOffset ScaleRatio LUT ColorTableComponent Exponent SrcMin SrcMax DstMin DstMax Kernel Size Coefs
    GDALWarpOptions WarpMemoryLimit ResampleAlg WorkingDataType Option SourceDataset Transformer ApproxTransformer MaxError
    BaseTransformer GenImgProjTransformer SrcGeoTransform SrcInvGeoTransform DstGeoTransform DstInvGeoTransform ReprojectTransformer
    ReprojectionTransformer SourceSRS TargetSRS SourceCRS TargetCRS Options BandList BandMapping SrcNoDataReal SrcNoDataImag
    DstNoDataReal DstNoDataImag
    """,
    )
)
MESHES = (".obj", ".ply", ".stl")
PARTS = re.compile(r'^(NETCDF|GPKG|GTIFF_DIR):(?:\d+:)?"?(/?[^":]+)"?(?::[^:]*)?$')  # name of one raster among several in a file
SQLITE = b"SQLite format 3\0"
SHAPEFILE, FLATGEOBUF = b"\0\0\x27\x0a", b"fgb\3"
GEODATABASE = "*.gdbtable"  # files of the folder of a file geodatabase


def is_vrt(path: Path) -> bool:
    """Whether GDAL takes a file for a virtual raster, whatever its name."""
    return VRT_MARK in header(path)


def header(path: Path) -> bytes:
    """First bytes of a file."""
    with open(path, "rb") as file:
        return file.read(HEADER)


def require_vrt_inside(path: Path, error: type[InputError]) -> list[Path]:
    """Sources of a virtual raster and of its sources. All must lie in the site folder, or without a site in the folder of the VRT.

    Raises InputError of the given kind if a VRT holds anything but plain bands of such files.
    """
    files: dict[Path, None] = {}
    _collect(path, root_of(path), error, files, 0)
    return list(files)


def _collect(path: Path, root: Path, error: type[InputError], files: dict[Path, None], depth: int) -> None:
    if depth > DEEPEST:
        raise error(f"{path}: a VRT that names VRTs, more than {DEEPEST} levels deep; {_as_tiff(path)}")
    for name, relative in _sources(_parsed(path, error), path, error):
        source = _inside(path, root, name, relative, error)
        if source in files:
            continue
        files[source] = None
        if len(files) > MOST_SOURCES:
            raise error(f"{path}: names more than {MOST_SOURCES} files; {_as_tiff(path)}")
        first = header(source)
        if VRT_MARK in first:
            _collect(source, root, error, files, depth + 1)
        elif not _plain(first):
            raise error(f"{path}: its source {name} is neither GeoTIFF, ESRI ASCII, Erdas Imagine nor VRT; {_as_tiff(path)}")


def _plain(first: bytes) -> bool:
    """Whether GDAL recognises a source by its magic number or as a plain text grid, and in no other way."""
    if first.startswith(TIFF) or first.startswith(b"EHFA_HEADER_TAG"):
        return FOREIGN.search(first) is None
    return re.match(rb"\s*(ncols|nrows|xll|dsaa|north:)", first, re.IGNORECASE) is not None and not re.search(rb'[<{"]', first)


def _parsed(path: Path, error: type[InputError]) -> "ElementTree.Element":
    from xml.etree import ElementTree

    if path.stat().st_size > LARGEST_TEXT:
        raise error(f"{path}: a VRT of {path.stat().st_size} bytes; {_as_tiff(path)}")
    text = path.read_bytes()
    if b"<!" in text.replace(b"<!--", b""):  # entities can refer to files and expand without bound
        raise error(f"{path}: a VRT with a document type or entities; {_as_tiff(path)}")
    try:
        tree = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, LookupError) as cause:
        raise error(f"{path}: is not a well-formed VRT ({cause}); {_as_tiff(path)}") from cause
    if tree.tag != "VRTDataset":
        raise error(f"{path}: holds a VRT within something else; {_as_tiff(path)}")
    return tree


def _sources(tree: "ElementTree.Element", path: Path, error: type[InputError]) -> Iterator[tuple[str, bool]]:
    """Name of every source and whether it is relative to the VRT. Elements that do more than copy bands are refused."""
    for element in tree.iter():
        kind = element.get("subClass")
        if element.tag not in KNOWN or (element.tag == "VRTDataset" and kind not in (None, "VRTWarpedDataset")):
            raise error(f"{path}: the VRT holds {kind or element.tag!r}, which is not read here; {_as_tiff(path)}")
        if element.tag == "VRTRasterBand" and kind not in BANDS:
            raise error(f"{path}: the VRT has a band of the kind {kind!r}, which is not read here; {_as_tiff(path)}")
        text = (element.get("Projection") if element.tag == "GCPList" else element.text) or ""
        if element.tag in SYSTEMS and not SYSTEM.match(text):
            fault = f"the VRT names its coordinate system {text.strip()[:80]!r}"
            raise error(f"{path}: {fault}; write WKT or a code such as EPSG:32632")
        if element.tag in SOURCES:
            yield text, element.get("relativeToVRT", "0").strip() == "1"


def _inside(path: Path, root: Path, name: str, relative: bool, error: type[InputError]) -> Path:
    """The file that a source of a VRT names."""
    if ADDRESS.search(name):
        raise error(f"{path}: its source {name!r} is no file on this machine; only files are read; {_as_tiff(path)}")
    source = Path(os.path.abspath(path.parent / name if relative else name))
    if not source.resolve().is_relative_to(root.resolve()):
        raise error(
            f"{path}: its source {name} lies outside {root}; copy it there and rebuild the VRT, or name in site.yaml the raster "
            "itself or a VRT that lies beside its sources"
        )
    if not source.is_file():
        raise error(f"{path}: its source {name} is no file; rebuild the VRT with `gdalbuildvrt`")
    return require_regular(source, error)


def _as_tiff(path: Path) -> str:
    return f"if you trust it, write it as GeoTIFF: `gdal_translate {path} elevation.tif`"


def require_json_inside(path: Path, error: type[InputError]) -> None:
    """Raise an error if a file is not JSON, or its coordinate system is a link, which GDAL would fetch."""
    size = path.stat().st_size
    if size > LARGEST_TEXT:
        raise error(f"{path}: GeoJSON of {size} bytes is too large to read; write it as GeoPackage: `ogr2ogr polygons.gpkg {path}`")

    def checked(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        for key, value in pairs:
            if key == "crs" and isinstance(value, dict) and str(value.get("type", "name")).lower() not in ("name", "epsg"):
                remedy = "which is not followed; name the system, for example EPSG:32632"
                raise error(f"{path}: its coordinate system is a link ({str(value)[:200]}), {remedy}")
        return dict(pairs)

    try:
        json.loads(path.read_bytes(), object_pairs_hook=checked)
    except json.JSONDecodeError as cause:
        place = f"line {cause.lineno}, column {cause.colno}: {cause.msg}"
        raise error(f"{path}: is not valid JSON ({place}); mend it or export it again") from cause
    except RecursionError as cause:
        raise error(f"{path}: is nested too deeply; export it again") from cause
    except ValueError as cause:  # bytes that are not text, numbers with thousands of digits
        raise error(f"{path}: is not valid JSON ({cause}); export it again") from cause


def require_geopackage_inside(path: Path, error: type[InputError]) -> None:
    """Raise an error if a GeoPackage holds views or virtual tables, which can execute what they name."""
    real = path.resolve()
    unwritten = real.with_name(real.name + "-wal")  # holds what is not yet in the file itself
    immutable = "" if unwritten.is_file() and unwritten.stat().st_size else "&immutable=1"
    try:
        with closing(sqlite3.connect(f"{path.as_uri()}?mode=ro{immutable}", uri=True)) as database:
            database.text_factory = lambda text: text.decode(errors="replace")
            entries = database.execute("SELECT type, name, sql FROM sqlite_master").fetchall()
            layers = {str(row[0]).lower() for row in database.execute("SELECT table_name FROM gpkg_contents")}
    except (sqlite3.Error, UnicodeError) as cause:  # SQLite repeats damaged names in its messages
        remedy = (
            "export it again" if immutable else "close it in other programs, or copy it and its -wal file to a folder of your own"
        )
        raise error(f"{path}: cannot be read as a GeoPackage ({cause}); {remedy}") from cause
    for kind, name, text in entries:
        if kind == "view" and str(name).lower() in layers:
            raise error(f"{path}: layer {name!r} is a view; write it as a table: `ogr2ogr polygons.gpkg {path} {name}`")
        module = re.search(r"\bUSING\s+[\"'\[`]?(\w+)", text or "", re.IGNORECASE) if kind == "table" else None
        virtual = re.match(r"\s*CREATE\s+VIRTUAL", text or "", re.IGNORECASE)
        if virtual and not (module and module.group(1).lower().startswith(("rtree", "fts"))):
            raise error(f"{path}: {name!r} is a virtual table; write the layer alone: `ogr2ogr polygons.gpkg {path} LAYER`")


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
