"""Coordinate system of a NetCDF variable: its grid mapping, in the words of CF, as WKT, or as a code.

The CF Conventions (1.11, chapter 5.6 and appendix F) state the figure of the Earth and the projection by numbers.
"""

import math
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.errors import DemError
from runout.io.crs import degrees_of_prime_meridian, horizontal, metres_per_unit, parse

TEXTS = ("crs_wkt", "spatial_ref", "esri_pe_string", "proj4", "proj4_params", "proj4text", "proj4_string", "epsg_code", "EPSG_code")
LENGTHS = ("false_easting", "false_northing")  # in the unit of the axes
FIGURE = ("semi_major_axis", "semi_minor_axis", "inverse_flattening", "earth_radius")
PARAMETERS = (
    *LENGTHS, "azimuth_of_central_line", "grid_north_pole_latitude", "grid_north_pole_longitude", "latitude_of_projection_origin",
    "longitude_of_central_meridian", "longitude_of_projection_origin", "north_pole_grid_longitude", "perspective_point_height",
    "scale_factor_at_central_meridian", "scale_factor_at_projection_origin", "standard_parallel",
    "straight_vertical_longitude_from_pole", "towgs84",
)  # fmt: skip
ONE_OR_TWO_PARALLELS = ("albers_conical_equal_area", "lambert_conformal_conic")
AGREE = 1e-6  # relative difference of numbers that are taken to be equal
UNKNOWN = ("", "undefined", "unknown")
REMEDY = "write the whole system into it as the attribute crs_wkt, for example with rioxarray or `gdal_translate -a_srs EPSG:CODE`"

Attributes = dict[str, Any]


@dataclass(frozen=True)
class CfSystem:
    """Coordinate system of a variable."""

    crs: Any  # pyproj.CRS or None: None if the file states none
    attributes: Attributes  # attributes of the grid mapping; empty if there is none
    sentences: tuple[str, ...] = ()  # assumptions, one sentence each


def system_of(dataset: Any, variable: Any, axes: tuple[str, str], metres: float | None, text: str) -> CfSystem:
    """Coordinate system that the grid mapping of a variable states.

    Parameters
    ----------
    dataset : xarray.Dataset
        Its file.
    variable : xarray.DataArray
    axes : tuple of str
        Names of its horizontal coordinates.
    metres : float or None
        Metres in the unit of these coordinates [m], in which CF states the false easting; None if they are angles or state no unit.
    text : str
        File, for messages.

    Raises
    ------
    DemError
        If the grid mapping is missing, is not understood, contradicts itself, or holds parameters that its projection does not use.
    """
    name = _mapping_name(dataset, variable, axes, text)
    if name is None:
        return CfSystem(None, {})
    attributes = {str(key): _plain(value) for key, value in dataset.variables[name].attrs.items()}
    attributes |= {key: str(attributes[key]) for key in ("grid_mapping_name",) if key in attributes}
    source = f"{text}: grid mapping {name!r}"
    system = next((attributes[key] for key in TEXTS if attributes.get(key) not in (None, "")), None)
    if system is not None:
        crs = parse(_as_code(system), text)
        _require_same_numbers(crs, attributes, metres, source)
        return CfSystem(crs, attributes)
    if "grid_mapping_name" not in attributes:
        known = ", ".join(attributes) or "nothing"
        raise DemError(f"{source} states no grid_mapping_name (its attributes: {known}); {REMEDY}")
    crs, sentences = _of_parameters(attributes, 1.0 if metres is None else metres, source)
    return CfSystem(crs, attributes, sentences)


def _mapping_name(dataset: Any, variable: Any, axes: tuple[str, str], text: str) -> str | None:
    """Name of the grid mapping of the axes: ``crs``, or of the extended form ``crs: x y other: lat lon``; None if there is none."""
    words = str(variable.attrs.get("grid_mapping") or variable.encoding.get("grid_mapping") or "").split()
    if not words:
        marks = ("grid_mapping_name", "crs_wkt", "spatial_ref")
        alone = [str(n) for n, v in dataset.variables.items() if v.ndim == 0 and any(mark in v.attrs for mark in marks)]
        return alone[0] if len(alone) == 1 else None
    coordinates: dict[str, list[str]] = {}
    for word in words:
        if word.endswith(":") or not coordinates:
            coordinates[last := word.removesuffix(":")] = []
        else:
            coordinates[last].append(word)
    of_axes = [name for name, named in coordinates.items() if not named or set(axes) <= set(named)]
    if not of_axes:
        return None
    if of_axes[0] not in dataset.variables:
        missing = f"variable {variable.name!r} names the grid mapping {of_axes[0]!r}, which is not in the file"
        raise DemError(f"{text}: {missing}; add it, or remove the attribute grid_mapping and state crs in site.yaml")
    return of_axes[0]


