"""Whole runs of the example site through ``runout.simulate`` on a GPU, and its maps against those of the CPU.

    python tests/benchmarks/gpu_whole_runs.py --device cuda:0 --out whole.json [--cells 20 10 5]

A compute node without raster libraries takes terrain and release from a file that ``--write-inputs`` made elsewhere (``--inputs``).
At the first, coarsest cell size the same scene runs with the backend scan too. Both are float32, so that they part after a while;
maps are compared by the mean difference over the mean of the CPU's (relative L1). Prints a line a run; the JSON holds the records.
"""

import argparse
import json
import pickle
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

import runout
from runout.simulation.result import Result
from tests.benchmarks.seed_cases.memory_peak import card_name

SITE = Path(__file__).parents[2] / "sites" / "jacksboro"
MAPS = ("max_flow_thickness", "max_speed", "max_pressure", "deposit_thickness")


def site_inputs() -> dict[str, Any]:
    """Keywords of :func:`runout.simulate` for the site."""
    from runout.config.site import read_site

    return read_site(SITE).member_arguments({})


def difference(a: np.ndarray, b: np.ndarray) -> float:
    """Relative L1 difference of a map from another."""
    return float(np.nansum(np.abs(a - b)) / np.nansum(np.abs(b)))


def one_run(inputs: dict[str, Any], cell_size: float, end_time: float, **choices: Any) -> tuple[dict[str, Any], Result]:
    """A record and the result of a run."""
    started = time.perf_counter()
    result = runout.simulate(**{**inputs, "cell_size": cell_size, "end_time": end_time, "seed": 0, **choices})
    taken = time.perf_counter() - started
    mass = np.asarray(result.series["mass"]) + np.asarray(result.series["escaped_mass"])
    record = {
        "cell_size": cell_size, **choices, "seconds": taken, "stages": dict(result.timing), "particles": result.n_particles,
        "steps": result.steps, "observations": len(mass), "stop_reason": result.stop_reason,
        "mass_error": float(np.abs(mass / mass[0] - 1).max()),
        "particle_steps_per_second": result.n_particles * result.steps / taken,
    }  # fmt: skip
    return record, result


def main() -> None:
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--cells", type=float, nargs="*", default=[20.0, 10.0, 5.0], help="cell sizes [m], the coarsest first")
    parser.add_argument("--end-time", type=float, default=60.0)
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--write-inputs", type=Path)
    parser.add_argument("--inputs", type=Path)
    a = parser.parse_args()
    inputs = pickle.loads(a.inputs.read_bytes()) if a.inputs else site_inputs()
    if a.write_inputs:
        a.write_inputs.write_bytes(pickle.dumps(inputs))
        return
    card = card_name() if a.device != "cpu" else None
    report: dict[str, Any] = {"site": SITE.name, "device": a.device, "card": card, "commit": a.commit, "records": []}
    one_run(inputs, a.cells[0], 2.0, backend="hash", device=a.device)  # compiles
    for cell_size in a.cells:
        record, result = one_run(inputs, cell_size, a.end_time, backend="hash", device=a.device)
        if cell_size == a.cells[0]:
            cpu, expected = one_run(inputs, cell_size, a.end_time, backend="scan", device="cpu")
            record["against_cpu"] = {name: difference(result.fields[name], expected.fields[name]) for name in MAPS}
            report["records"].append(cpu)
        report["records"].append(record)
        print(json.dumps(record), flush=True)
        if a.out:
            a.out.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
