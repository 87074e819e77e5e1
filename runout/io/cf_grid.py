"""Where the cells of a NetCDF variable lie: its axes with their units, spacing, bounds and rounding, and its coordinate system."""

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.errors import DemError
from runout.io.cf_crs import CfSystem, system_of
from runout.io.crs import horizontal, longitude_latitude, parse
from runout.io.georeference import require_usable

UNEVEN = 1e-3  # of a cell
EXACT = 1e-9  # of a cell
DIRECTIONS = {  # of standard names, of _CoordinateAxisType, and of the names of coordinates without either
    "projection_x_coordinate": "x", "longitude": "x", "grid_longitude": "x", "geox": "x", "lon": "x", "x": "x", "easting": "x",
    "eastings": "x", "rlon": "x", "long": "x", "x_coordinate": "x", "projection_x_angular_coordinate": "x",
    "projection_y_coordinate": "y", "latitude": "y", "grid_latitude": "y", "geoy": "y", "lat": "y", "y": "y", "northing": "y",
    "northings": "y", "rlat": "y", "y_coordinate": "y", "projection_y_angular_coordinate": "y",
}  # fmt: skip
COMPASS = {"east": "x", "e": "x", "west": "x", "w": "x", "north": "y", "n": "y", "south": "y", "s": "y"}
ANGLES = {
    "degree": math.radians(1), "deg": math.radians(1), "°": math.radians(1), "radian": 1.0, "rad": 1.0, "grad": math.pi / 200,
    "gon": math.pi / 200, "arc minute": math.radians(1 / 60), "arcminute": math.radians(1 / 60), "arcmin": math.radians(1 / 60),
    "arc second": math.radians(1 / 3600), "arcsecond": math.radians(1 / 3600), "arcsec": math.radians(1 / 3600),
}  # fmt: skip
LENGTHS = {
    "m": 1.0, "metre": 1.0, "meter": 1.0, "km": 1e3, "kilometre": 1e3, "kilometer": 1e3, "hm": 100.0, "hectometre": 100.0,
    "hectometer": 100.0, "dm": 0.1, "decimetre": 0.1, "decimeter": 0.1, "cm": 0.01, "centimetre": 0.01, "centimeter": 0.01,
    "mm": 1e-3, "millimetre": 1e-3, "millimeter": 1e-3, "ft": 0.3048, "foot": 0.3048, "international foot": 0.3048,
    "us survey foot": 1200 / 3937, "survey foot": 1200 / 3937, "us foot": 1200 / 3937, "us ft": 1200 / 3937, "usft": 1200 / 3937,
    "ftus": 1200 / 3937, "mile": 1609.344, "nautical mile": 1852.0, "yard": 0.9144,
}  # fmt: skip
LOOSE = ("ft", "foot", "feet", "m", "metre", "meter", "metres", "meters")  # without the kind: US survey, German legal, ...
LOOSELY = 3e-4  # largest relative difference of the kinds of a foot and of a metre
DEGREE = re.compile(r"degrees?(?: (?P<to>east|west|north|south|[ewns])|(?P<joined>east|west|north|south|[ewn]))")
NUMBER = re.compile(r"(?P<number>[-+]?[\d.]+(?:e[-+]?\d+)?)[ ]?(?P<unit>\S.*)")


@dataclass(frozen=True)
class AxisUnit:
    """Unit of a coordinate."""

    word: str  # as the file states it, in lower case
    factor: float  # radians or metres in it; negative if it counts to the west or south
    is_angle: bool
    direction: str | None = None  # "x" or "y" if the unit says it, such as degrees_north


@dataclass(frozen=True)
class CfGrid:
    """Place of the cells of a variable."""

    # x, y: dimensions along a row and along a column
    x: str
    y: str
    # affine map `(a, b, c, d, e, f)` from the outer corner of the first cell, in the unit of `crs`, without one in metres
    transform: tuple[float, float, float, float, float, float]
    crs: Any  # pyproj.CRS or None
    assumption: str  # sentence on a coordinate system that the file does not state; empty if it states one
    sentences: tuple[str, ...]  # what was converted on the way, one sentence each


