"""Rasters of elevations, thickness or friction: one reader for every form that a file may have.

A source is opened, placed and checked once; then the part that is needed is read, put north up, and converted to the unit of its
quantity. GeoTIFF, ESRI ASCII grid, NetCDF, anything else that GDAL reads.

What a raster file and its side files state of its numbers is scale, offset and unit; GDAL applies only some of it. Side files have
lines of their own: Z_FACTOR and UNIT of SAGA, Zunits of Esri, units in the header of a binary grid, the vertical scale of a BT
file, and the scale of the sources of a virtual raster.
"""

import difflib
import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from runout.errors import DemError, InputError, ReleaseError
from runout.io import crs as coordinate_systems
from runout.io.boundary import as_path, exists, kind_of, names_in
from runout.io.elevation_raster import ElevationRaster, Header
from runout.io.georeference import require_usable
from runout.io.mesh_files import MESHES, OTHER_MESHES
from runout.io.opening import PARTS, is_netcdf, open_raster
from runout.io.references import header, require_vrt_inside
from runout.io.units import factor_to, is_stated, metres_in, words_for
from runout.io.window import Bounds
from runout.model.parameters import Parameter

SIDE_TEXTS = (".prj", ".hdr", ".sgrd")  # that GDAL lists with a raster, besides a raster that is text itself
TEXT_GRIDS = ("AAIGrid", "GRASSASCIIGrid")
LINE = re.compile(
    r"^[ \t]*(z_?factor|z_?scale|z_?units?|vertical_?units?|elev(?:ation)?_?(?:m_)?units?|(?:data|value)[ _]units?|unit)"
    r"(?=[\s=:])[ \t]*[=:]?[ \t]*(\S.*?)?\s*$",
    re.IGNORECASE | re.MULTILINE,
)
BT_SCALE = slice(62, 66)  # bytes of the vertical scale in the header of a BT file [m]; 0 stands for 1
NO_UNIT = ("no", "none", "")
SURFACES = (*MESHES, *OTHER_MESHES)
ROTATED = 1e-9  # share of a cell by which a row or column may lean: the digits of a header


@dataclass(frozen=True)
class StatedScale:
    """Meaning of the numbers of a band: value = ``scale`` x number + ``offset``, in ``unit``; None if no unit is stated."""

    scale: float
    offset: float
    unit: str | None

    def words(self) -> str:
        """The meaning for a message."""
        return f"value = {self.scale:g} x number + {self.offset:g}" + (f" in {self.unit}" if self.unit else "")


def stated_scale(dataset: Any, source: Path | str, error: type[InputError]) -> StatedScale:
    """Scale, offset and unit of the first band of an open rasterio dataset, of its side files and of the sources of a VRT.

    Raises InputError of the given kind if a scale is 0 or not finite, or two statements contradict each other.
    """
    scale, offset, units = dataset.scales[0], dataset.offsets[0], [dataset.units[0]]
    for key, text in _lines(dataset):
        if "factor" in key or "scale" in key:
            scale *= _number(text, key, source, error)
        elif re.fullmatch(r"[\d.eE+-]+", text):  # Esri: units to a metre
            scale, units = scale / _number(text, key, source, error), [*units, "m"]
        else:
            units.append(text)
    if dataset.driver == "BT":
        scale, units = scale * (_bt_scale(dataset.files[0]) or 1.0), ["m"]
    _require_scale(scale, offset, source, error)
    band = StatedScale(scale, offset, _one_unit([unit for unit in units if is_stated(unit)], source, error))
    return _with_sources(band, Path(dataset.files[0]), error) if dataset.driver == "VRT" else band


def require_corner(dataset: Any, source: Path | str, error: type[InputError]) -> None:
    """Raise an error if the header of a grid states its corner along one axis and a centre along the other, or only one of both.

    GDAL reads such a header without a word, and places the grid at the origin or half a cell off.
    """
    if dataset.driver not in ("AAIGrid", "EHdr"):
        return
    corner = {}
    for text in _texts(dataset):
        for axis, kind, value in re.findall(r"^\s*([xy])ll(\w+)\s+(\S+)", text, re.IGNORECASE | re.MULTILINE):
            corner[axis.lower() + kind.lower()] = value
    both = [{"x" + kind, "y" + kind} for kind in ("corner", "center")]
    if set(corner) in both or (dataset.driver == "EHdr" and not corner):
        return
    corner_text = " and ".join(f"{key[0]}ll{key[1:]} {value}" for key, value in sorted(corner.items())) or "neither"
    raise error(
        f"{source}: its header states {corner_text}; xllcorner and yllcorner are needed, or xllcenter and yllcenter: "
        "the corner lies half a cellsize west and south of the centre"
    )


