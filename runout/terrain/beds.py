"""Reads the depth of an erodible bed from polygons and rasters."""

import logging
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np

from runout.errors import InputError, ReleaseError
from runout.io.polygon_coverage import on_cells
from runout.io.polygons import read_polygons, without_overlap
from runout.model.bed import Bed, default_erosion
from runout.model.erosion_laws import Erosion
from runout.model.limits import LIMITS
from runout.model.parameters import Parameter
from runout.model.terrain import Terrain
from runout.terrain.friction_rasters import sampled_raster

log = logging.getLogger(__name__)
DEPTH = Parameter("depth", "depth of the bed", replace(LIMITS["bed_depth"], open_low=False), None, 0.0, 1.0, sampled=False)


def read_bed_polygons(
    path: str | PathLike[str], terrain: Terrain, depth: float | str, *,
    layer: str | None = None, erosion: Erosion | None = None, density: float | None = None,
    pore_pressure_ratio: float | None = None,
) -> Bed:  # fmt: skip
    """Bed of :meth:`runout.Bed.from_vector`; cells that an outline cuts have the covered share of the depth."""
    source = Path(path)
    try:
        polygons = read_polygons(source, terrain, layer, "bed")
        depths = polygons.stated(depth, "bed_depth", "depth")
        separate, overlaps = without_overlap(polygons, depths, "depth")
    except ReleaseError as error:  # the readers of polygons are those of a release, and so are their errors
        raise InputError(str(error)) from error
    _, weighted, parts = on_cells(separate, depths, terrain)
    if not parts:
        raise InputError(
            f"{source}: no polygon of the bed lies on the terrain {terrain.source}; check the coordinate system of both"
        )
    changes = (*polygons.changes, *overlaps)
    for change in changes:
        log.warning(change)
    return Bed(weighted.T[::-1], erosion or default_erosion(), density, str(source), pore_pressure_ratio, changes)


def read_bed_raster(
    path: str | PathLike[str], terrain: Terrain, *, erosion: Erosion | None = None, density: float | None = None,
    pore_pressure_ratio: float | None = None,
) -> Bed:  # fmt: skip
    """Bed of :meth:`runout.Bed.from_raster`; each cell of the terrain has the depth of the cell of the raster at its centre."""
    values, sentences, doubts = sampled_raster(Path(path), terrain, DEPTH)
    depth = values.T[::-1]
    missing = int((np.isnan(depth) & np.isfinite(terrain.elevation)).sum())
    blank = [f"{path}: {missing} of {depth.size} cells of the terrain have no value; they have no bed"] if missing else []
    changes = (*sentences, *doubts, *blank)
    for change in changes:
        log.warning(change)
    if not (np.nan_to_num(depth) > 0).any():
        raise InputError(f"{path}: depth of the bed is 0 on all cells of the terrain; check the raster, or remove the bed")
    return Bed(depth, erosion or default_erosion(), density, str(path), pore_pressure_ratio, changes)
