"""Numerical error of the maps of a site, from three grids that are also shifted against the terrain."""

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout import log
from runout.errors import ConfigError
from runout.scores.elevation_change import elevation_change
from runout.studies.grid_index import GridIndex, area_above, common_differences, compared

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.result import Result

LOGGER = logging.getLogger("runout.convergence")
FILE = "convergence.json"
RATIO = math.sqrt(2.0)  # ratio of cell sizes of neighbouring grids; the next coarser one has a quarter of the cost
TITLES = {
    "f99": ("front of 99 % of the mass", "m"),
    "centre_of_mass_runout": ("run-out of the centre of mass", "m"),
    "peak_speed": ("peak speed (99th percentile of the cells)", "m/s"),
}
MAPS = {
    "flow_thickness": "max_flow_thickness",
    "deposit": "deposit_thickness",
    "speed": "max_speed",
    "pressure": "max_pressure",
    "arrival": "arrival_time",
}  # name in the study -> map of a run
SHIFTS = 5  # shifts of the grid against the terrain, for all grids but the finest


@dataclass(frozen=True)
class Run:
    """Result of one run: quantities by name, and maps (rows, columns) on the cells of the DEM."""

    quantities: dict[str, float]
    maps: dict[str, np.ndarray]
    seconds: float
    particles: int