def _require_scale(scale: float, offset: float, source: Path | str, error: type[InputError]) -> None:
    if scale == 0.0 or not abs(scale) < float("inf") or not abs(offset) < float("inf"):
        remedy = f"state the right one, for example `gdal_edit.py -scale 1 -offset 0 {source}`"
        raise error(f"{source}: the file states the scale {scale:g} and the offset {offset:g} of its numbers; {remedy}")


def _lines(dataset: Any) -> Iterator[tuple[str, str]]:
    """Keys and values of all lines on vertical scale and unit."""
    for text in _texts(dataset):
        lines = ((key.lower(), value.strip("{} \"'")) for key, value in LINE.findall(text))
        yield from ((key, value) for key, value in lines if value.lower() not in NO_UNIT)
    titles = dataset.tags(ns="ENVI").get("z_plot_titles", "").strip("{} ").split(",", 1)
    if len(titles) == 2 and metres_in(titles[1]) is not None:
        yield "z plot titles", titles[1].strip()


def _texts(dataset: Any) -> Iterator[str]:
    """Beginnings of the text files of a raster."""
    for name in dataset.files:
        path = Path(name)
        is_side = path.suffix.lower() in SIDE_TEXTS or path.name.lower() == "prj.adf"
        if path.is_file() and (is_side or (dataset.driver in TEXT_GRIDS and name == dataset.files[0])):
            yield header(path).decode("latin-1").replace("\r", "\n")


def _number(text: str, key: str, source: Path | str, error: type[InputError]) -> float:
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if number == 0.0 or not abs(number) < float("inf"):
        raise error(f"{source}: its side file states {key} {text!r}; write a number other than 0, or remove the line")
    return number


def _bt_scale(name: str) -> float:
    return float(struct.unpack("<f", header(Path(name))[BT_SCALE])[0])


def _with_sources(band: StatedScale, path: Path, error: type[InputError]) -> StatedScale:
    """What a VRT and its sources state: GDAL copies the numbers of the sources and leaves out what they mean.

    Raises InputError of the given kind if the sources state different meanings, or others than the VRT.
    """
    remedy = "convert them before you build the VRT: `gdal_translate -unscale`, `gdal_calc.py`"
    alike: dict[tuple[float, float, float | str], tuple[StatedScale, Path]] = {}
    for source in require_vrt_inside(path, error):
        with open_raster(source, error) as file:
            if file.driver != "VRT":  # the sources of that are on the list
                own = stated_scale(file, source, error)
                alike.setdefault((own.scale, own.offset, _meaning(own.unit)), (own, source))
    if len(alike) > 1:
        (one, first), (other, second), *_ = alike.values()
        raise error(f"{path}: its sources differ: {first.name} states {one.words()}, {second.name} {other.words()}; {remedy}")
    own, source = next(iter(alike.values()), (StatedScale(1.0, 0.0, None), path))
    plain, packed = (own.scale, own.offset) == (1.0, 0.0), (band.scale, band.offset) != (1.0, 0.0)
    rescaled = packed or b"<ScaleRatio>" in path.read_bytes()
    if (rescaled and not plain and (own.scale, own.offset) != (band.scale, band.offset)) or (
        band.unit and own.unit and _meaning(band.unit) != _meaning(own.unit)
    ):
        raise error(f"{path}: states {band.words()}, its source {source.name} {own.words()}; {remedy}")
    return StatedScale(*((band.scale, band.offset) if rescaled else (own.scale, own.offset)), band.unit or own.unit)


def _meaning(unit: str | None) -> float | str:
    """Metres in a unit of length; other units as they are."""
    return metres_in(unit or "m") or str(unit)


def _one_unit(units: list[str], source: Path | str, error: type[InputError]) -> str | None:
    """The unit that all statements mean; an error if they differ."""
    different = {_meaning(unit) for unit in units}
    if len(different) > 1:
        raise error(f"{source}: the raster and its side files state different units ({', '.join(units)}); correct one of them")
    return units[-1] if units else None


@dataclass(frozen=True)
class Quantity:
    """What the values of a raster are."""

    name: str  # for messages
    unit: str  # of the values once they are read, as of :func:`runout.io.units.factor_to`
    error: type[InputError]  # error that is raised
    variables: tuple[str, ...]  # names or standard names of a NetCDF variable, the likeliest first

    @property
    def values(self) -> str:
        """The values in a sentence."""
        return "elevations" if self.name == "elevation" else f"values of {self.name}"


ELEVATION = Quantity(
    "elevation", "m", DemError,
    ("elevation", "surface_altitude", "dem", "z", "altitude", "height", "topography", "orog", "band1"),
)  # fmt: skip
THICKNESS = Quantity(
    "thickness", "m", ReleaseError, ("thickness", "release_thickness", "release_depth", "release", "depth", "height", "band1")
)