def _plain(value: Any) -> Any:
    """An attribute as a number, a list of numbers or a text."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    return value[0] if isinstance(value, list) and len(value) == 1 else value


def _as_code(system: Any) -> Any:
    """A system as pyproj reads it: the number of a code gets its authority."""
    word = str(int(system)) if isinstance(system, float) and system.is_integer() else str(system).strip()
    return f"EPSG:{word}" if word.isdigit() else word


def _of_parameters(attributes: Attributes, metres: float, source: str) -> tuple[Any, tuple[str, ...]]:
    """System of the parameters of CF, and sentences on assumptions."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    attributes, sentences = _with_known_datum(_in_metres(attributes, metres), source)
    kind = str(attributes["grid_mapping_name"])
    used = _Used(attributes)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a latitude of origin that PROJ does not use; see _require_used
            document = CRS.from_wkt(CRS.from_cf(used).to_wkt()).to_json_dict()
    except KeyError as error:
        raise DemError(f"{source} is {kind} and lacks the attribute {error}; add it, or {REMEDY}") from error
    except (CRSError, TypeError, ValueError) as error:
        reason = str(error).split(": (")[0]
        raise DemError(f"{source} is {kind}, which is not understood ({reason}); {REMEDY}") from error
    for part in _horizontal_parts(document):
        if part.get("name") in UNKNOWN:
            part["name"] = f"{kind.replace('_', ' ')} of its grid mapping"
    for part in document.get("components", ())[1:]:
        part["name"] = part["datum"]["name"]
    crs = parse(document, source)
    _require_used(attributes, used.keys_read, source)
    _require_same_figure(crs, attributes, source)
    return crs, sentences


class _Used(dict[str, Any]):
    """Attributes that note which of them are read."""

    def __init__(self, attributes: Mapping[str, Any]):
        super().__init__(attributes)
        self.keys_read: set[str] = set()

    def __getitem__(self, key: str) -> Any:
        self.keys_read.add(key)
        return super().__getitem__(key)

    def get(self, key: str, default: Any = None) -> Any:
        """Value of an attribute."""
        self.keys_read.add(key)
        return super().get(key, default)


def _in_metres(attributes: Attributes, metres: float) -> Attributes:
    """Parameters with lengths in metres, and parallels of cones as pyproj takes them."""
    converted = attributes | {key: attributes[key] * metres for key in LENGTHS if isinstance(attributes.get(key), int | float)}
    kind, parallel = attributes["grid_mapping_name"], attributes.get("standard_parallel")
    has_origin = kind.startswith("albers") or "latitude_of_projection_origin" in attributes
    # one parallel is where the cone touches; pyproj would take the other of Albers to be the equator, and that of Lambert as origin
    if kind in ONE_OR_TWO_PARALLELS and isinstance(parallel, int | float) and has_origin:
        converted["standard_parallel"] = [parallel, parallel]
    return converted


def _with_known_datum(attributes: Attributes, source: str) -> tuple[Attributes, tuple[str, ...]]:
    """Attributes whose datum PROJ knows, or without it, and sentences on assumptions."""
    from pyproj.crs import Datum
    from pyproj.exceptions import CRSError

    datum = str(attributes.get("horizontal_datum_name", "")).strip()
    others = {key: value for key, value in attributes.items() if key != "horizontal_datum_name"}
    has_figure = any(key in others for key in FIGURE) or str(others.get("reference_ellipsoid_name", "")) not in UNKNOWN
    if datum.lower() in UNKNOWN:
        named = str(others.get("geographic_crs_name", "")).lower() not in UNKNOWN
        return others, () if named or has_figure else ("its grid mapping names no datum; taken as WGS 84",)
    for spelling in (datum, datum.replace("_", " "), f"D_{datum}"):  # as EPSG, GDAL and Esri write it
        try:
            return others | {"horizontal_datum_name": Datum.from_name(spelling).name}, ()
        except CRSError:
            continue
    if not has_figure:
        raise DemError(f"{source} names the datum {datum!r}, which PROJ does not know, and no ellipsoid; {REMEDY}")
    return others, (f"the datum {datum!r} of its grid mapping is not known to PROJ; only its ellipsoid counts",)


