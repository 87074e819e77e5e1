"""Opens rasters and vectors. Only listed formats, local files and bounded sizes are accepted; no network.

An input may come from an untrusted source. GDAL can open services, archives, databases and programs that a file names. Here
the formats are listed, and references of a file are checked first (:mod:`runout.io.references`).

HDF5 files that refer to other files are refused: the library opens such files unasked. External storage, virtual datasets and
external links are found in the bytes of the file by the layout of the format (HDF5 File Format Specification 3.0, IV.A.2.g,
IV.A.2.h and IV.A.2.i) and by where they point, so that the library opens no file first.
"""

import importlib
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import InputError
from runout.io.boundary import exists, require_regular
from runout.io.georeference import FARTHEST, require_own_grids
from runout.io.references import (
    FLATGEOBUF,
    GEODATABASE,
    PARTS,
    SHAPEFILE,
    SQLITE,
    header,
    is_json,
    is_vrt,
    require_geopackage_inside,
    require_json_inside,
    require_vrt_inside,
    with_file,
)

SIGNATURE = b"\x89HDF\r\n\x1a\n"
PLACES = (0, *(512 << k for k in range(16)))  # offsets of the signature after a user block
PIECE, OVERLAP = 2**24, 64  # bytes searched at a time, and overlap of the pieces
NAME_SIZES = (1, 2, 4, 8)

Bytes = Any  # ndarray (n,) of uint8
RASTER_DRIVERS = (
    *("GTiff", "AAIGrid", "GRASSASCIIGrid", "AIG", "EHdr", "ENVI", "HFA", "SRTMHGT", "DTED", "USGSDEM", "GSAG", "GSBG", "GS7BG"),
    *("SAGA", "RST", "BT", "JP2OpenJPEG", "GPKG", "XYZ"),
)
VECTOR_DRIVERS = ("ESRI Shapefile", "GPKG", "GeoJSON", "FlatGeobuf", "OpenFileGDB")
PART_DRIVERS = {"NETCDF": "netCDF", "GPKG": "GPKG", "GTIFF_DIR": "GTiff"}
NETCDF_SUFFIXES = (".nc", ".nc4", ".cdf")
NETCDF = (b"CDF\x01", b"CDF\x02", b"CDF\x05", b"\x89HDF\r\n\x1a\n")
NO_NETWORK = {"CPL_VSIL_CURL_ALLOWED_FILENAME": "none", "GDAL_VRT_ENABLE_PYTHON": "NO", "OGR_SQLITE_ALLOW_EXTERNAL_ACCESS": "NO"}
# formats that reach services or run programs; GDAL is loaded without them
SERVICES = "WFS,OAPIF,OGCAPI,CSW,HTTP,OGR_VRT,GPSBabel,GDALG,ADBC,Elasticsearch,Carto,AmigoCloud,PLSCENES,NGW,EEDA,GTFS,MapML,PDF"
BYTES_PER_CELL = 80  # peak memory of reading, preparing and checking a raster (79 measured with 16 million cells)
MOST_FEATURES = 100_000
NAMED = 5  # broken features that a message names
BROKEN = {  # remedies by a part of the reason of GEOS
    "closed linestring": "a ring is not closed; add its first point once more at its end",
    "LinearRing": "a ring has too few points; give it three corners or more, and its first point once more at its end",
    "point array": "a line or ring has one point; give a line two, and a ring three corners and its first point once more",
}


def require_own_storage(path: Path, error: type[InputError]) -> None:
    """Raise an error if a file is HDF5 and its values lie in other files.

    Raises InputError of the given kind for external storage, virtual datasets and external links.
    """
    if path.is_dir():
        return
    status = os.stat(path)
    what = _elsewhere(path, status.st_size, status.st_mtime_ns, status.st_ino)
    if what:
        raise error(
            f"{path}: holds {what}: numbers that lie in another file, which is not read; if you trust it, write all into one "
            f"file, for example `h5repack -l CONTI {path} elevation.nc` or `ncks -4 {path} elevation.nc`"
        )


