"""Calls of the Python interface with odd arrays and numbers."""

from random import Random
from typing import Any

import numpy as np
from odd_sites import COLUMNS, ROWS, odd_values
from odd_values import FLOATS

from runout import Bed, PorePressure, RammsErosion, Release, Terrain
from runout.model.pore_pressure import RatioZones

ODD: list[Any] = [
    None,
    "x",
    "",
    [],
    {},
    (),
    True,
    5,
    -1,
    1e300,
    float("nan"),
    b"x",
    object(),
    [1, 2],
    (1, 2, 3),
    np.array([]),
    3 + 4j,
]


def odd_array(random: Random) -> Any:
    """An array, or what stands in its place."""
    rows, columns = (random.choice([0, 1, 2, 3, ROWS, COLUMNS]) for _ in "ab")
    if random.random() < 0.6:
        rows, columns = ROWS, COLUMNS
    values: Any = odd_values(random, rows, columns)
    kind = random.choice(["good", "good", "type", "type", "shape", "mask", "other", "order"])
    if kind == "type":
        with np.errstate(all="ignore"):
            values = values.astype(
                random.choice(["complex128", "int8", "bool", "object", "U8", "S4", "float16", "M8[s]", "longdouble"])
            )
    elif kind == "shape":
        values = random.choice([values.ravel(), values[None], values[..., None], values.T])
    elif kind == "mask":
        values = np.ma.masked_less(values, random.choice([0.0, 80.0, 1e9]))
    elif kind == "order":
        values = random.choice([np.asfortranarray(values), values[::-1], values.tolist()])
    elif kind == "other":
        values = random.choice(ODD)
    return values


def call_odd_array(seed: int) -> None:
    """Make a terrain or a release as a seed says."""
    random = Random(seed)
    number = random.choice([10.0, 10.0, (10.0, 10.0), *FLOATS, *ODD])
    if random.random() < 0.5:
        crs = random.choice([None, None, "EPSG:32632", "EPSG:4326", "x", 5, -1, {}, b"x", "+proj=x", 32632])
        origin = random.choice([(0.0, 0.0), (5e5, 5e6), (0.0,), *((f, 0.0) for f in FLOATS), *ODD])
        Terrain.from_array(odd_array(random), number, crs, origin)
        return
    terrain = Terrain.from_array(np.add.outer(np.arange(float(ROWS)), np.arange(float(COLUMNS))), 10.0)
    path = random.choice(["x.tif", "", ".", "/dev/zero", "\0", "x" * 9999, "NETCDF:x:y", "GPKG::", *ODD])
    kind = random.choice(["array"] * 6 + ["raster", "vector", "terrain", "pores", "zones", "bed"])
    if kind == "array":
        choices = {"volume": number, "basal_friction_angle_deg": random.choice([None, 20.0, *FLOATS, *ODD])}
        chosen = {key: value for key, value in choices.items() if random.random() < 0.3}
        Release.from_array(
            np.abs(odd_values(random, ROWS, COLUMNS)) if random.random() < 0.4 else odd_array(random), terrain, **chosen
        )
    elif kind == "raster":
        Release.from_raster(path, terrain, volume=number)
    elif kind == "vector":
        Release.from_vector(path, terrain, thickness=number, layer=random.choice([None, "x", 5]))
    elif kind in ("pores", "zones", "bed"):
        _call_of_water_and_bed(kind, number, terrain, random)
    else:
        Terrain.from_raster(
            path, crs=random.choice([None, *ODD]), extent=random.choice([None, (0.0, 0.0, 9.0, 9.0), *FLOATS, *ODD])
        )


def _call_of_water_and_bed(kind: str, number: Any, terrain: Terrain, random: Random) -> None:
    """Make the pore pressure of a release, or a bed, and lay it on the terrain."""
    thickness = np.full((ROWS, COLUMNS), 2.0)
    release = Release.from_array(thickness, terrain, placement="on_surface")
    values, other = odd_array(random), random.choice([None, 0.3, *FLOATS, *ODD])
    if kind == "bed":
        erosion = random.choice([RammsErosion(), None, *ODD]) if random.random() < 0.3 else RammsErosion()
        Bed(
            random.choice([values, number]), erosion, other, pore_pressure_ratio=random.choice([None, 0.5, *FLOATS, *ODD])
        ).depth_on(terrain, [release])
        return
    ratio = random.choice([values, number, {"low": 0.1, "high": other, "block": number}, {"low": 0.2}])
    if kind == "zones":
        zone = np.where(thickness > 0, random.choice([0, -1, 3]), -1) if random.random() < 0.5 else values
        ratio = RatioZones(zone=zone, ratio=random.choice([None, 0.4, values, number]), low=other, high=0.9, elsewhere=other)
    pore = PorePressure(ratio=ratio, saturation=random.choice([0.0, 1.0, *FLOATS]), decay_time=random.choice([5.0, *FLOATS, *ODD]))
    pore.require_fits(thickness, 2000.0, "release")
    pore.at(np.array([15.0, 45.0]), np.array([15.0, 45.0]), (10.0, 10.0), (1, 2))
