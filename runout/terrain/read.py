"""Reading elevation rasters: GeoTIFF, ESRI ASCII, NetCDF, anything GDAL reads, arrays, and the sample of matplotlib."""

import difflib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from runout.errors import DemError
from runout.io import crs as coordinate_systems
from runout.io.boundary import as_path, exists, kind_of, names_in
from runout.io.elevation_raster import ElevationRaster, Header
from runout.io.georeference import require_usable
from runout.io.mesh_files import MESHES, OTHER_MESHES
from runout.io.opening import PARTS, is_netcdf, open_raster
from runout.io.source_kinds import sample_path
from runout.io.window import Bounds
from runout.model.arrays import real_array, real_pair, shown
from runout.model.terrain import Terrain
from runout.terrain import prepare

SAMPLE = "matplotlib:jacksboro_fault_dem"
SURFACES = (*MESHES, *OTHER_MESHES)


def read_terrain(path: str | PathLike[str], crs: Any = None, extent: Bounds | None = None) -> Terrain:
    """Terrain of an elevation raster, checked and in metres.

    Parameters
    ----------
    path : path or str
        GeoTIFF, ESRI ASCII grid, NetCDF or anything else that GDAL opens, or ``"matplotlib:jacksboro_fault_dem"``
        for the sample that matplotlib ships.
    crs : anything that pyproj understands, optional
        Coordinate reference system of a raster that states none.
    extent : tuple of float, optional
        West, south, east and north edge of what is read, in the coordinates of the file; whole cells, the rest is not touched.

    Returns
    -------
    Terrain
        North up, elevation in metres (float64), NaN where unknown. ``changes`` lists what was done on the way.

    Raises
    ------
    DemError
        If the file is missing or unreadable, or its georeference, units or values cannot be used as they are.
    """
    text, extent = _text_of(path), real_extent(extent)
    if text.startswith("matplotlib:"):
        raster = _cropped(_sample(text), extent)
    else:
        with _opened(text) as source:
            raster = source.read(extent)
    return prepare.terrain(coordinate_systems.with_stated(raster, crs))


def read_header(path: str | PathLike[str], crs: Any = None) -> Header:
    """What the file of an elevation raster states; no value is read. Parameters and errors as of :func:`read_terrain`."""
    text = _text_of(path)
    if text.startswith("matplotlib:"):
        sample = _sample(text)
        return Header(sample.transform, sample.values.shape, sample.crs, text)  # type: ignore[arg-type]
    with _opened(text) as source:
        header = source.header
    return header if crs is None or header.crs else replace(header, crs=coordinate_systems.parse(crs, text))


def real_extent(extent: Any) -> Bounds | None:
    """West, south, east and north as numbers; DemError unless they are finite and in order."""
    if extent is None:
        return None
    edges = real_array(extent, "extent", DemError)
    if edges.shape != (4,) or not np.isfinite(edges).all() or edges[0] >= edges[2] or edges[1] >= edges[3]:
        raise DemError(f"extent is {shown(extent)}; it must be west, south, east and north, with west < east and south < north")
    return tuple(edges.tolist())  # type: ignore[return-value]


class _Source(Protocol):
    """An open elevation raster."""

    header: Header

    def read(self, extent: Bounds | None) -> ElevationRaster:
        """The cells of an extent."""


@contextmanager
def _opened(text: str) -> Iterator[_Source]:
    if text.lower().endswith(SURFACES):
        remedy = "give a mesh as OBJ, PLY or STL in site.yaml (terrain.dem with terrain.resolution), or to Terrain.from_mesh"
        raise DemError(f"{text}: is a mesh, not a raster; {remedy}")
    path = text if _is_gdal_name(text) else _existing(text)
    if is_netcdf(path):
        from runout.terrain.netcdf import open_elevation

        with open_elevation(path) as source:
            yield source
    else:
        with open_raster(path, DemError) as dataset:
            yield GdalElevation(dataset, path)


def _text_of(path: str | PathLike[str]) -> str:
    return fspath(as_path(path, DemError)) if not isinstance(path, str) else path


def _cropped(raster: ElevationRaster, extent: Bounds | None) -> ElevationRaster:
    """The part of a raster that has been read already."""
    header = Header(raster.transform, raster.values.shape, raster.crs, raster.source)  # type: ignore[arg-type]
    part = header.part(extent, DemError)
    changes = (*raster.changes, *header.said(part))
    return replace(raster, values=raster.values[part.slices], transform=part.transform(raster.transform), changes=changes)


def terrain_from_array(
    elevation: np.ndarray, cell_size: float | tuple[float, float], crs: Any = None, origin: tuple[float, float] = (0.0, 0.0)
) -> Terrain:
    """Terrain of an array (rows, columns) [m], north-west corner first; masked cells and usual nodata values become NaN.

    ``cell_size`` [m] is one number or ``(east-west, north-south)``; ``origin`` is the map position [m] of the outer
    south-west corner; ``crs`` names a projected system in metres.
    """
    dx, dy = real_pair(cell_size, "array: cell_size", DemError)
    if np.shape(origin) != (2,):
        raise DemError(f"array: origin is {shown(origin)}; it must be the finite easting and northing of the south-west corner")
    west, south = real_pair(origin, "array: origin", DemError)
    require_usable((dx, 0.0, west, 0.0, -dy, south), "array", DemError)
    values, changes = prepare.known_or_nan(real_array(elevation, "array: elevation", DemError), "array")
    system = None if crs is None else coordinate_systems.parse(crs, "array")
    wkt = None if system is None else coordinate_systems.projected_in_metres(system, "array").to_wkt()
    height = coordinate_systems.vertical_name(system)
    return Terrain(values, (dx, dy), west, south, wkt, "array", changes, None, height)


