"""Rasters of friction parameters, sampled on the cells of the terrain."""

import logging
from collections.abc import Iterator, Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np

from runout.errors import ZoneError
from runout.io.elevation_raster import ElevationRaster, Header
from runout.io.layer_crs import to_terrain
from runout.io.window import Bounds
from runout.model.friction import FrictionZones
from runout.model.friction_laws import DEFAULT_FRICTION, FRICTIONS, FrictionLaw
from runout.model.limits import LARGEST_RADIANS, SMALLEST_RADIANS
from runout.model.parameters import Parameter
from runout.model.terrain import Terrain
from runout.terrain.source import errors_as, north_up_in_unit_of, of_parameter, open_source, require_straight

log = logging.getLogger(__name__)

MARGIN = 3  # cells of a raster that are read around the terrain
FAR = 10.0  # ratio of a value to all others beyond which it hardly states ground


def read_friction_rasters(paths: Mapping[str, str | PathLike[str]], terrain: Terrain, *, law: str | None = None) -> FrictionZones:
    """Parameters of a friction law from rasters; as in :meth:`runout.model.friction.FrictionZones.from_rasters`.

    Raises ZoneError with the place, the value and the remedy.
    """
    chosen = FRICTIONS.find(law or DEFAULT_FRICTION)
    of_law = {p.key: (p, number) for p, number in zip(chosen.parameters, chosen.numbers, strict=True)}
    unknown = [key for key in paths if key not in of_law]
    if unknown:
        raise ZoneError(f"friction_rasters: the friction law {chosen.name} has no {unknown[0]}; choose among {', '.join(of_law)}")
    gridded, statements, warnings = {}, [], []
    for key, path in paths.items():
        parameter, number = of_law[key]
        values, sentences, doubts = sampled_raster(Path(path), terrain, parameter)
        gridded[number] = np.isnan(values).astype(float), _numbers(values, chosen, parameter, number)
        known = values[np.isfinite(values)]
        statements += [*sentences, f"{path}: {key} is {known.min():.4g} to {known.max():.4g} on {len(known)} cells of the terrain."]
        warnings += doubts
    for warning in warnings:
        log.warning(warning)
    ones = np.ones((terrain.shape[1], terrain.shape[0]))
    source, changes = ", ".join(map(str, paths.values())), (*statements, *warnings)
    return FrictionZones(
        ones, np.zeros_like(ones), terrain.cell_size, (), source, changes, gridded=gridded, warnings=tuple(warnings)
    )


def sampled_raster(path: Path, terrain: Terrain, parameter: Parameter) -> tuple[np.ndarray, tuple[str, ...], list[str]]:
    """Values (nx, ny) of the raster cells that hold the centres of the cells of a terrain, NaN where there is none.

    Also sentences on changes, and on values that hardly are meant.
    """
    points, quantity = _centres(terrain), of_parameter(parameter, ZoneError)
    with errors_as(ZoneError), open_source(path, quantity) as source:
        header = source.header
        require_straight(header.transform, header.source, parameter.key)
        placed = to_terrain(path, header.crs, terrain, header.bounds, "gdalwarp")
        x, y = (points if placed.inverse is None else placed.inverse(points)).T
        raster = north_up_in_unit_of(source.read(_extent(path, header, x, y)), quantity)
    west, north, (width, height) = raster.transform[2], raster.transform[5], raster.cell
    with np.errstate(invalid="ignore"):  # a place that has none in the system of the raster
        column, row = (x - west) / width, (north - y) / height
        rows, columns = raster.values.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    values = np.full(len(points), np.nan)
    values[inside] = raster.values[row[inside].astype(np.int64), column[inside].astype(np.int64)]
    _require_valid(raster, values, points, parameter)
    changes = (*(f"{path}: {change}." for change in raster.changes), *placed.sentences)
    cells = values.reshape(terrain.shape[1], terrain.shape[0])
    return cells, changes, list(_doubts(raster, cells, parameter))


