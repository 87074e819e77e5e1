"""Error and time of flows on terrain by the substeps of a transfer, on uneven grids and over seeds.

    RUNOUT_DATA=DIR python -m tests.benchmarks.substeps OUT [--processes 16] [--sites NAME ...] [--substeps 1 4]
        [--backend hash --device cuda:0]

Sites are the flows of `error_cases/terrains.py`, 60 s each. Errors are the relative L1 of the map of largest thickness and of the
deposit at 60 s against the finest grid with four substeps, and the lag of its centre [m]; the difference between one and four
substeps on the finest grid is stated beside them. Times are processor times on one thread (of the host, with a GPU). Runs are kept
in OUT, so that a second call only writes the record. Writes substeps.json; copy it to tests/benchmarks/records/, then run
`python -m docs.pages`.
"""

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from runout.io.atomic import write_json
from runout.studies.convergence import relative_l1
from runout.studies.work_precision import machine, versions

CELLS = {  # [m], the finest is the reference
    "frank_slide": (56.6, 48.0, 40.0, 34.0, 28.3, 22.0, 14.0),
    "frank_slide_20": (56.6, 48.0, 40.0, 34.0, 28.3, 22.0, 14.0),
    "jacksboro": (48.0, 40.0, 34.0, 28.3, 22.0, 17.0, 10.0),
    "jacksboro_25": (48.0, 40.0, 34.0, 28.3, 22.0, 17.0, 10.0),
    "coulomb_only": (20.0, 17.0, 14.1, 12.0, 10.0, 8.2, 5.0),
}
SUBSTEPS = 1, 2, 4, 8
SEEDS = 0, 1
OF_REFERENCE = 4
MAPS = "max_flow_thickness", "deposit_thickness"
Task = tuple[str, float, int, int]
ENGINE = {"backend": "scan", "device": "cpu"}


def choose(engine: dict[str, str]) -> None:
    """Make the runs of this process with a backend and device."""
    ENGINE.update(engine)


def run(folder: Path, task: Task) -> dict[str, Any]:
    """Maps and cost of a run, from the folder if they are there."""
    import runout
    from tests.benchmarks.error_cases.terrains import site_arguments

    site, cell, substeps, seed = task
    file = folder / f"{site}_{cell:g}_{substeps}_{seed}.npz"
    if not file.is_file():
        arguments = {**site_arguments(site), **ENGINE, "cell_size": cell, "substeps": substeps, "seed": seed}
        begun, wall = time.process_time(), time.perf_counter()
        result = runout.simulate(**{**arguments, "threads": 1})
        passed = time.process_time() - begun
        ledger, setup = result.ledger, result.timing["setup"] / (time.perf_counter() - wall)
        lost = float(ledger.numerical_dissipation[-1] / (ledger.potential_energy[0] - ledger.potential_energy[-1]))
        maps = {name: np.nan_to_num(result.maps[name].values).astype(np.float32) for name in MAPS}
        cost = {"seconds": passed * (1 - setup), "particles": result.n_particles, "steps": result.steps, "numerical": lost}
        np.savez_compressed(file, **maps, **cost)
        print(f"{file.stem}: {passed:.0f} s", flush=True)
    return dict(np.load(file))


def row(task: Task, numbers: dict[str, Any], exact: dict[str, Any]) -> dict[str, Any]:
    """Errors and cost of a run."""
    from tests.benchmarks.error_cases.terrains import site_arguments

    site, cell, substeps, seed = task
    size = site_arguments(site)["terrain"].cell_size
    centres = [centre(one[MAPS[1]], size) for one in (numbers, exact)]
    return {
        "site": site, "cell": cell, "substeps": substeps, "seed": seed,
        "peak": relative_l1(numbers[MAPS[0]], exact[MAPS[0]]), "deposit": relative_l1(numbers[MAPS[1]], exact[MAPS[1]]),
        "centre": float(np.hypot(*(centres[0] - centres[1]))), "numerical": float(numbers["numerical"]),
        "seconds": float(numbers["seconds"]), "particle_steps": int(numbers["particles"]) * int(numbers["steps"]),
    }  # fmt: skip


def centre(deposit: np.ndarray, size: tuple[float, float]) -> np.ndarray:
    """Centre (2,) [m] of a deposit, from the north-west corner."""
    y, x = np.indices(deposit.shape)
    return np.array([(deposit * x).sum() * size[0], (deposit * y).sum() * size[1]]) / deposit.sum()


def main() -> None:
    """Run what is missing and write the record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--sites", nargs="+", default=list(CELLS))
    parser.add_argument("--substeps", nargs="+", type=int, default=SUBSTEPS)
    parser.add_argument("--backend", default="scan")
    parser.add_argument("--device", default="cpu")
    chosen = parser.parse_args()
    os.environ["NUMBA_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"
    chosen.out.mkdir(parents=True, exist_ok=True)
    tasks = [(s, c, k, seed) for s in chosen.sites for c in CELLS[s][:-1] for k in chosen.substeps for seed in SEEDS]
    finest = [(s, CELLS[s][-1], k, 0) for s in chosen.sites for k in (OF_REFERENCE, 1)]
    everything = sorted({*tasks, *finest}, key=lambda t: t[1] / CELLS[t[0]][-1])
    engine = {"backend": chosen.backend, "device": chosen.device}
    with ProcessPoolExecutor(chosen.processes, get_context("spawn"), choose, (engine,)) as pool:
        outcomes = dict(zip(everything, pool.map(run, [chosen.out] * len(everything), everything), strict=True))
    rows = [row(t, outcomes[t], outcomes[t[0], CELLS[t[0]][-1], OF_REFERENCE, 0]) for t in everything if t not in finest[::2]]
    rows.sort(key=lambda r: (r["site"], -r["cell"], r["substeps"], r["seed"]))
    record = {"versions": versions(), "machine": machine(), "engine": engine, "runs": rows}
    print(write_json(record, chosen.out / "substeps.json"))


if __name__ == "__main__":
    main()
