"""Rasters of friction parameters, sampled on the cells of the terrain."""

from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np

from runout.errors import ReleaseError, ZoneError
from runout.io.band import unpacked
from runout.io.boundary import exists
from runout.io.georeference import require_usable
from runout.io.layer_crs import to_terrain
from runout.io.opening import open_raster
from runout.io.window import bounds_of
from runout.model.friction import FrictionZones
from runout.model.friction_laws import DEFAULT_FRICTION, FRICTIONS, FrictionLaw
from runout.model.parameters import Parameter
from runout.model.terrain import Terrain


def read_friction_rasters(paths: Mapping[str, str | PathLike[str]], terrain: Terrain, *, law: str | None = None) -> FrictionZones:
    """Parameters of a friction law from rasters; as in :meth:`runout.model.friction.FrictionZones.from_rasters`.

    Raises
    ------
    ZoneError
        With the place, the value and the remedy.
    """
    chosen = FRICTIONS.find(law or DEFAULT_FRICTION)
    of_law = {p.key: (p, number) for p, number in zip(chosen.parameters, chosen.numbers, strict=True)}
    unknown = [key for key in paths if key not in of_law]
    if unknown:
        raise ZoneError(f"friction_rasters: the friction law {chosen.name} has no {unknown[0]}; choose among {', '.join(of_law)}")
    gridded, said = {}, []
    for key, path in paths.items():
        parameter, number = of_law[key]
        values, sentences = _sampled(Path(path), terrain, parameter)
        gridded[number] = np.isnan(values).astype(float), _numbers(values, chosen, parameter, number)
        known = values[np.isfinite(values)]
        said += [*sentences, f"{path}: {key} is {known.min():.4g} to {known.max():.4g} on {len(known)} cells of the terrain."]
    ones = np.ones((terrain.shape[1], terrain.shape[0]))
    source = ", ".join(map(str, paths.values()))
    return FrictionZones(ones, np.zeros_like(ones), terrain.cell_size, (), source, tuple(said), gridded=gridded)


def _sampled(path: Path, terrain: Terrain, parameter: Parameter) -> tuple[np.ndarray, tuple[str, ...]]:
    """Values (nx, ny) of the raster cells that hold the centres of the cells of a terrain, NaN where there is none."""
    if not exists(path):
        raise ZoneError(f"{path}: no such file; check the path of the raster of {parameter.key}")
    try:
        with open_raster(path, ZoneError) as raster:
            transform = tuple(raster.transform)[:6]
            require_usable(transform, path, ZoneError)
            if raster.count != 1:
                raise ZoneError(f"{path}: has {raster.count} bands; keep one: gdal_translate -b 1 {path} {parameter.name}.tif")
            if raster.transform.is_identity or not raster.transform.is_rectilinear:
                raise ZoneError(f"{path}: has no georeference or is rotated; warp it to the terrain: gdalwarp {path} warped.tif")
            crs = raster.crs.to_wkt() if raster.crs else None
            found = to_terrain(path, crs, terrain, bounds_of(transform, raster.shape), "gdalwarp")
            stored = raster.read(1, masked=True).astype(np.float64)
            numbers, packing = unpacked(raster, stored, path, parameter.key, ZoneError)
            band = np.ma.filled(numbers, np.nan)
    except ReleaseError as error:  # the readers of coordinate systems are those of a release
        raise ZoneError(str(error)) from error
    points = _centres(terrain)
    x, y = (points if found.inverse is None else found.inverse(points)).T
    column, row = (np.floor((place - origin) / size).astype(np.int64) for place, origin, size in (
        (x, transform[2], transform[0]), (y, transform[5], transform[4]),
    ))  # fmt: skip
    inside = (row >= 0) & (row < band.shape[0]) & (column >= 0) & (column < band.shape[1])
    values = np.full(len(points), np.nan)
    values[inside] = band[row[inside], column[inside]]
    _require_valid(path, values, points, parameter)
    return values.reshape(terrain.shape[1], terrain.shape[0]), (*packing, *found.sentences)


def _centres(terrain: Terrain) -> np.ndarray:
    """Map coordinates (nx ny, 2) [m] of the centres of the cells, from the south-west corner, northwards first."""
    rows, columns = terrain.shape
    x = terrain.west + (np.arange(columns) + 0.5) * terrain.cell_size[0]
    y = terrain.south + (np.arange(rows) + 0.5) * terrain.cell_size[1]
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)


def _require_valid(path: Path, values: np.ndarray, points: np.ndarray, parameter: Parameter) -> None:
    """ZoneError if no cell of the terrain has a value, or one is out of the range of the parameter."""
    known = np.flatnonzero(~np.isnan(values))
    if not len(known):
        raise ZoneError(f"{path}: no cell of the terrain has a value; check the coordinate system of both")
    valid = parameter.valid
    assert valid is not None  # parameters of friction have ranges
    low = values[known] <= valid.low if valid.open_low else values[known] < valid.low
    wrong = known[low | (values[known] > valid.high)]
    if len(wrong):
        (east, north), value = points[wrong[0]], values[wrong[0]]
        raise ZoneError(
            f"{path}: {parameter.key} is {value:g} at easting {east:.2f}, northing {north:.2f}, {len(wrong)} cells in all; "
            f"{valid.allowed()}; if {value:g} marks cells without a value, declare it: gdal_edit.py -a_nodata {value:.9g} {path}"
        )


def _numbers(values: np.ndarray, law: FrictionLaw, parameter: Parameter, number: str) -> np.ndarray:
    """What the law makes of values of a parameter (:meth:`BasalFriction.numbers`); 0 where they are NaN."""
    different, place = np.unique(values[~np.isnan(values)], return_inverse=True)
    made = np.array([replace(law.example, **{parameter.name: value}).numbers()[number] for value in different.tolist()])
    found = np.zeros(values.shape)
    found[~np.isnan(values)] = made[place.ravel()]
    return found
