"""Births of an inflow: when its particles enter, how many, where on the line or the polygon, and how fast.

At a line, particles are born in planes along it. A plane is born once the flow at the line has gone the distance of particles, and
has the volume that entered meanwhile. So the planes fill the flow without gaps, whatever its speed, and their volumes sum to that
of the hydrograph. A flow thinner than half a layer of particles pools its volume until it gives whole particles, whose places
along the line are those of a sequence of low discrepancy. Over a polygon every particle is one such place.

The reader of a line or polygons of a vector file, with a hydrograph of a CSV file, is here as well.
"""

import logging
import math
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np

from runout.errors import ConfigError, InputError, Problem
from runout.io.boundary import as_path
from runout.io.hydrographs import read_hydrograph
from runout.io.polygon_coverage import covered_area
from runout.io.polygons import read_frame, read_polygons
from runout.io.probe_layers import read_lines
from runout.model.basal_friction import BasalFriction
from runout.model.inflow import STRIP, Cumulative, Hydrograph, Inflow
from runout.model.limits import checked
from runout.model.materials import Material
from runout.model.pore_pressure import PorePressure
from runout.model.release import Edge, Placement, Release
from runout.model.terrain import Terrain
from runout.release import arrangement

GOLDEN = 0.6180339887498949  # step of a sequence of low discrepancy on a line
THIN = 0.5  # layers of particles; thinner planes give single particles
SHARE_AT_ONCE = 0.25  # layers by which a polygon rises between two births
log = logging.getLogger(__name__)
LINE, POLYGON = "line", "polygon"


@dataclass(frozen=True)
class Births:
    """Groups of particles that are born together, in the order in which they enter."""

    time: np.ndarray  # (m,): at which each is due [s]
    count: np.ndarray  # (m,): particles of each group
    volume: np.ndarray  # (m,): of a particle of each [m3]
    thickness: np.ndarray  # (m,): vertical [m], 0 for single particles
    speed: np.ndarray  # (m,): horizontal [m/s]

    def __len__(self) -> int:
        return len(self.time)

    @property
    def total(self) -> float:
        """Volume [m3] of all."""
        return float(self.count @ self.volume)


@dataclass(frozen=True)
class Spacing:
    """Distances of the particles of an inflow: along the flow and across [m], height of a layer [m].

    ``columns`` of a line, and ``planes`` that are born together, those of a cell.
    """

    along: float
    across: float
    layer: float
    columns: int
    planes: int

    @classmethod
    def of(cls, inflow: Inflow, spacing: tuple[float, float, float], per_axis: tuple[int, int, int]) -> "Spacing":
        """Those of a grid of ``spacing`` [m] with so many particles ``per_axis`` of a cell."""
        (dx, dy, dz), (px, py, pz) = spacing, per_axis
        along = math.sqrt(dx * dy / (px * py))
        columns = max(1, round(inflow.width / along))
        return cls(along, inflow.width / columns, dz / pz, columns, px)

    @property
    def volume(self) -> float:
        """Of a standard particle [m3]."""
        return self.along * self.across * self.layer


def path_of(inflow: Inflow, slope: float) -> Cumulative:
    """Horizontal path [m] of the flow at a line over time, on ground with a ``slope`` [1] along the flow."""
    h = inflow.hydrograph
    if h.velocity is not None:
        return Cumulative(h.time, inflow.horizontal_speed(h.velocity, slope))
    assert inflow.thickness is not None
    return Cumulative(h.time, h.discharge / (inflow.width * inflow.thickness))


def births_at_line(inflow: Inflow, how: Spacing, slope: float) -> Births:
    """Planes of an inflow at a line, on ground with a ``slope`` [1] along the flow."""
    entered, path = inflow.hydrograph.entered, path_of(inflow, slope)
    begin = max(0.0, inflow.hydrograph.begin)
    start, way = float(path.at(begin)), float(path.at(inflow.hydrograph.end)) - float(path.at(begin))
    planes = max(1, round(way / how.along))
    length = way / planes
    time = path.when(start + length * np.arange(1, planes + 1))
    time[-1] = inflow.hydrograph.end
    owed = np.diff(entered.at(np.concatenate([[begin], time])))
    before = np.concatenate([[begin], time[:-1]])
    speed = np.divide(length, time - before, out=np.zeros(planes), where=time > before)
    count, volume, thickness = _pooled(owed, how, length)
    there = np.flatnonzero(count)
    return Births(time[there], count[there], volume[there], thickness[there], speed[there])


