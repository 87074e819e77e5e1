"""Presets of accuracy: the cell size of each, and the numerical errors of grids.

The errors come from :data:`SOURCE`; a test compares both.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from runout.errors import ConfigError
from runout.forecast.numerical_error import measured_errors
from runout.model.limits import CFL

if TYPE_CHECKING:
    from runout.model.release import Release

SOURCE = "tests/benchmarks/records/error_bars.json"
EXAMPLE = "five sites"  # whose error bars were measured
MAP_ERROR, RUNOUT_ERROR = 0.22, 0.064  # of a grid with one cell through the mean thickness
FEWEST_MEASURED = 0.7  # cells through the mean thickness for which this holds
BOUNDS = "Error bars hold 9 of 10 cases. They hold the error of the grid only, not that of friction, release, law or elevation."
EXPECTED = (
    f"Expected errors are medians of the error bars of {EXAMPLE}; `runout verify SITE --convergence` measures those of this site."
)
MEASURED = "Errors are those of `runout verify SITE --convergence` on this site, brought to other cells by first order."
FEWEST_ACROSS = 4.0  # cells across a square of the area of a release

CellSize = float | tuple[float, float, float]


@dataclass(frozen=True)
class Preset:
    """One level of accuracy."""

    cells: float  # cells through the mean thickness of the release

    def cell_size(self, thickness: float, area: float) -> float:
        """Spacing [m] for a release of mean ``thickness`` [m] whose smallest part covers ``area`` [m2], rounded down."""
        size = min(thickness / self.cells, math.sqrt(area) / FEWEST_ACROSS)
        step = 10.0 ** (math.floor(math.log10(size)) - 1)
        return round(math.floor(size / step + 1e-9) * step, 9)


PRESETS: dict[str, Preset] = {"screening": Preset(1.0), "standard": Preset(1.5), "high": Preset(3.0)}


def preset(accuracy: str) -> Preset:
    """Preset with this name. Raises ConfigError if there is none."""
    if accuracy not in PRESETS:
        raise ConfigError(f"accuracy is {accuracy!r}; choose one of {', '.join(PRESETS)}")
    return PRESETS[accuracy]


def chosen_cell_size(accuracy: str | None, releases: "Sequence[Release]", cell_size: CellSize | None = None) -> CellSize | None:
    """The ``cell_size`` [m] of a run; where it is None that of the preset, and None without a release: the run reports the error.

    Raises ConfigError if there is no such preset, or neither cell_size nor accuracy is given.
    """
    chosen = None if accuracy is None else preset(accuracy)
    if cell_size is not None:
        return cell_size
    if chosen is None:
        raise ConfigError("neither cell_size nor accuracy is given; give one of them, accuracy as screening, standard or high")
    if not releases:
        return None
    volume, area = sum(r.volume for r in releases), sum(r.area for r in releases)
    return chosen.cell_size(volume / area, min(r.area for r in releases))


def expected_errors(cells: float) -> tuple[float, float]:
    """Expected error bars of the map of flow thickness and of the run-out [1] with so many cells through the mean thickness.

    The medians of the error bars that :mod:`~runout.forecast.numerical_error` gives :data:`EXAMPLE`; first order in the cell size.
    """
    return MAP_ERROR / cells, RUNOUT_ERROR / cells


def work(grid: Mapping[str, Any]) -> float:
    """Particle-steps of a run with cell_size, particles_per_cell and cfl, up to a factor that depends on the site."""
    size, count = grid["cell_size"], grid["particles_per_cell"]
    dx, dy, dz = size if isinstance(size, Sequence) else (size,) * 3
    particles = math.prod(count) if isinstance(count, Sequence) else count
    return float(particles / (dx * dy * dz) / (grid["cfl"] * min(dx, dy, dz)))


def lines(
    accuracy: str | None,
    releases: "Sequence[Release]",
    grid: Mapping[str, Any],
    particles: Callable[[float], tuple[int, int, int]],
    measured: Mapping[str, Any],
) -> list[str]:
    """Lines of ``runout check``: the cells of a run with its error bars, and those of each preset with its relative work.

    ``particles`` gives the default particles per cell (px, py, pz) for a cell height [m]; ``measured`` is the content of
    ``convergence.json``, empty without: then the error bars are those that are expected.
    """
    depth = sum(r.volume for r in releases) / sum(r.area for r in releases)
    name, through = f"accuracy {accuracy}: " if accuracy else "", _through(grid, depth)
    cells = f"cells of {_sizes(grid['cell_size'])} with {_count(grid['particles_per_cell'])} particles"
    rows = [f"grid      {name}{cells}, {through:.1f} through the mean thickness of {depth:.3g} m; "]
    rows[0] += error_statement(through, measured_errors(measured, _east(grid["cell_size"])))
    for other in PRESETS:
        size: Any = chosen_cell_size(other, releases)
        count = particles(size)
        ratio = work({"cell_size": size, "cfl": CFL, "particles_per_cell": count}) / work(grid)
        error = error_statement(depth / size, measured_errors(measured, size))
        rows.append(f"          {other}: {_sizes(size)} with {_count(count)}, {ratio:.3g} times this work; {error}")
    return [*rows, f"          ({MEASURED if measured else EXPECTED} {BOUNDS})"]


def error_statement(through: float, measured: tuple[float | None, float | None] = (None, None)) -> str:
    """Error bars of a grid with so many cells ``through`` the mean thickness of the release, in words.

    Those ``measured`` of map and run-out, or those that are expected, which are not known below :data:`FEWEST_MEASURED` cells.
    """
    if None not in measured:
        return f"measured numerical error {_bars(*measured)}"
    if through < FEWEST_MEASURED:
        return f"expected numerical error not known with fewer than {FEWEST_MEASURED:g} cells through the mean thickness"
    return f"expected numerical error {_bars(*expected_errors(through))}"


def _bars(of_map: float | None, of_runout: float | None) -> str:
    return f"± {100 * (of_runout or 0.0):.2g} % of the run-out, ± {100 * (of_map or 0.0):.2g} % of the thickness map"


def _east(size: "CellSize") -> float:
    return float(size[0] if isinstance(size, Sequence) else size)


def _through(grid: Mapping[str, Any], depth: float) -> float:
    """Cells through a depth [m]."""
    size = grid["cell_size"]
    return float(depth / (size[2] if isinstance(size, Sequence) else size))


def _count(particles: int | Sequence[int]) -> str:
    return " x ".join(map(str, particles)) if isinstance(particles, Sequence) else str(particles)


def _sizes(size: "CellSize") -> str:
    return " x ".join(f"{x:g}" for x in size) + " m" if isinstance(size, Sequence) else f"{size:g} m"
