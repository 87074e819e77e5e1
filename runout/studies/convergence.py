"""Numerical error of the maps of a site, from runs on its grid and on coarser ones that are shifted against the terrain."""

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout import log
from runout.ensemble.sweep import median_parameters
from runout.errors import ConfigError
from runout.forecast.accuracy import BOUNDS
from runout.forecast.numerical_error import MAP, MAP_SAFETY, ORDER, SAFETY, SCATTERS, SHARE, ErrorBar, statements
from runout.model.release import thickness_of
from runout.scores.contingency import contingency
from runout.scores.elevation_change import elevation_change
from runout.scores.field_errors import differences
from runout.scores.flow import BAR_MAPS, OF_MEMBER
from runout.studies.work_precision import markdown
from runout.terrain.relief import resolved_in
from runout.terrain.sdf import raster_surface

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.model.terrain import Terrain
    from runout.simulation.result import Result

LOGGER = logging.getLogger("runout.convergence")
FILE = "convergence.json"
COARSER = (2.0, 2.0, 1.7, 1.7, 1.4, 1.4, 1.2)  # cell sizes over those of the site, one a run; uneven, so that no two share a raster
COMPARED = 1.4  # of these, the grid whose maps are compared in all scores
SHIFT = 0.382  # cells between the shifts of one run and the next
MAPS = {BAR_MAPS.get(name, name): of_run for name, of_run in OF_MEMBER.items()}  # name in the study -> map of a run
FROM_MAP = {"peak_speed": "speed"}  # map that a quantity is taken from, where it is not that of flow thickness
MOST_ESCAPED = 0.01  # share of the mass beyond the terrain up to which run-out is known
PAIRED = 1.2  # of these, the grid that also runs on another ground
METHOD = (
    "Each coarser grid was shifted against the terrain, with other positions of the particles. A fit through all runs, of order "
    f"{ORDER:g} in the cell size, gives the trend, which is the difference from a grid of vanishing cells, and the scatter of the "
    "runs about it. All have the ground of the site's grid. One more run has the relief of a few raster cells that this grid "
    "filters, or lacks that which it has; the part of the difference that is an error is that of the ground. The error is "
    f"{SAFETY:g} times the root of the sum of squares of the trend, of {SCATTERS:g} scatters, of the ground, and of {SHARE:g} of "
    f"the error of the map; that of a map is the root of the sum of squares of {MAP_SAFETY:g} times trend and noise, and of "
    f"{SAFETY:g} times the ground. Run-out is the horizontal distance from the centre of the released mass. Areas count fractions "
    "of cells."
)
QUANTITIES = ("quantity", "unit", "value", "trend", "scatter", "ground", "error", "relative")


@dataclass(frozen=True)
class Run:
    """Result of one run: cells over those of the site, quantities by name, and maps (rows, columns) on the cells of the DEM."""

    ratio: float
    quantities: dict[str, float]
    maps: dict[str, np.ndarray]
    seconds: float
    particles: int


@dataclass(frozen=True)
class Ground:
    """Parts of the natural waves of two cells of a raster that the grounds of a study keep: ``fine_relief`` of the terrain."""

    own: float  # of all grids
    other: float | None = None  # of one more run; None if the ground is the same with it
    weight: float = 1.0  # error over the difference that this run makes


@dataclass(frozen=True)
class Pair:
    """Two runs of one grid, on another ground and on that of all grids, and how much of their difference is an error."""

    other: Run
    own: Run
    weight: float


FILTERED = Ground(0.0)


