"""``outlines.gpkg``: releases, areas of equal probability, structures, probes and observations as vector layers for any GIS."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.hazard.danger import INTENSITY, LEVEL, PERIOD, entries_of
from runout.hazard.observed import observed_layers
from runout.hazard.outline_style import arrival_style, danger_styles, outline_styles
from runout.hazard.round_numbers import round_edges
from runout.hazard.writers import Products
from runout.io.vector import outline, reaches, write_outlines
from runout.quantities import FIRST_ARRIVAL, QUANTITIES

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from runout.model.inflow import Inflow
    from runout.model.probes import Probes
    from runout.model.terrain import Terrain


ARRIVAL_LAYER, ARRIVAL_START = "arrival", "reached_at"  # layer and column that a GIS plays over time
RELEASED_AT = "2000-01-01T00:00:00"  # date that stands for the start of the release
MOMENTS = 24  # of the arrival, about


def earlier(results: Path) -> set[Path]:
    """The outlines of an earlier run."""
    return {path for path in [results / "outlines.gpkg"] if path.is_file()}


def write(products: Products) -> list[Path]:
    """Path of the file."""
    site, terrain, hazard, observed = products.site, products.terrain, products.hazard, products.observed
    path = write_outlines(
        products.results / "outlines.gpkg",
        terrain,
        products.releases,
        hazard["inundation_probability"].values,
        attributes={"thickness_threshold_m": float(hazard["thickness_threshold"].values[0])} | products.ensemble.counts(),
        zones=site.files.zones(),
        obstacles=[part for obstacles in site.files.obstacles() for part in obstacles.parts],
        styles=outline_styles() | danger_styles(hazard) | arrival_style(arrival_edges(hazard)),
        further={**(observed_layers(observed) if observed else {}), **products.built.layers, **probe_layers(site.files.probes())}
        | inflow_layers(site.files.inflows().require())
        | return_period_layer(hazard, terrain)
        | danger_layers(hazard, terrain)
        | arrival_layer(hazard, terrain),
    )
    return [path]


def danger_layers(hazard: "xr.Dataset", terrain: "Terrain") -> dict[str, tuple[str, list[dict[str, Any]]]]:
    """Layers ``danger_level`` and ``intensity_class``: a multipolygon for each level, and for each class and return period."""
    if INTENSITY not in hazard:
        return {}
    of_classes = [
        {"return_period_years": float(years), **row}
        for years in hazard[PERIOD].values
        for row in _areas(hazard, INTENSITY, hazard[INTENSITY].sel({PERIOD: years}).values, terrain, "class")
    ]
    of_levels = _areas(hazard, LEVEL, hazard[LEVEL].values, terrain, "level") if LEVEL in hazard else []
    layers = {"danger_level": ("MultiPolygon", of_levels), "intensity_class": ("MultiPolygon", of_classes)}
    return {name: layer for name, layer in layers.items() if layer[1]}


def _areas(hazard: "xr.Dataset", name: str, values: np.ndarray, terrain: "Terrain", column: str) -> list[dict[str, Any]]:
    """Rows of the classes or levels that occur in a map, with outline, area, meaning and state of checking."""
    return [
        {
            column: entry["name"], "number": entry["number"], "meaning": entry["text"], "checked": entry["checked"],
            "scheme": hazard[name].attrs["scheme"], "area_m2": float((values == entry["number"]).sum() * terrain.cell_area),
            "geometry": outline(values == entry["number"], terrain),
        }
        for entry in entries_of(hazard, name)
        if (values == entry["number"]).any()
    ]  # fmt: skip


def arrival_edges(hazard: "xr.Dataset") -> list[float]:
    """Round times [s] from 0 to after the earliest arrival in the last cell, at equal distances; none where no flow arrives."""
    times = hazard[FIRST_ARRIVAL].values
    if not np.isfinite(times).any():
        return []
    latest = float(np.nanmax(times))
    first = round_edges(0.0, latest, MOMENTS)[:2]
    step = first[1] if len(first) > 1 else 1.0
    return [step * k for k in range(int(latest // step) + 2)]


def moment(seconds: float) -> "pd.Timestamp":
    """Date of a time after the release."""
    import pandas as pd

    return pd.Timestamp(RELEASED_AT) + pd.Timedelta(seconds, unit="s")


def arrival_layer(hazard: "xr.Dataset", terrain: "Terrain") -> dict[str, tuple[str, list[dict[str, Any]]]]:
    """Layer ``arrival``: cells that the flow of any member reaches first between two times, with a date for players of time."""
    edges, times = arrival_edges(hazard), hazard[FIRST_ARRIVAL].values
    rings = [(low, high, (times >= low) & (times < high)) for low, high in pairwise(edges)]
    rows = [
        {"from_s": low, "to_s": high, ARRIVAL_START: moment(low), "geometry": outline(cells, terrain)}
        for low, high, cells in rings
        if cells.any()
    ]
    return {ARRIVAL_LAYER: ("MultiPolygon", rows)} if rows else {}


def return_period_layer(hazard: "xr.Dataset", terrain: "Terrain") -> dict[str, tuple[str, list[dict[str, Any]]]]:
    """Layer ``return_periods``: outline of the cells that reach the lowest threshold of thickness at 1 / return period or more."""
    name = QUANTITIES["thickness"].at_return_period
    if name not in hazard:
        return {}
    limit = float(hazard["thickness_threshold"].values[0])
    cells = {float(years): reaches(hazard[name].sel(return_period=years).values, limit) for years in hazard["return_period"].values}
    rows = [
        {"return_period_a": years, "thickness_threshold_m": limit, "geometry": outline(mask, terrain)}
        for years, mask in cells.items()
        if mask.any()
    ]
    return {"return_periods": ("MultiPolygon", rows)} if rows else {}


def inflow_layers(inflows: "Sequence[Inflow]") -> dict[str, tuple[str, list[dict[str, Any]]]]:
    """Layers ``inflow_lines`` and ``inflow_areas``: type of geometry, and rows with ``name``, volume, peak and ``geometry``."""
    from shapely import LineString

    def row(one: "Inflow", geometry: Any) -> dict[str, Any]:
        kept = one.record()
        return {"name": one.name, "volume_m3": kept["volume"], "peak_m3_s": kept["peak_discharge"], "geometry": geometry}

    lines = [row(one, LineString(one.line)) for one in inflows if one.line is not None]
    areas = [row(one, one.polygon) for one in inflows if one.line is None]
    layers = {"inflow_lines": ("LineString", lines), "inflow_areas": ("MultiPolygon", areas)}
    return {name: layer for name, layer in layers.items() if layer[1]}


def probe_layers(probes: "Probes | None") -> dict[str, tuple[str, list[dict[str, Any]]]]:
    """Layers ``probes`` and ``cross_sections``: type of geometry, and rows with ``name`` and ``geometry``; none without probes."""
    from shapely import LineString, Point

    if probes is None:
        return {}
    points = [{"name": p.name, "geometry": Point(p.easting, p.northing)} for p in probes.points]
    lines = [{"name": s.name, "length_m": s.length, "geometry": LineString(s.vertices)} for s in probes.cross_sections]
    layers = {"probes": ("Point", points), "cross_sections": ("LineString", lines)}
    return {name: layer for name, layer in layers.items() if layer[1]}
