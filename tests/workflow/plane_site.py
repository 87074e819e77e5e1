"""A site on a plane oblique to its raster: stiff slabs, below their strength, slide over zones from polygons or rasters."""

import geopandas
import numpy as np
import rasterio
import shapely
from rasterio.transform import from_origin

from runout.studies.verification_cases.closed_forms import GRAVITY, ZonesDownSlope

WEST, SOUTH, CELL, ROWS, COLUMNS = 500_000.0, 4_000_000.0, 5.0, 48, 54
SLOPE_DEG = 25.0
COS = np.cos(np.radians(SLOPE_DEG))
DOWN, ACROSS = np.array([0.8, 0.6]), np.array([-0.6, 0.8])  # in plan, towards the fall and to its left
START = np.array([60.0, 60.0])  # of the way, in local metres
LENGTH, THICKNESS, GRID = 48.0, 2.0, 2.0  # of the slabs in plan and vertically [m]; spacing of the grid [m]
BORDERS = (88.7, 131.3)  # of the zones, in plan down the way [m]
ROUGH_DEG, FACTOR, WOOD_DEG = 22.0, 3.0, 28.0  # of the second zone, and of the third as polygon and as raster
POLYGONS = f"""
  friction_zones:
    - {{polygons: inputs/rough.gpkg, basal_friction_angle_deg: {ROUGH_DEG:g}}}
    - {{polygons: inputs/wood.gpkg, factor: factor}}"""
RASTER = """
  friction_rasters: {friction_angle_deg: inputs/angle.tif}"""
SITE = """\
name: plane
title: Slabs on a plane
terrain:
  dem: inputs/dem.tif{zones}
release:
{releases}
material: {{density: 2000, youngs_modulus: 2.0e+7, poisson_ratio: 0.0, friction_angle_deg: 50, cohesion: 1.0e+6}}
{friction}
simulation: {{cell_size: {grid:g}, particles_per_cell: 8, end_time: {time:g}, backend: {backend}}}
ensemble:
  members: {members}
  seed: 1
  parameters:
    {sampled}: {{distribution: discrete, values: {values}, frequencies: {equal}}}
hazard: {{thickness_thresholds: [0.5], percentiles: [50]}}
"""
RELEASE = """\
  - name: {name}
    polygons: inputs/{name}.gpkg
    thickness: {thickness:g}
    placement: on_surface
    edge: vertical
"""


def stripe(first, last, right=-300.0, left=300.0):
    """Rectangle in local metres between two places down the way and two across it."""
    corners = [(first, right), (last, right), (last, left), (first, left)]
    return shapely.Polygon([START + x * DOWN + y * ACROSS for x, y in corners])


def write_polygons(path, polygon, **attributes):
    moved = shapely.transform(polygon, lambda c: c + np.array([WEST, SOUTH]))
    geopandas.GeoDataFrame(attributes, geometry=[moved], crs="EPSG:32632").to_file(path, engine="pyogrio")


def write_raster(path, values):
    """Raster of values (rows, columns) on the cells of the terrain, NaN where there is none."""
    place = {"transform": from_origin(WEST, SOUTH + ROWS * CELL, CELL, CELL), "crs": "EPSG:32632", "nodata": -9999.0}
    filled = np.where(np.isnan(values), -9999.0, values)
    with rasterio.open(path, "w", driver="GTiff", height=ROWS, width=COLUMNS, count=1, dtype="float64", **place) as raster:
        raster.write(filled, 1)


def down_the_way():
    """Places (rows, columns) [m] of the centres of the cells in plan down the way, northernmost row first."""
    x, y = (np.arange(COLUMNS) + 0.5) * CELL, (np.arange(ROWS)[::-1] + 0.5) * CELL
    return (x[None, :] - START[0]) * DOWN[0] + (y[:, None] - START[1]) * DOWN[1]


def write_site(folder, zones=POLYGONS, angles=(10,), slabs=None, **stated):
    """Folder of a site whose members have friction ``angles`` [deg] of their own; ``slabs`` states the right and left edge of each
    release and what site.yaml says of its friction."""
    slabs = slabs or {"slab": (-12.0, 12.0, "")}
    (folder / "inputs").mkdir(parents=True)
    way = down_the_way()
    write_raster(folder / "inputs" / "dem.tif", 200.0 - np.tan(np.radians(SLOPE_DEG)) * way)
    write_polygons(folder / "inputs" / "rough.gpkg", stripe(*BORDERS))
    write_polygons(folder / "inputs" / "wood.gpkg", stripe(BORDERS[1], 500.0), factor=[FACTOR])
    write_raster(folder / "inputs" / "angle.tif", np.select([way < BORDERS[0], way < BORDERS[1]], [np.nan, ROUGH_DEG], WOOD_DEG))
    releases = ""
    for name, (right, left, own) in slabs.items():
        write_polygons(folder / "inputs" / f"{name}.gpkg", stripe(0.0, LENGTH, right, left))
        releases += RELEASE.format(name=name, thickness=THICKNESS) + own
    usual = {"sampled": "basal_friction_angle_deg", "values": list(angles), "friction": "basal_friction_angle_deg: 10"}
    said = {**usual, "time": 12.0, "backend": "scan", **stated, "releases": releases, "zones": zones, "grid": GRID}
    (folder / "site.yaml").write_text(SITE.format(members=len(said["values"]), equal=[1] * len(said["values"]), **said))
    return folder


def exact_speeds(friction, way, drag=()):
    """Speeds (n,) [m/s] of a slab after ways (n,) [m] of its centre along the slope, from rest at the first.

    ``friction`` and ``drag`` of the three zones as in :class:`ZonesDownSlope`.
    """
    middle, borders = LENGTH / 2 / COS, tuple(border / COS for border in BORDERS)
    return ZonesDownSlope(borders, friction, drag).speeds(middle + way, LENGTH / COS, SLOPE_DEG, 0.0)


def motion(series):
    """Way [m] of the centre of mass along the slope and its speed [m/s] towards the fall at the times of a ledger, from its energy
    and momentum."""
    mass, fall = np.asarray(series["mass"]), np.array([*DOWN * COS, -np.sin(np.radians(SLOPE_DEG))])
    momentum = np.column_stack([series[f"momentum_{axis}"] for axis in "xyz"])
    height = np.asarray(series["potential_energy"]) / (mass * GRAVITY)
    return (height[0] - height) / np.sin(np.radians(SLOPE_DEG)), momentum @ fall / mass
