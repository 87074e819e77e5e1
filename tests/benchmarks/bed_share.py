"""Time that an erodible bed takes of a run: a mass that slides over a bed, and the same without one, in turn.

    .venv/bin/python tests/benchmarks/bed_share.py --particles 30000 300000 --json bed_share.json
    .venv/bin/python tests/benchmarks/bed_share.py --backend hash --device cuda:0 --particles 3800000 --end 4 --json bed_share.json

The share of the bed is the time of its updates (columns of the flow, rates, births, lowered ground) over that of all steps and
updates, by the processor time of this process on a CPU and by wall time on a GPU. The run without a bed is another flow: its time a
particle and substep tells what lowered ground and newborn particles cost beside the updates.
"""

import argparse
import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np

import runout
from runout.simulation.erosion import ErodingBed
from runout.simulation.run import Run

CELL = 1.0  # of the grid [m]
RASTER = 5.0  # [m]
THICK = 5.0  # of the release [m], vertical
SLOPE, FRICTION = 25.0, 14.0  # [deg]
SOIL = runout.DruckerPrager(density=1900.0, friction_angle=32.0)
BED = 1.2  # [m]
PER_CELL = (2, 2, 2)


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


def measure(watch: Watch, particles: int, end: float, bed: float, rate: float, choices: dict[str, Any]) -> dict[str, Any]:
    """Times, counters and sums of one run."""
    terrain, release = site(particles)
    watch.reset()
    below = runout.Bed(bed, runout.RammsErosion(rate=rate)) if bed else None
    result = runout.simulate(
        terrain,
        release,
        SOIL,
        basal_friction_angle=FRICTION,
        cell_size=CELL,
        end_time=end,
        bed=below,
        stop=False,
        particles_per_cell=PER_CELL,
        **choices,
    )
    whole, spent = watch.seconds["go"], watch.seconds.get("update", np.zeros(2))
    ledger = result.ledger
    entrained = float(ledger["entrained_mass"][-1]) if bed else 0.0
    released = float(ledger["mass"][0])
    return {
        "bed": bed,
        "particles": result.n_particles,
        "born": round(entrained / released * result.n_particles),
        "substeps": result.steps,
        "updates": watch.calls.get("update", 0),
        "births": watch.calls.get("_particles_at", 0),
        "wall": whole[0],
        "processor": whole[1],
        "wall_of_bed": spent[0],
        "processor_of_bed": spent[1],
        "mass_error": abs(float(ledger["mass"][-1] + ledger["escaped_mass"][-1]) - entrained - released) / released,
    }


def row_of(run: dict[str, Any], gpu: bool) -> str:
    """A line of the table."""
    clock = "wall" if gpu else "processor"
    share = 100.0 * run[f"{clock}_of_bed"] / run[clock]
    each = 1e9 * (run[clock] - run[f"{clock}_of_bed"]) / run["substeps"] / (run["particles"] + 0.5 * run["born"])
    return (
        f"{run['bed']:6g} {run['particles']:10d} {run['born']:8d} {run['substeps']:8d} {run['updates']:8d} {run['births']:7d} "
        f"{run[clock]:9.2f} {run[f'{clock}_of_bed']:9.2f} {share:7.1f} {each:9.1f} {run['mass_error']:10.1e}"
    )


HEAD = "   bed  particles     born substeps  updates  births    time s  of bed s share %     ns/ps  mass err."


def main() -> None:
    """Measure, print the table and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--particles", type=int, nargs="+", default=[30_000])
    parser.add_argument("--backend", default="scan")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--end", type=float, default=6.0, help="simulated time [s]")
    parser.add_argument("--rate", type=float, default=0.025, help="erosion rate [m/s]")
    parser.add_argument("--repeat", type=int, default=2, help="pairs of runs")
    parser.add_argument("--json", help="file for the numbers")
    given = parser.parse_args()
    choices = {"backend": given.backend, "device": given.device, "threads": given.threads}
    gpu, watch, runs = given.device.startswith("cuda"), Watch(), []
    for owner, name in ((ErodingBed, "update"), (ErodingBed, "_particles_at"), (Run, "go")):
        watch.wrap(owner, name)
    measure(watch, 2000, 1.0, BED, given.rate, choices)  # compiles
    print("times are", "wall times" if gpu else "processor times", "without setup; ns/ps: without the bed, by particle and substep")
    print(HEAD)
    for particles in given.particles:
        for bed in (BED, 0.0) * given.repeat:
            runs.append(measure(watch, particles, given.end, bed, given.rate, choices))
            print(row_of(runs[-1], gpu), flush=True)
    if given.json:
        record = {"version": runout.__version__, **choices, "end": given.end, "rate": given.rate, "runs": runs}
        Path(given.json).write_text(json.dumps(record, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
