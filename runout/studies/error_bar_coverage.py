"""Coverage of error bars: how often the bar of a convergence study contains the value of a grid twice as fine.

Grids form a sequence. A case uses three neighbouring grids for its bar and the second grid after them as the truth, so that a
run serves several cases. Run as ``python -m runout.studies.error_bar_coverage DIR``; :data:`PLANS` lists sites and grids.
"""

import json
import os
import platform
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from runout.studies.convergence import RATIO, SHIFTS, run_once
from runout.studies.grid_index import GridIndex

FILE = "error_bars.json"
FINER = 2  # grids from the finest of a case to its truth, whose cells are half as large
FRICTIONS = (11.0, 13.0, 15.0, 17.0, 19.0)  # [deg]
CASES = 3  # cases in a sequence of grids


@dataclass(frozen=True)
class Plan:
    """A sequence of grids at one site.

    Attributes
    ----------
    site : str
        Folder below ``sites``.
    coarsest : float
        Largest cell size [m]; each further grid is finer by the ratio of the study.
    end_time : float
        End time of every run [s].
    """

    site: str
    coarsest: float
    end_time: float


PLANS = (Plan("jacksboro", 80.0 * RATIO, 60.0), Plan("frank_slide", 160.0 * RATIO, 60.0))


def ladder(run: Callable[[float, float, int], Mapping[str, float]], coarsest: float, shifts: int) -> list[list[dict[str, float]]]:
    """Quantities of every rung, coarse first, one by shift; ``run`` takes cells [m], a shift [cells] and its number.

    The coarser two grids of a case are shifted; those that are only finest or truth run once.
    """
    rungs = CASES + 2 + FINER
    counts = [shifts if level < CASES + 1 else 1 for level in range(rungs)]
    return [[dict(run(coarsest / RATIO**level, k / n, k)) for k in range(n)] for level, n in enumerate(counts)]


def cases_of(found: Sequence[Sequence[Mapping[str, float]]]) -> list[dict[str, Any]]:
    """Bar, truth and whether the bar holds it, for each quantity of each case of a ladder."""
    cases = []
    for first in range(len(found) - 2 - FINER):
        coarse, middle, fine = found[first : first + 3]
        truth = found[first + 2 + FINER][0]
        for name, value in truth.items():
            index = GridIndex.of([[run[name] for run in coarse], [run[name] for run in middle], [fine[0][name]]], RATIO)
            holds = bool(abs(value - index.fine) <= index.error)
            cases.append({"rung": first, "quantity": name, "truth": value, "holds": holds, **index.as_dict()})
    return cases


def coverage(cases: Sequence[Mapping[str, Any]], key: str | None = None) -> dict[str, tuple[int, int]]:
    """Bars that hold and all bars, by the values of a key, or of all."""
    found: dict[str, tuple[int, int]] = {}
    for case in cases:
        name = str(case[key]) if key else "all"
        held, count = found.get(name, (0, 0))
        found[name] = held + bool(case["holds"]), count + 1
    return found


def measure(plan: Plan, friction: float, shifts: int = SHIFTS) -> list[dict[str, Any]]:
    """The cases of one ladder at a basal friction angle [deg]."""
    from runout import read_site

    site = read_site(Path("sites") / plan.site)
    arguments = {**site.member_arguments({"basal_friction_angle_deg": friction}), "end_time": plan.end_time}
    thresholds = site.settings.hazard.thickness_thresholds

    def run(h: float, shift: float, number: int) -> Mapping[str, float]:
        return run_once(arguments, np.full(3, h), shift, number, thresholds).quantities

    cases = cases_of(ladder(run, plan.coarsest, shifts))
    return [{"site": plan.site, "friction": friction, "cell": plan.coarsest / RATIO ** (c["rung"] + 2), **c} for c in cases]


def record(cases: Sequence[Mapping[str, Any]], seconds: float) -> dict[str, Any]:
    """Machine, versions, cases and how many bars hold, after so many seconds."""
    from runout import __version__
    from runout.io.provenance import installed_versions
    from runout.studies.work_precision import commit

    return {
        "machine": {"architecture": platform.machine(), "cores": os.cpu_count()},
        "versions": installed_versions(),
        "version": __version__,
        "commit": commit(),
        "seconds": round(seconds),
        "shifts": SHIFTS,
        "coverage": coverage(cases),
        "by_quantity": coverage(cases, "quantity"),
        "by_site": coverage(cases, "site"),
        "cases": list(cases),
    }


def main(out: Path) -> None:
    """Measure all sequences of grids. The record is written after each, so that an interrupted run keeps its results."""
    from runout.io.atomic import write_json
    from runout.studies.error_bar_page import page

    started, cases = time.time(), []
    for plan in PLANS:
        for friction in FRICTIONS:
            cases += measure(plan, friction)
            write_json(record(cases, time.time() - started), out / FILE)
            print(json.dumps({"site": plan.site, "friction": friction, "coverage": coverage(cases)}), flush=True)
    page(record(cases, time.time() - started)).write(out)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
