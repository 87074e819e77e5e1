"""Site folders with one or more faults, from a seed: site.yaml, rasters and vectors, and arrays for the Python interface."""

import json
import math
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from odd_large import odd_extent, odd_hdf5, odd_huge
from odd_values import FLOATS, SYSTEMS, mutated, scalar

ROWS, COLUMNS, CELL, WEST, SOUTH = 12, 16, 10.0, 500_000.0, 5_000_000.0
SITE = """\
name: fuzz
title: A tilted plane
terrain:
  dem: inputs/dem.tif
  crs: EPSG:32632
  obstacles:
    - polygons: inputs/dam.geojson
      height: 3.0
  friction_zones:
    - polygons: inputs/zone.geojson
      factor: 1.5
release:
  - name: scar
    polygons: inputs/release.geojson
    thickness: depth
  - name: pile
    raster: inputs/thickness.tif
    placement: on_surface
material:
  density: 2000
  youngs_modulus: 5.0e+6
  friction_angle_deg: 30
basal_friction_angle_deg: 20
simulation:
  cell_size: 10
  end_time: 3
ensemble:
  members: 2
  seed: 1
  parameters:
    basal_friction_angle_deg: {distribution: uniform, low: 12, high: 22}
hazard: {thickness_thresholds: [0.1, 1], percentiles: [50]}
budget: {hours: 100}
"""
MORE = """\
description: every block that a site may have
metadata:
  author: A. Name
  purpose: fuzz
structures:
  - file: inputs/house.geojson
    name: house
    height: 5.0
bed:
  depth: inputs/bed.tif
  density: 1900
  pore_pressure: {ratio: 0.5}
  erosion:
    law: ramms
    rate: 0.025
    critical_stress: 1000
    depth_per_stress: 1.0e-4
bulking: 0.9
inflow:
  - name: gauge
    line: inputs/gauge.geojson
    hydrograph: inputs/q.csv
    thickness: 1.0
    material:
      friction_angle_deg: 28
    basal_friction: {law: voellmy, mu: 0.1, xi: 500}
    pore_pressure:
      ratio: 0.4
      decay_time: 10
  - name: spring
    polygon: inputs/spring.geojson
    hydrograph: inputs/v.csv
probes:
  points: inputs/points.geojson
  cross_sections: inputs/line.geojson
  interval: 0.5
stability:
  cohesion: {distribution: uniform, low: 0, high: 4900}
  friction_angle_deg: 35
observations:
  outline: {polygons: inputs/zone.geojson}
  deposit: {raster: inputs/deposit.tif}
  difference:
    raster: inputs/difference.tif
    detection_limit: 0.1
  gauges:
    points: inputs/points.geojson
    speed: v
  thalweg: {line: inputs/line.geojson}
report: {stills: none, orthophoto: inputs/orthophoto.tif}
"""
SCHEME = """\
title: of the fuzzer
process: any
source: {title: none, edition: none, address: none}
classes:
  - {name: low, when: [{reached: true}], checked: memory}
  - {name: mean, when: [{thickness: 0.5, speed: 0.5}, {deposit: 1}], checked: memory, note: of a test}
  - {name: high, when: [{pressure: 3000, thickness: 1}, {house_strength: {force: 35300, height: 5.6}}], checked: memory}
return_periods: {years: [30, 100], checked: memory}
levels:
  - {name: yellow, colour: "#ffff00", consequence: Little happens., checked: memory}
  - {name: red, colour: "#ff0000", consequence: Much happens., checked: memory}
matrix:
  rows: {low: [yellow, yellow], mean: [red, yellow], high: [red, red]}
  checked: memory
beyond: yellow
does_not_say: [What a real one says.]
"""
TABLE = """\
basal_friction_angle_deg,weight,annual_rate,scenario,seed
18,0.75,0.03,often,4
,0.25,0.01,rare,5
"""
WET = {  # lines of a site with all blocks, in the place of lines of SITE
    "    thickness: depth\n": """\
    thickness: depth
    pore_pressure:
      ratio:
        polygons: inputs/wet.geojson
        ratio: water
        elsewhere: 0.3
      saturation: 0.5
      decay_time: 5
""",
    "    placement: on_surface\n": """\
    placement: on_surface
    pore_pressure:
      ratio:
        low: 0.2
        high: 0.6
        block: 20
      diffusivity: 1.0e-3
    start_time: 1.0
    velocity: {speed: 2.0, azimuth_deg: 90}
    material:
      law: herschel_bulkley
      density: 1800
      yield_stress: 500
      consistency: 100
    basal_friction: {law: voellmy, mu: 0.1, xi: 500}
""",
    "  parameters:\n": """\
  parameters:
    pore_pressure_ratio_low: {distribution: uniform, low: 0.1, high: 0.2}
    pore_pressure_ratio_elsewhere: {distribution: uniform, low: 0.3, high: 0.4}
    pore_pressure_saturation: {distribution: uniform, low: 0, high: 0.5}
    erosion_rate: {distribution: uniform, low: 0.01, high: 0.05}
    bed_depth_factor: {distribution: uniform, low: 0.5, high: 2}
    bed_pore_pressure_ratio: {distribution: uniform, low: 0.3, high: 0.6}
    bulking: {distribution: uniform, low: 0.8, high: 1}
    discharge_factor: {distribution: uniform, low: 0.5, high: 2}
    inflow_delay: {distribution: uniform, low: 0, high: 1}
    pile.start_time: {distribution: uniform, low: 0, high: 1}
    pile.start_speed: {distribution: uniform, low: 0, high: 3}
    pile.basal_mu: {distribution: uniform, low: 0.1, high: 0.2}
    pile.yield_stress: {distribution: uniform, low: 400, high: 600}
    scar.pore_pressure_decay_time: {distribution: uniform, low: 4, high: 6}
""",
    "hazard: {thickness_thresholds: [0.1, 1], percentiles: [50]}\n": """\
  scenarios:
    - name: often
      exceedance_return_period: 30
      members: 1
      parameters: {basal_friction_angle_deg: 18}
    - name: seldom
      exceedance_return_period: 100
    - name: pile
      return_period: 50
      releases: [pile, gauge, spring]
    - name: rate
      annual_rate: 0.001
      releases: [scar, pile, gauge, spring]
      parameters:
        release_volume_factor: {distribution: uniform, low: 1, high: 2}
    - name: law
      power_law: {coefficient: 2, exponent: 0.5, low: 100, high: 1.0e+6}
hazard:
  return_periods: [30, 100]
  scheme: inputs/scheme.yaml
  thickness_thresholds: [0.1, 1]
  eroded_depth_thresholds: [0.5]
  net_erosion_thresholds: [0.1, 0.5]
  net_deposition_thresholds: [0.5]
  joint: [{thickness: 1, eroded_depth: 0.5}]
  percentiles: [50]
""",
}


