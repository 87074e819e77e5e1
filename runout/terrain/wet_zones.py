"""Reads zones of pore pressure ratios from polygons."""

import logging
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import InputError, ReleaseError
from runout.io.polygon_coverage import within_extent
from runout.io.polygons import NAMED, read_polygons, without_overlap
from runout.model.pore_pressure import RatioZones
from runout.model.terrain import Terrain
from runout.terrain.overlay import covered_part

log = logging.getLogger(__name__)
LEAST_COVER = 0.5  # share of a cell that a zone covers at least


def read_ratio_zones(
    path: str | PathLike[str], terrain: Terrain, ratio: float | str | None = None, *, low: float | None = None,
    high: float | None = None, elsewhere: float | None = None, layer: str | None = None,
) -> RatioZones:  # fmt: skip
    """Zones of :meth:`runout.RatioZones.from_vector`."""
    path = Path(path)
    try:
        polygons = read_polygons(path, terrain, layer, "pore pressure zone")
        ratios = None if ratio is None else polygons.stated(ratio, "pore_pressure_ratio", "ratio")
        numbers = np.arange(len(polygons.polygons), dtype=np.float64)  # those that draw a ratio differ
        told = [f"zone {int(number) + 1}" for number in numbers] if ratios is None else None
        separate, overlaps = without_overlap(polygons, numbers if ratios is None else ratios, "ratio", "", told)
    except ReleaseError as error:  # the readers of polygons are those of a release, and so are their errors
        raise InputError(str(error)) from error
    zone = _zones_of_cells(separate, terrain)
    if (zone < 0).all():
        raise InputError(
            f"{path}: no polygon covers half of a cell of the terrain {terrain.source}; check the coordinate system of both"
        )
    empty = [str(polygons.number(k)) for k in range(len(separate)) if not (zone == k).any()]
    changes = (*polygons.changes, *overlaps, *_of_empty(path, empty))
    for change in changes:
        log.warning(change)
    last = int(zone.max()) + 1
    values: Any = ratio if ratios is None or not isinstance(ratio, str) else ratios[:last]
    return RatioZones(zone=zone, ratio=values, low=low, high=high, elsewhere=elsewhere, changes=changes)


def _zones_of_cells(separate: np.ndarray, terrain: Terrain) -> np.ndarray:
    """Number (rows, columns) of the polygon that covers half of each cell or more; -1 where there is none."""
    zone = np.full(terrain.shape, -1, np.int32)
    for k, part in enumerate(within_extent(separate, terrain.extent)):
        if part.area > 0:
            window, area = covered_part(part, terrain)
            zone[window][area >= LEAST_COVER * terrain.cell_area * (1.0 - 1e-9)] = k
    return zone


def _of_empty(path: Path, empty: list[str]) -> list[str]:
    if not empty:
        return []
    more = f" and {len(empty) - NAMED} more" if len(empty) > NAMED else ""
    return [f"{path}: zones {', '.join(empty[:NAMED])}{more} cover no cell of the terrain to a half; they have no effect"]
