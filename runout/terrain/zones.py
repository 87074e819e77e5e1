"""Zones of the polygons in vector files: of friction, and of pore pressure ratios."""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import InputError, ReleaseError, ZoneError
from runout.io.polygon_coverage import covered_part, on_cells, within_extent
from runout.io.polygons import NAMED, OVERLAP, SLIVER, PolygonLayer, read_polygons, without_overlap
from runout.model.friction import FrictionZones
from runout.model.friction_laws import DEFAULT_FRICTION, FRICTIONS, FrictionLaw
from runout.model.pore_pressure import RatioZones
from runout.model.terrain import Terrain

log = logging.getLogger(__name__)
LEAST_COVER = 0.5  # share of a cell that a zone covers at least


def read_zones(
    path: str | PathLike[str],
    terrain: Terrain,
    *,
    factor: float | str | None = None,
    basal_friction_angle_deg: float | str | None = None,
    basal_friction: Mapping[str, float | str] | None = None,
    layer: str | None = None,
    law: str | None = None,
) -> FrictionZones:
    """Zones of the polygons of a vector file; parameters as in :meth:`runout.model.friction.FrictionZones.from_vector`.

    What lies beyond the terrain is left out. Overlapping polygons of one value count once. Raises ZoneError with the place, the
    value and the remedy.
    """
    source = Path(path)
    if sum(choice is not None for choice in (factor, basal_friction_angle_deg, basal_friction)) != 1:
        raise ZoneError(
            f"{source}: give factor, which multiplies friction, or basal_friction_angle_deg, which replaces it, or basal_friction, "
            "which replaces parameters of its law"
        )
    try:
        polygons = read_polygons(source, terrain, layer, "friction zone")
        if basal_friction is not None:
            return _warned(_of_parameters(polygons, basal_friction, FRICTIONS.find(law or DEFAULT_FRICTION), terrain))
        if basal_friction_angle_deg is None:
            assert factor is not None  # one of them is given
            values = polygons.stated(factor, "friction_factor", "factor")
        else:
            values = polygons.stated(basal_friction_angle_deg, "basal_friction_angle", "basal_friction_angle_deg")
        doubts = _zeros(polygons, factor if basal_friction_angle_deg is None else basal_friction_angle_deg, values)
        parts, overlaps = without_overlap(polygons, values, "friction", "" if basal_friction_angle_deg is None else " deg")
    except ReleaseError as error:  # the readers of polygons are those of a release, and so are their errors
        raise ZoneError(str(error)) from error
    if basal_friction_angle_deg is not None:
        values = np.tan(np.radians(values))
    covered, weighted, parts_inside = _on_terrain(source, parts, values, terrain)
    outside = np.maximum(1.0 - covered, 0.0)
    multiplies = basal_friction_angle_deg is None
    zones = FrictionZones(
        outside + weighted if multiplies else outside,
        np.zeros_like(weighted) if multiplies else weighted,
        terrain.cell_size,
        tuple({"geometry": part, "factor" if multiplies else "coefficient": value} for part, value in parts_inside),
        str(source),
        polygons.changes + overlaps + doubts,
        warnings=doubts,
    )
    return _warned(zones)


def _of_parameters(polygons: PolygonLayer, entries: Mapping[str, float | str], law: FrictionLaw, terrain: Terrain) -> FrictionZones:
    """Zones that replace parameters of a law of friction; ``entries`` by their keys in site.yaml."""
    of_law = {p.key: (p, number) for p, number in zip(law.parameters, law.numbers, strict=True)}
    unknown = [key for key in entries if key not in of_law]
    if unknown:
        raise ZoneError(f"{polygons.source}: the friction law {law.name} has no {unknown[0]}; choose among {', '.join(of_law)}")
    values = {key: polygons.within(entry, of_law[key][0]) for key, entry in entries.items()}
    doubts = tuple(d for key, own in values.items() if of_law[key][0].default != 0 for d in _zeros(polygons, entries[key], own))
    _, kind = np.unique(np.column_stack(list(values.values())), axis=0, return_inverse=True)
    in_words = [", ".join(f"{key} {value[i]:g}" for key, value in values.items()) for i in range(len(kind))]
    parts, overlaps = without_overlap(polygons, kind.ravel().astype(float), "friction", told=in_words)
    ones, replaced = np.ones((terrain.shape[1], terrain.shape[0])), {}
    for key, value in values.items():
        parameter, number = of_law[key]
        numbers = [replace(law.example, **{parameter.name: v}).numbers()[number] for v in value.tolist()]
        covered, weighted, _ = _on_terrain(polygons.source, parts, np.array(numbers), terrain)
        replaced[number] = np.maximum(1.0 - covered, 0.0), weighted
    _, _, parts_inside = _on_terrain(polygons.source, parts, np.arange(len(parts)), terrain)
    zones = [{"geometry": part, "parameters": {key: float(v[int(i)]) for key, v in values.items()}} for part, i in parts_inside]
    changes = polygons.changes + overlaps + doubts
    return FrictionZones(
        ones, np.zeros_like(ones), terrain.cell_size, tuple(zones), str(polygons.source), changes, replaced, warnings=doubts
    )