def square(west: float, south: float, side: float) -> list[list[float]]:
    """Ring of a square, from the south-west corner of the raster [m]."""
    x, y = WEST + west, SOUTH + south
    return [[x, y], [x + side, y], [x + side, y + side], [x, y + side], [x, y]]


def features(rings: list[Any], **more: Any) -> dict[str, Any]:
    """GeoJSON of polygons of one ring each."""
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}}
    made = [
        {"type": "Feature", "properties": {"depth": 4.0, "name": "a"}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
        for ring in rings
    ]
    return {"type": "FeatureCollection", "crs": crs, "features": made, **more}


def slope() -> np.ndarray:
    """Elevation (rows, columns) [m] that falls to the east."""
    return np.broadcast_to(100.0 - 3.0 * np.arange(COLUMNS), (ROWS, COLUMNS)).copy()


def write_tiff(path: Path, values: np.ndarray, transform: Any = None, crs: Any = "EPSG:32632", **profile: Any) -> None:
    """Write a GeoTIFF of (rows, columns) or (bands, rows, columns)."""
    import rasterio

    bands = values if values.ndim == 3 else values[None]
    transform = rasterio.Affine(*(transform or (CELL, 0, WEST, 0, -CELL, SOUTH + ROWS * CELL)))
    shape = {"count": bands.shape[0], "height": bands.shape[1], "width": bands.shape[2], "dtype": bands.dtype}
    with rasterio.open(path, "w", driver="GTiff", transform=transform, crs=crs, **shape, **profile) as file:
        file.write(bands)


def write_good(folder: Path, *, full: bool = False) -> None:
    """A site without faults; with all blocks if it is ``full``."""
    inputs = folder / "inputs"
    inputs.mkdir(parents=True)
    pile = np.zeros((ROWS, COLUMNS))
    pile[1:4, 8:11] = 2.0
    write_tiff(inputs / "dem.tif", slope())
    write_tiff(inputs / "thickness.tif", pile)
    for name, ring in {"release": square(20, 20, 40), "dam": square(110, 20, 20), "zone": square(80, 10, 30)}.items():
        (inputs / f"{name}.geojson").write_text(json.dumps(features([ring])), encoding="utf-8")
    _write_more(inputs, pile)
    (folder / "site.yaml").write_text(site_text(full=full), encoding="utf-8")
    (inputs / "empty").touch()
    os.mkfifo(inputs / "pipe")
    (inputs / "loop").symlink_to("loop")


def site_text(*, full: bool) -> str:
    """Text of site.yaml; with all blocks if it is ``full``."""
    text = SITE
    for line, wet in WET.items() if full else ():
        text = text.replace(line, wet)
    return text + MORE * full


def _write_more(inputs: Path, pile: np.ndarray) -> None:
    """Inputs of the blocks that few sites have."""
    deposit = np.roll(pile, 4, axis=1)
    write_tiff(inputs / "deposit.tif", deposit)
    write_tiff(inputs / "difference.tif", deposit - pile)
    write_tiff(inputs / "bed.tif", np.ones((ROWS, COLUMNS)))
    write_tiff(inputs / "orthophoto.tif", np.tile(np.arange(COLUMNS, dtype=np.uint8), (3, ROWS, 1)))
    wet = features([square(20, 20, 20)])
    wet["features"][0]["properties"]["water"] = 0.7
    (inputs / "wet.geojson").write_text(json.dumps(wet), encoding="utf-8")
    line = {"type": "LineString", "coordinates": [[WEST + 30, SOUTH + 60], [WEST + 130, SOUTH + 60]]}
    shapes: dict[str, list[dict[str, Any]]] = {
        "house": [{"type": "Polygon", "coordinates": [square(110, 70, 20)]}],
        "spring": [{"type": "Polygon", "coordinates": [square(70, 30, 20)]}],
        "points": [{"type": "Point", "coordinates": [WEST + x, SOUTH + 60]} for x in (50, 90)],
        "line": [line],
        "gauge": [{"type": "LineString", "coordinates": [[WEST + 60, SOUTH + 30], [WEST + 60, SOUTH + 90]]}],
    }
    for name, geometries in shapes.items():
        content = features([])
        content["features"] = [
            {"type": "Feature", "properties": {"name": f"{name} {k}", "v": 3.0}, "geometry": one}
            for k, one in enumerate(geometries)
        ]
        (inputs / f"{name}.geojson").write_text(json.dumps(content), encoding="utf-8")
    (inputs / "q.csv").write_text("time,discharge\n0,0\n1,20\n3,0\n", encoding="utf-8")
    (inputs / "scheme.yaml").write_text(SCHEME, encoding="utf-8")
    (inputs / "v.csv").write_text("time,discharge,velocity\n0,0,1\n1,20,2\n3,0,1\n", encoding="utf-8")


def odd_members(folder: Path, random: Random) -> None:
    """Members from a table with odd numbers, columns or bytes in the place of those of site.yaml."""
    file, path = folder / "site.yaml", folder / "inputs" / "members.csv"
    text = file.read_text(encoding="utf-8")
    first, last = text.index("ensemble:\n"), text.index("hazard:")
    file.write_text(text[:first] + "ensemble: {table: inputs/members.csv}\n" + text[last:], encoding="utf-8")
    rows = [line.split(",") for line in TABLE.splitlines()]
    for _ in range(random.choice([0, 1, 1, 2])):
        rows[random.randrange(len(rows))][random.randrange(len(rows[0]))] = random.choice(
            [scalar(random), "", "nan", "1e999", "pile.fails", "weight", "seed", "basal_mu", "-1"]
        )
    content = "\n".join(",".join(row) for row in rows).encode("utf-8", errors="surrogatepass")
    path.write_bytes(mutated(content, random) if random.random() < 0.2 else content)


def odd_scheme(folder: Path, random: Random) -> None:
    """A scheme of danger classes with odd values or bytes."""
    path = folder / "inputs" / "scheme.yaml"
    lines = SCHEME.splitlines()
    for _ in range(random.choice([1, 1, 2])):
        k = random.randrange(len(lines))
        key = lines[k].partition(":")[0]
        other = lines[random.randrange(len(lines))]
        lines[k] = random.choice(["", other, f"{key}: {scalar(random)}", f"{key}: [{scalar(random)}]"])
    content = "\n".join(lines).encode("utf-8", errors="surrogatepass")
    path.write_bytes(mutated(content, random) if random.random() < 0.2 else content)


def odd_hydrograph(folder: Path, random: Random) -> None:
    """A hydrograph with odd numbers, columns or bytes."""
    path = folder / "inputs" / random.choice(["q.csv", "v.csv"])
    rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()]
    kind = random.choice(["number", "number", "number", "order", "column", "mark", "rows", "bytes"])
    if kind == "number":
        rows[random.randrange(1, len(rows))][random.randrange(len(rows[0]))] = scalar(random)
    elif kind == "order":
        random.shuffle(rows)
    elif kind == "column":
        rows[0][random.randrange(len(rows[0]))] = random.choice(["", "time", "Time [s]", "q", "velocity", "discharge"])
    elif kind == "rows":
        rows = rows[: random.randrange(3)]
    text = random.choice([";", "\t", " ", ""]) if kind == "mark" else ","
    content = "\n".join(text.join(row) for row in rows).encode("utf-8", errors="surrogatepass")
    path.write_bytes(mutated(content, random) if kind == "bytes" else content)