def grid_of(dataset: Any, variable: Any, text: str) -> CfGrid:
    """Place of the cells of a two-dimensional variable (:func:`with_axes`); ``text`` names its file in messages.

    Raises DemError if a coordinate is missing, uneven or of an unknown unit, if its system is not understood or does not fit its
    unit.
    """
    x, y = (_coordinate(variable, direction, text) for direction in ("x", "y"))
    units = [_unit_of(coordinate, text) for coordinate in (x, y)]
    kinds = {unit.is_angle for unit in units if unit}
    lengths = [unit.factor for unit in units if unit and not unit.is_angle]
    cf_system = system_of(dataset, variable, (str(x.name), str(y.name)), lengths[0] if lengths else None, text)
    system, assumption = cf_system.crs, "; ".join(cf_system.sentences)
    if system is None and True in kinds:
        system, assumption = parse("EPSG:4326", text), "coordinates are degrees of an unnamed datum; taken as WGS 84"
    factors = [_factor(coordinate, unit, system, text) for coordinate, unit in zip((x, y), units, strict=True)]
    if len(kinds) == 2 or not math.isclose(abs(factors[0]), abs(factors[1]), rel_tol=1e-9):
        words = [repr(unit.word) if unit else "no unit" for unit in units]
        raise DemError(f"{text}: {x.name!r} is in {words[0]}, {y.name!r} in {words[1]}; state both in one unit")
    edges: list[tuple[float, float]] = []
    sentences: list[str] = []
    for coordinate, unit, factor in zip((x, y), units, factors, strict=True):
        if unit and factor not in (1.0, -1.0):
            to = "metres" if system is None else horizontal(system).axis_info[0].unit_name
            sentences.append(f"coordinate {coordinate.name} was in {unit.word}; multiplied by {factor:.10g} ({to})")
        first, step, notes = _edge_and_step(dataset, coordinate, text)
        edges.append((first * factor, step * factor))
        sentences += notes
    (west, dx), (north, dy) = edges
    transform = (dx, 0.0, west, 0.0, dy, north)
    require_usable(transform, text, DemError)
    shape = (y.size, x.size)
    coarseness = max(_resolution(x), _resolution(y)) * abs(factors[0])
    transform, differing = _with_geo_transform(transform, shape, cf_system, coarseness)
    _require_on_map(system, transform, shape, cf_system, text)
    return CfGrid(str(x.name), str(y.name), transform, system, assumption, (*sentences, *differing))


def directions(variable: Any) -> dict[str, str]:
    """Name of the coordinate variable of each direction, "x" and "y", that a variable has."""
    names = {_direction(variable.coords[d]): str(d) for d in variable.dims if d in variable.coords}
    return {direction: name for direction, name in names.items() if direction}


def is_position(variable: Any) -> bool:
    """Whether the values of a variable are positions by its attributes or its name, such as two-dimensional longitudes."""
    return _direction(variable) is not None


def with_axes(dataset: Any, variable: Any) -> Any:
    """A variable whose dimensions without coordinates have those that other variables state along them.

    Such a coordinate has another name than its dimension. If it has two dimensions, it must change along one of them only.
    """
    positions = [dataset[n] for n, v in dataset.variables.items() if v.ndim in (1, 2) and set(v.dims) <= set(variable.dims)]
    for position in sorted((p for p in positions if is_position(p)), key=lambda p: p.ndim):
        for dimension in position.dims:
            line = _along(position, dimension)
            if line is not None and dimension in variable.dims and dimension not in variable.coords:
                name = str(position.name)
                coordinate = (name, line, position.attrs, position.encoding)
                variable = variable.drop_vars(name, errors="ignore").rename({dimension: name}).assign_coords({name: coordinate})
                break
    return variable