@lru_cache(maxsize=64)
def _elsewhere(path: Path, size: int, modified: int, inode: int) -> str | None:
    """Kind of reference to another file that a file holds; None if it holds none. Its status is part of the key of the cache."""
    if size < len(SIGNATURE):
        return None
    content = np.memmap(path, np.uint8, "r")
    start = next((place for place in PLACES if content[place : place + len(SIGNATURE)].tobytes() == SIGNATURE), None)
    if start is None:
        return None
    address = _size_of_addresses(content, start)
    for first in range(0, len(content), PIECE):
        piece = np.asarray(content[first : first + PIECE + OVERLAP])
        if _names_marks(content, start, first + _external(piece) + 8, address, b"HEAP"):
            return "external storage"
        if _names_marks(content, start, first + _virtual(piece) + 2, address, b"GCOL"):
            return "a virtual dataset"
        if any(_is_external_link(content, int(place)) for place in first + _links(piece)):
            return "an external link"
    return None


def _size_of_addresses(content: Bytes, start: int) -> int:
    """Bytes of an address by the superblock, at most eight."""
    version = int(content[start + 8]) if start + 8 < len(content) else 0
    place = start + (13 if version < 2 else 9)
    size = int(content[place]) if place < len(content) else 8
    return size if size in (2, 4) else 8


def _external(b: Bytes) -> Bytes:
    """Possible starts of external file messages: version 1, three zeros, slots allocated and used (two bytes each, not 0)."""
    heads = np.flatnonzero((b[:-7] == 1) & (b[1:-6] == 0) & (b[2:-5] == 0) & (b[3:-4] == 0))
    return heads[((b[heads + 4] | b[heads + 5]) != 0) & ((b[heads + 6] | b[heads + 7]) != 0)]


def _virtual(b: Bytes) -> Bytes:
    """Possible starts of layout messages of virtual datasets: version 4 to 15, class 3."""
    return np.flatnonzero((b[1:] == 3) & (b[:-1] >= 4) & (b[:-1] <= 15))


def _links(b: Bytes) -> Bytes:
    """Possible starts of external link messages: version 1, flags with link type, link type 64."""
    return np.flatnonzero((b[:-2] == 1) & (b[2:] == 64) & ((b[1:-1] & 0b1110_1000) == 8))


def _names_marks(content: Bytes, start: int, places: Bytes, size: int, mark: bytes) -> bool:
    """Whether an address [size bytes] at any of the places points to the mark."""
    places = places[places + size <= len(content)]
    places = places[content[places + size - 1] == 0] if size == 8 else places  # no file has 2^56 bytes
    target = np.full(len(places), start, np.uint64)
    for k in range(size):
        target += content[places + k].astype(np.uint64) << np.uint64(8 * k)
    target = target[target <= len(content) - len(mark)].astype(np.int64)
    matches = np.ones(len(target), bool)
    for k, byte in enumerate(mark):
        matches &= content[target + k] == byte
    return bool(matches.any())


def _is_external_link(content: Bytes, place: int) -> bool:
    """Whether a link message holds flags, a name, a length, and then file and path, both terminated by a zero."""
    flags = int(content[place + 1])
    width = NAME_SIZES[flags & 3]
    place += 3 + (8 if flags & 4 else 0) + (1 if flags & 16 else 0)
    length = int.from_bytes(content[place : place + width].tobytes(), "little")
    place += width + length
    if length == 0 or place + 2 > len(content):
        return False
    told = int.from_bytes(content[place : place + 2].tobytes(), "little")
    target = content[place + 2 : place + 2 + told].tobytes()
    return len(target) == told >= 4 and target[0] == 0 and target[-1] == 0 and target[1:-1].count(0) == 1


