"""Reading elevation rasters: GeoTIFF, ESRI ASCII, NetCDF, anything GDAL reads, arrays, and the sample of matplotlib."""

from dataclasses import replace
from os import PathLike, fspath
from typing import Any

import numpy as np

from runout.errors import DemError
from runout.io import crs as coordinate_systems
from runout.io.boundary import as_path
from runout.io.elevation_raster import ElevationRaster, Header
from runout.io.georeference import require_usable
from runout.io.references import sample_path
from runout.io.window import Bounds
from runout.model.arrays import real_array, real_pair, shown
from runout.model.terrain import Terrain
from runout.terrain import prepare
from runout.terrain.source import ELEVATION, open_source

SAMPLE = "matplotlib:jacksboro_fault_dem"


def read_terrain(path: str | PathLike[str], crs: Any = None, extent: Bounds | None = None) -> Terrain:
    """Terrain of an elevation raster, checked and in metres; parameters as in :meth:`runout.Terrain.from_raster`.

    Any raster that GDAL opens, or ``matplotlib:jacksboro_fault_dem``, the sample that matplotlib ships. North up, in float64, NaN
    where unknown. ``changes`` lists what was done on the way. Raises DemError if the file is missing or unreadable, or its
    georeference, units or values cannot be used as they are.
    """
    text, extent = _text_of(path), real_extent(extent)
    if text.startswith("matplotlib:"):
        raster = _cropped(_sample(text), extent)
    else:
        with open_source(text, ELEVATION) as source:
            raster = source.read(extent)
    return prepare.terrain(coordinate_systems.with_stated(raster, crs))


def read_header(path: str | PathLike[str], crs: Any = None) -> Header:
    """What the file of an elevation raster states; no value is read. Parameters and errors as of :func:`read_terrain`."""
    text = _text_of(path)
    if text.startswith("matplotlib:"):
        sample = _sample(text)
        return Header(sample.transform, sample.values.shape, sample.crs, text)  # type: ignore[arg-type]
    with open_source(text, ELEVATION) as source:
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


def _text_of(path: str | PathLike[str]) -> str:
    return fspath(as_path(path, DemError)) if not isinstance(path, str) else path


def _cropped(raster: ElevationRaster, extent: Bounds | None) -> ElevationRaster:
    """The part of a raster that has been read already."""
    header = Header(raster.transform, raster.values.shape, raster.crs, raster.source)  # type: ignore[arg-type]
    part = header.part(extent, DemError)
    changes = (*raster.changes, *header.sentences(part))
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
