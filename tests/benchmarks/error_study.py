"""The full error study with each problem in a process of its own: for a machine with many cores, in minutes.

    python tests/benchmarks/error_study.py --out DIR [--workers 16]

Times are processor times on one thread, as in `runout bench --error --full`, which does the same one after the other. The
longest parts start first. A part that is done is kept in DIR/parts, and a second run does those that are missing. Copy
DIR/work_precision.json to tests/benchmarks/records/, then run `python -m runout.studies.documentation`.
"""

import argparse
import json
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from runout.io.atomic import write_json

Entries = list[dict[str, Any]]
LONGEST_FIRST = ("fine_terrain", "terrain", "F3", "F5", "T5", "T1")


def kept(folder: Path, make: Callable[[str], Entries], name: str) -> Entries:
    """What ``make`` finds for a name, or found in an earlier run."""
    path = folder / f"{make.__name__}_{name}.json"
    if path.is_file():
        return json.loads(path.read_text(encoding="utf-8"))["entries"]  # type: ignore[no-any-return]
    found = make(name)
    write_json({"entries": found}, path)
    return found


def problem(name: str) -> list[dict[str, Any]]:
    """One problem in full, as the record has it; nothing where its data are not at hand."""
    from runout.studies import error_against_time as study

    study.measured_presets = lambda coarser: []  # they have processes of their own
    return study.measured([name], full=True, repeats=study.REPEATS)["problems"]  # type: ignore[no-any-return]


def presets(site: str) -> list[dict[str, Any]]:
    """The presets on one site."""
    from runout.studies.error_cases.presets import at_hand, presets_on

    return presets_on(site) if at_hand(site) else []


def main() -> None:
    """Run all parts, and write record, page, tables and figure."""
    from runout.studies.error_against_time import FILE, recorded
    from runout.studies.error_cases.presets import PRESET_SITES
    from runout.studies.error_cases.problems import PROBLEMS
    from runout.studies.error_page import page, rows

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    a = parser.parse_args()
    os.environ["NUMBA_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"
    parts = a.out / "parts"
    names = [p.name for p in PROBLEMS.values()]
    order = sorted(names, key=lambda n: LONGEST_FIRST.index(n) if n in LONGEST_FIRST else len(LONGEST_FIRST))
    problem("terrain_25"), problem("U9")  # compile once, for all processes
    with ProcessPoolExecutor(a.workers, mp_context=get_context("spawn")) as pool:
        of_sites = [pool.submit(kept, parts, presets, site) for site in reversed(PRESET_SITES)]
        of_problems = {name: pool.submit(kept, parts, problem, name) for name in order}
        found = [entry for name in names for entry in of_problems[name].result()]
        content = recorded(found, [row for part in reversed(of_sites) for row in part.result()], full=True)
    print(rows(content))
    write_json(content, a.out / FILE)
    print(page(content).write(a.out))


if __name__ == "__main__":
    main()
