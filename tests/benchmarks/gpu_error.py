"""Error against wall time on a device: the spreading cap (F3, three-dimensional) and the flow of jacksboro.

    python tests/benchmarks/gpu_error.py --backend hash --device cuda:0 --out gpu_error.json
    python tests/benchmarks/gpu_error.py --backend scan --device cpu --out cpu_error.json --cells 28.3 20 20:1x8 --reference 7

Every run is made twice and the second one counts, so that nothing is compiled in it. F3: relative L2 of thickness at 5 s from the
closed form, seconds of the steps. Terrain: relative L1 of the map of flow thickness from that with cells of ``--reference``,
seconds of the whole simulation with observers but without its setup. Single precision.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import warp as wp

sys.path.insert(0, str(Path(__file__).parents[2]))

from runout.simulation.result import Result
from runout.studies.verification_cases.spreading_cap import Cells
from tests.benchmarks.error_cases.choice import Variation
from tests.benchmarks.error_cases.flows import distance, flowed, runout_of
from tests.benchmarks.spreading_cap import cells_of, timed

CAPS = (
    *("4", "2", "1", "0.7", "0.5", "3:3", "2:3", "1.4:3", "1:3", "0.7:3", "2:4", "1.4:4", "1:4"),
    *("8/1:2x4", "8/0.5:2x4", "4/1:1x4", "4/1:2x4", "4/0.5:2x4", "4/0.5:2x6"),
)  # as spreading_cap.py takes them
CELLS = ("56.6", "40", "28.3", "20", "14.1", "10", "28.3:1x4", "20:1x4", "20:1x8", "14.1:1x4")


def shaped(cells: Cells) -> dict[str, Any]:
    """Sizes [m] and particles of cells, as a record names them."""
    return {"cell": cells.size, "height": cells.height, "per_axis": cells.plan, "through_depth": cells.depth}


def cap(backend: str, device: str, cells: Cells) -> dict[str, Any]:
    """A record of the spreading cap."""
    timed(backend, device, cells)
    error, particles, steps, seconds = timed(backend, device, cells)
    return {"problem": "F3", **shaped(cells), "error": error, "particles": particles, "steps": steps, "seconds": seconds}


def terrain(backend: str, device: str, cells: list[Cells], reference: Cells) -> list[dict[str, Any]]:
    """Records of the flow on real terrain, the coarsest grid first."""

    def run(one: Cells) -> tuple[Result, float, float]:
        changed = {"device": device, "flat": one.size / one.height}
        choice = Variation(device, one.plan, one.depth, arguments=changed, backend=backend)
        return [flowed(one.size, choice) for _ in range(2)][1]

    runs = {one: run(one) for one in (*cells, reference)}
    finest, records = runs.pop(reference)[0], []
    for one, (result, _, wall) in runs.items():
        work = {"particles": result.n_particles, "steps": result.steps, "seconds": wall - result.timing["setup"]}
        found = {"error": distance(result, finest), "runout": runout_of(result), **work}
        records.append({"problem": "terrain", **shaped(one), "reference": reference.size, **found})
    return records


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", default="hash")
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--caps", nargs="*", default=[cells_of(text) for text in CAPS], type=cells_of)
    parser.add_argument("--cells", nargs="*", default=[cells_of(text) for text in CELLS], type=cells_of)
    parser.add_argument("--reference", default=cells_of("5"), type=cells_of)
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--out", type=Path, required=True)
    a = parser.parse_args()
    name = wp.get_device(a.device).name if a.backend == "hash" else a.backend
    report = {"device": name, "commit": a.commit, "records": []}
    for cells in a.caps:
        report["records"].append(cap(a.backend, a.device, cells))
        print(json.dumps(report["records"][-1]), flush=True)
    report["records"] += terrain(a.backend, a.device, list(a.cells), a.reference) if a.cells else []
    for record in report["records"][len(a.caps) :]:
        print(json.dumps(record))
    a.out.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