def _along(position: Any, dimension: Any) -> Any:
    """Coordinates along a dimension of a variable, if they do not change along the other one; else None."""
    values = np.asarray(position.values)
    if not np.issubdtype(values.dtype, np.number) or values.shape[position.dims.index(dimension)] < 2:
        return None
    lines = np.moveaxis(values, position.dims.index(dimension), 0).reshape(position.sizes[dimension], -1)
    step = abs(float(lines[1, 0]) - float(lines[0, 0]))
    return lines[:, 0] if float(np.ptp(lines, axis=1).max()) <= max(UNEVEN * step, 2 * _resolution(position)) and step else None


def _coordinate(variable: Any, direction: str, text: str) -> Any:
    name = directions(variable).get(direction)
    if name is None:
        missing = f"variable {variable.name!r} has no {direction} coordinate along {variable.dims}"
        raise DemError(f"{text}: {missing}; {_remedy_of_axes(variable, text)}")
    coordinate = variable.coords[name]
    values = np.asarray(coordinate.values)
    if not np.issubdtype(values.dtype, np.number) or not np.isfinite(values).all() or values.size < 2:
        raise DemError(f"{text}: coordinate {name!r} does not hold two or more finite numbers; correct it")
    return coordinate


def _remedy_of_axes(variable: Any, text: str) -> str:
    for dimension in (d for d in variable.dims if d in variable.coords):
        clues = _direction_clues(variable.coords[dimension])
        if len(set(clues.values())) > 1:
            clues_in_words = ", ".join(f"{key} {value}" for key, value in clues.items())
            return f"{dimension!r} is told to run along both x and y ({clues_in_words}); correct its attributes"
    bent = [str(name) for name, c in variable.coords.items() if c.ndim == 2 and is_position(c)]
    if bent:
        return f"warp it by {' and '.join(bent)}: `gdalwarp -geoloc {text} elevation.tif`"
    return "add coordinate variables x and y"


def _direction(coordinate: Any) -> str | None:
    """Direction of a coordinate, by its attributes, and without any by its name; None if it has none or they contradict."""
    candidates = set(_direction_clues(coordinate).values())
    if len(candidates) > 1 or str(coordinate.attrs.get("axis", "")).upper() in ("Z", "T"):
        return None
    return candidates.pop() if candidates else DIRECTIONS.get(str(coordinate.name).lower())


def _direction_clues(coordinate: Any) -> dict[str, str]:
    attributes = {key: str(coordinate.attrs.get(key, "")).lower() for key in ("standard_name", "axis", "_CoordinateAxisType")}
    clues = {key: DIRECTIONS[word] for key, word in attributes.items() if word in DIRECTIONS}
    unit = _unit(str(coordinate.attrs.get("units", "")))
    return clues | ({"units": unit.direction} if unit and unit.direction else {})


def _unit(units: str) -> AxisUnit | None:
    """Unit in the words of UDUNITS; None if it is not known."""
    word = units.strip().lower().replace("_", " ").replace("-", " ")
    number = NUMBER.fullmatch(word)
    scale = float(number["number"]) if number else 1.0
    plain = number["unit"] if number else word
    compass = DEGREE.fullmatch(plain)
    if compass:
        to = compass["to"] or compass["joined"]
        return AxisUnit(word, (-scale if to[0] in "ws" else scale) * ANGLES["degree"], True, COMPASS[to])
    one = plain.replace("feet", "foot")
    for spelling in (one, one.removesuffix("s")):
        for table, is_angle in ((ANGLES, True), (LENGTHS, False)):
            if spelling in table:
                return AxisUnit(word, scale * table[spelling], is_angle)
    return None


