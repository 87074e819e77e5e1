"""Coordinate reference systems of elevation rasters: parsing, validity and UTM zone."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from runout.errors import DemError
from runout.io.elevation_raster import ElevationRaster
from runout.io.georeference import require_own_grids

LARGEST_SCALE_ERROR = 0.02  # largest of national and continental systems; that of Web Mercator is 24 % at 36 degrees
REMARKABLE_SCALE_ERROR = 0.005  # UTM has less than 0.001 in its zone
NO_DATUM = ("unknown", "undefined", "not specified", "unspecified")  # names of PROJ, Esri and EPSG for an unknown datum
LARGEST_SHIFT = 0.02  # between the longitudes and latitudes of one place in two datums [deg]
WIDEST = 6.0  # width of a UTM zone [degrees of longitude]


def parse(crs: Any, source: str) -> Any:
    """pyproj CRS of a code, WKT, PROJ text, PROJJSON or object; DemError if it is not known."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    require_own_grids(str(crs), source, DemError)  # before PROJ opens any file
    try:
        # systems that pyproj builds from parts, such as those of CRS.from_cf, have no horizontal part until they are plain ones
        system = CRS.from_wkt(crs.to_wkt()) if isinstance(crs, CRS) and type(crs) is not CRS else CRS.from_user_input(crs)
        horizontal(system)  # some systems can be parsed but not inspected
    except (CRSError, TypeError, UnicodeError) as error:
        raise DemError(f"{source}: crs {crs!r} is not known ({error}); write for example EPSG:32632") from error
    require_own_grids(system.to_wkt(), source, DemError)
    return system


def of_raster(crs: Any, source: str) -> Any:
    """pyproj CRS of a rasterio CRS."""
    return parse(crs.to_wkt(), source)


def with_stated(raster: ElevationRaster, crs: Any) -> ElevationRaster:
    """The raster with the stated system; DemError if the file states another one."""
    if crs is None:
        return raster.noted(raster.assumption) if raster.assumption else raster
    system = parse(crs, raster.source)
    if raster.crs is None:
        return raster.noted(f"the file states no coordinate system; {system.name} as given", crs=system)
    if raster.assumption and _differs_in_datum_only(system, raster):
        return raster.noted(f"the file names no datum; {system.name} as given", crs=system)
    if same(raster.crs, system) and vertical_name(raster.crs) is None:
        return replace(raster, crs=system)  # the stated system may add a vertical datum
    if not same(raster.crs, system):
        remedy = "leave crs away, or write the right one into the file with `gdal_edit.py -a_srs`"
        raise DemError(f"{raster.source}: the file states {raster.crs.name}, crs says {system.name}; {remedy}")
    return raster


def _differs_in_datum_only(system: Any, raster: ElevationRaster) -> bool:
    """Whether a system gives the middle of a raster the longitude and latitude of its own one, but for the shift of a datum."""
    if is_local(system) or horizontal(system).is_geographic != horizontal(raster.crs).is_geographic:
        return False
    one, other = (np.array(longitude_latitude(horizontal(crs), *raster.centre)) for crs in (system, raster.crs))
    return bool(np.abs(one - other).max() < LARGEST_SHIFT)


def same(one: Any, other: Any) -> bool:
    """Whether two systems have the same horizontal coordinates; the order of axes is ignored."""
    a, b = horizontal(one), horizontal(other)
    if a.equals(b, ignore_axis_order=True):
        return True
    code = a.to_epsg(min_confidence=70)
    return code is not None and code == b.to_epsg(min_confidence=70)


def names_datum(crs: Any) -> bool:
    """Whether a system states its datum or a transformation to WGS 84, not only an ellipsoid."""
    if crs.is_bound:
        return True
    datum = crs.datum
    return datum is not None and not datum.name.lower().replace("_", " ").removeprefix("d ").startswith(NO_DATUM)


def same_ellipsoid(one: Any, other: Any) -> bool:
    """Whether two systems have the same ellipsoid."""
    a, b = one.ellipsoid, other.ellipsoid
    if a is None or b is None:
        return False
    return abs(a.semi_major_metre - b.semi_major_metre) < 1e-3 and abs(a.inverse_flattening - b.inverse_flattening) < 1e-6


def vertical_name(crs: Any) -> str | None:
    """Name of the vertical datum of a system; None if it states none."""
    upward = vertical(crs)
    if upward is not None:
        code = upward.to_epsg(min_confidence=70)
        return f"{upward.name} (EPSG:{code})" if code else str(upward.name)
    if crs is not None and not crs.is_compound and len(crs.axis_info) == 3:
        return f"height above the ellipsoid of {crs.name}"
    return None


def horizontal(crs: Any) -> Any:
    """The horizontal part of a system."""
    if crs.is_compound:
        return crs.sub_crs_list[0].to_2d()
    return crs.to_2d()


def vertical(crs: Any) -> Any:
    """Vertical part of a compound system; None for other systems."""
    parts = crs.sub_crs_list if crs is not None and crs.is_compound else []
    return next((part for part in parts if part.is_vertical), None)


