"""Time that an erodible bed and pore pressure take of a run: a mass that slides over a bed, wet, both or neither, in turn.

    .venv/bin/python tests/benchmarks/bed_share.py --particles 30000 --json bed_share.json
    .venv/bin/python tests/benchmarks/bed_share.py --cases "dry, bare" "wet, bare" --repeat 12
    .venv/bin/python tests/benchmarks/bed_share.py --backend hash --device cuda:0 --particles 1000000 --end 2 --repeat 1

The share of the bed is the time of its updates (columns of the flow, rates, births, lowered ground) over that of the run, by
processor time on a CPU and by wall time on a GPU. A run with a bed is another flow, so that runs are compared by
their time a particle and substep: its ratio to that of the dry run without a bed counts also what lowered ground and newborn
particles cost beside the updates. The pore pressure is so small that it changes no flow. The last columns are milliseconds a
call of the parts of an update. Medians of the repeats follow, with least and largest.
"""

import argparse
import json
import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import runout
from runout.backends.hash.backend import HashBackend
from runout.backends.scan.backend import ScanBackend
from runout.simulation.erosion import ErodingBed
from runout.simulation.run import Run

CELL = 1.0  # of the grid [m]
RASTER = 5.0  # [m]
THICK = 5.0  # of the release [m], vertical
SLOPE, FRICTION = 25.0, 14.0  # [deg]
SOIL = runout.DruckerPrager(density=1900.0, friction_angle=32.0)
BED = 1.2  # [m]
PER_CELL = (2, 2, 2)
BARE = "dry, bare"
CASES = {BARE: (0.0, False), "wet, bare": (0.0, True), "dry, bed": (BED, False), "wet, bed": (BED, True)}  # depth, pore pressure
DAMP = runout.PorePressure(ratio=1e-9, saturation=0.0, diffusivity=1e-3)
PARTS = "node_columns", "lower", "add"


class Watch:
    """Times of the parts of a run, which methods that it wraps report.

    Attributes
    ----------
    seconds : dict
        Wall and processor time [s] by the name of a method.
    calls : dict
    """

    def __init__(self) -> None:
        self.seconds: dict[str, np.ndarray] = {}
        self.calls: dict[str, int] = {}

    def wrap(self, owner: type, name: str) -> None:
        """Note the time that a method takes."""
        method = getattr(owner, name)

        def timed(*arguments: Any, **more: Any) -> Any:
            before = np.array([time.perf_counter(), time.process_time()])
            result = method(*arguments, **more)
            spent = np.array([time.perf_counter(), time.process_time()]) - before
            self.seconds[name] = self.seconds.get(name, np.zeros(2)) + spent
            self.calls[name] = self.calls.get(name, 0) + 1
            return result

        setattr(owner, name, timed)

    def reset(self) -> None:
        self.seconds.clear(), self.calls.clear()


def site(particles: int) -> tuple[runout.Terrain, runout.Release]:
    """A slope, and a release at its top, twice as long as wide, of about so many particles."""
    width = math.sqrt(particles * CELL**3 / math.prod(PER_CELL) / THICK / 2.0)
    across, along = (max(2, round(size / RASTER)) for size in (width, 2.0 * width))
    rows, columns = across + 40, along + 120
    x = (np.arange(columns) + 0.5) * RASTER
    elevation = np.repeat((x[-1] - x)[None, :] * math.tan(math.radians(SLOPE)), rows, axis=0)
    terrain = runout.Terrain.from_array(elevation, RASTER)
    thickness = np.zeros(elevation.shape)
    thickness[20 : 20 + across, 6 : 6 + along] = THICK
    return terrain, runout.Release.from_array(thickness, terrain, placement="on_surface")