def odd_yaml(folder: Path, random: Random) -> None:
    """Some lines of site.yaml changed, or its bytes damaged."""
    file = folder / "site.yaml"
    if random.random() < 0.1:
        file.write_bytes(mutated(file.read_bytes(), random))
        return
    lines = file.read_text(encoding="utf-8").splitlines()
    for _ in range(random.choice([1, 1, 1, 2, 3])):
        at = random.randrange(len(lines))
        key, colon, _ = lines[at].partition(": ")
        change = random.choice(["value"] * 6 + ["drop", "double", "swap", "indent", "key", "insert", "merge"])
        if change == "value" and colon:
            lines[at] = f"{key}: {scalar(random)}"
        elif change == "drop":
            del lines[at]
        elif change == "double":
            lines.insert(at, lines[at])
        elif change == "swap":
            other = random.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
        elif change == "indent":
            lines[at] = random.choice([" ", "   ", "\t", "- ", "\u00a0"]) + lines[at]
        elif change == "key":
            word = random.choice(
                ["<<", "<uniform>", "?", "''", "1", "~", "resolution", "layer", "volume", "accuracy", "law", "x" * 999]
            )
            lines[at] = lines[at].replace(key.strip(" -"), word) if key.strip(" -") else word
        elif change == "insert":
            lines.insert(at, f"{random.choice(['', '  ', '    '])}{random.choice(INSERTED)}: {scalar(random)}")
        else:
            lines.insert(
                at, random.choice(["base: &b {a: 1}", "<<: {a: 1}", "<<: *b", "---", "...", "%YAML 1.1", "# x", "!!set", "{"])
            )
    file.write_text("\n".join(lines) + "\n", encoding="utf-8", errors="surrogatepass")