def of_parameter(parameter: Parameter, error: type[InputError]) -> Quantity:
    """Quantity of a declared parameter of a law."""
    unit = parameter.valid.unit if parameter.valid else ""
    return Quantity(parameter.key, unit, error, (parameter.key, parameter.name, "band1"))


class Source(Protocol):
    """An open raster."""

    header: Header

    def read(self, extent: Bounds | None) -> ElevationRaster:
        """The cells of an extent."""


@contextmanager
def open_source(path: str | PathLike[str], quantity: Quantity) -> Iterator[Source]:
    """Open raster of a quantity.

    Raises InputError of the quantity if the file is missing or unreadable, is rotated, or does not state where it lies or what it
    holds.
    """
    text = fspath(as_path(path, quantity.error)) if not isinstance(path, str) else path
    if text.lower().endswith(SURFACES):
        remedy = "give a mesh as OBJ, PLY or STL in site.yaml (terrain.dem with terrain.resolution), or to Terrain.from_mesh"
        raise quantity.error(f"{text}: is a mesh, not a raster; {remedy}")
    with errors_as(quantity.error):
        name = text if _is_gdal_name(text) else _existing(text, quantity)
        if is_netcdf(name):
            from runout.terrain.netcdf import open_elevation

            with open_elevation(name, quantity.variables, quantity.name) as source:
                yield source
        else:
            with open_raster(name, quantity.error) as dataset:
                yield GdalSource(dataset, name, quantity)


@contextmanager
def errors_as(error: type[InputError]) -> Iterator[None]:
    """Context that turns the errors of the readers of elevations and releases into those of another quantity."""
    try:
        yield
    except (DemError, ReleaseError) as cause:
        if isinstance(cause, error):
            raise
        raise error(str(cause)) from cause


class GdalSource:
    """An open rasterio dataset whose one band, besides transparency, holds the quantity."""

    def __init__(self, dataset: Any, text: str, quantity: Quantity):
        from rasterio.enums import ColorInterp

        meanings = zip(dataset.indexes, dataset.colorinterp, strict=True)
        self.dataset, self.quantity = dataset, quantity
        self.alpha = [index for index, meaning in meanings if meaning == ColorInterp.alpha]
        values = [index for index in dataset.indexes if index not in self.alpha]
        _require_one_band(dataset, text, len(values), quantity)
        self.band = values[0]
        require_corner(dataset, text, quantity.error)
        _require_georeference(dataset, text, quantity)
        transform = tuple(dataset.transform)[:6]
        require_usable(transform, text, quantity.error)
        system = coordinate_systems.of_raster(dataset.crs, text) if dataset.crs else None
        self.header = Header(transform, (dataset.height, dataset.width), system, text)
        self.meaning: StatedScale = stated_scale(dataset, text, quantity.error)

    def read(self, extent: Bounds | None) -> ElevationRaster:
        """The cells of an extent."""
        dataset, header, meaning = self.dataset, self.header, self.meaning
        part = header.part(extent, self.quantity.error)
        band = dataset.read(self.band, window=part.window, masked=True)
        values = np.ma.filled(band.astype(np.float64), np.nan)
        for index in self.alpha:  # GDAL itself heeds transparency only where it is stored as whole numbers
            values[dataset.read(index, window=part.window) == 0] = np.nan
        place = part.transform(header.transform)
        raster = ElevationRaster(values, place, header.crs, meaning.unit, header.source, header.sentences(part))
        if (meaning.scale, meaning.offset) != (1.0, 0.0):
            packing = f"the file stores packed numbers; {self.quantity.name} = {meaning.scale:g} x number + {meaning.offset:g}"
            return raster.scaled(meaning.scale, meaning.offset).noted(packing)
        if np.issubdtype(band.dtype, np.integer) and self.quantity is ELEVATION:
            return raster.noted(f"elevations are whole numbers ({band.dtype}); slopes are stepped by one unit a cell")
        return raster


def _require_one_band(dataset: Any, text: str, bands: int, quantity: Quantity) -> None:
    if dataset.subdatasets and bands == 0:
        names = dataset.subdatasets
        raise quantity.error(f"{text}: holds {len(names)} rasters; name one of them, for example {names[0]!r}")
    if bands != 1:
        remedy = f"`gdal_translate -b 1 {text} {quantity.name}.tif`"
        fault = f"has {bands} bands and does not say which is the {quantity.name}"
        raise quantity.error(f"{text}: {fault}; extract it, for example {remedy}")


