"""Layers of the Swiss data model of hazard mapping (identifier 166.1, version 1.2), as a GeoPackage.

Names, types, ranges and constraints are those of the classes ``intensity_by_source``, ``par_debris_flow_depth``,
``par_debris_flow_velocity`` and ``hazard_area`` of the INTERLIS model Hazard_Mapping_LV95_V1_2. What only an expert can decide is
not written: areas without impact, the extreme scenario, and the assessment area.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.errors import ConfigError
from runout.hazard.danger import INTENSITY, LEVEL, PERIOD, entries_of
from runout.io.vector import outline, write_layers
from runout.model.terrain import Terrain
from runout.quantities import QUANTITIES

if TYPE_CHECKING:
    import xarray as xr

NAME, LV95 = "hazard_mapping_166_1.gpkg", 2056
CANTONS = (
    *("ZH", "BE", "LU", "UR", "SZ", "OW", "NW", "GL", "ZG", "FR", "SO", "BS", "BL", "SH", "AR", "AI", "SG"),
    *("GR", "AG", "TG", "TI", "VD", "VS", "NE", "GE", "JU"),
)
MAIN_PROCESS = {  # processes of the model that runout simulates, and the main process of each
    "w_debris_flow": "water",
    "l_sud_spontaneous_landslide": "landslide",
    "l_sud_hillslope_debris_flow": "landslide",
    "r_rock_slide_rock_avalanche": "rockfall",
    "a_flowing_avalanche": "avalanche",
}
CLASSES = {"weak": "low", "low": "low", "medium": "mean", "strong": "high", "high": "high"}  # names of schemes: those of the model
LEVELS = {"residual": "residual_hazard", "yellow": "slight", "blue": "mean", "red": "substantial"}
BANDS = (0.0, 0.5, 1.0, 2.0, 4.0, 10.0)  # of depth [m] and velocity [m/s]; the model ends at 10
LONGEST = 10_000.0  # return period [a] of the model
PARAMETERS = {"par_debris_flow_depth": ("thickness", "df_h", "m"), "par_debris_flow_velocity": ("speed", "df_v", "m_s")}


@dataclass(frozen=True)
class Delivery:
    """What a delivery states beside the maps."""

    canton: str  # two letters of the canton that is responsible for the data
    process: str  # one of :data:`MAIN_PROCESS`
    source: str  # name of the source of the process, at most 50 characters
    term: str = ""  # word of the canton for the process; by default ``process``

    def __post_init__(self) -> None:
        if self.canton not in CANTONS:
            raise ConfigError(f"canton {self.canton!r}: choose one of {', '.join(CANTONS)}")
        if self.process not in MAIN_PROCESS:
            raise ConfigError(f"process {self.process!r}: choose one of {', '.join(MAIN_PROCESS)}")
        for name, text in {"source": self.source, "term": self.term}.items():
            if len(text) > 50 or (name == "source" and not text.strip()):
                raise ConfigError(f"{name} {text!r}: 1 to 50 characters are needed")


def write_delivery(hazard: "xr.Dataset", delivery: Delivery, path: Path) -> Path:
    """Path of the GeoPackage, after writing its layers from hazard maps.

    Raises ConfigError if the maps have no classes, their classes are not those of a Swiss scheme, or their system is not LV95
    (EPSG:2056). Raises StorageError if it cannot be written.
    """
    terrain = _terrain(hazard)
    if INTENSITY not in hazard:
        raise ConfigError("the maps have no intensity classes; state hazard.scheme and ensemble.scenarios, and run the site")
    unknown = [entry["name"] for entry in entries_of(hazard, INTENSITY) if entry["name"] not in CLASSES]
    if unknown:
        raise ConfigError(
            f"the model has no class {', '.join(unknown)}; use a Swiss scheme, or name its classes {', '.join(CLASSES)}"
        )
    layers = {"intensity_by_source": _intensities(hazard, delivery, terrain)}
    if delivery.process == "w_debris_flow":
        layers |= {name: _parameters(hazard, delivery, terrain, name) for name in PARAMETERS}
    if LEVEL in hazard:
        layers["hazard_area"] = _areas(hazard, delivery, terrain)
    rows = {name: [_with_identifier(row, name, k, delivery) for k, row in enumerate(of, 1)] for name, of in layers.items()}
    if not rows["intensity_by_source"]:
        raise ConfigError("no cell has an intensity class, so that there is nothing to deliver")
    return write_layers(path, terrain, {name: ("Polygon", of) for name, of in rows.items()})


def _terrain(hazard: "xr.Dataset") -> Terrain:
    """Raster of the maps, in LV95."""
    from pyproj import CRS

    crs = str(hazard["crs"].attrs["crs_wkt"]) if "crs" in hazard.variables else None
    if crs is None or CRS(crs).to_epsg(min_confidence=70) != LV95:
        name = CRS(crs).name if crs else "local coordinates"
        raise ConfigError(f"the maps are in {name}; the model needs LV95: give the elevations in EPSG:{LV95} and run again")
    x, y = hazard["x"].values, hazard["y"].values
    cell = float(x[-1] - x[0]) / (len(x) - 1), float(y[0] - y[-1]) / (len(y) - 1)
    return Terrain(hazard["elevation"].values.astype(np.float64), cell, float(x[0]) - cell[0] / 2, float(y[-1]) - cell[1] / 2, crs)


def _polygons(cells: np.ndarray, terrain: Terrain) -> Iterator[Any]:
    """Polygons of cells; the model has surfaces of one part."""
    yield from outline(cells, terrain).geoms


def _intensities(hazard: "xr.Dataset", delivery: Delivery, terrain: Terrain) -> list[dict[str, Any]]:
    """Rows of ``intensity_by_source``: total scenarios, from all scenarios of the ensemble together."""
    record, rows = hazard[INTENSITY].attrs, []
    for years in hazard[PERIOD].values:
        values = hazard[INTENSITY].sel({PERIOD: years}).values
        for entry in entries_of(hazard, INTENSITY):
            for polygon in _polygons(values == entry["number"], terrain):
                attributes = {"intensity_class": CLASSES[entry["name"]], "process_cantonal_term": delivery.term or delivery.process}
                comment = f"{record['scheme']}, class {entry['name']}, checked: {entry['checked']}"
                own = {"subproc_intensity_by_source": delivery.process, "comments": comment[:250], "geometry": polygon}
                rows.append(attributes | _of_scenario(years, delivery) | own)
    return rows


def _of_scenario(years: float, delivery: Delivery) -> dict[str, Any]:
    """Attributes that intensities and parameters share."""
    if not 1.0 <= years <= LONGEST:
        raise ConfigError(f"return period of {years:g} a: the model has 1 to {LONGEST:g} a")
    return {
        "data_responsibility": delivery.canton,
        "return_period_in_years": round(years),
        "extreme_scenario": False,
        "subscenario_probability": 1.0,
        "scenario_description": f"reached at an annual rate of 1/{years:g} or more, over all scenarios of the ensemble",
        "process_source": delivery.source,
    }


def _parameters(hazard: "xr.Dataset", delivery: Delivery, terrain: Terrain, layer: str) -> list[dict[str, Any]]:
    """Rows of a parameter: areas between two values at each return period; none without maps at return periods."""
    quantity, stem, unit = PARAMETERS[layer]
    name, rows = QUANTITIES[quantity].at_return_period, []
    for years in hazard["return_period"].values if name in hazard else ():
        values = np.minimum(np.nan_to_num(hazard[name].sel(return_period=years).values), BANDS[-1])
        for low, high in pairwise(BANDS):
            for polygon in _polygons((values > low) & (values <= high), terrain):
                limits = {f"{stem}_lower_{unit}": low, f"{stem}_upper_{unit}": high}
                method = {"method_of_assessment": "model_evaluation", "process_cantonal_term": delivery.term or delivery.process}
                comment = {"comments": "values above 10 belong to the highest band"} if high == BANDS[-1] else {"comments": ""}
                rows.append(_of_scenario(float(years), delivery) | limits | method | comment | {"geometry": polygon})
    return rows


def _areas(hazard: "xr.Dataset", delivery: Delivery, terrain: Terrain) -> list[dict[str, Any]]:
    """Rows of ``hazard_area``, of this source and process alone."""
    rows = []
    for entry in entries_of(hazard, LEVEL):
        if entry["name"] not in LEVELS:
            raise ConfigError(f"the model has no level {entry['name']}; name the levels of the scheme {', '.join(LEVELS)}")
        for polygon in _polygons(hazard[LEVEL].values == entry["number"], terrain):
            danger = {"main_process": MAIN_PROCESS[delivery.process], "hazard_level": LEVELS[entry["name"]]}
            complete = {"subprocesses_complete": "not_complete", "sources_complete": "not_complete"}
            comment = {"comments": f"{delivery.source}, {delivery.process} alone; checked: {entry['checked']}"[:250]}
            rows.append({"data_responsibility": delivery.canton} | danger | complete | comment | {"geometry": polygon})
    return rows


def _with_identifier(row: Mapping[str, Any], layer: str, number: int, delivery: Delivery) -> dict[str, Any]:
    """A row with its object identifier, ``<identifier of the canton>.<canton>.ch``."""
    return {"t_ili_tid": f"runout_{layer}_{number}.{delivery.canton.lower()}.ch", **row}