def study(
    site: "Site",
    *,
    coarser: Sequence[float] = COARSER,
    simulate: "Callable[..., Result] | None" = None,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Numerical error of the maps of a site's median scenario at its own cell size.

    The scenario, every sampled parameter at its median, runs on the site's grid and on coarser ones with the same number of
    particles a cell and the same volume. Each coarser grid is also shifted against the terrain, upwards by another part of a cell,
    with other positions of the particles. All have the ground of the site's grid. The grid of :data:`PAIRED` also runs with the
    relief of a few raster cells that the site's grid filters, or without that which it has.

    Parameters
    ----------
    site : Site
    coarser : sequence of float
        Cell size of each further run over the site's, above 1; at least two sizes.
    simulate : callable, optional
        Replaces :func:`runout.simulate`.
    progress : callable, optional
        Called with the finished fraction of the work, 0 to 1.

    Returns
    -------
    dict
        ``quantities``: one :class:`~runout.forecast.numerical_error.ErrorBar` a quantity as plain numbers, and that of the map of
        flow thickness; ``fields``: differences of each map from that of one coarser grid, with the ratio of its error to this
        difference; ``levels``: cells, particles, seconds of each run, the site's last.

    Raises
    ------
    ConfigError
        If there are fewer than two coarser grids or one is not coarser, or the coarsest cells are larger than a release.
    """
    if len(set(coarser)) < 2 or min(coarser) <= 1.0:
        raise ConfigError(f"coarser grids are {[*coarser]}; give at least two cell sizes over that of the site, all above 1")
    arguments = site.member_arguments(median_parameters(site.settings))
    spacing = np.broadcast_to(np.asarray(arguments["cell_size"], float), 3)
    _require_room(arguments, max(coarser) * spacing)
    thresholds = site.settings.hazard.thickness_thresholds
    ground = grounds(arguments["terrain"], spacing[:2].tolist())
    grids = plan(coarser, ground)
    costs = np.cumsum([ratio**-4.0 for ratio, *_ in grids])
    made: list[Run] = []
    for (ratio, number, part), cost in zip(grids, costs, strict=True):
        made.append(run_once(arguments, ratio, number * SHIFT, number, thresholds, simulate, part))
        LOGGER.info("cells of %.4g m, shifted by %.2g: %.1f s", ratio * spacing[0], number * SHIFT % 1.0, made[-1].seconds)
        if progress:
            progress(cost / costs[-1])
    runs, pair = paired(made, grids, ground.weight)
    return {
        "site": site.name,
        "scenario": median_parameters(site.settings),
        "levels": [
            {"cell_size": [*map(float, run.ratio * spacing)], "particles": run.particles, "seconds": run.seconds} for run in made
        ],
        "quantities": {name: bar.as_dict(name) for name, bar in bars(runs, pair).items()},
        "fields": _fields(runs, pair, site, arguments["terrain"].cell_area),
    }


def grounds(terrain: "Terrain", spacing: Sequence[float]) -> Ground:
    """Grounds of a study: the whole of the relief, or nothing of it, is the other one where the raster has such relief.

    On a grid that filters it, the whole difference is an error. On one that resolves it, waves of two cells of the raster have an
    error of the square of the cells of the grid over those of the raster.
    """
    own = resolved_in(spacing, terrain.cell_size) if terrain.fine_relief is None else terrain.fine_relief
    other = 1.0 if own < 0.5 else 0.0
    pair = (replace(terrain, fine_relief=part) for part in (own, other))
    here, there = (raster_surface(one, None, (float(spacing[0]), float(spacing[1]))).coefficients for one in pair)
    if np.array_equal(here, there):
        return Ground(own)
    ratio = max(h / one for h, one in zip(spacing, terrain.cell_size, strict=True))
    return Ground(own, other, (1.0 - own * (1.0 - min(ratio, 1.0) ** 2)) / abs(other - own))


def plan(coarser: Sequence[float] = COARSER, ground: Ground = FILTERED) -> list[tuple[float, int, float]]:
    """Cell size over the site's, number and ground of each run, coarse first; the site's own has number 0 and is not shifted.

    The other ground has a run of the cells nearest to :data:`PAIRED`, with the number of that on the own one.
    """
    grids = [(ratio, k + 1, ground.own) for k, ratio in enumerate(sorted(coarser, reverse=True))]
    ratio, number, _ = min(grids, key=lambda grid: abs(grid[0] - PAIRED))
    first = [] if ground.other is None else [(ratio, number, ground.other)]
    return [*first, *grids, (1.0, 0, ground.own)]


def paired(made: Sequence[Run], grids: Sequence[tuple[float, int, float]], weight: float) -> tuple[list[Run], Pair | None]:
    """Runs on the ground of all grids, and that on another ground with its like among them, if there is one."""
    own = [run for run, grid in zip(made, grids, strict=True) if grid[2] == grids[-1][2]]
    if len(own) == len(made):
        return own, None
    number = grids[0][1]
    like = next(run for run, grid in zip(made[1:], grids[1:], strict=True) if grid[1] == number)
    return own, Pair(made[0], like, weight)


def bars(runs: Sequence[Run], pair: Pair | None = None) -> dict[str, ErrorBar]:
    """Error bar of each quantity that all runs have, and of the map of flow thickness; the last run is the finest."""
    ratios, fine = [run.ratio for run in runs], runs[-1]
    of_map = {name: _bar_of_map(runs, pair, name) for name in ("flow_thickness", "speed")}
    error_bars = {}
    for name in fine.quantities:
        values, by_ground = [run.quantities[name] for run in runs], 0.0
        if pair:
            by_ground = pair.weight * abs(pair.other.quantities[name] - pair.own.quantities[name])
        if np.isfinite([*values, by_ground]).all():
            map_error = of_map[FROM_MAP.get(name, "flow_thickness")].error
            error_bars[name] = ErrorBar.of_value(ratios, values, map_error, by_ground)
        else:
            LOGGER.warning("%s has no error bar: more than %g %% of the mass left the terrain", name, 100 * MOST_ESCAPED)
    return {**error_bars, MAP: of_map["flow_thickness"]}


def _bar_of_map(runs: Sequence[Run], pair: Pair | None, name: str) -> ErrorBar:
    by_ground = pair.weight * _distances([pair.other, pair.own], name)[0] if pair else 0.0
    return ErrorBar.of_map([run.ratio for run in runs[:-1]], _distances(runs, name), by_ground)


def _distances(runs: Sequence[Run], name: str) -> list[float]:
    """Distance of a map of each coarser grid to that of the finest: relative L1 [1], of arrival the root mean square [s]."""
    fine = runs[-1].maps[name]
    if name == "arrival":
        return [common_differences(run.maps[name], fine)["root_mean_square"] or 0.0 for run in runs[:-1]]
    return [compared(run.maps[name], fine, ())["relative_l1"] for run in runs[:-1]]


def _require_room(arguments: Mapping[str, Any], coarsest: np.ndarray) -> None:
    for release in arguments["release"]:
        if release.area < 4 * coarsest[0] * coarsest[1]:
            raise ConfigError(
                f"release {release.name} is {release.area:.4g} m2, fewer than four of the coarsest cells ({coarsest[0]:.3g} m); "
                "set a smaller simulation.cell_size"
            )


def run_once(
    arguments: Mapping[str, Any], ratio: float, shift: float, seed: int, thresholds: Sequence[float], simulate: Any = None,
    fine_relief: float | None = None,
) -> Run:  # fmt: skip
    """One run with cells ``ratio`` times those of ``arguments``, the terrain raised by ``shift`` cells, less whole ones.

    ``fine_relief`` is the part of the waves of two cells of the raster that its ground keeps.
    """
    from runout.hazard.observed import removed

    if simulate is None:
        from runout.simulation.single import simulate
    terrain, h = arguments["terrain"], ratio * np.broadcast_to(np.asarray(arguments["cell_size"], float), 3)
    raised = replace(terrain, elevation=terrain.elevation + shift % 1.0 * h[2], fine_relief=fine_relief)
    changed = {"terrain": raised, "cell_size": tuple(float(x) for x in h), "seed": arguments["seed"] + seed}
    result = simulate(**{**arguments, **changed})
    values = quantities(result, arguments["release"], thresholds)
    maps = {name: result.fields[of_run] for name, of_run in MAPS.items() if of_run in result.fields}
    change = elevation_change(maps["deposit"], removed(arguments["release"]))
    maps |= {"erosion": np.maximum(-change, 0.0), "deposition": np.maximum(change, 0.0)}
    return Run(ratio, values, maps, result.timing["total"] - result.timing["setup"], result.n_particles)


def quantities(result: "Result", releases: Sequence[Any], thresholds: Sequence[float]) -> dict[str, float]:
    """Run-out of 99 % of the mass and of its centre [m], peak speed [m/s], areas [m2].

    Run-out is the horizontal distance from the centre of the released mass. Mass beyond the terrain counts as farther than all
    other; nan where run-out is not known for it.
    """
    terrain, released = result.terrain, thickness_of(releases, result.terrain)
    rows, columns = terrain.shape
    x = (np.arange(columns) + 0.5) * terrain.cell_size[0]
    y = (rows - 0.5 - np.arange(rows)) * terrain.cell_size[1]
    start = np.array([(released.sum(0) * x).sum(), (released.sum(1) * y).sum()]) / released.sum()
    place, mass = result.state.position(np.array(result.spacing))[:, :2], result.state.mass
    whole = float(result.series["mass"][0])
    distance = np.hypot(*(place - start).T)
    order = np.argsort(distance)
    farthest = np.searchsorted(np.cumsum(mass[order], dtype=float), (1.0 - MOST_ESCAPED) * whole)
    known = farthest < len(mass)
    speed = result.fields["max_speed"]
    values = {
        "f99": float(distance[order][farthest]) if known else np.nan,
        "centre_of_mass_runout": float(np.hypot(*((mass @ place) / mass.sum() - start))) if known else np.nan,
        "peak_speed": float(np.quantile(speed[speed > 0], 0.99)) if (speed > 0).any() else 0.0,
    }
    for threshold in thresholds:
        values[f"area_above_{threshold:g}_m"] = area_above(result.fields["max_flow_thickness"], threshold, terrain.cell_area)
    return values


def _fields(runs: Sequence[Run], pair: Pair | None, site: "Site", cell_area: float) -> list[dict[str, Any]]:
    """Differences of the maps of the site's grid from those of a coarser one, and their errors over these differences."""
    ratios, fine = [run.ratio for run in runs[:-1]], runs[-1]
    other = min(range(len(ratios)), key=lambda k: abs(ratios[k] - COMPARED))
    differences_of_maps = []
    for name, best in fine.maps.items():
        distances = _distances(runs, name)
        over = _bar_of_map(runs, pair, name).error / distances[other] if distances[other] else 1.0
        differences = _compared(name, runs[other].maps[name], best, site, cell_area)
        differences_of_maps.append({"ratio": ratios[other], "map": name, "error_over_difference": over, **differences})
    return differences_of_maps


def _compared(name: str, coarse: np.ndarray, best: np.ndarray, site: "Site", cell_area: float) -> dict[str, Any]:
    """Differences of a map on two grids; those of thickness and change also by the area above the thresholds of the site."""
    if name == "arrival":
        return common_differences(coarse, best)
    thresholds: Sequence[float] = ()
    if name in ("flow_thickness", "deposit"):
        thresholds = site.settings.hazard.thickness_thresholds
    elif name in ("erosion", "deposition"):
        thresholds = _detection_limits(site)
        coarse, best = (np.where(one < max(thresholds, default=0.0), 0.0, one) for one in (coarse, best))
    return compared(coarse, best, thresholds, cell_area)


def _detection_limits(site: "Site") -> list[float]:
    """Detection limit [m] of the DEM of difference that the site observes, if it does."""
    observed = site.settings.observations
    return [observed.difference.detection_limit] if observed and observed.difference else []


def as_markdown(content: Mapping[str, Any]) -> str:
    """The whole study as a page."""
    outlined = [field for field in content["fields"] if field.get("critical_success_index")]
    scenario = ", ".join(f"{name} {value:.4g}" for name, value in content["scenario"].items()) or "as in site.yaml"
    lines = [
        f"# Numerical error of {content['site']}",
        "",
        f"Scenario: the median of every sampled parameter ({scenario}). {METHOD} {BOUNDS}",
        "",
        markdown(QUANTITIES, map(_quantity, content["quantities"].values())),
        "",
        markdown(("cells [m]", "particles", "seconds"), map(_level, content["levels"])),
        "",
        f"Maps against those of cells {content['fields'][0]['ratio']:g} times as large:",
        "",
        markdown(("map", "relative L1", "critical success index"), map(_map, outlined)),
    ]
    return "\n".join(lines) + "\n"


def _level(level: Mapping[str, Any]) -> tuple[str, ...]:
    size = " x ".join(f"{x:.4g}" for x in level["cell_size"])
    return size, f"{level['particles']}", f"{level['seconds']:.1f}"


def _quantity(record: Mapping[str, Any]) -> tuple[str, ...]:
    value = "" if record["fine"] is None else f"{record['fine']:.4g}"
    relative = "" if record["relative_error"] is None else f"{100 * record['relative_error']:.2g} %"
    parts = (f"{record[key]:.2g}" for key in ("trend", "scatter", "ground", "error"))
    return record["title"], record["unit"], value, *parts, relative


def _map(field: Mapping[str, Any]) -> tuple[str, ...]:
    index = ", ".join(f"{value:.2f} at {threshold} m" for threshold, value in field["critical_success_index"].items())
    return field["map"].replace("_", " "), f"{field['relative_l1']:.3f}", index


def command(site_path: Path, out: Path | None, device: str | None = None) -> int:
    """Command ``runout verify SITE --convergence``: runs the study, prints it, and writes convergence.json and .md."""
    from runout.errors import ExitCode
    from runout.io.atomic import write_json, write_text
    from runout.workflow.study import Study

    opened = Study.open(site_path, out, device=device)
    with log.to_file(opened.results / "run.log"), log.progress("convergence") as bar:
        record = study(opened.site, coarser=COARSER, progress=bar)
    size = record["levels"][-1]["cell_size"][0]
    log.output().print(f"{record['site']}: numerical error of the median scenario with cells of {size:g} m", markup=False)
    for line in [*statements(record), BOUNDS]:
        log.output().print(f"  {line}", markup=False)
    for path in (write_json(record, opened.results / FILE), write_text(as_markdown(record), opened.results / "convergence.md")):
        LOGGER.info("wrote %s", path)
    return ExitCode.OK


def compared(field: np.ndarray, reference: np.ndarray, thresholds: Sequence[float], cell_area: float = 1.0) -> dict[str, Any]:
    """Differences of two maps on cells of ``cell_area`` [m2]; unknown cells count as dry.

    Keys: ``relative_l1`` [1]; sums over the plan area: ``absolute_sum`` of abs(d), ``net_sum`` of d [unit m2], ``squared_sum`` of
    d^2 [unit^2 m2]; ``reached_area`` where one of them is above 0 [m2]; ``critical_success_index`` by threshold: hits over hits,
    misses and false alarms, 1 where neither map exceeds it.
    """
    a, b = np.nan_to_num(field), np.nan_to_num(reference)
    index, d = {}, a - b
    either = (a > 0) | (b > 0)
    for threshold in thresholds:
        csi = contingency(a > threshold, b > threshold).critical_success_index
        index[f"{threshold:g}"] = 1.0 if math.isnan(csi) else csi
    sums = {"absolute_sum": np.abs(d), "net_sum": d, "squared_sum": d * d, "reached_area": either}
    totals = {name: float(cell_area * values.sum()) for name, values in sums.items()}
    return {"relative_l1": relative_l1(a, b), **totals, "critical_success_index": index}


def common_differences(field: np.ndarray, reference: np.ndarray) -> dict[str, float | None]:
    """Mean and root mean square difference of two maps on the cells that both have; None where there are none.

    And the share [1] of cells that one has alone, among those that either has.
    """
    one, other = np.isfinite(field), np.isfinite(reference)
    bias, rms, _ = differences(field[one & other], reference[one & other])
    alone, either = int((one ^ other).sum()), int((one | other).sum())
    return {"mean": _known(bias), "root_mean_square": _known(rms), "alone": alone / either if either else None}


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def relative_l1(field: np.ndarray, reference: np.ndarray) -> float:
    """Relative L1 distance of two maps [1], 1 where only the reference is empty; unknown cells count as dry."""
    a, b = (np.nan_to_num(np.asarray(one, float)) for one in (field, reference))
    return float(np.abs(a - b).sum() / np.abs(b).sum()) if b.any() else float(a.any())


def area_above(field: np.ndarray, threshold: float, cell_area: float) -> float:
    """Plan area [m2] where a map (rows, columns) exceeds a threshold, by fractions of cells.

    Between the centres of neighbouring cells the map is linear; the mean of all lines east-west and north-south. Ground beyond
    the map is at 0, and unknown cells count as dry.
    """
    padded = np.pad(np.nan_to_num(np.asarray(field, float)), 1)
    lengths = [_length_above(padded, threshold), _length_above(padded.T, threshold)]
    return 0.5 * cell_area * sum(lengths)


def _length_above(field: np.ndarray, threshold: float) -> float:
    """Length [cells] above a threshold along all rows of a map (rows, columns)."""
    low, high = np.minimum(field[:, 1:], field[:, :-1]), np.maximum(field[:, 1:], field[:, :-1])
    rise = high - low
    part = np.divide(high - threshold, rise, out=(high > threshold).astype(float), where=rise > 0)
    return float(np.clip(part, 0.0, 1.0).sum())