INSERTED = (
    "accuracy", "resolution", "layer", "volume", "sign", "edge", "particles_per_cell", "backend", "device", "cfl", "substeps",
    "arrival_threshold", "poisson_ratio", "cohesion", "law", "cone", "description", "frequencies",
    "memory_gb",
    "basal_friction_angle_deg", "placement", "density", "precision", "speed_thresholds", "release_volume_factor",
    "pore_pressure", "ratio", "saturation", "diffusivity", "decay_time", "pore_pressure_ratio", "pore_pressure_ratio_high",
    "low", "high", "block", "elsewhere", "polygons", "bed", "depth", "erosion", "bulking", "most", "growth_rate", "specific_energy",
    "bed_density", "erosion_most", "eroded_depth_thresholds", "net_deposition_thresholds", "joint",
    "inflow", "line", "polygon", "hydrograph", "discharge_factor", "inflow_delay", "start_time", "velocity", "speed", "azimuth_deg",
    "starts_when", "arrives", "scenarios", "table", "return_period", "annual_rate", "power_law", "return_periods", "scheme",
    "formats",
    "scar.start_time", "pile.basal_mu", "spring.start_time",
)  # fmt: skip


def odd_values(random: Random, rows: int, columns: int) -> np.ndarray:
    """Numbers (rows, columns), some of them odd."""
    values = np.resize(slope(), (rows, columns)).copy()
    kind = random.choice(["good", "some", "some", "all", "random", "many"])
    if kind == "some" and values.size:
        values.flat[random.randrange(values.size)] = random.choice(FLOATS)
    elif kind == "all":
        values[:] = random.choice(FLOATS)
    elif kind == "random":
        values = np.random.default_rng(random.randrange(2**31)).normal(size=(rows, columns)) * random.choice(
            [1.0, 1e3, 1e-3, 1e300]
        )
    elif kind == "many":
        values.flat[:: random.randrange(2, 9)] = random.choice(FLOATS)
    return values