def _pooled(owed: np.ndarray, how: Spacing, length: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Particles, volume of one [m3] and thickness [m] of planes of a ``length`` [m] that are ``owed`` (n,) [m3] each."""
    count, volume, thickness = np.zeros(len(owed), np.int64), np.zeros(len(owed)), np.zeros(len(owed))
    area, pool = how.columns * how.across * length, 0.0
    for k, more in enumerate(owed.tolist()):
        pool += more
        deep = pool / area
        if deep >= THIN * how.layer:
            count[k], thickness[k] = how.columns * int(arrangement.rows(np.array([deep]), how.layer)[0]), deep
            volume[k], pool = pool / count[k], 0.0
        elif pool >= how.volume:
            count[k], volume[k] = int(pool / how.volume), how.volume
            pool -= count[k] * how.volume
    there = np.flatnonzero(count)
    if len(there):
        volume[there[-1]] += pool / count[there[-1]]
    else:
        count[-1], volume[-1] = 1, pool
    return count, volume, thickness


def births_over_polygon(inflow: Inflow, how: Spacing) -> Births:
    """Single particles of an inflow over a polygon, as many at once as it rises by a share of a layer."""
    h = inflow.hydrograph
    begin, area = max(0.0, h.begin), float(inflow.polygon.area)
    before = float(h.entered.at(begin))
    whole = h.volume - before
    number = max(1, round(whole / how.volume))
    each = max(1, round(SHARE_AT_ONCE * area / (how.along * how.across)))
    count = np.full(math.ceil(number / each), each)
    count[-1] = number - each * (len(count) - 1)
    time = h.entered.when(before + whole * np.cumsum(count) / number)
    velocity = np.zeros(len(count)) if h.velocity is None else np.interp(time, h.time, h.velocity)
    return Births(time, count, np.full(len(count), whole / number), np.zeros(len(count)), velocity)


def shares_along(first: int, count: int) -> np.ndarray:
    """Places (count,) [1] on a line of the particles from number ``first`` on, by low discrepancy."""
    return (0.5 + GOLDEN * (first + np.arange(count))) % 1.0  # type: ignore[no-any-return]


def places_in(polygon: Any, count: int) -> np.ndarray:
    """Places (count, 2) [m] in a polygon, the points of a sequence of low discrepancy in its box that lie inside."""
    import shapely

    west, south, east, north = polygon.bounds
    shapely.prepare(polygon)
    inside, number, size = np.zeros((0, 2)), 0, max(64, 2 * count)
    while len(inside) < count:
        q = (0.5 + np.outer(number + 1 + np.arange(size), arrangement.PLASTIC)) % 1.0
        places = np.array([west, south]) + q * np.array([east - west, north - south])
        inside, number = np.concatenate([inside, places[shapely.contains_xy(polygon, *places.T)]]), number + size
    return inside[:count]


def mass_at(inflow: Inflow) -> Release:
    """The mass of an inflow as forecasts see it: on the surface at the line, or in the polygon, as thick and fast as at the most.

    It covers a strip of :data:`STRIP` cells of the terrain downslope of a line. Its volume is not that of the hydrograph. Raises
    ConfigError if it leaves the terrain, or lies on cells without elevation.
    """
    import shapely

    terrain = inflow.terrain
    outline, thickness = inflow.polygon, 0.0
    if inflow.line is not None:
        onwards = STRIP * max(terrain.cell_size) * inflow.direction
        outline = shapely.Polygon(np.concatenate([inflow.line, inflow.line[::-1] + onwards]))
        thickness = inflow.peak_thickness(slope_at(inflow))
    cells = _covered(inflow, outline)
    if inflow.line is None:
        thickness = inflow.hydrograph.volume / float(outline.area)
    return Release(
        thickness * cells, terrain, outline, Placement.ON_SURFACE, inflow.basal_friction_angle, inflow.material, inflow.name,
        inflow.source, edge=Edge.VERTICAL, basal_friction=inflow.basal_friction, pore_pressure=inflow.pore_pressure,
        velocity=inflow.peak_speed(slope_at(inflow) if inflow.line is not None else 0.0),
    )  # fmt: skip


def _covered(inflow: Inflow, outline: Any) -> np.ndarray:
    """Share (rows, columns) [1] of each cell of the terrain within an outline in map coordinates."""
    import shapely

    terrain, where = inflow.terrain, f"{inflow.source}: inflow {inflow.name}"
    west, south, east, north = terrain.extent
    if not shapely.box(west, south, east, north).covers(outline):
        far = f"easting {west:.2f} to {east:.2f}, northing {south:.2f} to {north:.2f}"
        raise ConfigError(
            f"{where} does not lie inside the terrain {terrain.source} ({far}), {STRIP:g} cells downslope included; move it, or "
            "check its coordinate system"
        )
    (rows, columns), (dx, dy) = terrain.shape, terrain.cell_size
    local = shapely.transform(outline, terrain.frame.to_local)
    share = covered_area(local, np.arange(columns + 1) * dx, np.arange(rows + 1) * dy) / (dx * dy)
    cells = share.T[::-1]
    unknown = (cells > 0) & np.isnan(terrain.elevation)
    if unknown.any():
        row, column = np.argwhere(unknown)[0]
        place = f"row {row}, column {column} (easting {terrain.easting[column]:.2f}, northing {terrain.northing[row]:.2f})"
        raise ConfigError(
            f"{where}: {int(unknown.sum())} cells of the terrain at it have no elevation, the first at {place}; move it, or fill "
            "the elevation raster"
        )
    return cells


def require_wide(inflow: Inflow, spacing: tuple[float, float, float]) -> None:
    """Raise ConfigError if the line or polygon of an inflow is smaller than a cell of a grid of ``spacing`` [m]."""
    cell = math.sqrt(spacing[0] * spacing[1])
    if inflow.width < cell * (1.0 - 1e-9):
        what = "line" if inflow.line is not None else "polygon"
        raise ConfigError(
            f"{inflow.source}: the {what} of inflow {inflow.name} is {inflow.width:.4g} m wide, less than a cell of {cell:.4g} m; "
            f"draw it wider, or use cell_size: {math.floor(1000 * inflow.width) / 1000:g} or less"
        )


def require_entering(inflow: Inflow, end_time: float, member: str = "") -> None:
    """Raise ConfigError if nothing of an inflow enters in a run until ``end_time`` [s]; ``member``: which one, in words."""
    h = inflow.hydrograph
    if not float(h.entered.at(end_time)) > float(h.entered.at(0.0)):
        raise ConfigError(
            f"{h.source}: nothing of inflow {inflow.name} enters{member}: its discharge lasts from {h.begin:g} to {h.end:g} s, the "
            f"run from 0 to {end_time:g} s; shift its times, or set end_time later"
        )


def slope_at(inflow: Inflow) -> float:
    """Slope [1] of the terrain along the flow at a line, the mean over it: negative, downwards."""
    from runout.model.probes import ground_at

    terrain: Terrain = inflow.terrain
    step = max(terrain.cell_size) * inflow.direction
    places = inflow.places(64)
    rise = ground_at(terrain, places + 0.5 * step) - ground_at(terrain, places - 0.5 * step)
    return float(np.nanmean(rise) / max(terrain.cell_size)) if np.isfinite(rise).any() else 0.0


def read_inflow(
    path: str | PathLike[str],
    terrain: Terrain,
    hydrograph: Hydrograph | str | PathLike[str],
    *,
    kind: str | None = None,
    thickness: float | None = None,
    layer: str | None = None,
    name: str | None = None,
    material: Material | None = None,
    basal_friction_angle_deg: float | None = None,
    basal_friction: BasalFriction | None = None,
    pore_pressure: PorePressure | None = None,
) -> Inflow:
    """Inflow of :meth:`runout.Inflow.from_vector`; ``kind`` "line" or "polygon" is what the file holds, by default whichever it is.

    Raises InputError if a file cannot be used, with place, value and remedy.
    """
    source = as_path(path, InputError)
    what = kind or _kind_of(path, layer)
    line = polygon = None
    changes: tuple[str, ...]
    if what == LINE:
        lines, changes = read_lines(source, terrain, layer, key="layer")
        if len(lines) != 1:
            said = f"the layer has {len(lines)} lines, an inflow has one"
            raise ConfigError([Problem(str(source), None, "", said, "write an inflow for each, with a file or a layer of its own")])
        line = lines[0].vertices
    else:
        import shapely

        polygons = read_polygons(source, terrain, layer, "inflow")
        polygon, changes = shapely.union_all(polygons.polygons), polygons.changes
    series = hydrograph if isinstance(hydrograph, Hydrograph) else read_hydrograph(hydrograph)
    angle = None
    if basal_friction_angle_deg is not None:
        angle = math.radians(checked("basal_friction_angle", basal_friction_angle_deg, place=str(source), error=ConfigError))
    for change in changes:
        log.warning(change)
    inflow = Inflow(
        terrain, series, line=line, polygon=polygon, thickness=thickness, name=name or source.stem, source=str(source),
        material=material, basal_friction_angle=angle, basal_friction=basal_friction, pore_pressure=pore_pressure, changes=changes,
    )  # fmt: skip
    mass_at(inflow)  # refuses what leaves the terrain or its known cells
    return inflow


def _kind_of(path: Any, layer: str | None) -> str:
    """Whether a file holds polygons or something else, which is read as lines."""
    frame, _ = read_frame(as_path(path, InputError), layer, "inflow")
    kinds = {str(g.geom_type) for g in frame.geometry if g is not None}
    return POLYGON if kinds and kinds <= {"Polygon", "MultiPolygon"} else LINE
