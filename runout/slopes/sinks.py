"""Closed sinks of an elevation raster, the main flow paths, and both in numbers."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.io.vector import outline

if TYPE_CHECKING:
    from runout.slopes.drainage import Drainage

LEAST_DEPTH = 0.05  # [m]; shallower sinks are noise of elevations and the gradient on filled flats
MOST_SINKS = 1000  # polygons that are written, the largest by volume
PATH_CELLS, LEAST_PATH_AREA = 200, 1e4  # a flow path drains at least so many cells and so many m2
SLOPE_CLASSES_DEG = (0.0, 5.0, 15.0, 25.0, 35.0, 45.0, 90.0)
LISTED = 10  # sinks of the page and the record


@dataclass(frozen=True)
class Sink:
    """A closed sink."""

    # easting, northing: deepest cell [m]
    easting: float
    northing: float
    depth: float  # largest depth below the spill [m]
    # area, volume: plan area [m2] and volume up to the spill [m3]
    area: float
    volume: float
    outline: Any  # shapely MultiPolygon: along the cell edges, in map coordinates

    def attributes(self) -> dict[str, float]:
        """Values without the outline, by name and unit."""
        values = asdict(self)
        names = {"easting": "easting", "northing": "northing", "depth": "depth_m", "area": "area_m2", "volume": "volume_m3"}
        return {name: round(values[key], 3) for key, name in names.items()}


def sinks(drained: "Drainage", least_depth: float = LEAST_DEPTH) -> tuple[list[Sink], dict[str, float]]:
    """Sinks deeper than ``least_depth`` [m], the largest volume first, and totals of all of them.

    At most :data:`MOST_SINKS` are listed; the totals ``number``, ``area_m2``, ``volume_m3`` and ``deepest_m`` hold all.
    """
    from scipy import ndimage

    depth = np.nan_to_num(drained.sink_depth)
    label, count = ndimage.label(depth > 0, np.ones((3, 3)))
    numbers = np.arange(1, count + 1)
    deepest = ndimage.maximum(depth, label, numbers) if count else np.zeros(0)
    deep = numbers[deepest > least_depth]
    cells = np.bincount(label.ravel(), minlength=count + 1)
    volumes = np.bincount(label.ravel(), depth.ravel(), count + 1) * drained.terrain.cell_area
    totals = {
        "number": len(deep),
        "area_m2": float(cells[deep].sum() * drained.terrain.cell_area),
        "volume_m3": float(volumes[deep].sum()),
        "deepest_m": float(deepest.max(initial=0.0)),
    }
    order = deep[np.argsort(-volumes[deep], kind="stable")][:MOST_SINKS]
    boxes = ndimage.find_objects(label)
    return [_sink(drained, depth, label, int(k), boxes[k - 1], float(volumes[k])) for k in order], totals


def _sink(drained: "Drainage", depth: np.ndarray, label: np.ndarray, number: int, box: tuple[slice, slice], volume: float) -> Sink:
    inside = label[box] == number
    own = np.where(inside, depth[box], 0.0)
    row, column = np.unravel_index(np.argmax(own), own.shape)
    terrain = drained.terrain
    part = _Place(terrain, box)
    area = float(inside.sum() * terrain.cell_area)
    east, north = terrain.easting[box[1].start + column], terrain.northing[box[0].start + row]
    return Sink(float(east), float(north), float(own.max()), area, volume, outline(inside, part))  # type: ignore[arg-type]


class _Place:
    """Cell size and extent of a part of a terrain, which may be smaller than a terrain can be."""

    def __init__(self, terrain: Any, box: tuple[slice, slice]):
        self.cell_size = dx, dy = terrain.cell_size
        west, north = terrain.west + box[1].start * dx, terrain.extent[3] - box[0].start * dy
        self.extent = (west, north - (box[0].stop - box[0].start) * dy, west + (box[1].stop - box[1].start) * dx, north)


def hidden_share(drained: "Drainage") -> float:
    """Share of the known area whose water passes through a sink before it leaves the terrain [1]."""
    depth = np.nan_to_num(drained.sink_depth) > LEAST_DEPTH
    through, flat = depth.ravel().copy(), drained.receiver.ravel()
    target = flat.copy()
    while True:  # doubled steps: every path is followed to its end in the logarithm of its length
        through |= through[target]
        further = target[target]
        if np.array_equal(further, target):
            break
        target = further
    known = np.isfinite(drained.area).ravel()
    return float(through[known].mean())


def path_area(drained: "Drainage") -> float:
    """Drainage area from which on a cell belongs to a flow path [m2]."""
    return max(PATH_CELLS * drained.terrain.cell_area, LEAST_PATH_AREA)


def flow_paths(drained: "Drainage", least_area: float | None = None) -> list[dict[str, Any]]:
    """Flow paths as rows with ``geometry`` (LineString, downstream) and ``drainage_area_m2`` at the lower end.

    Lines run between the heads and the junctions of the cells that drain ``least_area`` [m2] or more.
    """
    from shapely import LineString

    least = path_area(drained) if least_area is None else least_area
    area, receiver = np.nan_to_num(drained.area).ravel(), drained.receiver.ravel()
    on = np.flatnonzero(area >= least)
    donors = np.bincount(receiver[on][receiver[on] != on], minlength=area.size)
    rows = []
    for start in on[donors[on] != 1]:
        cells = [int(start)]
        while receiver[cells[-1]] != cells[-1]:
            cells.append(int(receiver[cells[-1]]))
            if donors[cells[-1]] > 1:
                break
        if len(cells) > 1:
            points = np.column_stack(_centres(drained, np.array(cells)))
            rows.append({"drainage_area_m2": float(area[cells[-2]]), "geometry": LineString(points)})
    return rows


def _centres(drained: "Drainage", cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Easting and northing (n,) [m] of cells by their flat index."""
    row, column = np.divmod(cells, drained.terrain.shape[1])
    return drained.terrain.easting[column], drained.terrain.northing[row]