def odd_transform(random: Random) -> tuple[float, ...]:
    """An affine map with some odd numbers."""
    transform = [CELL, 0.0, WEST, 0.0, -CELL, SOUTH + ROWS * CELL]
    for _ in range(random.choice([0, 0, 1, 1, 2])):
        transform[random.randrange(6)] = random.choice([*FLOATS, 180.0, -CELL, 10.0, 1e-7, 89.9])
    return tuple(transform)


def odd_raster(folder: Path, random: Random) -> None:
    """The elevation or the thickness in an odd form."""
    path = folder / "inputs" / random.choice(["dem.tif", "dem.tif", "thickness.tif", "deposit.tif", "difference.tif", "bed.tif"])
    kind = random.choice(["tiff"] * 5 + ["bytes", "bytes", "ascii", "netcdf", "vrt", "side"])
    rows, columns = (random.choice([1, 2, 3, 5, ROWS, COLUMNS, 40]) for _ in "ab")
    if random.random() < 0.5:
        rows, columns = ROWS, COLUMNS
    values = odd_values(random, rows, columns)
    if kind == "tiff":
        dtype = random.choice(["uint8", "int8", "int16", "uint16", "int32", "float32", "float64", "float64", "complex64", "int64"])
        bands = np.stack([values] * random.choice([1, 1, 1, 1, 2, 4])).astype(dtype)
        nodata = random.choice([None, None, 0.0, 1.0, 4.0])
        write_tiff(path, bands, odd_transform(random), random.choice(["EPSG:32632", *SYSTEMS]), nodata=nodata)
    elif kind == "bytes":
        path.write_bytes(mutated(path.read_bytes(), random))
    elif kind == "side":
        side = random.choice([".aux.xml", ".ovr", ".msk", ".RPB"])
        Path(str(path) + side).write_bytes(
            random.choice([b"", b"<PAMDataset>", random.randbytes(99), b"<PAMDataset></PAMDataset>"])
        )
    else:
        _other_raster(path, values, kind, random)


