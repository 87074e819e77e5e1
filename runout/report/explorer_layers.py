"""Maps of the explorer: quantised to whole numbers, cut to what is reached, and packed for a browser.

A family is a map of ``hazard.nc`` with all its thresholds, percentiles or return periods, or a map of all members. Its values are
stored as 16-bit codes: 0 is no value, code ``c`` is ``low + (c - 1) * step`` in the printed unit. Differences of the codes along
the rows are packed, their low and their high bytes apart, since these compress well.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.hazard.boundary import DEVIATION, MEAN
from runout.hazard.danger import INTENSITY, LEVEL
from runout.hazard.joint import conditions_of
from runout.hazard.maps import classes_of
from runout.hazard.round_numbers import round_below
from runout.hazard.second_grid import DECIDING
from runout.hazard.style import NUMBERS, MapClasses
from runout.palettes import palette_of
from runout.quantities import ALL_QUANTITIES, ARRIVAL_PERCENTILE, FIRST_ARRIVAL, UNTIL_ARRIVAL, MapQuantity
from runout.report.values import Window
from runout.report.wording import MINUS, number, quantity, unit
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

STEPS, MEMBER_STEPS, MOST_STEPS = 1000, 200, 20_000  # of the largest value
STEPS_OF_CLASS = 10  # below the first class
SIGNED_CLASSES = 8
MOST_VALUES = 4_000_000  # cells of all products together; coarser cells above
TERRAIN = ("elevation", "ground_slope", "release_thickness")
CHOICES = {
    "percentile": "Percentile",
    "joint": "Condition",
    "return_period": "Return period",
    "class_return_period": "Return period",
}


@dataclass(frozen=True)
class Grid:
    """Cells of a map in the explorer: ``factor`` x ``factor`` cells of the raster each, row 0 in the north.

    Attributes
    ----------
    window : Window
        Rows and columns of the raster.
    factor : int
    """

    window: Window
    factor: int = 1

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = (-(-(part.stop - part.start) // self.factor) for part in self.window)
        return rows, columns

    def reduce(self, values: np.ndarray, of: Callable[..., np.ndarray] = np.fmax) -> np.ndarray:
        """Values (..., rows, columns) of the window on these cells: the largest of each, or what another ufunc chooses."""
        if self.factor == 1:
            return values
        rows, columns = self.shape
        lacking = rows * self.factor - values.shape[-2], columns * self.factor - values.shape[-1]
        padded = np.pad(values, [*[(0, 0)] * (values.ndim - 2), (0, lacking[0]), (0, lacking[1])], constant_values=np.nan)
        cells = padded.reshape(*values.shape[:-2], rows, self.factor, columns, self.factor)
        return of.reduce(of.reduce(cells, axis=-1), axis=-2)  # type: ignore[attr-defined, no-any-return]


@dataclass(frozen=True)
class Family:
    """A map with its levels: thresholds, percentiles, return periods or members."""

    name: str  # variable of ``hazard.nc`` or of a member
    # group, title, unit: heading in the list of maps, name and printed unit
    group: str
    title: str
    unit: str
    choice: str  # what the levels are; empty for one level
    levels: list[str]  # words of the levels
    values: np.ndarray  # (levels, rows, columns): in the printed unit; NaN where there is none
    classes: MapClasses  # those of the QGIS style
    step: float  # distance of two codes in the printed unit

    @property
    def low(self) -> float:
        """Value of code 1."""
        least = float(np.nanmin(self.values)) if np.isfinite(self.values).any() else 0.0
        return math.floor(min(least, 0.0 if self.name != "elevation" else least) / self.step) * self.step

    def codes(self) -> np.ndarray:
        """Codes (levels, rows, columns), uint16; a value above 0 never gets the code of 0."""
        steps = np.rint((self.values.astype(np.float64) - self.low) / self.step)
        steps = np.where((self.values > 0) & (self.low == 0), np.maximum(steps, 1), steps)
        return np.where(np.isfinite(steps), steps + 1, 0).astype(np.uint16)  # type: ignore[no-any-return]

    def described(self, grid: str, offset: int) -> dict[str, Any]:
        """What the browser needs besides the codes; ``offset`` is their first byte."""
        decimals = max(0, -math.floor(math.log10(self.step) + 1e-9))
        largest = float(np.nanmax(self.values)) if np.isfinite(self.values).any() else 0.0
        own = ("name", "group", "title", "unit", "choice", "levels", "step")
        return {name: getattr(self, name) for name in own} | _legend(self.name, self.classes) | {
            "low": self.low, "decimals": decimals, "largest": largest, "time": self.name in UNTIL_ARRIVAL,
            "grid": grid, "offset": offset,
        }  # fmt: skip


def _legend(name: str, classes: MapClasses) -> dict[str, Any]:
    """Classes for the browser: lower ``edges``, ``colours``, ``labels``, whether 0 is ``opaque`` and values are ``named``."""
    edges, colours, labels = list(classes.edges), list(classes.colours), list(classes.labels)
    palette = palette_of(name)
    if palette.signed:  # QGIS mixes their colours
        edges = np.linspace(edges[0], edges[-1], SIGNED_CLASSES + 1)[:-1].tolist()
        colours = palette.hexadecimal(SIGNED_CLASSES)
        ends = [f"{edge:g}".replace("-", MINUS) for edge in edges]
        labels = [*(f"{low} to {high}" for low, high in pairwise(ends)), f"{ends[-1]} or more"]
    opaque = not classes.nothing and (not palette.signed or name == MEAN)
    return {"edges": edges, "colours": colours, "labels": labels, "opaque": opaque, "named": classes.kind == NUMBERS}


def round_step(largest: float, steps: int) -> float:
    """Round step, of which at least ``steps`` reach ``largest``; 1 for a map without values."""
    if not largest > 0 or not math.isfinite(largest):
        return 1.0
    return round_below(largest / steps)


def families(hazard: "xr.Dataset", grid: Grid) -> Iterator[Family]:
    """All maps of ``hazard.nc`` in the order of the list."""
    names = [str(name) for name, array in hazard.data_vars.items() if array.dims[-2:] == ("y", "x") and array.ndim <= 3]
    for name in sorted(names, key=_place):
        array = hazard[name]
        units, divisor = VARIABLES[name].printed
        layers = array.values.reshape(-1, *array.shape[-2:])[(slice(None), *grid.window)]
        values = layers.astype(np.float32) / np.float32(divisor)
        choice, levels = _levels(hazard, array.dims[0]) if array.ndim == 3 else ("", [""])
        group, title = naming(name)
        classes = classes_of(hazard, name)
        step = step_of(name, values, classes)
        yield Family(name, group, title, unit(units), choice, levels, _reduced(name, values, grid), classes, step)


def _reduced(name: str, values: np.ndarray, grid: Grid) -> np.ndarray:
    return grid.reduce(values, np.fmin if name in UNTIL_ARRIVAL else np.fmax)


def step_of(name: str, values: np.ndarray, classes: MapClasses, steps: int = STEPS) -> float:
    """Distance of two codes of a map in the printed unit: a part of the largest value, and of the first class above 0."""
    if name in (INTENSITY, LEVEL, DECIDING) or "members" in name:
        return 1.0
    if "probability" in name or "share" in name:
        return 1.0 / steps
    finite = np.abs(values[np.isfinite(values)])
    largest = float(finite.max(initial=0.0))
    step = round_step(float(np.ptp(finite)) if name == "elevation" and finite.size else largest, steps)
    fine = round_step(next((edge for edge in classes.edges if edge > 0.0), largest), STEPS_OF_CLASS)
    return min(step, max(fine, round_step(largest, MOST_STEPS)))


def naming(name: str) -> tuple[str, str]:
    """Heading and title of a map in the list; the title is clear without the heading."""
    for q in ALL_QUANTITIES.values():
        if name in _titles(q):
            group, pattern = _titles(q)[name]
            return group, _capital(pattern.format(q.words))
    return _group(name), _capital(OWN_TITLES.get(name) or VARIABLES[name].long_name)


def _titles(q: MapQuantity) -> dict[str, tuple[str, str]]:
    """Heading and title of each map of a quantity."""
    return {
        q.exceedance("probability"): (PROBABILITIES, "Probability of {}"),
        q.annual_exceedance: ("Annual rate", "Annual rate of {}"),
        q.at_return_period: ("Value at a return period", "{}, return period"),
        q.percentile: ("Percentile over the members", "{}, percentile of the members"),
        q.peak: ("Largest of all members", "{}, largest of all members"),
        q.mean: ("Mean of the members", "{}, mean of the members"),
        q.exceedance("standard_error"): (ERRORS, "Standard error of the probability of {}"),
        q.exceedance("numerical_error"): (ERRORS, "Numerical error of the probability of {}"),
        q.deviation: (ERRORS, "{}, standard deviation of the members"),
        q.standard_error: (ERRORS, "{}, standard error of the mean of the members"),
        q.numerical_error: (ERRORS, "{}, numerical error of the mean of the members"),
    }


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


PROBABILITIES, ERRORS = "Probability that a threshold is reached", "Errors of each cell"
OWN_TITLES = {
    "inundation_probability": "probability that the flow arrives (lowest threshold of thickness)",
    "joint_exceedance_probability": "probability of a joint condition",
    "joint_exceedance_standard_error": "standard error of the probability of a joint condition",
    "joint_exceedance_numerical_error": "numerical error of the probability of a joint condition",
    "joint_annual_exceedance": "annual rate of a joint condition",
    DECIDING: "largest of the three errors of the mean flow thickness",
    INTENSITY: "intensity class at a return period",
    LEVEL: "level of danger",
    MEAN: "distance to the boundary of the flow, positive inside, mean",
    DEVIATION: "position of the boundary of the flow, standard deviation",
    "members_reached": "number of members that reach the cell",
    FIRST_ARRIVAL: "arrival, earliest of all members",
    ARRIVAL_PERCENTILE: "arrival, percentile of the members",
}
GROUPS = (
    *("Danger", PROBABILITIES, "Annual rate", "Value at a return period", "Percentile over the members"),
    *("Largest of all members", "Arrival", "Mean of the members", "Boundary of the flow", "Observed", "Further maps"),
    *(ERRORS, "Terrain"),
)


def _group(name: str) -> str:
    of = {
        "Danger": name in (INTENSITY, LEVEL), "Terrain": name in TERRAIN, "Arrival": name in UNTIL_ARRIVAL,
        ERRORS: name.endswith("_error"), "Boundary of the flow": "boundary" in name,
        PROBABILITIES: name.endswith("probability"), "Annual rate": "annual" in name,
        "Observed": "observed" in name or name.endswith("difference"),
    }  # fmt: skip
    return next((group for group, holds in of.items() if holds), "Further maps")


def _place(name: str) -> tuple[int, int]:
    """Order in the list: by heading, then by quantity."""
    own = [k for k, q in enumerate(ALL_QUANTITIES.values()) if name in _titles(q)]
    return GROUPS.index(naming(name)[0]), own[0] if own else len(ALL_QUANTITIES)


def _levels(hazard: "xr.Dataset", dimension: Any) -> tuple[str, list[str]]:
    """What the levels of a dimension are, and their words."""
    values = hazard[dimension].values
    if dimension == "joint":
        parts = [" and ".join(f"{ALL_QUANTITIES[q].words} {_limit(q, v)}" for q, v in one.items()) for one in conditions_of(hazard)]
        return CHOICES["joint"], parts
    if str(dimension).endswith("_threshold"):
        return "Threshold", [_limit(str(dimension).removesuffix("_threshold"), float(v)) for v in values]
    return CHOICES.get(str(dimension), str(dimension)), [_level(str(dimension), float(v)) for v in values]


def _limit(name: str, value: float) -> str:
    units, divisor = VARIABLES[ALL_QUANTITIES[name].threshold].printed
    return f"≥\u00a0{quantity(value / divisor, units)}"


def _level(dimension: str, value: float) -> str:
    return f"{value:g} %" if dimension == "percentile" else f"{number(value, 6)} years" if "period" in dimension else number(value)


def bytes_of(codes: np.ndarray) -> bytes:
    """Codes (levels, rows, columns) as bytes: of each level the low bytes, then the high bytes, of differences along its rows."""
    difference = codes.copy()
    difference[..., 1:] -= codes[..., :-1]
    return np.stack([difference & 0xFF, difference >> 8], axis=1).astype(np.uint8).tobytes()