@contextmanager
def open_raster(name: Path | str, error: type[InputError]) -> Iterator[Any]:
    """Open rasterio dataset of a raster file. Only the file, its side files and the sources of a VRT are read.

    ``name``: file, folder of an ESRI grid, or GDAL's name of one raster of several in a file, such as ``NETCDF:"dem.nc":z``.
    ``error``: error that is raised. Raises InputError if it is not a regular file of a known format, refers to files that are not
    read, or has blocks that do not fit into the memory.
    """
    import rasterio
    from rasterio._err import CPLE_BaseError  # of damaged metadata: rasterio does not convert those of every property
    from rasterio.errors import CRSError, NotGeoreferencedWarning, RasterioError
    from rasterio.io import DatasetReader

    target, drivers = _raster_target(str(name), error)
    with rasterio.Env(**NO_NETWORK, GTIFF_REPORT_COMPD_CS=True), warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        try:
            with _proj_database():
                opened = DatasetReader(target, driver=drivers)
            with opened as dataset:
                _require_own_overviews(dataset, name, error)
                _require_real(dataset, name, error)
                require_own_grids(dataset.crs.to_wkt() if dataset.crs else "", name, error)
                _require_blocks(dataset, name, error)
                yield dataset
        except (RasterioError, CRSError, CPLE_BaseError, UnicodeError) as cause:
            remedy = "check it with `gdalinfo`, or write it as GeoTIFF"
            raise error(f"{name}: cannot be read as a raster ({cause}); {remedy}") from cause


@contextmanager
def _proj_database() -> Iterator[None]:
    """Context in which libgeotiff finds the units of PROJ: rasterio tells its database to GDAL only, and libgeotiff complains."""
    import rasterio

    folder = Path(rasterio.__file__).with_name("proj_data")
    if "PROJ_DATA" in os.environ or "PROJ_LIB" in os.environ or not folder.is_dir():
        yield
        return
    os.environ["PROJ_DATA"] = str(folder)
    try:
        yield
    finally:
        os.environ.pop("PROJ_DATA", None)


def _raster_target(name: str, error: type[InputError]) -> tuple[str, list[str]]:
    """Name that GDAL opens, and the formats that it may try."""
    part = PARTS.match(name)
    if part and not Path(name).exists():
        path = require_regular(Path(part.group(2)), error)
        require_own_storage(path, error)
        return with_file(name, path), [PART_DRIVERS[part.group(1)]]
    path = require_regular(Path(name), error)
    if path.is_dir():
        return str(path), ["AIG"]
    if is_vrt(path):
        require_vrt_inside(path, error)
        return str(path), ["VRT"]
    if header(path).startswith(SQLITE):
        require_geopackage_inside(path, error)
    return str(path), list(RASTER_DRIVERS)


def _require_own_overviews(dataset: Any, name: Path | str, error: type[InputError]) -> None:
    overview_file = dataset.tags(ns="OVERVIEWS").get("OVERVIEW_FILE")
    if overview_file:
        raise error(
            f"{name}: names the file {overview_file!r} for its overviews, which is not read; remove it with `gdaladdo -clean`"
        )


def _require_real(dataset: Any, name: Path | str, error: type[InputError]) -> None:
    wrong = [kind for kind in dataset.dtypes if kind.startswith("complex")]
    if wrong:
        raise error(f"{name}: holds complex numbers ({wrong[0]}); a raster of real numbers is needed")


def _require_blocks(dataset: Any, name: Path | str, error: type[InputError]) -> None:
    """Raise an error if the storage blocks of a raster do not fit into the memory."""
    for rows, columns in dataset.block_shapes:
        if rows * columns * BYTES_PER_CELL > _free_memory():
            remedy = f"write it in tiles: `gdal_translate -co TILED=YES {name} tiled.tif`"
            raise error(f"{name}: its cells are stored in blocks of {columns} x {rows}, too large for the memory; {remedy}")


def require_room(rows: int, columns: int, source: Path | str, error: type[InputError]) -> None:
    """Raise an error, with both numbers, if so many cells of a raster do not fit into the free memory."""
    needed, free = rows * columns * BYTES_PER_CELL, _free_memory()
    if needed > free:
        raise error(
            f"{source}: {columns} x {rows} cells need about {needed / 1e9:.3g} GB of memory to read, {free / 1e9:.3g} GB are free; "
            "state the part under study, terrain.extent: [WEST, SOUTH, EAST, NORTH] in the coordinates of the elevation raster, or "
            f"crop it: `gdal_translate -projwin WEST NORTH EAST SOUTH {source} cropped.tif`"
        )


def _free_memory() -> float:
    if find_spec("psutil") is None:
        return float(2**34)
    import psutil

    return float(psutil.virtual_memory().available)