def _extent(path: Path, header: Header, x: np.ndarray, y: np.ndarray) -> Bounds:
    """West, south, east and north of places in the coordinates of a raster, and some cells more; ZoneError if it lies elsewhere."""
    known = np.isfinite(x) & np.isfinite(y)
    low, high = (
        [getattr(axis[known], end)(initial=start) for axis in (x, y)] for end, start in (("min", np.inf), ("max", -np.inf))
    )
    west, south, east, north = header.bounds
    if not (low[0] <= east and high[0] >= west and low[1] <= north and high[1] >= south):
        raise _nowhere(path)
    more = MARGIN * abs(header.transform[0]), MARGIN * abs(header.transform[4])
    return low[0] - more[0], low[1] - more[1], high[0] + more[0], high[1] + more[1]


def _nowhere(path: Path | str) -> ZoneError:
    return ZoneError(f"{path}: no cell of the terrain has a value; check the coordinate system of both")


def _doubts(raster: ElevationRaster, values: np.ndarray, parameter: Parameter) -> Iterator[str]:
    """Questions on values (nx, ny) that often mark cells beyond the mapped area: 0, or one value at the rim, far from all others.

    What the law takes if nothing is stated may stand there without a question.
    """
    known, remedy = (
        values[~np.isnan(values)],
        "if {0:g} marks cells without a value, declare it: gdal_edit.py -a_nodata {0:.9g} {1}",
    )
    for value in dict.fromkeys((0.0, _background(values))):
        share = float(np.mean(values == value))
        others = known[(known != value) & ((known != 0.0) | (value == 0.0))]
        is_far = value == 0.0 or (len(others) > 0 and (others.min() >= FAR * value or others.max() <= value / FAR))
        if share and is_far and value != parameter.default:
            share_of_value = f"{parameter.key} is {value:g} on {100 * share:.3g} % of the cells of the terrain"
            others_are = f", {others.min():.4g} to {others.max():.4g} on the others" if len(others) else ""
            yield f"{raster.source}: {share_of_value}{others_are}; {remedy.format(raster.stored(value), raster.source)}"


def _background(values: np.ndarray) -> float:
    """The value (nx, ny) that most cells hold along the rim of those with a value."""
    from scipy import ndimage

    known = ~np.isnan(values)
    different, counts = np.unique(values[known & ~ndimage.binary_erosion(known)], return_counts=True)
    return float(different[np.argmax(counts)])


def _centres(terrain: Terrain) -> np.ndarray:
    """Map coordinates (nx ny, 2) [m] of the centres of the cells, from the south-west corner, northwards first."""
    return np.stack(np.meshgrid(terrain.easting, terrain.northing[::-1], indexing="ij"), axis=-1).reshape(-1, 2)


def _require_valid(raster: ElevationRaster, values: np.ndarray, points: np.ndarray, parameter: Parameter) -> None:
    """ZoneError if no cell of the terrain has a value, or one is out of the range of the parameter."""
    path, known = raster.source, np.flatnonzero(~np.isnan(values))
    if not len(known):
        raise _nowhere(path)
    valid = parameter.valid
    assert valid is not None  # parameters of friction have ranges
    own = values[known]
    low = own <= valid.low if valid.open_low else own < valid.low
    radians = (own >= SMALLEST_RADIANS) & (own <= LARGEST_RADIANS) if valid.degrees else np.zeros(len(own), bool)
    wrong = known[low | (own > valid.high) | radians]
    if len(wrong):
        (east, north), value = points[wrong[0]], float(values[wrong[0]])
        number, allowed = raster.stored(value), valid.allowed()
        if radians.any():
            allowed = f"so small an angle looks like radians; if it is in radians, state it: gdal_edit.py -units rad {path}"
        raise ZoneError(
            f"{path}: {parameter.key} is {value:g} at easting {east:.2f}, northing {north:.2f}, {len(wrong)} cells in all; "
            f"{allowed}; if {number:g} marks cells without a value, declare it: gdal_edit.py -a_nodata {number:.9g} {path}"
        )


def _numbers(values: np.ndarray, law: FrictionLaw, parameter: Parameter, number: str) -> np.ndarray:
    """What the law makes of values of a parameter (:meth:`BasalFriction.numbers`); 0 where they are NaN."""
    different, place = np.unique(values[~np.isnan(values)], return_inverse=True)
    numbers = np.array([replace(law.example, **{parameter.name: value}).numbers()[number] for value in different.tolist()])
    gridded = np.zeros(values.shape)
    gridded[~np.isnan(values)] = numbers[place.ravel()]
    return gridded