def _horizontal_parts(document: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Horizontal systems in a PROJJSON document."""
    yield document
    for part in (*document.get("components", ())[:1], document.get("source_crs")):
        if part:
            yield from _horizontal_parts(part)


def _require_used(attributes: Attributes, read: set[str], source: str) -> None:
    """DemError if a parameter is stated that the projection leaves out, and that would move the map."""
    kind = attributes["grid_mapping_name"]
    if kind == "vertical_perspective":
        read = read - set(LENGTHS)  # PROJ has none for it
    unused = {key: attributes[key] for key in PARAMETERS if key in attributes and key not in read}
    if kind == "polar_stereographic":
        pole = float(unused.pop("latitude_of_projection_origin", 0.0) or 0.0)
        parallel = float(attributes.get("standard_parallel") or 0.0)
        if pole * parallel < 0:
            raise DemError(f"{source} states the pole {pole:g} and the standard_parallel {parallel:g} of the other; correct one")
    for key, value in unused.items():
        neutral = 1.0 if key.startswith("scale_factor") else 0.0
        if not np.array_equal(np.asarray(value, dtype=np.float64), np.full(np.shape(value), neutral)):
            raise DemError(f"{source} is {kind}, which does not use its attribute {key} = {value}; {REMEDY}")


def _require_same_figure(crs: Any, attributes: Attributes, source: str) -> None:
    """DemError if the figure of the Earth or the prime meridian differ from those of the system."""
    ellipsoid = horizontal(crs).ellipsoid
    if ellipsoid is None:
        return
    axes = {"semi_major_axis": ellipsoid.semi_major_metre, "semi_minor_axis": ellipsoid.semi_minor_metre}
    figure = axes | {"earth_radius": ellipsoid.semi_major_metre, "longitude_of_prime_meridian": degrees_of_prime_meridian(crs)}
    _require_equal(crs, attributes, figure, source)


def _require_same_numbers(crs: Any, attributes: Attributes, metres: float | None, source: str) -> None:
    """DemError if numbers of CF stand beside a whole system and differ from it: CF lets the numbers count, GDAL the system."""
    _require_same_figure(crs, attributes, source)
    flat = horizontal(crs)
    if any(axis.unit_name in ("grad", "gon") for axis in getattr(flat.geodetic_crs, "axis_info", ())):
        return  # writers leave the angles of such a system in grads
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        try:
            numbers = flat.to_cf()
        except KeyError:  # pyproj does not write each projection that it reads
            return
    if numbers.get("grid_mapping_name") != attributes.get("grid_mapping_name"):
        return
    skipped = () if metres == 1.0 and metres_per_unit(flat) == 1.0 else LENGTHS
    _require_equal(crs, attributes, {key: numbers[key] for key in PARAMETERS if key in numbers and key not in skipped}, source)


def _require_equal(crs: Any, attributes: Attributes, numbers: Mapping[str, Any], source: str) -> None:
    for key, value in numbers.items():
        attribute = attributes.get(key)
        if not isinstance(attribute, int | float | list) or isinstance(attribute, bool):
            continue
        one, other = (np.atleast_1d(np.asarray(number, dtype=np.float64)) for number in (attribute, value))
        turn = 360.0 if "longitude" in key else math.inf
        apart = np.abs(one - other) if one.shape == other.shape else np.zeros(1)
        if (np.minimum(apart, np.abs(turn - apart)) > AGREE * np.maximum(np.abs(other).max(), 1.0)).any():
            reason = f"{source} states {key} = {attribute}, but its system {crs.name} has {value}"
            raise DemError(f"{reason}; correct one of them, or remove the attribute")
