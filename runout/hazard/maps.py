"""Rasters of single maps for a GIS, each with its group, its words and its style."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from runout.hazard.bed_maps import BED_MEANS, CHANGES
from runout.hazard.boundary import DEVIATION, MEAN
from runout.hazard.danger import INTENSITY, LEVEL, PERIOD, entries_of, label
from runout.hazard.joint import conditions_of
from runout.hazard.second_grid import DECIDING, SOURCES
from runout.hazard.style import MapClasses, legend_unit
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
GROUPS = {  # folder of maps/ -> words, in the order of the layers of a GIS
    "danger": "Danger classes",
    "probability": "Probability",
    "errors": "Errors of each cell",
    "return_periods": "Annual rates and return periods",
    "intensity": "Intensity",
    "arrival": "Arrival",
    "deposit": "Deposit and bed",
    "boundary": "Position of the boundary",
    "observed": "Observations",
    "terrain": "Terrain",
}
TERRAIN_MAPS = ("elevation", "ground_slope", "release_thickness")
_VALUE = r"_[-+.0-9e]+(kPa)?"
_JOINT = rf"(_({'|'.join(ALL_QUANTITIES)}){_VALUE})+"
OWN_MAP = re.compile(rf"({'|'.join(VARIABLES)})((_over)?({_VALUE})?|{_JOINT})\.(tif|qml|tif\.aux\.xml)")  # names of map_layers
BED_SUMMARIES = (*(name for q in BED_QUANTITIES.values() for name in (q.mean, q.peak) if name), *BED_MEANS)
PERCENTILES = (*(q.percentile for q in ALL_QUANTITIES.values() if q.percentile), CHANGE_PERCENTILE, ARRIVAL_PERCENTILE)
CELL_ERRORS = (*(name for q in QUANTITIES.values() if q.has_mean for name in (*q.means, q.numerical_error)), DECIDING)
_WORDS = {
    "members_reached": "members that reach the cell",
    FIRST_ARRIVAL: "earliest arrival of any member",
    MEAN: "distance to the mean boundary, positive inside",
    DEVIATION: "standard deviation of the boundary",
}
_KINDS = ("probability", "standard_error", "numerical_error")
JOINT_KINDS = (*(f"exceedance_{kind}" for kind in _KINDS), "annual_exceedance")


class MapLayer(NamedTuple):
    """A map that becomes a raster of its own."""

    stem: str  # file name without suffix
    name: str  # variable of the products
    selection: dict[str, float]  # coordinates of the variable that it shows
    group: str  # key of :data:`GROUPS`
    title: str  # words for a list of layers

    @property
    def path(self) -> str:
        """Path below the results, without suffix: main maps lie in ``maps/``, the others in a folder of their group."""
        folder = "" if self.name in (*HEADLINE_MAPS, LEVEL) else f"{self.group}/"
        return f"maps/{folder}{self.stem}"


def map_layers(hazard: "xr.Dataset") -> Iterator[MapLayer]:
    """Every map that becomes a raster of its own; the one to look at first comes first."""
    for stem, name, selection, title in _layers(hazard):
        yield MapLayer(stem, name, selection, _group_of(name), title[:1].upper() + title[1:])


def headline(hazard: "xr.Dataset") -> MapLayer:
    """The map to look at first: levels of danger, or the probability of inundation."""
    return next(map_layers(hazard))


def _layers(hazard: "xr.Dataset") -> Iterator[tuple[str, str, dict[str, float], str]]:
    """File name without suffix, variable, coordinates and words of the layers."""
    if LEVEL in hazard:
        yield LEVEL, LEVEL, {}, "level of danger"
    for name in (*HEADLINE_MAPS, *TERRAIN_MAPS):
        yield name, name, {}, _words(hazard, name)
    for name in dict.fromkeys((INFLOW_MAP, *BED_SUMMARIES, *OBSERVED_MAPS, *BOUNDARY_MAPS, *CELL_ERRORS)):
        if name in hazard and name not in HEADLINE_MAPS:
            yield name, name, {}, _words(hazard, name)
    for quantity in ALL_QUANTITIES.values():
        yield from _over_thresholds(hazard, quantity)
        for years in hazard["return_period"].values if quantity.at_return_period in hazard else ():
            name = quantity.at_return_period
            yield f"{name}_{years:g}", name, {"return_period": float(years)}, f"{quantity.words}, {years:g} years"
    yield from _joint(hazard)
    for years in hazard[PERIOD].values if INTENSITY in hazard else ():
        yield f"{INTENSITY}_{years:g}", INTENSITY, {PERIOD: float(years)}, f"intensity, {years:g} years"
    for name in PERCENTILES:
        for value in hazard["percentile"].values if name in hazard else ():
            shown = quantity_of(name)
            words = shown.words if shown else name.removesuffix("_percentile").replace("_", " ")
            yield f"{name}_{value:g}", name, {"percentile": float(value)}, f"{words}, percentile {value:g}"


def _over_thresholds(hazard: "xr.Dataset", quantity: MapQuantity) -> Iterator[tuple[str, str, dict[str, float], str]]:
    """Layers of probabilities, their errors and annual rates of a quantity over its thresholds."""
    if quantity.threshold not in hazard.coords:
        return
    for name in (*map(quantity.exceedance, _KINDS), quantity.annual_exceedance):
        for value in hazard[quantity.threshold].values if name in hazard else ():
            selection = {quantity.threshold: float(value)}
            yield f"{name}_over_{_stem(quantity, value)}", name, selection, _over(quantity, value)


def _joint(hazard: "xr.Dataset") -> Iterator[tuple[str, str, dict[str, float], str]]:
    """Layers of joint conditions."""
    for name in (f"joint_{kind}" for kind in JOINT_KINDS):
        for number, condition in enumerate(conditions_of(hazard) if name in hazard else (), 1):
            limits = [(ALL_QUANTITIES[of], limit) for of, limit in condition.items()]
            stem = "_".join(f"{quantity.name}_{_stem(quantity, limit)}" for quantity, limit in limits)
            yield f"{name}_{stem}", name, {"joint": number}, " and ".join(_over(*limit) for limit in limits)


def _over(quantity: MapQuantity, value: float) -> str:
    """A threshold in words."""
    units, divisor = VARIABLES[quantity.threshold].printed
    return f"{quantity.words} {value / divisor:g}{legend_unit(units)} or more"


def _words(hazard: "xr.Dataset", name: str) -> str:
    """Words of a map without further dimensions."""
    if name == "inundation_probability":
        return f"probability of {_over(QUANTITIES['thickness'], float(hazard['thickness_threshold'].min()))}"
    means = {quantity.mean: f"mean {quantity.words} of the members" for quantity in ALL_QUANTITIES.values() if quantity.mean}
    return (_WORDS | means).get(name, VARIABLES[name].long_name)


def _group_of(name: str) -> str:
    """Key of :data:`GROUPS` of a variable."""
    if name in (*TERRAIN_MAPS, INFLOW_MAP):
        return "terrain"
    words = {
        "observed": "observed", "difference": "observed", INTENSITY: "danger", LEVEL: "danger", "boundary": "boundary",
        "_error": "errors", "deviation": "errors", "probability": "probability", "members": "probability",
        "annual": "return_periods", "at_return_period": "return_periods", "arrival": "arrival", "deposit": "deposit",
        "bed": "deposit", "erod": "deposit", "net_": "deposit", "change": "deposit",
    }  # fmt: skip
    return next((group for word, group in words.items() if word in name), "intensity")


def write_maps(hazard: "xr.Dataset", results: Path) -> list[Path]:
    """Paths of a GeoTIFF and a QGIS style of every map of :func:`map_layers`; layers of one variable share their classes.

    Mean and percentiles of the change of elevation share one scale, symmetric about 0.
    """
    paths = []
    styles: dict[str, str] = {}
    for layer in map_layers(hazard):
        paths.append(write_cog(hazard, layer.name, results / f"{layer.path}.tif", **layer.selection))
        if layer.name not in styles:
            styles[layer.name] = classes_of(hazard, layer.name).qml()
        paths.append(write_text(styles[layer.name], results / f"{layer.path}.qml"))
    return paths


def write_own_maps(
    maps: "xr.Dataset", names: Iterable[str], folder: Path, thresholds: Mapping[str, Sequence[float]] | None = None
) -> list[Path]:
    """Paths of a GeoTIFF and a QGIS style of each named map (rows, columns), with classes of its own."""
    paths = []
    for name in names:
        paths.append(write_cog(maps, name, folder / f"{name}.tif"))
        classes = MapClasses.over(name, [maps[name].values], (thresholds or {}).get(name, ()))
        paths.append(write_text(classes.qml(), folder / f"{name}.qml"))
    return paths


def classes_of(hazard: "xr.Dataset", name: str) -> MapClasses:
    """Classes of a map of the products; all layers of one variable share them."""
    if name == DECIDING:
        return MapClasses.numbered([(number, colour, words) for number, (words, colour) in enumerate(SOURCES, 1)])
    if name in (INTENSITY, LEVEL):
        return MapClasses.numbered([(entry["number"], entry["colour"], label(entry)) for entry in entries_of(hazard, name)])
    alike = [other for other in CHANGES if other in hazard] if name in CHANGES else [name]
    return MapClasses.over(name, (hazard[other].values for other in alike), _thresholds(hazard, name))


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
