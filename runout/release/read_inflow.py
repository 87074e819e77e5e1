"""Reads inflows: a line or polygons of a vector file, and a hydrograph of a CSV file."""

import logging
import math
from os import PathLike
from typing import Any

from runout.errors import ConfigError, InputError, Problem
from runout.io.boundary import as_path
from runout.io.hydrographs import read_hydrograph
from runout.io.polygons import read_frame, read_polygons
from runout.io.probe_layers import read_lines
from runout.model.basal_friction import BasalFriction
from runout.model.inflow import Hydrograph, Inflow
from runout.model.limits import checked
from runout.model.materials import Material
from runout.model.pore_pressure import PorePressure
from runout.model.terrain import Terrain
from runout.release.inlet import mass_at

log = logging.getLogger(__name__)
LINE, POLYGON = "line", "polygon"


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