def _unit_of(coordinate: Any, text: str) -> AxisUnit | None:
    """Unit of a coordinate; None if it states none and is not called a longitude or latitude."""
    units = str(coordinate.attrs.get("units", "")).strip()
    unit = _unit(units)
    if unit:
        return unit
    if units not in ("", "1"):
        raise DemError(f"{text}: coordinate {coordinate.name!r} is in {units!r}; metres or degrees are needed")
    names = (coordinate.attrs.get("standard_name"), str(coordinate.name).lower())
    is_angle = any(name in ("longitude", "latitude", "lon", "lat", "grid_longitude", "grid_latitude") for name in names)
    return AxisUnit("degrees", ANGLES["degree"], True) if is_angle and not units else None


def _factor(coordinate: Any, unit: AxisUnit | None, system: Any, text: str) -> float:
    """Factor from the numbers of a coordinate to the unit of its system, metres if it has none."""
    if unit is None:
        return 1.0
    flat = None if system is None else horizontal(system)
    if flat is not None and unit.is_angle != flat.is_geographic:
        has = f"coordinates in {flat.axis_info[0].unit_name}" if flat.axis_info else "other coordinates"
        reason = f"coordinate {coordinate.name!r} is in {unit.word!r}, but {flat.name} has {has}"
        raise DemError(f"{text}: {reason}; correct the units of the coordinates or the grid mapping")
    per_unit = 1.0 if flat is None else float(flat.axis_info[0].unit_conversion_factor)
    factor = unit.factor / per_unit
    if unit.word in LOOSE and math.isclose(factor, 1.0, rel_tol=LOOSELY):
        return 1.0
    return float(np.sign(factor)) if math.isclose(abs(factor), 1.0, rel_tol=1e-12) else factor


def _edge_and_step(dataset: Any, coordinate: Any, text: str) -> tuple[float, float, list[str]]:
    """Outer edge of the first cell, spacing with its sign, both in the numbers of a coordinate, and sentences."""
    c = np.asarray(coordinate.values, dtype=np.float64)
    coarseness = _resolution(coordinate)
    step, start = _even(c, coarseness, f"coordinate {coordinate.name!r}", text)
    notes = []
    if coarseness > UNEVEN * abs(step):
        kind = coordinate.encoding.get("dtype", coordinate.dtype)
        place = f"{coordinate.name} is stored as {kind}, which resolves {coarseness:g} there, cells are {abs(step):g} wide"
        if coarseness > abs(step) / 2:
            raise DemError(f"{text}: {place}; write it in double precision")
        notes.append(place)
    name = str(coordinate.attrs.get("bounds") or coordinate.encoding.get("bounds") or "")
    if name not in dataset.variables or dataset.variables[name].shape != (c.size, 2):
        return start - step / 2, step, [*notes, *([f"the bounds {name} of {coordinate.name} are not in the file"] if name else [])]
    bounds = np.sort(np.asarray(dataset.variables[name].values, dtype=np.float64), axis=1)[:, :: 1 if step > 0 else -1]
    tolerance = max(UNEVEN * abs(step), coarseness)
    if np.abs(bounds[1:, 0] - bounds[:-1, 1]).max() > tolerance:
        raise DemError(f"{text}: the cells of {name!r}, bounds of {coordinate.name!r}, do not touch each other; correct them")
    _, edge = _even(np.append(bounds[:, 0], bounds[-1, 1]), coarseness, f"bounds {name!r} of {coordinate.name!r}", text)
    if abs(edge - (start - step / 2)) <= tolerance:
        return start - step / 2, step, notes
    shift = (edge + step / 2 - start) / step
    return edge, step, [*notes, f"{coordinate.name} lies {abs(shift):.3g} cells beside the centres of the cells; {name} counts"]


def _even(c: np.ndarray, coarseness: float, what: str, text: str) -> tuple[float, float]:
    """Spacing and first value of evenly spaced numbers that are rounded to ``coarseness``."""
    step, start = (c[-1] - c[0]) / (c.size - 1), c[0]
    index = np.arange(c.size)
    off = np.abs(c - (start + step * index)).max()
    if np.isfinite(step) and step != 0 and EXACT * abs(step) < off <= 2 * coarseness:
        step, middle = np.polyfit(index - index.mean(), c, 1)  # the line through all of them is rounded less than its ends
        start = middle - step * index.mean()
        off = np.abs(c - (start + step * index)).max()
    if not (np.isfinite(step) and step != 0 and off <= max(UNEVEN * abs(step), coarseness)):
        raise DemError(f"{text}: {what} is not evenly spaced (off by up to {off:g}); resample it with `gdalwarp`")
    return float(step), float(start)