def _require_georeference(dataset: Any, text: str, quantity: Quantity) -> None:
    if dataset.transform.is_identity:
        remedy = f"`gdal_translate -a_ullr WEST NORTH EAST SOUTH -a_srs EPSG:CODE {text} {quantity.name}.tif`"
        points = " (only ground control points; warp it first)" if dataset.gcps[0] else ""
        raise quantity.error(f"{text}: has no georeference{points}; add one, for example {remedy}")


def _is_gdal_name(text: str) -> bool:
    """Whether a text is GDAL's name of one raster of several in a file."""
    return PARTS.match(text) is not None and not exists(Path(text))


def _existing(text: str, quantity: Quantity) -> str:
    path = Path(text)
    is_folder = exists(path) and path.is_dir()
    if exists(path) and path.is_file():
        return text
    if is_folder and (path / "hdr.adf").is_file():  # an ESRI grid is a folder
        return text
    if is_folder:
        raise quantity.error(f"{text}: is a folder; name the raster file in it")
    if kind_of(path):
        raise quantity.error(f"{text}: is {kind_of(path)}, not a file; copy the values to a file and name that")
    near = difflib.get_close_matches(path.name, names_in(path.parent), 1)
    remedy = f"did you mean {near[0]!r}?" if near else f"check the path of the raster of {quantity.name}"
    raise quantity.error(f"{text}: no such file; {remedy}")


def require_straight(transform: tuple[float, ...], source: str, name: str = "elevation") -> None:
    """Raise DemError if a raster with an affine map ``(a, b, c, d, e, f)`` is rotated or sheared."""
    a, b, _, d, e, _ = transform
    if max(abs(b), abs(d)) > ROTATED * max(abs(a), abs(e)):
        method = "cubic" if name == "elevation" else "near"
        remedy = f"resample it north up, for example `gdalwarp -r {method} {source} north_up.tif`"
        raise DemError(f"{source}: the raster is rotated or sheared (by {np.degrees(np.arctan2(d, a)):.3g} deg); {remedy}")


def north_up(raster: ElevationRaster) -> ElevationRaster:
    """The raster with its first row in the north and its first column in the west; DemError if it is rotated."""
    require_straight(raster.transform, raster.source)
    a, _, c, _, e, f = raster.transform
    rows, columns = raster.values.shape
    if e > 0:
        flipped = (a, 0.0, c, 0.0, -e, f + e * rows)
        raster = raster.changed("rows ran from south to north; put in order", values=raster.values[::-1], transform=flipped)
    if a < 0:
        flipped = (-a, 0.0, c + a * columns, 0.0, raster.transform[4], raster.transform[5])
        raster = raster.changed("columns ran from east to west; put in order", values=raster.values[:, ::-1], transform=flipped)
    return raster


def in_unit_of(raster: ElevationRaster, quantity: Quantity) -> ElevationRaster:
    """The raster in the unit of its quantity; DemError if its own unit is unknown, or unstated where metres are unlikely."""
    upward = coordinate_systems.vertical(raster.crs) if quantity.unit == "m" else None
    unit = raster.unit if is_stated(raster.unit) else upward.axis_info[0].unit_name if upward is not None else None
    factor = factor_to(quantity.unit, unit)
    if factor is None:
        remedy = f'if they are in {quantity.unit or "no unit"}, say so: `gdal_edit.py -units "{quantity.unit}" {raster.source}`'
        understood = f"{words_for(quantity.unit)} are understood"
        raise quantity.error(f"{raster.source}: {quantity.values} are in {unit!r}; {understood}; {remedy}; else convert them")
    if unit is None and quantity is ELEVATION and raster.crs is not None and _is_not_in_metres(raster.crs):
        remedy = "state it, for example `gdal_edit.py -units ft` (or us-ft, or m)"
        map_unit = coordinate_systems.horizontal(raster.crs).axis_info[0].unit_name
        named = "" if raster.crs.name == "unknown" else f" ({raster.crs.name})"
        reason = f"the map is in {map_unit}{named} and the unit of the {quantity.values} is not stated"
        raise quantity.error(f"{raster.source}: {reason}; {remedy}")
    if factor == 1.0:
        return raster
    return raster.scaled(factor).changed(f"{quantity.values} were in {unit}; multiplied by {factor:.10g}")


def north_up_in_unit_of(raster: ElevationRaster, quantity: Quantity) -> ElevationRaster:
    """The raster north up and in the unit of its quantity; the caller logs its changes."""
    return in_unit_of(north_up(replace(raster, is_logged=False)), quantity)


def _is_not_in_metres(crs: object) -> bool:
    system = coordinate_systems.horizontal(crs)
    return system.is_projected and coordinate_systems.metres_per_unit(system) != 1.0
