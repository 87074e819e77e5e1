"""Elevation of a NetCDF file: which variable it is, and what its numbers mean by the CF Conventions.

GDAL drops the coordinates of a variable that names no grid mapping, and then places the raster at the origin; the coordinate
variables themselves say more.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from runout.errors import DemError
from runout.io.cf_grid import directions, grid_of, is_position, with_axes
from runout.io.elevation_raster import ElevationRaster, Header
from runout.io.opening import PARTS, open_groups, open_netcdf
from runout.io.window import Bounds

GROUND = (  # standard names
    *("surface_altitude", "altitude", "bedrock_altitude", "ground_level_altitude", "height_above_reference_ellipsoid"),
    *("height_above_mean_sea_level", "height_above_geopotential_datum", "surface_height_above_geopotential_datum"),
    *("height_above_geoid", "surface_height_above_reference_ellipsoid"),
)
DEPTHS = (  # standard names, positive downwards
    *("depth", "depth_below_geoid", "sea_floor_depth", "sea_floor_depth_below_geoid", "sea_floor_depth_below_mean_sea_level"),
    *("sea_floor_depth_below_sea_surface", "sea_floor_depth_below_reference_ellipsoid"),
    "sea_floor_depth_below_geopotential_datum",
)
NAMES = ("z", "height", "band1")  # besides those with a word of ELEVATION
ELEVATION = frozenset(
    ["elevation", "elevations", "elev", "dem", "dtm", "dsm", "altitude", "topography", "topo", "orog", "orography", "terrain"]
)
DEPTH = frozenset(["depth", "depths", "bathymetry", "bathy"])
OTHER = DEPTH | frozenset(  # words of quantities that are no elevation of the ground, unless a word of ELEVATION stands beside them
    [
        *("thickness", "vegetation", "canopy", "tree", "trees", "forest", "crown", "building", "buildings", "snow", "soil"),
        *("biomass", "geoid", "undulation", "precipitation", "rain", "temperature", "pressure", "speed", "velocity", "density"),
    ]
)
DERIVED = frozenset(  # words of what is derived from an elevation or describes it
    [
        *("slope", "slopes", "aspect", "gradient", "curvature", "roughness", "hillshade", "shade", "steepness", "mask", "error"),
        *("errors", "uncertainty", "std", "stddev", "deviation", "sigma", "rmse", "variance", "quality", "change", "dod"),
    ]
)
LABELS = frozenset(  # words of labels and counts, in names only: the long name of a band of GDAL is "GDAL Band Number 1"
    ["flag", "flags", "count", "counts", "number", "source", "id", "tid", "index", "class", "classes", "area", "difference", "diff"]
)
NO_LENGTH = re.compile(r"%|percent|deg.*|rad.*|grad|celsius|k|s|pa|kpa|kg\b.*|.*/.*|.* s(\^|\*\*)?-\d|m ?\W*[23]|m-\d.*")  # units
MOST_LISTED = 12  # variables in a message
MOST_CELLS = 10_000_000  # of a variable whose range is stated in a message


@contextmanager
def open_elevation(text: str, names: Sequence[str] = (), what: str = "elevation") -> "Iterator[NetcdfElevation]":
    """The open elevation of a NetCDF file, or another quantity ``what``, of any order of rows, columns and dimensions.

    ``text`` is the file, or GDAL's name of a variable in it: ``NETCDF:"dem.nc":bed``, ``NETCDF:"dem.nc":/group/bed``. ``names``
    are names and standard names that tell a quantity other than the elevation. Raises DemError if the file cannot be read, several
    variables may be meant, or the place or the meaning of the numbers is not clear.
    """
    path, group, name = _parts(text)
    with open_netcdf(path, DemError, group) as dataset, _with_ancestors(dataset, path, group) as whole:
        _require_numbers(whole, text)
        variable = _named(whole, name, text) if name else _only_variable(dataset, path, names, what)
        yield NetcdfElevation(whole, variable, text, what, is_chosen=bool(name))


def _parts(text: str) -> tuple[str, str | None, str | None]:
    """Path of the file, group and variable of a name; None for the root and for a variable that is not named."""
    part = PARTS.match(text)
    if not text.startswith("NETCDF:") or part is None:
        return text, None, None
    group, _, name = text[part.end(2) :].lstrip('"').removeprefix(":").strip("/").rpartition("/")
    return part[2], group or None, name or None


@contextmanager
def _with_ancestors(dataset: Any, path: str, group: str | None) -> Iterator[Any]:
    """Dataset of a group with the coordinates and grid mappings of the groups around it."""
    if group is None:
        yield dataset
        return
    outer = group.rpartition("/")[0] or None
    with open_netcdf(path, DemError, outer) as around, _with_ancestors(around, path, outer) as whole:
        own = set(dataset.variables)
        sizes = dict(dataset.sizes)
        inherited = {
            name: variable for name, variable in whole.variables.items()
            if name not in own and all(sizes.get(d, whole.sizes[d]) == whole.sizes[d] for d in variable.dims)
        }  # fmt: skip
        yield dataset.assign_coords(inherited)


def _require_numbers(dataset: Any, text: str) -> None:
    """DemError if an attribute by which numbers are unpacked is a text; xarray makes texts of the numbers then."""
    for name, variable in dataset.variables.items():
        for key in ("scale_factor", "add_offset", "missing_value"):
            value = {**variable.attrs, **variable.encoding}.get(key)
            if isinstance(value, str) and np.dtype(variable.encoding.get("dtype", variable.dtype)).kind in "iuf":
                raise DemError(f"{text}: attribute {key} of {name!r} is {value!r}, not a number; correct it with `ncatted`")


class NetcdfElevation:
    """A variable of an open xarray dataset as elevation, or as another quantity."""

    def __init__(self, dataset: Any, variable: Any, text: str, what: str, *, is_chosen: bool):
        self.what, self.sentences = what, list(_left_out(variable))
        flat = with_axes(dataset, variable.squeeze(drop=True))
        grid = grid_of(dataset, flat, text)
        self.variable = flat.transpose(grid.y, grid.x)
        self.is_depth = what == "elevation" and _is_depth(flat, text)
        self.assumption = grid.assumption
        self.header = Header(grid.transform, self.variable.shape, grid.crs, text)
        self.sentences += grid.sentences
        names = [str(v.name) for v in _surfaces(dataset)]
        if len(names) > 1 and not is_chosen:
            self.sentences.append(f"of the variables {', '.join(names)}, {flat.name} is taken as the {what}")

    def read(self, extent: Bounds | None) -> ElevationRaster:
        """The cells of an extent."""
        header, variable = self.header, self.variable
        part = header.part(extent, DemError)
        unit = str(variable.attrs.get("units", "")) or None
        values, sentences = _valid(np.array(variable[part.slices].values, dtype=np.float64), variable, self.what, header.source)
        raster = ElevationRaster(values, part.transform(header.transform), header.crs, unit, header.source, header.sentences(part))
        for sentence in (*self.sentences, *sentences):
            raster = raster.noted(sentence)
        if self.is_depth:
            raster = raster.changed("values count downwards; elevation = -1 x value", values=-raster.values)
        return replace(raster, assumption=self.assumption)


def _left_out(variable: Any) -> Iterator[str]:
    """Sentences on dimensions of length 1 that are left out."""
    for dimension, length in variable.sizes.items():
        if length == 1:
            at = f" ({variable.coords[dimension].values[0]})" if dimension in variable.coords else ""
            yield f"dimension {dimension} of length 1{at} is left out"


def _named(dataset: Any, name: str, text: str) -> Any:
    """The variable of a name; DemError if it is missing or has not two dimensions."""
    if name not in dataset.variables:
        known = ", ".join(str(v.name) for v in dataset.data_vars.values() if v.ndim >= 2) or "none"
        raise DemError(f"{text}: there is no variable {name!r}; its variables of two dimensions or more: {known}")
    variable = dataset[name]
    if not np.issubdtype(variable.dtype, np.number):
        raise DemError(f"{text}: variable {name!r} holds {variable.dtype}, no numbers; name another one")
    _require_two_dimensions(variable, text)
    return variable


def _require_two_dimensions(variable: Any, text: str) -> None:
    long = [str(d) for d, length in variable.sizes.items() if length > 1]
    if len(long) == 2:
        return
    more = [d for d in long if d not in directions(variable).values()]
    sizes = ", ".join(f"{d} ({length})" for d, length in variable.sizes.items())
    path = _parts(text)[0]
    cut = "".join(f" -d {d},0" for d in more) if len(long) > 2 else ""
    remedy = f"keep one layer, for example `ncks{cut} {path} elevation.nc`" if cut else "a grid of rows and columns is needed"
    raise DemError(f"{text}: variable {variable.name!r} has the dimensions {sizes}; {remedy}")


def _surfaces(dataset: Any, dimensions: int = 2) -> list[Any]:
    """Variables of so many dimensions that are neither bounds nor positions, nor belong to another variable."""
    roles = ("bounds", "climatology", "grid_mapping", "ancillary_variables", "cell_measures", "coordinates")
    attributes = [str({**v.encoding, **v.attrs}.get(role, "")) for v in dataset.variables.values() for role in roles]
    auxiliary = {word for text in attributes for word in text.split()}
    return [
        variable for name, variable in dataset.data_vars.items()
        if sum(length > 1 for length in variable.shape) == dimensions and np.issubdtype(variable.dtype, np.number)
        and name not in auxiliary and not is_position(variable)
    ]  # fmt: skip


def _only_variable(dataset: Any, text: str, names: Sequence[str], what: str) -> Any:
    """The only variable that can be the elevation, or another quantity.

    A standard name decides. Without one, a variable is taken if it is the only one, or if its name says elevation and the name, the
    unit or the standard name of each other one says another quantity. Other quantities are told by the given names alone.
    """
    surfaces = _surfaces(dataset)
    if what == "elevation":
        certain = [v for v in surfaces if _standard_name(v) in (*GROUND, *DEPTHS)]
        possible = [v for v in surfaces if not _is_other(v, is_alone=len(surfaces) == 1)]
    else:
        certain = [v for v in surfaces if {str(v.name).lower(), _standard_name(v)} & set(names)]
        possible = surfaces
    if len(certain) == 1:
        return certain[0]
    if not certain and len(possible) == 1 and (len(surfaces) == 1 or _is_named_elevation(possible[0])):
        return possible[0]
    layered = [v for n in (3, 4) for v in _surfaces(dataset, n) if len(directions(with_axes(dataset, v))) == 2 and not _is_other(v)]
    if not possible and len(layered) == 1:
        _require_two_dimensions(layered[0], text)
    listed = ", ".join(str(v.name) for v in surfaces) or "none"
    example = str(next(iter(certain or possible or surfaces)).name) if surfaces else "VARIABLE"
    raise DemError(
        f"{text}: cannot tell which variable is the {what} (two-dimensional ones: {listed}){_described(surfaces)}"
        f'{_of_groups(text)}; name the variable after the file, for example NETCDF:"{text}":{example}, in place of {text}'
    )


def _standard_name(variable: Any) -> str:
    return str(variable.attrs.get("standard_name", "")).strip().lower()


def _words(text: Any) -> set[str]:
    return set(re.findall(r"[a-z]+\d*", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", str(text)).replace("_", " ").lower()))


def _is_named_elevation(variable: Any) -> bool:
    words = _words(variable.name)
    return str(variable.name).lower() in NAMES or (bool(words & ELEVATION) and not words & (DERIVED | LABELS))


def _is_other(variable: Any, *, is_alone: bool = False) -> bool:
    """Whether the standard name, the unit or the words of a variable say that it is no elevation; "1" only beside others."""
    standard_name, unit = _standard_name(variable), str(variable.attrs.get("units", "")).strip().lower()
    if standard_name:
        return standard_name not in (*GROUND, *DEPTHS)
    name, long_name = _words(variable.name), _words(variable.attrs.get("long_name", ""))
    if NO_LENGTH.fullmatch(unit) or name & (DERIVED | LABELS):
        return True
    if name & ELEVATION or (_is_depth_by_name(variable) and (is_alone or "positive" in variable.attrs)):
        return False
    return (
        (unit == "1" and not is_alone) or bool(name & OTHER) or (bool(long_name & (OTHER | DERIVED)) and not long_name & ELEVATION)
    )


def _is_depth_by_name(variable: Any) -> bool:
    """Whether a name says that it is a depth, and not of what but the ground."""
    name = _words(variable.name)
    return bool(name & DEPTH) and not name & (ELEVATION | OTHER - DEPTH)


def _described(variables: Sequence[Any]) -> str:
    """Long name, unit and range of variables, for a message."""
    lines = []
    for variable in variables[:MOST_LISTED]:
        title = variable.attrs.get("long_name") or variable.attrs.get("standard_name")
        unit = variable.attrs.get("units") or "without unit"
        known = variable.values[np.isfinite(variable.values)] if variable.size <= MOST_CELLS else np.empty(0)
        span = f", {known.min():.6g} to {known.max():.6g}" if known.size else ""
        lines.append(f"{variable.name} ({f'{title}, ' if title else ''}{unit}{span})")
    return "".join(f"; {line}" for line in lines)


def _of_groups(text: str) -> str:
    """Names of the two-dimensional variables of groups, for a message."""

    def walk(group: Any) -> Iterator[str]:
        for child in group.groups.values():
            flat = (v for v in child.variables.values() if sum(n > 1 for n in v.shape) == 2)
            yield from (f"{child.path}/{v.name}" for v in flat)
            yield from walk(child)

    with open_groups(text) as file:
        names = list(walk(file))
    return f"; groups hold {', '.join(names[:MOST_LISTED])}" if names else ""


def _is_depth(variable: Any, text: str) -> bool:
    """Whether values count downwards; DemError if its attributes contradict each other or do not say it of a depth."""
    positive, standard_name = str(variable.attrs.get("positive", "")).strip().lower(), _standard_name(variable)
    if positive not in ("", "up", "down"):
        raise DemError(f"{text}: variable {variable.name!r} has positive = {positive!r}; it must be up or down")
    if (standard_name in DEPTHS and positive == "up") or (standard_name in GROUND and positive == "down"):
        contradiction = f"variable {variable.name!r} is a {standard_name} with positive = {positive!r}"
        raise DemError(f"{text}: {contradiction}; correct one of them with `ncatted`")
    if not positive and not standard_name and _is_depth_by_name(variable):
        remedy = f"state it, for example `ncatted -a positive,{variable.name},c,c,down {_parts(text)[0]}`"
        raise DemError(f"{text}: variable {variable.name!r} does not say whether it counts upwards or downwards; {remedy}")
    return positive == "down" or standard_name in DEPTHS


def _valid(values: np.ndarray, variable: Any, what: str, text: str) -> tuple[np.ndarray, list[str]]:
    """Values with NaN outside the valid range that the file states, and sentences on it and on the storage."""
    encoding, sentences = variable.encoding, []
    scale, offset = float(encoding.get("scale_factor", 1.0)), float(encoding.get("add_offset", 0.0))
    if scale == 0.0 or not np.isfinite([scale, offset]).all():
        packing = f"the scale_factor {scale:g} and the add_offset {offset:g}"
        raise DemError(f"{text}: variable {variable.name!r} has {packing}; write it anew with the right ones")
    stored = np.dtype(encoding.get("dtype", variable.dtype))
    if (scale, offset) != (1.0, 0.0):
        sentences.append(f"the file stores packed numbers; {what} = {scale:g} x number + {offset:g}")
    elif stored.kind in "iu" and what == "elevation":
        sentences.append(f"elevations are whole numbers ({stored}); slopes are stepped by one unit a cell")
    low, high = sorted(_limit(number, stored, scale, offset, encoding) for number in _stated_range(variable, text))
    half = abs(scale) / 2 if stored.kind in "iu" else 0.0
    outside = (values < low - half) | (values > high + half)
    if outside.any():
        sentences.append(f"{int(outside.sum())} cells outside the valid range of the file, {low:g} to {high:g}, are unknown")
        values = np.where(outside, np.nan, values)
    return values, sentences


def _stated_range(variable: Any, text: str) -> tuple[Any, Any]:
    """valid_min and valid_max, or both of valid_range, in the type in which they are stated."""
    attributes = variable.attrs
    pair = attributes.get("valid_range", (attributes.get("valid_min", -np.inf), attributes.get("valid_max", np.inf)))
    try:
        low, high = (np.asarray(number) for number in pair)
        ordered = float(low) <= float(high)
    except (TypeError, ValueError):
        ordered = False
    if not ordered:
        raise DemError(f"{text}: variable {variable.name!r} has the valid range {pair}; two numbers in order are needed")
    return low, high


def _limit(number: Any, stored: np.dtype, scale: float, offset: float, encoding: dict[str, Any]) -> float:
    """A limit as an elevation: it is in stored numbers if it has their type, else in unpacked ones (NetCDF User Guide, A)."""
    if not np.isfinite(number):
        return float(number)
    if stored.kind == "f":
        number = number.astype(stored)  # the value at the limit has the same rounding
    elif stored.kind in "iu" and number.dtype.kind in "iu" and str(encoding.get("_Unsigned", "")).lower() == "true":
        number = number.astype(f"i{stored.itemsize}").view(f"u{stored.itemsize}")
    is_packed = number.dtype.kind in "iu" if stored.kind in "iu" else number.dtype == stored
    return float(number) * scale + offset if is_packed else float(number)
