"""Coordinates and grid mapping of a raster for CF and GDAL."""

import math
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.io.crs import longitude_latitude
from runout.model.terrain import Terrain

if TYPE_CHECKING:
    import pyproj
    import xarray as xr

UNNAMED = "latitude_longitude"  # grid mapping of CF that states only the ellipsoid


def grid_dataset(terrain: Terrain) -> "xr.Dataset":
    """Dataset with the cell centres ``x`` ascending, ``y`` descending [m], and the variable ``crs`` unless the system is local.

    If CF does not define the projection, also ``longitude`` and ``latitude`` [degree] of the middle of the raster.
    """
    import xarray as xr

    coordinates = {
        "x": xr.Variable("x", terrain.easting, _axis("x", "easting of the cell centre")),
        "y": xr.Variable("y", terrain.northing, _axis("y", "northing of the cell centre")),
    }
    if terrain.crs is not None:
        attributes = grid_mapping(terrain.crs) | {"GeoTransform": geo_transform(terrain)}
        coordinates["crs"] = xr.Variable((), np.int32(0), attributes)
        if attributes["grid_mapping_name"] == UNNAMED:
            coordinates |= _middle(terrain)
    return crs_as_variable(xr.Dataset(coords=coordinates))


def crs_as_variable(dataset: "xr.Dataset") -> "xr.Dataset":
    """The dataset with ``crs``, if it has one, as a variable: the title of a plot names every scalar coordinate."""
    return dataset.reset_coords("crs") if "crs" in dataset.coords else dataset


def _middle(terrain: Terrain) -> "dict[str, xr.Variable]":
    """Longitude and latitude of the middle of the raster, which this grid mapping requires."""
    import xarray as xr

    west, south, east, north = terrain.extent
    place = longitude_latitude(horizontal_crs(str(terrain.crs)), 0.5 * (west + east), 0.5 * (south + north))
    return {
        name: xr.Variable((), value, {"standard_name": name, "units": units, "long_name": f"{name} of the middle of the raster"})
        for name, value, units in zip(("longitude", "latitude"), place, ("degrees_east", "degrees_north"), strict=True)
    }


def _axis(name: str, long_name: str) -> dict[str, str]:
    standard_name = f"projection_{name}_coordinate"  # otherwise the CF checker takes an axis for longitude or latitude
    described = {"units": "m", "axis": name.upper(), "standard_name": standard_name, "long_name": long_name}
    return described | {"coverage_content_type": "coordinate"}


def geo_transform(terrain: Terrain) -> str:
    """GDAL's affine transform as text: west, width, 0, north, 0, minus height [m]."""
    west, _, _, north = terrain.extent
    dx, dy = terrain.cell_size
    return " ".join(repr(float(v)) for v in (west, dx, 0.0, north, 0.0, -dy))


def grid_mapping(crs: str) -> dict[str, Any]:
    """Attributes of the grid mapping variable: parameters of CF, and WKT for complete definitions."""
    from pyproj.exceptions import CRSError

    horizontal = horizontal_crs(crs)
    with warnings.catch_warnings():  # CF has no parameter for the rotation of Swiss LV95; crs_wkt and spatial_ref keep it
        warnings.simplefilter("ignore", UserWarning)
        try:
            attributes = _with_degrees(horizontal).to_cf()
        except KeyError:  # pyproj does not write each projection that it reads, such as vertical_perspective
            attributes = {}
    if "grid_mapping_name" not in attributes:
        attributes = _figure_of_the_earth(horizontal) | attributes | {"grid_mapping_name": UNNAMED}
    attributes["crs_wkt"] = horizontal.to_wkt()
    if "azimuth_of_central_line" in attributes:
        attributes["azimuth"] = attributes["azimuth_of_central_line"]
    try:
        attributes["spatial_ref"] = horizontal.to_wkt("WKT1_GDAL")
    except CRSError:  # systems that WKT1 cannot express; crs_wkt is complete
        attributes["spatial_ref"] = horizontal.to_wkt()
    return attributes | {"long_name": f"coordinate reference system: {horizontal.name}"}