def study(
    site: "Site",
    *,
    shifts: int = SHIFTS,
    ratio: float = RATIO,
    simulate: "Callable[..., Result] | None" = None,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Numerical error of the maps of a site's median scenario at its own cell size.

    The scenario, every sampled parameter at its median, runs on the site's grid and on two coarser ones with the same
    number of particles a cell and the same volume. Each coarser grid is also shifted against the terrain, upwards in equal
    parts of a cell, with other positions of the particles.

    Parameters
    ----------
    site : Site
    shifts : int
        Number of runs on each coarser grid, at least 2.
    ratio : float
        Ratio of cell sizes of neighbouring grids, more than 1.
    simulate : callable, optional
        Replaces :func:`runout.simulate`.
    progress : callable, optional
        Called with the finished fraction of the work, 0 to 1.

    Returns
    -------
    dict
        ``quantities``: one :class:`runout.studies.grid_index.GridIndex` a quantity as plain numbers; ``fields``: relative L1
        distance, other differences and critical success index between a map of a grid and of the finest; ``levels``: cells,
        particles, seconds.

    Raises
    ------
    ConfigError
        If a number is out of its range, or the coarsest cells are larger than a release.
    """
    if shifts < 2 or ratio <= 1.0:
        raise ConfigError(f"shifts is {shifts} and ratio {ratio:g}; at least 2 shifts and a ratio above 1 are needed")
    arguments = site.member_arguments(median_parameters(site))
    spacing = np.broadcast_to(np.asarray(arguments["cell_size"], float), 3)
    _require_room(arguments, ratio**2 * spacing)
    thresholds = site.settings.hazard.thickness_thresholds
    plan = [(level, shift) for level in (2, 1, 0) for shift in range(shifts if level else 1)]
    costs = np.cumsum([ratio ** (-4 * level) for level, _ in plan])
    runs: dict[int, list[Run]] = {0: [], 1: [], 2: []}
    for (level, shift), cost in zip(plan, costs, strict=True):
        h = ratio**level * spacing
        runs[level].append(run_once(arguments, h, shift / shifts, shift, thresholds, simulate))
        LOGGER.info("cells of %.4g m, shifted by %.2g: %.1f s", h[0], shift / shifts, runs[level][-1].seconds)
        if progress:
            progress(cost / costs[-1])
    return _summary(runs, spacing, ratio, site, arguments["terrain"].cell_size)


def median_parameters(site: "Site") -> dict[str, float]:
    """Median of every sampled parameter, in the units of site.yaml."""
    from runout.ensemble.design import quantiles

    sampled = site.settings.ensemble.parameters or {}
    return {name: float(quantiles(one, np.array([0.5]), name)[0]) for name, one in dict(sampled).items()}


def _require_room(arguments: Mapping[str, Any], coarsest: np.ndarray) -> None:
    for release in arguments["release"]:
        if release.area < 4 * coarsest[0] * coarsest[1]:
            raise ConfigError(
                f"release {release.name} is {release.area:.4g} m2, fewer than four of the coarsest cells ({coarsest[0]:.3g} m); "
                "set a smaller simulation.cell_size"
            )


def run_once(
    arguments: Mapping[str, Any], h: np.ndarray, shift: float, seed: int, thresholds: Sequence[float], simulate: Any = None
) -> Run:
    """One run with cells ``h`` (3,) [m], the terrain raised by ``shift`` cells."""
    from runout.hazard.observed import removed

    if simulate is None:
        from runout.simulation import simulate
    terrain = arguments["terrain"]
    raised = replace(terrain, elevation=terrain.elevation + shift * h[2])
    changed = {"terrain": raised, "cell_size": tuple(float(x) for x in h), "seed": arguments["seed"] + seed}
    result = simulate(**{**arguments, **changed})
    found = quantities(result, arguments["release"], thresholds)
    maps = {name: result.fields[of_run] for name, of_run in MAPS.items() if of_run in result.fields}
    change = elevation_change(maps["deposit"], removed(arguments["release"]))
    maps |= {"erosion": np.maximum(-change, 0.0), "deposition": np.maximum(change, 0.0)}
    return Run(found, maps, result.timing["total"] - result.timing["setup"], result.n_particles)


def quantities(result: "Result", releases: Sequence[Any], thresholds: Sequence[float]) -> dict[str, float]:
    """Run-out of 99 % of the mass and of its centre [m], peak speed [m/s], areas [m2] and largest deposit [m]."""
    terrain = result.terrain
    rows, columns = terrain.shape
    released = np.sum([release.thickness for release in releases], axis=0)
    x = (np.arange(columns) + 0.5) * terrain.cell_size[0]
    y = (rows - 0.5 - np.arange(rows)) * terrain.cell_size[1]
    start = np.array([(released.sum(0) * x).sum(), (released.sum(1) * y).sum()]) / released.sum()
    place, mass = result.state.position(np.array(result.spacing))[:, :2], result.state.mass
    distance = np.hypot(*(place - start).T)
    order = np.argsort(distance)
    share = np.cumsum(mass[order]) / mass.sum()
    found = {
        "f99": float(distance[order][np.searchsorted(share, 0.99)]),
        "centre_of_mass_runout": float(np.hypot(*((mass @ place) / mass.sum() - start))),
        "peak_speed": float(np.quantile(result.fields["max_speed"][result.fields["max_speed"] > 0], 0.99)),
    }
    for threshold in thresholds:
        found[f"area_above_{threshold:g}_m"] = area_above(result.fields["max_flow_thickness"], threshold, terrain.cell_area)
    return found


def _summary(
    runs: Mapping[int, Sequence[Run]], spacing: np.ndarray, ratio: float, site: "Site", cell: tuple[float, float]
) -> dict[str, Any]:
    """Return value of :func:`study`."""
    names = runs[0][0].quantities
    values = {name: [[run.quantities[name] for run in runs[level]] for level in (2, 1, 0)] for name in names}
    block = max(1, math.ceil(ratio**2 * float(spacing[:2].max()) / min(cell) - 1e-9))
    fine = runs[0][0]
    fields = [
        {"level": level, "map": name, **_compared(name, runs[level][0].maps[name], best, block, cell, site)}
        for level in (2, 1)
        for name, best in fine.maps.items()
    ]
    return {
        "site": site.name,
        "scenario": median_parameters(site),
        "ratio": ratio,
        "levels": [
            {
                "level": level,
                "cell_size": [float(x) for x in ratio**level * spacing],
                "runs": len(runs[level]),
                "particles": runs[level][0].particles,
                "seconds": sum(run.seconds for run in runs[level]),
            }
            for level in (2, 1, 0)
        ],
        "block_of_cells": block,
        "quantities": {name: {**_titled(name), **GridIndex.of(v, ratio).as_dict()} for name, v in values.items()},
        "fields": fields,
    }


def _compared(
    name: str, coarse: np.ndarray, best: np.ndarray, block: int, cell: tuple[float, float], site: "Site"
) -> dict[str, Any]:
    """Differences of a map on two grids; those of thickness and change also by the area above the thresholds of the site."""
    if name == "arrival":
        return common_differences(coarse, best)
    thresholds: Sequence[float] = ()
    if name in ("flow_thickness", "deposit"):
        thresholds = site.settings.hazard.thickness_thresholds
    elif name in ("erosion", "deposition"):
        thresholds = _detection_limits(site)
        coarse, best = (np.where(one < max(thresholds, default=0.0), 0.0, one) for one in (coarse, best))
    return compared(coarse, best, block, thresholds, cell[0] * cell[1])


def _detection_limits(site: "Site") -> list[float]:
    """Detection limit [m] of the DEM of difference that the site observes, if it does."""
    observed = site.settings.observations
    return [observed.difference.detection_limit] if observed and observed.difference else []


def _titled(name: str) -> dict[str, str]:
    title, unit = TITLES.get(name) or (f"area deeper than {name.removeprefix('area_above_').removesuffix('_m')} m", "m2")
    return {"title": title, "unit": unit}


def command(site_path: Path, out: Path | None, device: str | None = None, shifts: int | None = None) -> int:
    """Command ``runout verify SITE --convergence``: runs the study, prints it, and writes convergence.json and .md."""
    from runout.errors import ExitCode
    from runout.io.atomic import write_json, write_text
    from runout.studies.convergence_page import as_lines, as_markdown
    from runout.workflow.study import Study

    opened = Study.open(site_path, out, device=device)
    with log.to_file(opened.results / "run.log"), log.progress("convergence") as bar:
        found = study(opened.site, shifts=shifts or SHIFTS, progress=bar)
    for line in as_lines(found):
        log.output().print(line, markup=False)
    for path in (
        write_json(found, opened.results / FILE),
        write_text(as_markdown(found), opened.results / "convergence.md"),
    ):
        LOGGER.info("wrote %s", path)
    return ExitCode.OK
