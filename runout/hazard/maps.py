"""Rasters of single maps for a GIS, each with its style."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runout.hazard.bed_maps import BED_MEANS, CHANGES
from runout.hazard.boundary import DEVIATION, MEAN
from runout.hazard.danger import INTENSITY, LEVEL, PERIOD, entries_of, label
from runout.hazard.joint import conditions_of
from runout.hazard.second_grid import DECIDING, SOURCES
from runout.hazard.style import class_edges, palette, qml
from runout.io.atomic import write_text
from runout.io.geotiff import write_cog
from runout.quantities import (
    ALL_QUANTITIES,
    ARRIVAL_PERCENTILE,
    BED_QUANTITIES,
    CHANGE_PERCENTILE,
    DEPOSIT,
    FIRST_ARRIVAL,
    INFLOW_MAP,
    QUANTITIES,
    MapQuantity,
    peak_quantities,
    quantity_of,
)
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

HEADLINE_MAPS = (
    "inundation_probability",
    *(q.peak for q in peak_quantities()),
    FIRST_ARRIVAL,
    QUANTITIES[DEPOSIT].mean,
    QUANTITIES[DEPOSIT].peak,
    "members_reached",
)
OBSERVED_MAPS = (  # of sites with observations
    "observed_deposit_thickness",
    "deposit_thickness_difference",
    "observed_elevation_change",
    "mean_elevation_change",
    "elevation_change_difference",
)
BOUNDARY_MAPS = (MEAN, DEVIATION)
TERRAIN_MAPS = ("elevation", "ground_slope", "release_thickness")
_VALUE = r"_[-+.0-9e]+(kPa)?"
_JOINT = rf"(_({'|'.join(ALL_QUANTITIES)}){_VALUE})+"
OWN_MAP = re.compile(rf"({'|'.join(VARIABLES)})((_over)?({_VALUE})?|{_JOINT})\.(tif|qml|tif\.aux\.xml)")  # names of map_layers
BED_SUMMARIES = (*(name for q in BED_QUANTITIES.values() for name in (q.mean, q.peak) if name), *BED_MEANS)
PERCENTILES = (*(q.percentile for q in ALL_QUANTITIES.values() if q.percentile), CHANGE_PERCENTILE, ARRIVAL_PERCENTILE)
CELL_ERRORS = (*(name for q in QUANTITIES.values() if q.has_mean for name in (*q.means, q.numerical_error)), DECIDING)
_KINDS = ("probability", "standard_error", "numerical_error")
JOINT_KINDS = (*(f"exceedance_{kind}" for kind in _KINDS), "annual_exceedance")


def map_layers(hazard: "xr.Dataset") -> Iterator[tuple[str, str, dict[str, float]]]:
    """File name without suffix, variable and coordinates of every map that becomes a raster of its own."""
    for name in (*HEADLINE_MAPS, *TERRAIN_MAPS):
        yield name, name, {}
    for name in dict.fromkeys((INFLOW_MAP, *BED_SUMMARIES, *OBSERVED_MAPS, *BOUNDARY_MAPS, *CELL_ERRORS)):
        if name in hazard:
            yield name, name, {}
    for quantity in ALL_QUANTITIES.values():
        for name in (name for name in map(quantity.exceedance, _KINDS) if name in hazard):
            for value in hazard[quantity.threshold].values if quantity.threshold in hazard.coords else ():
                yield f"{name}_over_{_stem(quantity, value)}", name, {quantity.threshold: float(value)}
        for value in hazard[quantity.threshold].values if quantity.annual_exceedance in hazard else ():
            yield (
                f"{quantity.annual_exceedance}_over_{_stem(quantity, value)}",
                quantity.annual_exceedance,
                {quantity.threshold: float(value)},
            )
        for years in hazard["return_period"].values if quantity.at_return_period in hazard else ():
            yield f"{quantity.at_return_period}_{years:g}", quantity.at_return_period, {"return_period": float(years)}
    for kind in JOINT_KINDS:
        for number, condition in enumerate(conditions_of(hazard), 1):
            of = "_".join(f"{name}_{_stem(ALL_QUANTITIES[name], limit)}" for name, limit in condition.items())
            if f"joint_{kind}" in hazard:
                yield f"joint_{kind}_{of}", f"joint_{kind}", {"joint": number}
    for years in hazard[PERIOD].values if INTENSITY in hazard else ():
        yield f"{INTENSITY}_{years:g}", INTENSITY, {PERIOD: float(years)}
    if LEVEL in hazard:
        yield LEVEL, LEVEL, {}
    for name in PERCENTILES:
        for value in hazard["percentile"].values if name in hazard else ():
            yield f"{name}_{value:g}", name, {"percentile": float(value)}


def write_maps(hazard: "xr.Dataset", folder: Path) -> list[Path]:
    """Paths of a GeoTIFF and a QGIS style of every map of :func:`map_layers`; layers of one variable share their classes.

    Mean and percentiles of the change of elevation share one scale, symmetric about 0.
    """
    paths = []
    styles: dict[str, str] = {}
    for stem, name, selection in map_layers(hazard):
        paths.append(write_cog(hazard, name, folder / f"{stem}.tif", **selection))
        if name not in styles:
            styles[name] = _style(hazard, name)
        paths.append(write_text(styles[name], folder / f"{stem}.qml"))
    return paths


def _style(hazard: "xr.Dataset", name: str) -> str:
    if name == DECIDING:
        return palette([(number, colour, words) for number, (words, colour) in enumerate(SOURCES, 1)])
    if name in (INTENSITY, LEVEL):
        return palette([(entry["number"], entry["colour"], label(entry)) for entry in entries_of(hazard, name)])
    units, divisor = VARIABLES[name].printed
    alike = [other for other in CHANGES if other in hazard] if name in CHANGES else [name]
    finite = [hazard[other].values[np.isfinite(hazard[other].values)] / divisor for other in alike]
    ends = [end for values in finite if values.size for end in (float(values.min()), float(values.max()))]
    smallest, largest = (min(ends), max(ends)) if ends else (0.0, 0.0)
    return qml(class_edges(name, _thresholds(hazard, name), smallest, largest), units, name)


def _thresholds(hazard: "xr.Dataset", name: str) -> list[float]:
    """Thresholds of the quantity that a map shows, in the unit for people; none for times and counts."""
    quantity = quantity_of(name)
    if quantity is None or quantity.threshold not in hazard.coords:
        return []
    return (hazard[quantity.threshold].values / VARIABLES[quantity.threshold].printed[1]).tolist()


def _stem(quantity: MapQuantity, value: float) -> str:
    """A threshold as part of a file name, with its unit where that is not the one of site.yaml."""
    variable = VARIABLES[quantity.threshold]
    units, divisor = variable.printed
    return f"{value / divisor:g}{units if units != variable.units else ''}"
