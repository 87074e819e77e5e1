"""Reading elevation from NetCDF with xarray.

GDAL drops the coordinates of a variable that names no grid mapping, and then places the raster at the origin; the coordinate
variables themselves say more.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from runout.errors import DemError
from runout.io.crs import parse
from runout.io.elevation_raster import ElevationRaster, Header
from runout.io.georeference import require_usable
from runout.io.opening import open_netcdf
from runout.io.window import Bounds

AXES = {
    "x": ("x", "lon", "longitude", "easting", "projection_x_coordinate"),
    "y": ("y", "lat", "latitude", "northing", "projection_y_coordinate"),
}
UNEVEN = 1e-3  # of a cell; single-precision coordinates stay below it


@contextmanager
def open_elevation(text: str, names: Sequence[str], what: str) -> "Iterator[NetcdfElevation]":
    """The open raster of a NetCDF file: its only two-dimensional variable, or the first with one of the ``names``.

    Any order of rows, columns and dimensions. DemError if the file cannot be read, the variable cannot be told, or the
    coordinates are missing or uneven.
    """
    with open_netcdf(text, DemError) as dataset:
        yield NetcdfElevation(dataset, text, names, what)


class NetcdfElevation:
    """The elevation of an open xarray dataset."""

    def __init__(self, dataset: Any, text: str, names: Sequence[str], what: str):
        variable = _variable(dataset, text, names, what).squeeze(drop=True)
        x, y = (_coordinate(variable, axis, text) for axis in ("x", "y"))
        self.variable = variable.transpose(y.name, x.name)
        dx, dy = _step(x, text), _step(y, text)
        transform = (dx, 0.0, float(x.values[0]) - dx / 2, 0.0, dy, float(y.values[0]) - dy / 2)
        require_usable(transform, text, DemError)
        mapping = _grid_mapping(dataset, variable)
        system = _crs(mapping, x, text)
        self.unnamed = system is None and _in_degrees(x)
        system = parse("EPSG:4326", text) if self.unnamed else system
        self.header = Header(_exact_transform(transform, mapping), self.variable.shape, system, text)

    def read(self, extent: Bounds | None) -> ElevationRaster:
        """The cells of an extent."""
        header, variable = self.header, self.variable
        part = header.part(extent, DemError)
        unit = str(variable.attrs.get("units", "")) or None
        if variable.encoding.get("scale_factor", 1.0) == 0:
            raise DemError(f"{header.source}: variable {variable.name!r} has the scale_factor 0; write it anew with the right one")
        values = np.array(variable[part.slices].values, dtype=np.float64)
        raster = ElevationRaster(values, part.transform(header.transform), header.crs, unit, header.source, header.said(part))
        return raster.noted("coordinates are degrees of an unnamed datum; taken as WGS 84") if self.unnamed else raster


def _variable(dataset: Any, text: str, names: Sequence[str], what: str) -> Any:
    flat = [
        v for v in dataset.data_vars.values()
        if sum(n > 1 for n in v.shape) == 2 and np.issubdtype(v.dtype, np.number)
    ]  # fmt: skip
    for name in names:
        for variable in flat:
            if name in (str(variable.name).lower(), variable.attrs.get("standard_name")):
                return variable
    if len(flat) == 1:
        return flat[0]
    held = ", ".join(str(v.name) for v in flat) or "none"
    remedy = f'keep the {what} only, for example `ncks -v NAME {text} {what}.nc`, or name it "{names[0]}"'
    raise DemError(f"{text}: cannot tell which variable is the {what} (two-dimensional ones: {held}); {remedy}")


def _coordinate(variable: Any, axis: str, text: str) -> Any:
    for dimension in variable.dims:
        if dimension not in variable.coords:
            continue
        coordinate = variable.coords[dimension]
        words = (str(dimension).lower(), coordinate.attrs.get("standard_name"), str(coordinate.attrs.get("axis", "")).lower())
        if any(word in AXES[axis] for word in words):
            return coordinate
    remedy = "add coordinate variables x and y"
    raise DemError(f"{text}: variable {variable.name!r} has no {axis} coordinate along {variable.dims}; {remedy}")


def _step(coordinate: Any, text: str) -> float:
    """Spacing of an evenly spaced coordinate, with its sign."""
    c = np.asarray(coordinate.values, dtype=np.float64)
    step = (c[-1] - c[0]) / (len(c) - 1)
    off = np.abs(c - (c[0] + step * np.arange(len(c)))).max()
    if not (np.isfinite(step) and step != 0 and off <= UNEVEN * abs(step)):
        uneven = f"coordinate {coordinate.name!r} is not evenly spaced (off by up to {off:g})"
        raise DemError(f"{text}: {uneven}; resample it with `gdalwarp`")
    return float(step)


def _grid_mapping(dataset: Any, variable: Any) -> dict[str, Any]:
    name = variable.attrs.get("grid_mapping") or variable.encoding.get("grid_mapping") or ""
    name = name.split(":")[0].split()[0] if name else "crs"
    return dict(dataset.variables[name].attrs) if name in dataset.variables else {}


def _exact_transform(transform: tuple[float, ...], mapping: dict[str, Any]) -> Any:
    """The GeoTransform attribute where it agrees with the coordinates: it carries no rounding."""
    try:
        c, a, b, f, d, e = (float(number) for number in str(mapping.get("GeoTransform", "")).split())
    except ValueError:
        return transform
    stated = (a, b, c, d, e, f)
    return stated if np.allclose(stated, transform, rtol=0, atol=1e-6 * abs(transform[0])) else transform


def _crs(mapping: dict[str, Any], x: Any, text: str) -> Any:
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    wkt = mapping.get("crs_wkt") or mapping.get("spatial_ref")
    if wkt:
        return parse(wkt, text)
    units = str(x.attrs.get("units", ""))
    if not _in_degrees(x) and units not in ("", "1", "m", "metre", "meter", "metres", "meters"):
        raise DemError(f"{text}: coordinate {x.name!r} is in {units!r}; metres or degrees are needed")
    try:
        return parse(CRS.from_cf(mapping), text) if "grid_mapping_name" in mapping else None
    except (CRSError, KeyError, TypeError, ValueError) as error:
        raise DemError(f"{text}: its grid mapping is not understood ({error}); add the attribute crs_wkt") from error


def _in_degrees(x: Any) -> bool:
    units = str(x.attrs.get("units", ""))
    named = x.attrs.get("standard_name") == "longitude" or str(x.name).lower() in ("lon", "longitude")
    return units.startswith("degree") or (named and not units)
