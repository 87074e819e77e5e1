"""Time of a run in a valley with an erodible bed over that of the dry run without one, in turn.

    .venv/bin/python -m tests.benchmarks.bed_valley --json bed_valley.json
    .venv/bin/python -m tests.benchmarks.bed_valley --backend hash --device cuda:0

Two scenes, each with a bed of 1.2 m and cells of 5 m: the landslide of Cascades 2021 on its public DEM (a path of 0.5 km), and a
made valley of 2.2 km, a channel that falls by 20 degrees at its head and 6 at its end, with 60,000 m3 at the head. The default law
of erosion, friction 14 degrees, 150 s. Times are those of the time loop, by processor time on a CPU with one thread and by wall
time on a GPU. Medians of the ratios of the pairs follow, and their range.
"""

import argparse
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import runout
from runout.simulation.erosion import ErodingBed
from runout.simulation.run import Run
from runout.studies.validation_cases import cascades_2021
from tests.benchmarks.bed_share import Watch

BED, CELL, FRICTION, END = 1.2, 5.0, 14.0, 150.0  # [m], [m], [deg], [s]
SOIL = runout.DruckerPrager(density=1900.0, friction_angle=32.0)
RASTER, LENGTH, WIDTH = 10.0, 2200.0, 400.0  # of the made valley [m]
HEAD, FOOT = math.radians(20.0), math.radians(6.0)  # slopes of its channel
VOLUME = 60_000.0  # [m3]


def cascades() -> tuple[runout.Terrain, runout.Release]:
    """The landslide of Cascades 2021."""
    event = cascades_2021.read()
    return event.terrain, event.release


def valley() -> tuple[runout.Terrain, runout.Release]:
    """A channel that becomes flatter downwards, between flanks, and a mass at its head."""
    x, y = (np.arange(size / RASTER) * RASTER + 0.5 * RASTER for size in (LENGTH, WIDTH))
    share = x / LENGTH
    fall = np.cumsum(np.tan(HEAD + (FOOT - HEAD) * share)) * RASTER
    across = y[:, None] - 0.5 * WIDTH - 20.0 * np.sin(2.0 * math.pi * share)[None, :]
    terrain = runout.Terrain.from_array(1000.0 - fall[None, :] + across**2 / 100.0, RASTER)
    inside = (x[None, :] > 60.0) & (x[None, :] < 260.0)
    shape = np.where(inside, np.maximum(1.0 - (across / 40.0) ** 2, 0.0), 0.0)
    return terrain, runout.Release.from_array(shape * VOLUME / (shape.sum() * RASTER**2), terrain, placement="on_surface")


SCENES: dict[str, Callable[[], tuple[runout.Terrain, runout.Release]]] = {"cascades_2021": cascades, "valley": valley}


def measure(watch: Watch, scene: str, depth: float, end: float, choices: dict[str, Any]) -> dict[str, Any]:
    """Time and counters of one run with a bed of a ``depth`` [m], 0 without one."""
    terrain, release = SCENES[scene]()
    watch.reset()
    choices = choices | {"bed": runout.Bed(depth) if depth else None}
    result = runout.simulate(
        terrain, release, SOIL, basal_friction_angle=FRICTION, cell_size=CELL, end_time=end, **choices
    )  # fmt: skip
    clock = int(not choices["device"].startswith("cuda"))
    reached = np.nan_to_num(result.maps["max_flow_thickness"].values) > 0.1
    return {
        "scene": scene,
        "bed": depth,
        "particles": result.n_particles,
        "born": round(float(result.ledger["entrained_mass"][-1]) / SOIL.density) if depth else 0,  # [m3]
        "reach": float(np.ptp(np.argwhere(reached), axis=0).max() * terrain.cell_size[0]),
        "substeps": result.steps,
        "simulated": float(result.ledger["time"][-1]),
        "time": float(watch.seconds["go"][clock]),
        "share": 100.0 * float(watch.seconds.get("update", np.zeros(2))[clock] / watch.seconds["go"][clock]),
    }


def row_of(run: dict[str, Any]) -> str:
    """A line of the table."""
    counts = f"{run['particles']:9d} {run['born']:7d} {run['reach']:9.0f} {run['substeps']:8d}"
    return f"{run['scene']:>13} {run['bed']:4.1f} {counts} {run['simulated']:8.1f} {run['time']:8.3f} {run['share']:7.1f}"


def main() -> None:
    """Measure, print the table and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", default="scan")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(SCENES))
    parser.add_argument("--end", type=float, default=END, help="simulated time [s]")
    parser.add_argument("--repeat", type=int, default=3, help="pairs of each scene")
    parser.add_argument("--json", help="file for the numbers")
    options = parser.parse_args()
    choices = {"backend": options.backend, "device": options.device, "threads": options.threads}
    watch, runs = Watch(), []
    for owner, name in ((ErodingBed, "update"), (Run, "go")):
        watch.wrap(owner, name)
    for depth in (0.0, BED):
        measure(watch, options.scenes[0], depth, 5.0, choices)  # compiles
    print("        scene  bed particles born m3   reach m substeps   ends s   time s share %")
    for scene in options.scenes:
        ratios = []
        for turn in range(options.repeat):
            pair = {d: measure(watch, scene, d, options.end, choices) for d in (0.0, BED)[:: 1 - 2 * (turn % 2)]}
            runs += pair.values()
            ratios.append(pair[BED]["time"] / pair[0.0]["time"])
            for run in pair.values():
                print(row_of(run), flush=True)
        print(f"{scene}: time with a bed over that without {np.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})")
    if options.json:
        record = {"version": runout.__version__, **choices, "end": options.end, "runs": runs}
        Path(options.json).write_text(json.dumps(record, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