def is_netcdf(name: str) -> bool:
    """Whether a name is that of a NetCDF file, by its suffix or its first bytes, or GDAL's name of a variable in one."""
    path = Path(name)
    if PARTS.match(name) and not exists(path):
        return name.startswith("NETCDF:")
    try:
        return name.lower().endswith(NETCDF_SUFFIXES) or (path.is_file() and header(path).startswith(NETCDF))
    except OSError:  # its reader says why it cannot be opened
        return False


@contextmanager
def open_netcdf(name: Path | str, error: type[InputError], group: str | None = None) -> Iterator[Any]:
    """Open xarray dataset of a local NetCDF file or of a group of it; times are not decoded.

    Raises InputError of the given kind if it is not a regular file or not NetCDF.
    """
    import xarray as xr

    from runout.io.netcdf import LOCK

    path = require_regular(Path(name), error)
    first = b"" if path.is_dir() else header(path)
    if not first.startswith(NETCDF) and b"\x89HDF\r\n\x1a\n" not in first:
        raise error(f"{name}: cannot be read as NetCDF (it begins like another format); check it with `ncdump -h`, or rename it")
    require_own_storage(path, error)
    remedy = "check it with `ncdump -h`"
    try:
        with LOCK:
            dataset = xr.open_dataset(path, engine="netcdf4", decode_times=False, group=group)
    except (OSError, ValueError, RuntimeError, TypeError, AttributeError) as cause:  # of attributes of wrong types, too
        raise error(f"{name}: cannot be read as NetCDF ({cause}); {remedy}") from cause
    try:
        with LOCK, dataset:
            yield dataset
    except (OSError, ValueError, RuntimeError) as cause:
        raise error(f"{name}: cannot be read as NetCDF ({cause}); {remedy}") from cause


@contextmanager
def open_groups(name: Path | str) -> Iterator[Any]:
    """Open netCDF4 dataset with all groups of a file that :func:`open_netcdf` has opened before."""
    import netCDF4

    from runout.io.netcdf import LOCK

    with LOCK, netCDF4.Dataset(name) as file:
        yield file


@dataclass(frozen=True)
class VectorFile:
    """A vector file that has passed the checks."""

    path: Path  # as stated by the caller
    target: str  # name that GDAL opens
    error: type[InputError]  # error that is raised

    def layers(self) -> list[str]:
        """Names of the layers with geometries."""
        with _reading(self) as pyogrio:
            return [str(layer) for layer, kind in pyogrio.list_layers(self.target) if kind is not None]

    def information(self, layer: str | None = None) -> dict[str, Any]:
        """Fields, number of features and driver of a layer."""
        with _reading(self) as pyogrio:
            information: dict[str, Any] = pyogrio.read_info(self.target, layer=layer)
        if information["driver"] not in VECTOR_DRIVERS:
            driver = information["driver"]
            raise self.error(f"{self.path}: is of the format {driver}, which is not read here; {_vector_remedy(self.path)}")
        return information

    def read(self, layer: str) -> tuple[Any, str]:
        """GeoDataFrame of a layer, and the name of the GDAL driver."""
        import geopandas
        from shapely.errors import ShapelyError

        information = self.information(layer)
        count = information["features"]
        if count > MOST_FEATURES:
            remedy = "cut it to the area under study"
            raise self.error(f"{self.path}: layer {layer!r} has {count} features, more than {MOST_FEATURES}; {remedy}")
        with _reading(self) as pyogrio:
            try:
                frame = geopandas.read_file(self.target, layer=layer, engine="pyogrio", on_invalid="raise")
            except ShapelyError as cause:
                broken = pyogrio.raw.read(self.target, layer=layer, columns=[])[2]
                raise self.error("\n".join(_broken(self.path, broken)) or f"{self.path}: {cause}") from cause
            require_own_grids(frame.crs.to_wkt() if frame.crs else "", self.path, self.error)
        self._require_usable(frame)
        return frame, str(information["driver"])

    def _require_usable(self, frame: Any) -> None:
        """Raise an error if a coordinate is not finite, or farther from the origin than a map reaches."""
        import numpy as np
        import shapely

        points, feature = shapely.get_coordinates(frame.geometry.to_numpy(), return_index=True)
        wrong = np.argwhere(~(np.abs(points) <= FARTHEST))
        if len(wrong):
            value, number = points[tuple(wrong[0])], int(feature[wrong[0, 0]]) + 1
            remedy = f"coordinates are finite and at most {FARTHEST:g}; correct the point, or delete the feature"
            raise self.error(f"{self.path}: feature {number} of {len(frame)} has the coordinate {value:g}; {remedy}")


