"""Friction zones of the polygons in vector files."""

import logging
from collections.abc import Sequence
from itertools import combinations
from os import PathLike
from pathlib import Path

import numpy as np

from runout.errors import ReleaseError, ZoneError
from runout.io.polygon_overlap import OVERLAP
from runout.io.polygons import read_polygons, without_overlap
from runout.model.friction import FrictionZones
from runout.model.terrain import Terrain
from runout.terrain.overlay import on_cells

log = logging.getLogger(__name__)


def read_zones(
    path: str | PathLike[str],
    terrain: Terrain,
    *,
    factor: float | str | None = None,
    basal_friction_angle_deg: float | str | None = None,
    layer: str | None = None,
) -> FrictionZones:
    """Zones of the polygons of a vector file; parameters as in :meth:`runout.model.friction.FrictionZones.from_vector`.

    What lies beyond the terrain is left out. Overlapping polygons of one value count once.

    Raises
    ------
    ZoneError
        With the place, the value and the remedy.
    """
    source = Path(path)
    if (factor is None) == (basal_friction_angle_deg is None):
        raise ZoneError(f"{source}: give factor, which multiplies friction, or basal_friction_angle_deg, which replaces it")
    try:
        polygons = read_polygons(source, terrain, layer, "friction zone")
        if basal_friction_angle_deg is None:
            assert factor is not None  # one of the two is given
            values = polygons.stated(factor, "friction_factor", "factor")
        else:
            values = polygons.stated(basal_friction_angle_deg, "basal_friction_angle", "basal_friction_angle_deg")
        parts, overlaps = without_overlap(polygons, values, "friction", "" if basal_friction_angle_deg is None else " deg")
    except ReleaseError as error:  # the readers of polygons are those of a release, and so are their errors
        raise ZoneError(str(error)) from error
    if basal_friction_angle_deg is not None:
        values = np.tan(np.radians(values))
    covered, weighted, kept = on_cells(parts, values, terrain)
    if not kept:
        raise ZoneError(f"{source}: no friction zone lies on the terrain {terrain.source}; check the coordinate system of both")
    outside = np.maximum(1.0 - covered, 0.0)
    multiplies = basal_friction_angle_deg is None
    found = FrictionZones(
        outside + weighted if multiplies else outside,
        np.zeros_like(weighted) if multiplies else weighted,
        terrain.cell_size,
        tuple({"geometry": part, "factor" if multiplies else "coefficient": value} for part, value in kept),
        str(source),
        polygons.changes + overlaps,
    )
    for change in found.changes:
        log.warning(change)
    return found


def together(parts: Sequence[FrictionZones]) -> FrictionZones:
    """Zones of several files as one.

    Raises
    ------
    ZoneError
        If zones of two of them overlap.
    """
    import shapely

    for one, other in combinations(parts, 2):
        a, b = (shapely.union_all([zone["geometry"] for zone in part.zones]) for part in (one, other))
        common = a.intersection(b).area
        if common > OVERLAP * min(a.area, b.area):
            raise ZoneError(
                f"friction zones of {one.source} and {other.source} overlap by {common:.6g} m2; cut one of them back so that every "
                "place has one friction"
            )
    return FrictionZones(
        np.maximum(
            1.0 + np.sum([part.factor - 1.0 for part in parts], axis=0), 0.0
        ),  # on borders shares sum up to one with rounding
        np.sum([part.coefficient for part in parts], axis=0),
        parts[0].cell_size,
        tuple(zone for part in parts for zone in part.zones),
        ", ".join(part.source for part in parts),
        tuple(change for part in parts for change in part.changes),
    )