def _zeros(polygons: PolygonLayer, entry: float | str | None, values: np.ndarray) -> tuple[str, ...]:
    """A question on an attribute that is 0 in some polygons: a Shapefile holds 0 where a value is missing."""
    rows = np.flatnonzero(values == 0.0)
    if not isinstance(entry, str) or not len(rows):
        return ()
    named = ", ".join(str(polygons.number(row)) for row in rows[:NAMED]) + (", ..." if len(rows) > NAMED else "")
    doubt = f"attribute {entry!r} is 0 in {len(rows)} of {len(values)} polygons ({named}), which are ground without friction"
    return (f"{polygons.source}: {doubt}; if the value is missing there, write it, or delete these polygons",)


def _on_terrain(
    source: Path, parts: np.ndarray, values: np.ndarray, terrain: Terrain
) -> tuple[np.ndarray, np.ndarray, list[tuple[Any, float]]]:
    """:func:`runout.io.polygon_coverage.on_cells`; ZoneError if no part lies on the terrain."""
    covered, weighted, parts_inside = on_cells(parts, values, terrain)
    if not parts_inside:
        raise ZoneError(f"{source}: no friction zone lies on the terrain {terrain.source}; check the coordinate system of both")
    return covered, weighted, parts_inside


def _warned(zones: FrictionZones) -> FrictionZones:
    """The zones, after a warning of each of their changes."""
    for change in zones.changes:
        log.warning(change)
    return zones


def together(parts: Sequence[FrictionZones], rasters: FrictionZones | None = None) -> FrictionZones:
    """Zones of several files as one; they change what ``rasters`` state, if these are given.

    Raises ZoneError if zones of two of them overlap.
    """
    import shapely

    for one, other in combinations(parts, 2):
        a, b = (shapely.union_all([zone["geometry"] for zone in part.zones]) for part in (one, other))
        common = a.intersection(b).area
        if common > max(OVERLAP * min(a.area, b.area), SLIVER * math.prod(one.cell_size)):
            raise ZoneError(
                f"friction zones of {one.source} and {other.source} overlap by {common:.6g} m2; cut one of them back so that every "
                "place has one friction"
            )
    sources = [*([rasters] if rasters else []), *parts]
    return FrictionZones(
        np.maximum(
            1.0 + np.sum([part.factor - 1.0 for part in parts], axis=0), 0.0
        ),  # on borders shares sum up to one with rounding
        np.sum([part.coefficient for part in parts], axis=0),
        parts[0].cell_size,
        tuple(zone for part in parts for zone in part.zones),
        ", ".join(part.source for part in sources),
        tuple(change for part in sources for change in part.changes),
        _replaced_in(parts),
        rasters.gridded if rasters else {},
        tuple(warning for part in sources for warning in part.warnings),
    )


def _replaced_in(parts: Sequence[FrictionZones]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """What zones of several files replace: the parts that are left of the numbers of the mass, and what is added."""
    replaced: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for part in parts:
        for name, (share, own) in part.replaced.items():
            before, added = replaced.get(name, (np.ones_like(share), np.zeros_like(own)))
            replaced[name] = np.maximum(before + (share - 1.0), 0.0), added + own
    return replaced


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
