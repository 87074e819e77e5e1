"""Error against time: problems with a known answer on successively finer grids; one setting is changed at a time.

Each run is repeated in turns with the others and its shortest processor time on one thread counts; particle-steps tell the
work without the noise of a machine.
"""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from runout.errors import ConfigError
from runout.studies.verification_cases.column_collapse import measured_surface
from runout.studies.work_precision import machine, versions
from tests.benchmarks.error_cases.choice import BASE, REPEATED_BELOW, Outcome, Variation
from tests.benchmarks.error_cases.curve import cost_at, fitted, on_front
from tests.benchmarks.error_cases.problems import PROBLEMS, Problem
from tests.benchmarks.error_cases.terrains import at_hand

LOGGER = logging.getLogger("runout.work_precision")
SCHEMA = 1
FILE = "work_precision.json"
REPEATS = 2  # runs of each point in the full study
COARSE = 2  # number of grids of a slow variation; one in the small study


@dataclass
class Point:
    """All runs of one variation of one problem on one grid."""

    problem: Problem
    variation: Variation
    grid: float
    outcomes: list[Outcome]
    repeats: int

    def run(self) -> None:
        """Run once more, unless the run is too long to be repeated."""
        if len(self.outcomes) < self.repeats and not (self.outcomes and self.outcomes[0].seconds > REPEATED_BELOW):
            self.outcomes.append(self.problem.measure(self.grid, self.variation))

    def described(self) -> dict[str, Any]:
        """The shortest run, ready for JSON."""
        best = min(self.outcomes, key=lambda o: o.seconds)
        content = {name: None if value != value else value for name, value in asdict(best).items()}  # JSON has no nan
        return {"grid": self.grid, "cell": self.problem.cell(self.grid), "runs": len(self.outcomes), **content}


def measured(
    names: Sequence[str] = (),
    full: bool = False,
    repeats: int = 2,
    progress: Callable[[float], None] = lambda done: None,
) -> dict[str, Any]:
    """Measurements of every problem with each of its variations on its grids, with orders and rankings.

    Parameters
    ----------
    names : sequence of str
        Names from :data:`PROBLEMS`, upper or lower case; all if empty.
    full : bool
        More grids.
    repeats : int
        Runs of each point, of which the shortest counts.
    progress : callable
        Called with the finished fraction of the points.

    Raises
    ------
    ConfigError
        If there is no problem of a name.
    """
    chosen = [_named(name) for name in names or PROBLEMS]
    if measured_surface() is None and any(problem.name == "F5" for problem in chosen):
        LOGGER.warning("F5 is left out: RUNOUT_DATA names no folder with the digitised experiment")
        chosen = [problem for problem in chosen if problem.name != "F5"]
    chosen = [problem for problem in chosen if at_hand(problem.site)]
    done = []
    for k, problem in enumerate(chosen):
        started = time.perf_counter()
        done.append(_solved(_sized(problem, full), full, repeats, _part(progress, k, len(chosen))))
        LOGGER.info("%s: %.0f s", problem.name, time.perf_counter() - started)
    return recorded(done, full)


def recorded(problems: Sequence[Mapping[str, Any]], full: bool) -> dict[str, Any]:
    """The record of problems, each as :func:`measured` describes it."""
    return {
        "schema": SCHEMA,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "full": full,
        "machine": machine(),
        "versions": versions(),
        "seed": 0,
        "problems": list(problems),
    }


def _part(progress: Callable[[float], None], number: int, total: int) -> Callable[[float], None]:
    return lambda share: progress((number + share) / total)


def _named(name: str) -> Problem:
    if name.lower() not in PROBLEMS:
        raise ConfigError(f"there is no problem {name!r}; choose among {', '.join(p.name for p in PROBLEMS.values())}")
    return PROBLEMS[name.lower()]


def _sized(problem: Problem, full: bool) -> Problem:
    """The problem with the reference for its size."""
    return replace(problem, measure=problem.quick) if problem.quick and not full else problem