def _other_raster(path: Path, values: np.ndarray, kind: str, random: Random) -> None:
    """A text grid, NetCDF or VRT under the name that the site states, or beside it and named there."""
    site, name = path.parent.parent / "site.yaml", path.name
    other = path.with_suffix({"ascii": ".asc", "netcdf": ".nc", "vrt": ".vrt"}[kind])
    if kind == "ascii":
        head = f"ncols {values.shape[1]}\nnrows {values.shape[0]}\nxllcorner {WEST}\nyllcorner {SOUTH}\ncellsize {CELL}\n"
        text = head + "\n".join(" ".join(f"{v:g}" for v in row) for row in values)
        other.write_bytes(mutated(text.encode(), random) if random.random() < 0.7 else text.encode())
    elif kind == "netcdf":
        _write_netcdf(other, values, random)
    else:
        source = random.choice([name, f"../{name}", "/etc/passwd", "/vsicurl/http://127.0.0.1:9/x", path.name + "x", str(path)])
        text = (
            f'<VRTDataset rasterXSize="{random.choice([COLUMNS, 0, -1, 10**9])}" rasterYSize="{ROWS}"><SRS>EPSG:32632</SRS>'
            f"<GeoTransform>{WEST}, {CELL}, 0, {SOUTH + ROWS * CELL}, 0, -{CELL}</GeoTransform>"
            "<VRTRasterBand dataType='Float32' band='1'><SimpleSource>"
            f'<SourceFilename relativeToVRT="1">{source}</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>'
        )
        other.write_bytes(mutated(text.encode(), random) if random.random() < 0.5 else text.encode())
    site.write_text(site.read_text(encoding="utf-8").replace(f"inputs/{name}", f"inputs/{other.name}"), encoding="utf-8")


def _write_netcdf(path: Path, values: np.ndarray, random: Random) -> None:
    import xarray as xr

    x = WEST + (np.arange(values.shape[1]) + 0.5) * random.choice([CELL, CELL, 0.0, -CELL, math.nan, 1e300])
    y = SOUTH + (np.arange(values.shape[0]) + 0.5) * CELL
    attributes = {"units": random.choice(["m", "m", "ft", "K", 5.0, ""]), "scale_factor": random.choice([1.0, 0.0, math.nan])}
    made = xr.Dataset({"elevation": (("y", "x"), values, attributes)}, {"x": x, "y": y})
    if random.random() < 0.3:
        made["crs"] = ((), 0, {random.choice(["crs_wkt", "grid_mapping_name"]): random.choice(["", "x", "transverse_mercator"])})
    made.to_netcdf(path, engine="netcdf4")
    if random.random() < 0.4:
        path.write_bytes(mutated(path.read_bytes(), random))


def odd_ring(random: Random) -> Any:
    """A ring of a polygon, or what stands in its place."""
    ring: Any = square(random.choice([20, 20, -30, 1e6]), 20, random.choice([40, 40, 1e-9, 0, 1000]))
    kind = random.choice(["good", "number", "number", "open", "short", "cross", "three", "nest", "many", "double"])
    if kind == "number":
        ring[random.randrange(len(ring))][random.randrange(2)] = random.choice(FLOATS)
    elif kind == "open":
        ring = ring[:-1]
    elif kind == "short":
        ring = ring[: random.randrange(3)]
    elif kind == "cross":
        ring = [ring[0], ring[2], ring[1], ring[3], ring[0]]
    elif kind == "three":
        ring = [[*point, random.choice(FLOATS)] for point in ring]
    elif kind == "nest":
        ring = random.choice([[ring], 5, "x", None, {}, [[[]]], [5, 6]])
    elif kind == "many":
        angle = np.linspace(0.0, 2.0 * np.pi, random.choice([7, 500]))
        ring = [[WEST + 60 + 30 * math.cos(a), SOUTH + 60 + 30 * math.sin(a)] for a in angle]
    return ring