def measure(watch: Watch, particles: int, end: float, case: str, rate: float, choices: dict[str, Any]) -> dict[str, Any]:
    """Times, counters and sums of one run."""
    terrain, release = site(particles)
    depth, wet = CASES[case]
    release = replace(release, pore_pressure=DAMP) if wet else release
    watch.reset()
    result = runout.simulate(
        terrain, release, SOIL, basal_friction_angle=FRICTION, cell_size=CELL, particles_per_cell=PER_CELL, end_time=end,
        stop=False, bed=runout.Bed(depth, runout.RammsErosion(rate=rate)) if depth else None, **choices,
    )  # fmt: skip
    clock, ledger = int(not choices["device"].startswith("cuda")), result.ledger
    entrained = float(ledger["entrained_mass"][-1]) if depth else 0.0
    released, whole = float(ledger["mass"][0]), watch.seconds["go"][clock]
    born = round(entrained / released * result.n_particles)
    return {
        "case": case,
        "particles": result.n_particles,
        "born": born,
        "substeps": result.steps,
        "updates": watch.calls.get("update", 0),
        "births": watch.calls.get("add", 0),
        "time": whole,
        "share": 100.0 * watch.seconds.get("update", np.zeros(2))[clock] / whole,
        "each": 1e9 * whole / result.steps / (result.n_particles + 0.5 * born),
        "mass_error": abs(float(ledger["mass"][-1] + ledger["escaped_mass"][-1]) - entrained - released) / released,
        "ms": {part: 1e3 * watch.seconds.get(part, np.zeros(2))[clock] / max(watch.calls.get(part, 0), 1) for part in PARTS},
    }


def row_of(run: dict[str, Any], bare: float) -> str:
    """A line of the table; ``bare`` is the time of a run of the first case by particle and substep [ns]."""
    return (
        f"{run['case']:>12} {run['particles']:10d} {run['born']:8d} {run['substeps']:8d} {run['updates']:8d} {run['births']:7d} "
        f"{run['time']:9.2f} {run['share']:8.2f} {run['each']:9.3f} {run['each'] / bare:7.4f} {run['mass_error']:10.1e} "
        + " ".join(f"{run['ms'][part]:12.2f}" for part in PARTS)
    )


HEAD = "        case  particles     born substeps  updates  births    time s  share %     ns/ps   ratio  mass err."


def compare(watch: Watch, particles: int, options: argparse.Namespace, choices: dict[str, Any]) -> list[dict[str, Any]]:
    """Runs of all cases in turn; their table is printed, with medians over the repeats."""
    runs: list[dict[str, Any]] = []
    for turn in range(options.repeat):
        for case in options.cases[:: 1 - 2 * (turn % 2)]:
            runs.append(measure(watch, particles, options.end, case, options.rate, choices))
    many = len(options.cases)
    groups = [{run["case"]: run for run in runs[first : first + many]} for first in range(0, len(runs), many)]
    for group in groups:
        for case in options.cases:
            print(row_of(group[case], group[options.cases[0]]["each"]), flush=True)
    for case in options.cases:
        ratios = [group[case]["each"] / group[options.cases[0]]["each"] for group in groups]
        spread = f"{np.median(ratios):.4f} ({min(ratios):.4f} to {max(ratios):.4f})"
        print(f"median of {case}: ratio {spread}, share of the bed {np.median([group[case]['share'] for group in groups]):.2f} %")
    return runs


def main() -> None:
    """Measure, print the table and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--particles", type=int, nargs="+", default=[30_000])
    parser.add_argument("--backend", default="scan")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--end", type=float, default=6.0, help="simulated time [s]")
    parser.add_argument("--rate", type=float, default=0.025, help="erosion rate [m/s]")
    parser.add_argument("--repeat", type=int, default=2, help="runs of each case")
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES), help="ratios are to the first")
    parser.add_argument("--json", help="file for the numbers")
    options = parser.parse_args()
    choices = {"backend": options.backend, "device": options.device, "threads": options.threads}
    watch, runs = Watch(), []
    own = {"scan": ScanBackend, "hash": HashBackend}[options.backend]
    for owner, name in ((ErodingBed, "update"), (Run, "go"), *((own, part) for part in PARTS)):
        watch.wrap(owner, name)
    for case in options.cases:
        measure(watch, 2000, 1.0, case, options.rate, choices)  # compiles
    print("wall times" if options.device.startswith("cuda") else "processor times", "without setup; ns/ps: by particle and substep")
    print(HEAD, " ".join(f"{part:>12}" for part in PARTS))
    for particles in options.particles:
        runs += compare(watch, particles, options, choices)
    if options.json:
        record = {"version": runout.__version__, **choices, "end": options.end, "rate": options.rate, "runs": runs}
        Path(options.json).write_text(json.dumps(record, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