def _solved(problem: Problem, full: bool, repeats: int, progress: Callable[[float], None]) -> dict[str, Any]:
    """All points of a problem in turns, forwards and backwards, and what its curves say."""
    points = points_of(problem, problem.variations(), full, repeats)
    compiling = _first(problem, points)
    in_turns(points, repeats, progress)
    curves = {v.name: [p.described() for p in points if p.variation is v] for v in problem.variations()}
    return assembled(problem, curves, compiling)


def points_of(problem: Problem, variations: Sequence[Variation], full: bool, repeats: int) -> list[Point]:
    """Points of some variations of a problem, without outcomes."""
    sizes = problem.full if full else problem.small
    return [
        Point(problem, v, grid, [], repeats) for v in variations for grid in (sizes[: COARSE if full else 1] if v.slow else sizes)
    ]


def in_turns(points: Sequence[Point], repeats: int, progress: Callable[[float], None] = lambda done: None) -> None:
    """Run points in turns, forwards and backwards; ``progress`` is called with the finished fraction."""
    for turn in range(repeats):
        for k, point in enumerate(points[:: 1 if turn % 2 == 0 else -1]):
            point.run()
            progress((turn + (k + 1) / len(points)) / repeats)
            LOGGER.debug("%s, %s, grid %g: %s", point.problem.name, point.variation.name, point.grid, point.outcomes[-1])


def assembled(problem: Problem, curves: Mapping[str, Sequence[Mapping[str, Any]]], compiling: float | None) -> dict[str, Any]:
    """Entry of the record for a problem: its curves with their fits, Pareto front and costs at equal error.

    ``curves``: described points by the name of the variation; ``compiling``: wall time of compiling [s], None where it was not
    measured.
    """
    best = on_front(curves)
    return {
        **{name: getattr(problem, name) for name in ("name", "title", "error", "remark")},
        "jit_seconds": compiling,
        "curves": [{"variation": name, "points": _marked(curve, best[name]), "fit": _fit(curve)} for name, curve in curves.items()],
        "cost_at_equal_error": _ranked(curves),
    }


def _first(problem: Problem, points: Sequence[Point]) -> float:
    """Wall time [s] of compiling or loading kernels in the first run of each precision."""
    seconds, seen = 0.0, set()
    for point in points:
        kind = (point.variation.backend, point.variation.scene.get("precision", "float32"))
        if kind in seen or point.variation.slow:
            continue
        seen.add(kind)
        walls = []
        for _ in range(2):
            started = time.perf_counter()
            problem.measure(points[0].grid, point.variation)
            walls.append(time.perf_counter() - started)
        seconds += max(0.0, walls[0] - walls[1])
    return seconds


def _marked(curve: Sequence[Mapping[str, Any]], best: Sequence[bool]) -> list[dict[str, Any]]:
    """Points of a curve for the table: whether each is on the front by work, and DoE = -log10(error times seconds)."""
    return [
        {**p, "front": is_best, "doe": float(-np.log10(p["error"] * p["seconds"]))} for p, is_best in zip(curve, best, strict=True)
    ]


def _fit(curve: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Order and floor of the errors of a curve; None where none fits."""
    fit = fitted([p["cell"] for p in curve], [p["error"] for p in curve])
    return asdict(fit) if fit else None


def _ranked(curves: Mapping[str, Sequence[Mapping[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Work and time of every variation relative to the defaults at equal error; geometric means."""
    base, factors = curves[BASE.name], {}
    for name, curve in curves.items():
        ratios: dict[str, list[float]] = {}
        for cost in ("particle_steps", "seconds"):
            for point in base:
                other = cost_at(point["error"], [p[cost] for p in curve], [p["error"] for p in curve])
                if other is not None:
                    ratios.setdefault(cost, []).append(other / point[cost])
        means = {cost: float(np.exp(np.mean(np.log(values)))) for cost, values in ratios.items()}
        factors[name] = {**means, "errors": len(next(iter(ratios.values()), []))}
    return factors
