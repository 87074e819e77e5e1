"""Rasters of single maps for a GIS, each with its style."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runout.hazard.exceedance import QUANTITIES
from runout.hazard.style import class_edges, qml
from runout.io.atomic import write_text
from runout.io.geotiff import write_cog
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

HEADLINE_MAPS = (
    "inundation_probability",
    "peak_flow_thickness",
    "peak_speed",
    "peak_pressure",
    "first_arrival_time",
    "mean_deposit_thickness",
    "peak_deposit_thickness",
    "members_reached",
)
TERRAIN_MAPS = ("elevation", "ground_slope", "release_thickness")
OWN_MAP = re.compile(rf"({'|'.join(VARIABLES)})(_over)?(_[-+.0-9e]+(kPa)?)?\.(tif|qml|tif\.aux\.xml)")  # names of map_layers
PERCENTILES = (*(quantity.percentile for quantity in QUANTITIES.values()), "deposit_thickness_percentile")


def map_layers(hazard: "xr.Dataset") -> Iterator[tuple[str, str, dict[str, float]]]:
    """File name without suffix, variable and coordinates of every map that becomes a raster of its own."""
    for name in (*HEADLINE_MAPS, *TERRAIN_MAPS):
        yield name, name, {}
    for quantity in QUANTITIES:
        dimension = f"{quantity}_threshold"
        for product in ("probability", "standard_error"):
            name = f"{quantity}_exceedance_{product}"
            for value in hazard[dimension].values if dimension in hazard.coords else ():
                yield f"{name}_over_{_stem(dimension, value)}", name, {dimension: float(value)}
    for name in PERCENTILES:
        for value in hazard["percentile"].values if name in hazard else ():
            yield f"{name}_{value:g}", name, {"percentile": float(value)}


def write_maps(hazard: "xr.Dataset", folder: Path) -> list[Path]:
    """Paths of a GeoTIFF and a QGIS style of every map of :func:`map_layers`; layers of one variable share their classes."""
    paths = []
    styles: dict[str, str] = {}
    for stem, name, selection in map_layers(hazard):
        paths.append(write_cog(hazard, name, folder / f"{stem}.tif", **selection))
        if name not in styles:
            styles[name] = _style(hazard, name)
        paths.append(write_text(styles[name], folder / f"{stem}.qml"))
    return paths


def _style(hazard: "xr.Dataset", name: str) -> str:
    units, divisor = VARIABLES[name].printed
    values = hazard[name].values[np.isfinite(hazard[name].values)] / divisor
    smallest, largest = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    return qml(class_edges(name, _thresholds(hazard, name), smallest, largest), units, name)


def _thresholds(hazard: "xr.Dataset", name: str) -> list[float]:
    """Thresholds of the quantity that a map shows, in the unit for people; none for times and counts."""
    dimension = next((f"{q}_threshold" for q in QUANTITIES if q in name), "")
    return (hazard[dimension].values / VARIABLES[dimension].printed[1]).tolist() if dimension in hazard.coords else []


def _stem(dimension: str, value: float) -> str:
    """A threshold as part of a file name, with its unit where that is not the one of site.yaml."""
    variable = VARIABLES[dimension]
    units, divisor = variable.printed
    return f"{value / divisor:g}{units if units != variable.units else ''}"
