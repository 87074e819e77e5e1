"""Numerical error of a run by its grid: of what, the bar that runs on several grids give it, and how it is stated.

``check``, ``verify --convergence``, the report, the presets and the scores take the error from here, by one definition. The error
of a quantity is the distance of its value from that of a grid of vanishing cells, the error of a map the relative L1 distance. An
error bar is meant to hold the error in 9 of 10 cases (:data:`runout.forecast.accuracy.BOUNDS` says what it does not hold).

A bar comes from runs on the grid and on coarser ones, of uneven ratios and shifted against the terrain. A fit of c + b h^p through
them, by least squares with weights of 1/h (Eca & Hoekstra 2014, J. Comput. Phys. 262:104), gives the trend b h^p and the scatter
of the runs. The order p is given, not fitted: an order that is fitted to few runs turns with their scatter.

Coarse grids do not meet the relief of a few cells of the raster (:mod:`runout.terrain.relief`), finer ones do. No fit through
coarse grids sees that, and grids on both sides of this change have no trend. So all runs have the ground of the site's grid. One
more run has this relief, or lacks it; the difference that it makes is a part of the bar of its own.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import ObservationError, StorageError
from runout.model.limits import is_number

ORDER, MAP_ORDER = 1.5, 1.0  # of values, whose errors are of the first to the second order, and of distances of maps
SAFETY = 1.25  # of a trend over three grids and more (Roache 1994, J. Fluids Eng. 116:405)
MAP_SAFETY = 1.75  # of a map, whose distances to coarser grids grow less than its error: with 1.25, 8 of 10 bars hold
SCATTERS = 2.0  # standard deviations of the runs about the fit
SHARE = 0.35  # least relative error of a quantity over that of its map, for quantities that turn or hardly change with the grid
NUMBERS, WORDS = ("fine", "error"), ("title", "unit")
REMEDY = "run `runout verify --convergence` for this site again, or remove the file"
MAP = "thickness_map"
TITLES = {
    "f99": ("run-out of 99 % of the mass", "m"),
    "centre_of_mass_runout": ("run-out of the centre of mass", "m"),
    "peak_speed": ("peak speed (99th percentile of the cells)", "m/s"),
    MAP: ("map of flow thickness (relative L1)", ""),
}


@dataclass(frozen=True)
class ErrorBar:
    """Numerical error of one quantity."""

    fine: float | None  # value on the finest grid; None for a map
    trend: float  # difference from a grid of vanishing cells by the fit, in the unit of the quantity
    scatter: float  # standard deviation of the runs about the fit; of a map the noise of its own grid
    ground: float  # error by the relief of a few raster cells, in the unit of the quantity
    # the bar: :data:`SAFETY` times the root of the sum of squares of the trend, of :data:`SCATTERS` scatters, of the ground, and of
    # :data:`SHARE` of the error of the map. For a map, that of :data:`MAP_SAFETY` trends and noises and of :data:`SAFETY` grounds
    error: float

    @classmethod
    def of_value(cls, ratios: Sequence[float], values: Sequence[float], map_error: float, ground: float = 0.0) -> "ErrorBar":
        """Bar of a quantity from its values on grids with ``ratios`` of their cells over the finest, which has 1.

        ``map_error``: relative error of the map that the quantity is taken from; ``ground``: difference by relief of the raster.
        """
        fine = float(np.mean([v for r, v in zip(ratios, values, strict=True) if r == min(ratios)]))
        _, trend, scatter = fitted(ratios, values, ORDER)
        least = SHARE * map_error / SAFETY * fine
        return cls(fine, trend, scatter, ground, SAFETY * float(np.linalg.norm([trend, SCATTERS * scatter, ground, least])))

    @classmethod
    def of_map(cls, ratios: Sequence[float], distances: Sequence[float], ground: float = 0.0) -> "ErrorBar":
        """Bar of a map from the distances of maps on coarser grids to it, and that by the relief of the raster.

        Errors that shrink with the cells make distances that grow from zero. Noise of the map leaves a distance to a grid of equal
        cells; that is the root of two times the noise.
        """
        noise, trend, _ = fitted(ratios, distances, MAP_ORDER)
        noise = max(noise, 0.0) / math.sqrt(2.0)
        return cls(None, trend, noise, ground, math.hypot(MAP_SAFETY * math.hypot(trend, noise), SAFETY * ground))

    @property
    def relative(self) -> float | None:
        """Error over the value on the finest grid [1]; that of a map as it is; None where the value is zero."""
        if self.fine is None:
            return self.error
        return self.error / abs(self.fine) if self.fine else None

    def as_dict(self, name: str) -> dict[str, Any]:
        """Plain values with title and unit of the quantity, and the relative error."""
        area = f"area deeper than {name.removeprefix('area_above_').removesuffix('_m')} m", "m2"
        title, unit = TITLES.get(name, area)
        return {"title": title, "unit": unit, **asdict(self), "relative_error": self.relative}


def fitted(ratios: Sequence[float], values: Sequence[float], order: float) -> tuple[float, float, float]:
    """Value of the fit at the finest grid, its trend and the scatter of the values about it, all in the unit of the values.

    ``ratios`` of cell sizes over the finest. Two values leave no scatter.
    """
    x, y = np.asarray(ratios, float), np.asarray(values, float)
    weight = 1.0 / x / np.sqrt(np.mean(x**-2.0))
    design = np.column_stack([np.ones_like(x), x**order - 1.0]) * weight[:, None]
    coefficients, *_ = np.linalg.lstsq(design, y * weight, rcond=None)
    rest = weight * y - design @ coefficients
    start, trend = map(float, coefficients)
    return start, trend, float(np.sqrt((rest**2).sum() / max(len(x) - 2, 1)))


def measured_errors(convergence: Mapping[str, Any], size: float) -> tuple[float | None, float | None]:
    """Measured error bars of the map of flow thickness and of the run-out [1], at cells of ``size`` [m].

    Those of ``convergence.json`` are of its finest cells; others follow by first order. None where it has none.
    """
    quantities, levels = convergence.get("quantities", {}), convergence.get("levels")
    errors = (quantities.get(name, {}).get("relative_error") for name in (MAP, "f99"))
    of_map, of_runout = (error * size / float(levels[-1]["cell_size"][0]) if error and levels else None for error in errors)
    return of_map, of_runout


def statements(convergence: Mapping[str, Any]) -> Iterator[str]:
    """Value and error bar of each quantity of ``convergence.json``, as the terminal, the page and the report print them."""
    for entry in convergence["quantities"].values():
        fine, error = entry["fine"], entry["error"]
        if fine is None:
            yield f"{entry['title']} ± {100 * error:.2g} %"
        else:
            percent = f" ({100 * error / abs(fine):.2g} %)" if fine else ""
            yield f"{entry['title']} {_rounded(fine, 4)} ± {_rounded(error, 2)} {entry['unit']}{percent}"


def _rounded(value: float, digits: int) -> str:
    """A number to so many digits, without an exponent."""
    return f"{float(f'{value:.{digits}g}'):.12g}"


def read_convergence(results: Path) -> Mapping[str, Any]:
    """Content of ``convergence.json`` of a results folder; empty if there is none. Raises ObservationError if it is damaged."""
    path = Path(results) / "convergence.json"
    if not path.is_file():
        return {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as cause:
        content = cause
    if not isinstance(content, dict):
        raise ObservationError(f"{path}: not what was written there; run `runout verify --convergence` again, or remove the file")
    return content


def require_error_bars(content: Mapping[str, Any], path: Path) -> Mapping[str, Any]:
    """Content of ``convergence.json``, checked for the entries that are printed: error bars and finest cell size.

    Raises StorageError if an entry is missing or has another type; the message names the first one.
    """
    wrong = next(_faults(content), None)
    if wrong:
        raise StorageError(f"{path}: {wrong}; {REMEDY}")
    return content


def _faults(content: Mapping[str, Any]) -> Iterator[str]:
    quantities, levels = content.get("quantities"), content.get("levels")
    if not isinstance(quantities, dict) or not quantities:
        yield "holds no quantities"
        return
    for name, entry in quantities.items():
        for key in (*NUMBERS, *WORDS):
            if not isinstance(entry, dict) or key not in entry:
                yield f"quantities.{name}.{key} is missing"
            elif not (isinstance(entry[key], str) if key in WORDS else entry[key] is None or is_number(entry[key])):
                yield f"quantities.{name}.{key} is {repr(entry[key])[:60]}"
    finest = levels[-1] if isinstance(levels, list) and levels else None
    size = finest.get("cell_size") if isinstance(finest, dict) else None
    if not isinstance(size, list) or not size or not is_number(size[0]):
        yield "the last of its levels has no cell_size"