def _with_degrees(system: "pyproj.CRS") -> "pyproj.CRS":
    """The system with its angles in degrees, the unit of CF; pyproj writes the numbers as they are."""
    from pyproj import CRS

    document = system.to_json_dict()
    converted = _in_degrees(document)
    return system if converted == document else CRS.from_json_dict(converted)


def _in_degrees(part: Any) -> Any:
    """Part of a PROJJSON document with angles in degrees."""
    if isinstance(part, list):
        return [_in_degrees(one) for one in part]
    if not isinstance(part, dict):
        return part
    unit = part.get("unit")
    if "value" in part and isinstance(unit, dict) and unit.get("type") == "AngularUnit":
        return part | {"value": math.degrees(part["value"] * unit["conversion_factor"]), "unit": "degree"}
    return {key: _in_degrees(value) for key, value in part.items()}


def _figure_of_the_earth(horizontal: "pyproj.CRS") -> dict[str, Any]:
    """CF parameters of the datum for projections that CF does not define, such as Krovak or double stereographic."""
    named = _with_degrees(horizontal.geodetic_crs).to_cf() if horizontal.geodetic_crs else {}
    return named | {"comment": "CF has no name for this projection: crs_wkt holds it, the parameters tell the figure of the Earth"}


def horizontal_crs(crs: str) -> "pyproj.CRS":
    """The horizontal part of a coordinate reference system."""
    from pyproj import CRS

    system = CRS.from_user_input(crs)
    return system.sub_crs_list[0] if system.is_compound else system


def extent_attributes(terrain: Terrain) -> dict[str, Any]:
    """Global attributes of geographic extent and, if stated, vertical datum; empty for a local system."""
    from pyproj import CRS, Transformer

    if terrain.crs is None:
        return {}
    to_geographic = Transformer.from_crs(horizontal_crs(terrain.crs), CRS("EPSG:4326"), always_xy=True)
    west, south, east, north = to_geographic.transform_bounds(*terrain.extent)
    return {
        "geospatial_lat_min": south,
        "geospatial_lat_max": north,
        "geospatial_lat_units": "degrees_north",
        "geospatial_lat_resolution": f"{terrain.cell_size[1]:g} m",
        "geospatial_lon_min": west,
        "geospatial_lon_max": east,
        "geospatial_lon_units": "degrees_east",
        "geospatial_lon_resolution": f"{terrain.cell_size[0]:g} m",
        "geospatial_bounds": _corners(terrain.extent, to_geographic),
        "geospatial_bounds_crs": "EPSG:4326",
    } | _vertical_datum(terrain)


def _corners(extent: tuple[float, float, float, float], to_geographic: "pyproj.Transformer") -> str:
    """Polygon of the corners as WKT, latitude first as in EPSG:4326."""
    west, south, east, north = extent
    easting, northing = [west, east, east, west, west], [south, south, north, north, south]
    longitude, latitude = to_geographic.transform(easting, northing)
    return "POLYGON ((" + ", ".join(f"{y:.7f} {x:.7f}" for x, y in zip(longitude, latitude, strict=True)) + "))"


def _vertical_datum(terrain: Terrain) -> dict[str, str]:
    """Vertical datum of the terrain, as stated or from its compound system; empty if unknown."""
    from pyproj import CRS

    system = CRS.from_user_input(terrain.crs)
    if system.is_compound:
        vertical = system.sub_crs_list[1]
        authority = vertical.to_authority()
        code = ":".join(authority) if authority else vertical.name
        return {"vertical_datum": vertical.name, "geospatial_bounds_vertical_crs": code}
    if terrain.vertical_datum is None:
        return {}
    _, coded, code = terrain.vertical_datum.removesuffix(")").partition(" (EPSG:")
    return {"vertical_datum": terrain.vertical_datum} | ({"geospatial_bounds_vertical_crs": f"EPSG:{code}"} if coded else {})