def is_local(crs: Any) -> bool:
    """Whether a system is local: without a known position on Earth."""
    return crs.is_engineering or not (crs.is_projected or crs.is_geographic)


def metres_per_unit(crs: Any) -> float:
    """Metres in one unit of the first axis of a system that is not geographic [m]."""
    return float(crs.axis_info[0].unit_conversion_factor) if crs.axis_info else 1.0


def projected_in_metres(crs: Any, source: str) -> Any:
    """Horizontal part of a projected system in metres; DemError for other systems."""
    flat = horizontal(crs)
    if not flat.is_projected or metres_per_unit(flat) != 1.0:
        raise DemError(f"{source}: {crs.name} is not a projected system in metres; project the elevations, for example to UTM")
    return flat


def require_east_and_north(crs: Any, source: str) -> None:
    """Raise DemError if the axes of a system point west and south: files in such systems differ in the signs of coordinates."""
    if {axis.direction for axis in crs.axis_info} == {"west", "south"}:
        remedy = "warp it to a system with eastings and northings, for example `gdalwarp -t_srs EPSG:CODE` of the UTM zone"
        raise DemError(f"{source}: the axes of {crs.name} point west and south; {remedy}")


def longitude_latitude(crs: Any, x: Any, y: Any) -> tuple[Any, Any]:
    """Longitude from Greenwich and latitude [deg] of map positions in the datum of the system."""
    longitude, latitude = _geodetic(crs, x, y)
    return longitude + degrees_of_prime_meridian(crs), latitude


def degrees_of_prime_meridian(crs: Any) -> float:
    """Longitude of the prime meridian of a system from Greenwich [deg]."""
    meridian = crs.geodetic_crs.prime_meridian if crs.geodetic_crs else None
    return 0.0 if meridian is None else math.degrees(meridian.longitude * meridian.unit_conversion_factor)


def _geodetic(crs: Any, x: Any, y: Any) -> tuple[Any, Any]:
    """Longitude from the prime meridian of a system, and latitude [deg], of map positions in its datum."""
    from pyproj import Transformer

    geodetic = crs.geodetic_crs
    while geodetic.is_derived:  # a rotated pole
        geodetic = geodetic.source_crs
    degrees = math.degrees(geodetic.axis_info[0].unit_conversion_factor)
    longitude, latitude = Transformer.from_crs(crs, geodetic, always_xy=True).transform(x, y)
    return np.multiply(longitude, degrees), np.multiply(latitude, degrees)


def scale_error(crs: Any, x: float, y: float) -> float:
    """Largest relative error [1] of distances in a projected system at a map position."""
    from pyproj import Proj
    from pyproj.exceptions import ProjError

    try:
        factors = Proj(crs).get_factors(*_geodetic(crs, x, y))  # it takes longitudes from the meridian of the system
    except ProjError as error:
        raise DemError(
            f"the coordinate system {crs.name} cannot be used in computations ({error}); write for example EPSG:32632"
        ) from error
    return max(abs(factors.tissot_semimajor - 1.0), abs(factors.tissot_semiminor - 1.0))


def _usual_zone(longitude: float, latitude: float) -> Any:
    """UTM system of WGS 84 in whose area of use a position [deg] lies, by its number; None on a rim. The database takes 0.1 s."""
    from pyproj import CRS

    zone = math.floor((longitude + 180.0) / 6.0) + 1
    if not (1 <= zone <= 60 and -80.0 < latitude < 84.0):
        return None
    system = CRS.from_epsg((32600 if latitude >= 0.0 else 32700) + zone)
    area: Any = system.area_of_use
    inside = area.west < longitude < area.east and area.south < latitude < area.north
    return system if inside else None


def utm_for(crs: Any, longitude: float, latitude: float, source: str) -> Any:
    """UTM system of the zone of a position [deg], in the datum of ``crs`` if UTM zones are defined for it, else in WGS 84."""
    from pyproj import CRS
    from pyproj.aoi import AreaOfInterest
    from pyproj.database import query_utm_crs_info

    longitude = (longitude + 180.0) % 360.0 - 180.0
    if crs.geodetic_crs.name == "WGS 84" and (usual := _usual_zone(longitude, latitude)):
        return usual
    place = AreaOfInterest(longitude, latitude, longitude, latitude)
    for datum in (crs.geodetic_crs.name, "WGS 84"):
        candidates = [c for c in query_utm_crs_info(datum, place) if c.name.startswith(f"{datum} / UTM zone") and "(" not in c.name]
        if candidates:
            return CRS.from_authority(candidates[0].auth_name, candidates[0].code)
    remedy = "project it first, for example `gdalwarp -t_srs EPSG:3413` (north) or EPSG:3031 (south)"
    raise DemError(f"{source}: no UTM zone covers longitude {longitude:.3f}, latitude {latitude:.3f}; {remedy}")