def _is_gdal_name(text: str) -> bool:
    """Whether a text is GDAL's name of one raster of several in a file."""
    return PARTS.match(text) is not None and not exists(Path(text))


def _existing(text: str) -> str:
    path = Path(text)
    is_folder = exists(path) and path.is_dir()
    if exists(path) and path.is_file():
        return text
    if is_folder and (path / "hdr.adf").is_file():  # an ESRI grid is a folder
        return text
    if is_folder:
        raise DemError(f"{text}: is a folder; name the raster file in it")
    if kind_of(path):
        raise DemError(f"{text}: is {kind_of(path)}, not a file; copy the elevations to a file and name that")
    near = difflib.get_close_matches(path.name, names_in(path.parent), 1)
    remedy = f"did you mean {near[0]!r}?" if near else "check the path of the elevation raster"
    raise DemError(f"{text}: no such file; {remedy}")


class GdalElevation:
    """An open rasterio dataset whose one band, besides transparency, is the elevation."""

    def __init__(self, dataset: Any, text: str):
        from rasterio.enums import ColorInterp

        meanings = zip(dataset.indexes, dataset.colorinterp, strict=True)
        self.dataset, self.alpha = dataset, [index for index, meaning in meanings if meaning == ColorInterp.alpha]
        _require_one_band(dataset, text, dataset.count - len(self.alpha))
        _require_georeference(dataset, text)
        transform = tuple(dataset.transform)[:6]
        require_usable(transform, text, DemError)
        system = coordinate_systems.of_raster(dataset.crs, text) if dataset.crs else None
        self.header = Header(transform, (dataset.height, dataset.width), system, text)

    def read(self, extent: Bounds | None) -> ElevationRaster:
        """The cells of an extent."""
        dataset, header = self.dataset, self.header
        part = header.part(extent, DemError)
        band = dataset.read(1, window=part.window, masked=True)
        values = np.ma.filled(band.astype(np.float64), np.nan)
        for index in self.alpha:  # GDAL itself heeds transparency only where it is stored as whole numbers
            values[dataset.read(index, window=part.window) == 0] = np.nan
        place = part.transform(header.transform)
        raster = ElevationRaster(values, place, header.crs, dataset.units[0] or None, header.source, header.said(part))
        scale, offset = dataset.scales[0], dataset.offsets[0]
        if (scale, offset) != (1.0, 0.0):
            packing = f"the file stores packed numbers; elevation = {scale:g} x number + {offset:g}"
            raster = raster.noted(packing, values=values * scale + offset)
        elif np.issubdtype(band.dtype, np.integer):
            raster = raster.noted(f"elevations are whole numbers ({band.dtype}); slopes are stepped by one unit a cell")
        return raster


def _require_one_band(dataset: Any, text: str, bands: int) -> None:
    if dataset.subdatasets and bands == 0:
        names = dataset.subdatasets
        raise DemError(f"{text}: holds {len(names)} rasters; name one of them, for example {names[0]!r}")
    if bands != 1:
        remedy = f"`gdal_translate -b 1 {text} elevation.tif`"
        raise DemError(f"{text}: has {bands} bands and does not say which is the elevation; extract it, for example {remedy}")


def _require_georeference(dataset: Any, text: str) -> None:
    if dataset.transform.is_identity:
        remedy = f"`gdal_translate -a_ullr WEST NORTH EAST SOUTH -a_srs EPSG:CODE {text} elevation.tif`"
        points = " (only ground control points; warp it first)" if dataset.gcps[0] else ""
        raise DemError(f"{text}: has no georeference{points}; add one, for example {remedy}")


def _sample(text: str) -> ElevationRaster:
    """Jacksboro fault, Tennessee, as matplotlib ships it: geographic, 3 arc-seconds, whole metres.

    The file's ``ymax`` is the northern edge, but its ``ymin`` lies as far north of it as it should lie south (a wrong sign), so
    ``ymin`` is not used. The summit (1076 m) then meets Cross Mountain (1077 m; 36.1983 N, 84.2306 W) to a cell.
    """
    from pyproj import CRS

    if text != SAMPLE:
        raise DemError(f"{text}: not an elevation sample of matplotlib; the only one is {SAMPLE!r}")
    path = sample_path(text)
    if path is None or not path.is_file():
        raise DemError(f"{text}: matplotlib with its sample data is not installed; `pip install matplotlib`")
    with np.load(path) as sample:
        values = sample["elevation"].astype(np.float64)
        west, north = float(sample["xmin"]), float(sample["ymax"])
        dx, dy = float(sample["dx"]), float(sample["dy"])
    raster = ElevationRaster(values, (dx, 0.0, west, 0.0, -dy, north), CRS.from_epsg(4326), "m", text)
    raster = raster.noted("the file's ymin has a wrong sign and is not used; its ymax is the northern edge, as its summit shows")
    return raster.noted("elevations are whole numbers (int16); slopes are stepped by one unit a cell")
