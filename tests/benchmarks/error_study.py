"""The full error study with each curve in a process of its own: for a machine with many cores, in minutes.

    python -m tests.benchmarks.error_study --out DIR [--workers 16]

Times are processor times on one thread. The references come first, then the curves. A part that is done is kept in DIR/parts, and
a second run does those that are missing. Copy DIR/work_precision.json to tests/benchmarks/records/, then run
`python -m docs.pages`.
"""

import argparse
import json
import os
import pickle
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from runout.io.atomic import write_json

Key = tuple[str, ...]
Rows = list[dict[str, Any]]
LONGEST_FIRST = ("fine_terrain", "terrain", "coulomb_only", "T1", "F5", "F3", "T5")


def kept(folder: Path, make: Callable[..., Rows], *key: str) -> Rows:
    """What ``make`` finds for a key, or found in an earlier run."""
    path = folder / f"{make.__name__}_{'_'.join(key).replace(' ', '-').replace(',', '')}.json"
    if path.is_file():
        return json.loads(path.read_text(encoding="utf-8"))["entries"]  # type: ignore[no-any-return]
    started = time.perf_counter()
    curve = make(folder, *key)
    write_json({"entries": curve}, path)
    print(f"{path.stem}: {time.perf_counter() - started:.0f} s", flush=True)
    return curve


def reference(folder: Path, problem: str) -> Rows:
    """Run that the errors of a problem on terrain are measured from, kept as a file; no rows."""
    from tests.benchmarks.error_cases.flows import at_reference

    p = _problem(problem)
    result = at_reference(p.measure.reference, p.site)
    (folder / f"{problem}.pickle").write_bytes(pickle.dumps(result))
    return []


def curve(folder: Path, problem: str, variation: str) -> Rows:
    """Described points of one variation of a problem."""
    from tests.benchmarks import error_against_time as study
    from tests.benchmarks.error_cases import flows

    p = _problem(problem)
    if p.site:
        content = pickle.loads((folder / f"{problem}.pickle").read_bytes())
        flows.at_reference = lambda *_: content  # type: ignore[assignment]
    points = study.points_of(p, [v for v in p.variations() if v.name == variation], True, study.REPEATS)
    p.measure(points[0].grid, points[0].variation)  # compiles
    study.in_turns(points, study.REPEATS)
    return [point.described() for point in points]


def _problem(name: str) -> Any:
    from tests.benchmarks.error_cases.problems import PROBLEMS

    return PROBLEMS[name.lower()]


def run_parts(pool: ProcessPoolExecutor, folder: Path, problems: Mapping[str, Any]) -> dict[Key, Rows]:
    """Points by problem and variation; curves on terrain start when their reference is there."""
    order = sorted(problems, key=lambda n: LONGEST_FIRST.index(n) if n in LONGEST_FIRST else len(LONGEST_FIRST))
    jobs: dict[Any, Key] = {pool.submit(kept, folder, reference, n): (n,) for n in order if problems[n].site}

    def curves_of(name: str) -> dict[Any, Key]:
        return {pool.submit(kept, folder, curve, name, v.name): (name, v.name) for v in problems[name].variations()}

    for name in (n for n in order if not problems[n].site):
        jobs |= curves_of(name)
    done: dict[Key, Rows] = {}
    while waiting := [job for job, key in jobs.items() if key not in done]:
        job = next(as_completed(waiting))
        key = jobs[job]
        done[key] = job.result()
        if len(key) == 1:
            jobs |= curves_of(key[0])
    return {key: rows for key, rows in done.items() if len(key) == 2}


def main() -> None:
    """Run all parts, and write the record."""
    from docs.pages.work_precision import rows
    from runout.studies.verification_cases.column_collapse import measured_surface
    from tests.benchmarks.error_against_time import FILE, assembled, recorded
    from tests.benchmarks.error_cases.problems import PROBLEMS
    from tests.benchmarks.error_cases.terrains import at_hand

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    a = parser.parse_args()
    os.environ["NUMBA_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"
    folder = a.out / "parts"
    folder.mkdir(parents=True, exist_ok=True)
    problems = {p.name: p for p in PROBLEMS.values() if at_hand(p.site) and (p.name != "F5" or measured_surface() is not None)}
    for name in ("terrain_25", "U9"):  # compile once, for all processes
        kept(folder, curve, name, "defaults") if not problems[name].site else kept(folder, reference, name)
    with ProcessPoolExecutor(a.workers, mp_context=get_context("spawn")) as pool:
        curves = run_parts(pool, folder, problems)
    contents = [assembled(p, {v.name: curves[name, v.name] for v in p.variations()}, None) for name, p in problems.items()]
    content = recorded(contents, full=True)
    print(rows(content))
    print(write_json(content, a.out / FILE))


if __name__ == "__main__":
    main()
