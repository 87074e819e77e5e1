"""Error against wall time on a device: the spreading cap (F3, three-dimensional) and the flow of jacksboro.

    python tests/benchmarks/gpu_error.py --backend hash --device cuda:0 --out gpu_error.json
    python tests/benchmarks/gpu_error.py --backend scan --device cpu --out cpu_error.json --cells 56.6 40 28.3 20 14.1

Every run is made twice and the second one counts, so that nothing is compiled in it. F3: relative L2 of thickness at 5 s from the
closed form, seconds of the steps. Terrain: relative L1 of the map of flow thickness from that with cells of ``--reference`` [m],
seconds of the whole simulation with observers but without its setup. Single precision.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import warp as wp

sys.path.insert(0, str(Path(__file__).parents[2]))

from pipelines.error_cases.choice import Variation
from pipelines.error_cases.flows import distance, flowed
from tests.benchmarks.spreading_cap import timed

CAPS = (
    (4.0, 2),
    (2.0, 2),
    (1.0, 2),
    (0.7, 2),
    (0.5, 2),
    (3.0, 3),
    (2.0, 3),
    (1.4, 3),
    (1.0, 3),
    (0.7, 3),
    (2.0, 4),
    (1.4, 4),
    (1.0, 4),
)
CELLS = (56.6, 40.0, 28.3, 20.0, 14.1, 10.0)


def cap(backend: str, device: str, spacing: float, per_axis: int) -> dict[str, Any]:
    """A record of the spreading cap."""
    timed(backend, device, spacing, per_axis)
    error, particles, steps, seconds = timed(backend, device, spacing, per_axis)
    found = {"cell": spacing, "per_axis": per_axis, "error": error, "particles": particles, "steps": steps, "seconds": seconds}
    return {"problem": "F3", **found}


def terrain(backend: str, device: str, cells: list[float], reference: float) -> list[dict[str, Any]]:
    """Records of the flow on real terrain, the coarsest grid first."""
    choice = Variation(device, arguments={"device": device}, backend=backend)
    runs = {cell: [flowed(cell, choice) for _ in range(2)][1] for cell in (*cells, reference)}
    finest, records = runs.pop(reference)[0], []
    for cell, (result, _, wall) in runs.items():
        seconds = wall - result.timing["setup"]
        work = {"particles": result.n_particles, "steps": result.steps, "seconds": seconds}
        records.append({"problem": "terrain", "cell": cell, "reference": reference, "error": distance(result, finest), **work})
    return records


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", default="hash")
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--caps", nargs="*", default=CAPS, type=lambda text: (float(text.split(":")[0]), int(text.split(":")[1])))
    parser.add_argument("--cells", nargs="*", default=CELLS, type=float)
    parser.add_argument("--reference", type=float, default=5.0)
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--out", type=Path, required=True)
    a = parser.parse_args()
    name = wp.get_device(a.device).name if a.backend == "hash" else a.backend
    report = {"device": name, "commit": a.commit, "records": []}
    for spacing, per_axis in a.caps:
        report["records"].append(cap(a.backend, a.device, spacing, per_axis))
        print(json.dumps(report["records"][-1]), flush=True)
    report["records"] += terrain(a.backend, a.device, list(a.cells), a.reference) if a.cells else []
    for record in report["records"][len(a.caps) :]:
        print(json.dumps(record))
    a.out.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