@dataclass(frozen=True)
class TerrainFigures:
    """What an elevation raster holds and hides."""

    sinks: list[Sink]  # the largest volume first
    totals: dict[str, float]  # `number`, `area_m2`, `volume_m3` and `deepest_m` of all sinks
    through_sinks: float  # share of the known area whose water passes through a sink [1]
    paths: list[dict[str, Any]]  # flow paths as rows with `geometry`
    path_area: float  # drainage area from which on a cell belongs to a flow path [m2]
    classes: dict[str, float]  # share of the known area [1] by class of slope
    steepest_deg: float
    unknown: int  # cells without an elevation

    def record(self) -> dict[str, Any]:
        """Values for the JSON record."""
        return {
            "sinks": self.totals | {"share_of_area_through_sinks": self.through_sinks, "deeper_than_m": LEAST_DEPTH},
            "largest_sinks": [sink.attributes() for sink in self.sinks[:LISTED]],
            "slope_classes": self.classes,
            "steepest_slope_deg": self.steepest_deg,
            "cells_without_elevation": self.unknown,
            "flow_paths": {"number": len(self.paths), "drainage_area_from_m2": self.path_area},
        }

    def lines(self) -> Iterator[str]:
        """One line for each subject."""
        t = self.totals
        if t["number"]:
            of = f"{t['area_m2']:.4g} m2, {t['volume_m3']:.4g} m3, up to {t['deepest_m']:.3g} m deep"
            share = f"{self.through_sinks:.0%} of the area drains through one"
            yield f"sinks: {t['number']:g} deeper than {LEAST_DEPTH:g} m, {of}; {share}"
        else:
            yield f"sinks: none deeper than {LEAST_DEPTH:g} m"
        yield f"flow paths: {len(self.paths)} from {self.path_area:.3g} m2 of drainage area on"
        shares = ", ".join(f"{share:.0%} {name}" for name, share in self.classes.items() if share >= 0.005)
        yield f"slope: {shares}; steepest {self.steepest_deg:.1f} deg"


def terrain_figures(drained: "Drainage", slope: np.ndarray) -> TerrainFigures:
    """Figures of a drained terrain with its slope (rows, columns) [rad]."""
    closed_sinks, totals = sinks(drained)
    least = path_area(drained)
    degrees = np.degrees(slope[np.isfinite(slope)])
    counts = np.histogram(degrees, SLOPE_CLASSES_DEG)[0] / max(degrees.size, 1)
    names = [f"{low:g} to {high:g} deg" for low, high in pairwise(SLOPE_CLASSES_DEG)]
    unknown = int(np.isnan(drained.terrain.elevation).sum())
    classes = {name: float(share) for name, share in zip(names, counts, strict=True)}
    paths = flow_paths(drained, least)
    return TerrainFigures(
        closed_sinks, totals, hidden_share(drained), paths, least, classes, float(degrees.max(initial=0.0)), unknown
    )
