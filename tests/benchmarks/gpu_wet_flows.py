"""Wet flows with and without an erodible bed on a GPU, and their maps, volumes and ledger against those of the CPU.

    RUNOUT_DATA=DATA python tests/benchmarks/gpu_wet_flows.py --device cuda:0 --out gpu_wet_flows.json

Three scenes: a mass on a slope of 25 degrees, whose pressure drains through its thickness, over a wet bed of law `energy`; the
landslide of Cascades 2021 with that drainage and the default law; a debris flow of the upper Maipo, whose pressure decays in a
time, with Voellmy friction and the law `growth`. Each runs once on the backend scan and twice on the device, for a tenth of its
time and for all of it. The sums of a GPU have no fixed order, so that its second run shows what rounding alone changes. Maps are
compared by the mean difference over the mean (relative L1), energies and eroded mass by the largest difference of a row of the
ledger over the largest number.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

import runout
from runout.io.polygons import read_frame
from runout.scores import Grid
from runout.scores.grid import outline_shares
from runout.simulation.result import Result
from runout.studies.validation_cases import cascades_2021, maipo
from runout.studies.validation_cases.case import data_folder
from tests.benchmarks.bed_share import FRICTION, SOIL, site
from tests.benchmarks.gpu_whole_runs import difference
from tests.benchmarks.seed_cases.memory_peak import card_name

MAPS = "max_flow_thickness", "max_speed", "deposit_thickness", "eroded_depth"
DRAINS = runout.PorePressure(ratio=0.4, saturation=0.5, diffusivity=0.01)
DECAYS = runout.PorePressure(ratio=0.4, decay_time=60.0)
VOELLMY = runout.Voellmy(mu=0.2, xi=800.0)
ENERGY = runout.Bed(1.2, runout.EnergyErosion(specific_energy=1000.0), pore_pressure_ratio=0.5)
USUAL = runout.Bed(1.2, pore_pressure_ratio=0.5)
GROWTH = runout.Bed(1.0, runout.GrowthErosion(growth_rate=2e-3))
PARTICLES, VOLUME = 30_000, 1.0e4  # of the slope; of the debris flow [m3]


def on_slope() -> tuple[dict[str, Any], runout.Bed]:
    """A mass on a slope."""
    terrain, release = site(PARTICLES)
    release = replace(release, pore_pressure=DRAINS)
    return {"terrain": terrain, "release": release, "cell_size": 1.0, "end_time": 6.0, "basal_friction_angle": FRICTION}, ENERGY


def of_cascades() -> tuple[dict[str, Any], runout.Bed]:
    """The landslide of Cascades 2021."""
    event = cascades_2021.read()
    choices = {"cell_size": 5.0, "end_time": cascades_2021.END, "basal_friction_angle": FRICTION}
    return {"terrain": event.terrain, "release": event.wet_release(DRAINS), **choices}, USUAL


def of_maipo() -> tuple[dict[str, Any], runout.Bed]:
    """The last of the mapped debris flows of the Maipo."""
    folder = data_folder("maipo_debrisflow_runoptGPP", maipo.SOURCE)
    terrain = runout.Terrain.from_raster(folder / "elev_12_5m.tif")
    sources = read_frame(folder / "dflow_source_pnt.shp", None, "source")[0].geometry
    disc = sources.iloc[-1].buffer(math.sqrt(VOLUME / maipo.THICKNESS / math.pi))
    share = outline_shares(disc, Grid.of(terrain))
    thickness = VOLUME * share / (share.sum() * terrain.cell_area)
    release = runout.Release.from_array(thickness, terrain, "on_surface", pore_pressure=DECAYS)
    choices = {"cell_size": maipo.COARSE_CELL_SIZE, "end_time": maipo.END, "basal_friction": VOELLMY}
    return {"terrain": terrain, "release": release, **choices}, GROWTH


SCENES: dict[str, Callable[[], tuple[dict[str, Any], runout.Bed]]] = {
    "slope": on_slope, "cascades_2021": of_cascades, "maipo": of_maipo,
}  # fmt: skip


def sums_of(result: Result, cell: float, bed: bool) -> dict[str, float]:
    """Volumes [m3], and the largest error of the mass over that at the start, of which nothing is lost."""
    ledger = {name: np.asarray(values) for name, values in result.series.items()}
    entrained = ledger["entrained_mass"] if bed else np.zeros(1)
    lost = ledger["mass"] + ledger["escaped_mass"] - entrained - ledger["mass"][0]
    eroded = float(np.nansum(result.fields["eroded_depth"]) * cell) if bed else 0.0
    return {
        "deposit": float(np.nansum(result.fields["deposit_thickness"]) * cell),
        "eroded": eroded,
        "entrained": float(entrained[-1] / SOIL.density),
        "mass_error": float(np.abs(lost).max() / ledger["mass"][0]),
    }


def compared(runs: dict[str, Result], first: str, second: str) -> dict[str, float]:
    """Relative differences of maps and volumes of a second run from a first."""
    a, b = runs[first], runs[second]
    differences = {name: difference(b.fields[name], a.fields[name]) for name in MAPS if np.nansum(a.fields.get(name, 0.0))}
    for name in ("kinetic_energy", "basal_dissipation", "entrained_mass"):
        if name in a.series:
            x, y = (np.asarray(one.series[name]) for one in (a, b))
            rows = min(len(x), len(y))
            differences[name] = float(np.abs(y[:rows] - x[:rows]).max() / max(np.abs(x).max(), np.finfo(float).tiny))
    return differences


def measure(scene: str, with_bed: bool, precision: str, device: str, share: float) -> dict[str, Any]:
    """Runs of a scene on both backends, and their differences; ``share`` of its whole time."""
    arguments, bed = SCENES[scene]()
    arguments["end_time"] *= share
    cell, runs, seconds = arguments["terrain"].cell_area, dict[str, Result](), dict[str, float]()
    for name, engine in (("cpu", "scan"), ("first", "hash"), ("second", "hash")):
        started = time.perf_counter()
        where = {"backend": engine, "device": device if engine == "hash" else "cpu"}
        runs[name] = runout.simulate(
            material=SOIL, bed=bed if with_bed else None, precision=precision, **arguments, **where
        )  # fmt: skip
        seconds[name] = time.perf_counter() - started
    return {
        "scene": scene,
        "bed": with_bed,
        "precision": precision,
        "share": share,
        "end_time": arguments["end_time"],
        "particles": runs["cpu"].n_particles,
        "steps": [run.steps for run in runs.values()],
        "stop": [run.stop_reason for run in runs.values()],
        "sums": {name: sums_of(run, cell, with_bed) for name, run in runs.items()},
        "against_cpu": compared(runs, "cpu", "first"),
        "against_itself": compared(runs, "first", "second"),
        "seconds": seconds,
    }


def main() -> None:
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(SCENES))
    parser.add_argument("--precision", nargs="+", default=["float32", "float64"])
    parser.add_argument("--shares", type=float, nargs="+", default=[0.1, 1.0], help="of the whole time of each scene")
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    card = card_name() if a.device != "cpu" else None
    report: dict[str, Any] = {"device": a.device, "card": card, "commit": a.commit, "records": []}
    for precision, scene, with_bed, share in product(a.precision, a.scenes, (False, True), a.shares):
        report["records"].append(measure(scene, with_bed, precision, a.device, share))
        print(json.dumps(report["records"][-1]), flush=True)
        if a.out:
            a.out.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