def _resolution(coordinate: Any) -> float:
    """Smallest difference of coordinates as they are stored; 0 for whole numbers."""
    stored = np.dtype(coordinate.encoding.get("dtype", coordinate.dtype))
    scale = abs(float(coordinate.encoding.get("scale_factor", 0.0)))
    if stored.kind != "f":
        return scale
    largest = np.abs(np.asarray(coordinate.values, dtype=np.float64)).max()
    return float(np.spacing(np.asarray(largest / scale if scale else largest, dtype=stored))) * (scale or 1.0)


def _with_geo_transform(
    transform: tuple[float, ...], shape: tuple[int, int], cf_system: CfSystem, coarseness: float
) -> tuple[Any, tuple[str, ...]]:
    """The GeoTransform attribute where it agrees with the coordinates, since it carries no rounding; else a sentence."""
    numbers = cf_system.attributes.get("GeoTransform", "")
    try:
        c, a, b, f, d, e = (float(number) for number in (numbers.split() if isinstance(numbers, str) else numbers))
    except (TypeError, ValueError):
        return transform, ()
    dx, _, _, _, dy, _ = transform
    c, a = (c, a) if a * dx > 0 else (c + a * shape[1], -a)
    f, e = (f, e) if e * dy > 0 else (f + e * shape[0], -e)  # GDAL states it north up, whatever the order of the rows
    corners = [np.array([(m[2], m[5]), (m[2] + m[0] * shape[1], m[5] + m[4] * shape[0])]) for m in ((a, b, c, d, e, f), transform)]
    off = float(np.abs(corners[0] - corners[1]).max())
    if off <= max(1e-6 * abs(dx), 2 * coarseness) and b == d == 0:
        return (a, b, c, d, e, f), ()
    return transform, (f"the attribute GeoTransform differs from the coordinates by {off:.4g}; the coordinates count",)


def _require_on_map(system: Any, transform: tuple[float, ...], shape: tuple[int, int], cf_system: CfSystem, text: str) -> None:
    """DemError if degrees lie beside the globe, or the middle of a map of CF parameters beside its projection."""
    if system is None:
        return
    dx, _, west, _, dy, north = transform
    x, y = west + dx * shape[1] / 2, north + dy * shape[0] / 2
    flat = horizontal(system)
    if flat.is_geographic:
        turn = 2 * math.pi / flat.axis_info[0].unit_conversion_factor
        if abs(y) > turn / 4 or abs(x) > turn * 1.5:
            unit = flat.axis_info[0].unit_name
            raise DemError(
                f"{text}: its middle lies at {x:g}, {y:g}, which is not on the globe in units of {unit}; correct the units"
            )
    elif flat.is_projected and "grid_mapping_name" in cf_system.attributes and not _is_on_earth(flat, x, y):
        shifts = {key: cf_system.attributes[key] for key in ("false_easting", "false_northing") if key in cf_system.attributes}
        remedy = f"CF states {shifts or 'lengths'} in the unit of the coordinates: correct them, or write the system as crs_wkt"
        raise DemError(f"{text}: its middle, {x:g} m east and {y:g} m north, lies outside of {flat.name}; {remedy}")


def _is_on_earth(system: Any, x: float, y: float) -> bool:
    """Whether a position of a projected system is one on the Earth."""
    from pyproj.exceptions import ProjError

    try:
        return bool(np.isfinite(longitude_latitude(system, x, y)).all())
    except ProjError:  # it cannot be computed, such as UTM on a sphere
        return False