def odd_vector(folder: Path, random: Random) -> None:
    """The release, the dam or the zones in an odd form."""
    name = random.choice(["release", "release", "dam", "zone", "house", "points", "line", "wet", "gauge", "spring"])
    path = folder / "inputs" / f"{name}.geojson"
    kind = random.choice(["rings"] * 4 + ["members"] * 3 + ["bytes", "format", "format", "crowd"])
    if kind == "rings":
        content = features([odd_ring(random) for _ in range(random.choice([1, 1, 2, 5, 0]))])
        path.write_text(json.dumps(content), encoding="utf-8")
    elif kind == "members":
        _odd_members(path, random)
    elif kind == "bytes":
        path.write_bytes(mutated(path.read_bytes(), random))
    elif kind == "crowd":
        rings = [square(20 + random.random() * 40, 20 + random.random() * 40, 20.0 * random.random()) for _ in range(200)]
        path.write_text(json.dumps(features(rings)), encoding="utf-8")
    else:
        _other_format(path, random)


def _odd_members(path: Path, random: Random) -> None:
    content: Any = features([square(20, 20, 40), square(70, 70, 10)])
    value: Any = random.choice([None, 5, "x", [], {}, [None], math.nan, 10**400, -1.0, 1e300, "4", True, "2021-01-01"])
    place = random.choice(["features", "type", "crs", "geometry", "coordinates", "properties", "depth", "kind", "top"])
    first = content["features"][0]
    if place in content:
        content[place] = value
    elif place in ("geometry", "properties"):
        first[place] = value
    elif place == "coordinates":
        first["geometry"]["coordinates"] = value
    elif place == "depth":
        first["properties"]["depth"] = value
    elif place == "kind":
        first["geometry"]["type"] = random.choice(["Point", "LineString", "MultiPolygon", "GeometryCollection", "Curve", ""])
    else:
        content = value
    path.write_text(json.dumps(content), encoding="utf-8")


def _other_format(path: Path, random: Random) -> None:
    """A GeoPackage, Shapefile or FlatGeobuf, often damaged, that site.yaml names."""
    import geopandas
    import shapely

    suffix = random.choice([".gpkg", ".shp", ".fgb"])
    shapes = [
        shapely.Polygon(square(20, 20, 40)),
        random.choice([shapely.Point(0, 0), shapely.Polygon(), shapely.Polygon(square(70, 70, 9))]),
    ]
    frame = geopandas.GeoDataFrame(
        {"depth": [4.0, random.choice(FLOATS)]}, geometry=shapes, crs=random.choice(["EPSG:32632", *SYSTEMS])
    )
    other = path.with_suffix(suffix)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            frame.to_file(other, engine="pyogrio")
        except (RuntimeError, ValueError):  # GDAL does not write every one
            frame.iloc[:1].to_file(other, engine="pyogrio")
    if random.random() < 0.7:
        part = random.choice([other, other, *other.parent.glob(f"{other.stem}.[sdpc]*")])
        part.write_bytes(mutated(part.read_bytes(), random))
    site = path.parent.parent / "site.yaml"
    site.write_text(site.read_text(encoding="utf-8").replace(path.name, other.name), encoding="utf-8")


def huge(folder: Path, random: Random) -> None:
    """The slope, or a thickness, in a raster of 1.6e9 cells."""
    odd_huge(folder, random, slope(), (WEST, SOUTH + ROWS * CELL), CELL)


KINDS: dict[str, Callable[[Path, Random], None]] = {
    "yaml": odd_yaml,
    "raster": odd_raster,
    "vector": odd_vector,
    "hydrograph": odd_hydrograph,
    "members": odd_members,
    "scheme": odd_scheme,
    "huge": huge,
    "extent": odd_extent,
    "hdf5": odd_hdf5,
}
OFTEN = ["yaml", "raster", "vector"] * 4 + ["hydrograph", "members", "scheme", "huge", "extent", "hdf5"]


def write_odd_site(folder: Path, seed: int) -> str:
    """Write the site of a seed; the kind of its fault."""
    random = Random(seed)
    kind = random.choice(OFTEN)
    write_good(folder, full=random.random() < 0.5)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        KINDS[kind](folder, random)
    return kind