def open_vector(path: Path, error: type[InputError]) -> VectorFile:
    """Vector file of a path. Only the file and its side files are read.

    Raises InputError of the given kind if it is not a regular file of a known format, or refers to files that are not read.
    """
    absolute = require_regular(path, error)
    if absolute.is_dir():
        if not any(absolute.glob(GEODATABASE)):
            raise error(f"{path}: is a folder; name the vector file in it")
        return VectorFile(path, _uri(absolute, error), error)
    first = header(absolute)
    if first.startswith(SQLITE):
        require_geopackage_inside(absolute, error)
    elif is_json(first):
        require_json_inside(absolute, error)
    elif not first.startswith((FLATGEOBUF, SHAPEFILE)):
        reason = "of an unknown format, or a table with no geometries"
        raise error(f"{path}: cannot be read as a vector file ({reason}); {_vector_remedy(path)}")
    return VectorFile(path, _uri(absolute, error), error)


def _uri(path: Path, error: type[InputError]) -> str:
    """Name of a vector file that pyogrio, which reads names as addresses, opens as this file."""
    _pyogrio()
    from pyogrio.util import vsi_path

    for name in (str(path), f"file://{path}"):  # an address may hold a semicolon
        if vsi_path(name) == str(path):
            return name
    raise error(f"{path}: a vector file cannot be read under this name; rename it or its folder without !")


def _broken(path: Path, encoded: Any) -> Iterator[str]:
    """Messages on the first features whose geometry (WKB) cannot be read, each with its remedy."""
    import shapely
    from shapely.errors import ShapelyError

    count = 0
    for number, one in enumerate(encoded, 1):
        try:
            shapely.from_wkb(one)
        except ShapelyError as cause:
            count += 1
            if count <= NAMED:
                reason = str(cause).strip().removeprefix("IllegalArgumentException: ")
                remedy = next((words for sign, words in BROKEN.items() if sign in reason), "draw it anew")
                yield f"{path}: feature {number} has a broken geometry ({reason}); {remedy}"
    if count > NAMED:
        yield f"{path}: {count - NAMED} features more have a broken geometry"


def _vector_remedy(path: Path) -> str:
    return f"use GeoPackage, Shapefile, GeoJSON or FlatGeobuf, unpacked: `ogr2ogr polygons.gpkg {path}`"


@contextmanager
def _reading(file: VectorFile) -> Iterator[Any]:
    """Context of pyogrio without network that converts errors of pyogrio, pyproj and shapely into that of the file."""
    pyogrio = _pyogrio()
    from pyogrio.errors import DataLayerError, DataSourceError
    from pyproj.exceptions import ProjError

    before = {name: pyogrio.get_gdal_config_option(name) for name in NO_NETWORK}
    pyogrio.set_gdal_config_options(NO_NETWORK)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # warnings of GDAL; the result is checked instead
            yield pyogrio
    except (DataSourceError, DataLayerError, ProjError, UnicodeError) as cause:
        remedy = "use GeoPackage, Shapefile or GeoJSON"
        raise file.error(f"{file.path}: cannot be read as a vector file ({cause}); {remedy}") from cause
    finally:
        pyogrio.set_gdal_config_options(before)


def _pyogrio() -> Any:
    """Import pyogrio without the formats that reach services."""
    if "pyogrio" not in sys.modules:
        skipped = os.environ.get("OGR_SKIP")
        os.environ["OGR_SKIP"] = SERVICES if skipped is None else f"{skipped},{SERVICES}"
        try:
            importlib.import_module("pyogrio")
        finally:
            os.environ.pop("OGR_SKIP")
            os.environ.update({} if skipped is None else {"OGR_SKIP": skipped})
    return importlib.import_module("pyogrio")
