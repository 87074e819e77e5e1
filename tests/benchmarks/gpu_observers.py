"""Share of the observers in a run on a GPU, or on the CPU, by grid and raster.

    python tests/benchmarks/gpu_observers.py --device cuda:0 --out observers.json [--cells 20 10 5] [--finer 1 2 5]

A mass of 0.35 million m3 slides down a slope of 30 degrees onto a plain, on a raster as fine as the grid and finer. Runs with and
without observation of maps and ledger alternate; the share is what the run without lacks, of the shortest of each. It needs neither
raster libraries nor data. Prints a line a case; the JSON holds the records.
"""

import argparse
import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from runout import DruckerPrager, Release, Terrain
from runout.backends.protocol import get_backend
from runout.model.numerics import Numerics
from runout.simulation.run import Run, RunControl
from runout.simulation.scenario import build_scene
from tests.benchmarks.seed_cases.memory_peak import card_name

SIZE, CREST, RADIUS, THICKNESS = (1600.0, 640.0), 700.0, 120.0, 12.0  # [m]


class Unobserved(Run):
    """A run that observes its start and its end alone."""

    def plan(self, most: int) -> int:
        """Steps without looks, and no row of the ledger before the end."""
        self.ledger_due = 2.0 * self.control.end_time
        count = super().plan(most)
        self.look_steps = []
        return count


def slope(cell_size: float, finer: float) -> tuple[Any, Any]:
    """Scene and particles on a grid of ``cell_size`` [m]; the raster is so many times finer."""
    cell = cell_size / finer
    x, y = (cell * (np.arange(round(length / cell)) + 0.5) for length in SIZE)
    waves = 3.0 * np.sin(x / 40.0)[None, :] * np.cos(y / 50.0)[:, None]
    terrain = Terrain(math.tan(math.radians(30.0)) * np.maximum(CREST - x, 0.0)[None, :] + waves, (cell, cell))
    distance = ((x - 200.0) / RADIUS)[None, :] ** 2 + ((y - SIZE[1] / 2) / RADIUS)[:, None] ** 2
    release = Release(THICKNESS * np.sqrt(np.maximum(0.0, 1.0 - distance)), terrain)
    return build_scene(terrain, release, DruckerPrager(density=2000.0, friction_angle=30.0), 20.0, Numerics(cell_size=cell_size))


def seconds_of(kind: type[Run], made: tuple[Any, Any], end_time: float, device: str) -> tuple[float, Run]:
    """Wall time [s] of a run without its setup; on the CPU processor time of one thread."""
    engine = get_backend("scan", threads=1) if device == "cpu" else get_backend("hash", device)
    run = kind(engine, made[0], RunControl(end_time, stop=False), None, None)
    run.start(made[1])
    clock = time.process_time if device == "cpu" else time.perf_counter
    started = clock()
    run.go()
    return clock() - started, run


def measured(cell_size: float, finer: float, end_time: float, device: str, repeats: int) -> dict[str, Any]:
    """The record of a case."""
    made, seconds = slope(cell_size, finer), []
    seconds_of(Run, made, 0.02 * end_time, device)  # compiles
    for _ in range(repeats):
        pair = [seconds_of(kind, made, end_time, device) for kind in (Run, Unobserved)]
        seconds.append([taken for taken, _ in pair])
    observed, plain = np.min(seconds, axis=0).tolist()
    run = pair[0][1]
    return {
        "device": device, "cell_size": cell_size, "finer": finer, "particles": len(made[1]), "steps": run.counters.steps,
        "transfers": run.counters.transfers,
        "raster": [made[0].raster.rows, made[0].raster.columns], "looks": run.peaks.observations, "rows": len(run.ledger.time),
        "cells_per_look": run.peaks.cells / run.peaks.observations, "seconds": observed, "seconds_unobserved": plain,
        "share": 1.0 - plain / observed,
    }  # fmt: skip


def main() -> None:
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--cells", type=float, nargs="*", default=[20.0, 10.0, 5.0])
    parser.add_argument("--finer", type=float, nargs="*", default=[1.0, 2.0, 5.0])
    parser.add_argument("--end-time", type=float, default=30.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    records: list[dict[str, Any]] = []
    head = {"card": None if a.device == "cpu" else card_name(), "commit": a.commit}
    for cell_size in a.cells:
        for finer in a.finer:
            records.append(measured(cell_size, finer, a.end_time, a.device, a.repeats))
            print(json.dumps(records[-1]), flush=True)
            if a.out:
                a.out.write_text(json.dumps(head | {"records": records}, indent=1))


if __name__ == "__main__":
    main()
