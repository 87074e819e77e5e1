"""Error against wall time on a device: flows on real terrain by cell size.

    RUNOUT_DATA=DIR python tests/benchmarks/gpu_error.py --device cuda:0 --out gpu_error.json [--sites SITE]

Every run is made twice and the second one counts, so that nothing is compiled in it. Relative L1 of the map of largest thickness
from that of the finest grid, seconds of the whole simulation with observers but without its setup. Single precision.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import warp as wp

sys.path.insert(0, str(Path(__file__).parents[2]))

from runout.simulation.result import Result
from tests.benchmarks.error_cases.choice import Variation
from tests.benchmarks.error_cases.flows import distance, flowed, runout_of

CELLS = {  # [m], of the grids and of the reference
    "jacksboro": ((56.6, 40.0, 28.3, 22.0, 17.0, 14.1), 7.0),
    "frank_slide": ((56.6, 40.0, 28.3, 22.0, 17.0, 14.1), 7.0),
    "coulomb_only": ((20.0, 14.1, 10.0, 8.2, 7.0), 3.5),
}


def errors(site: str, backend: str, device: str) -> list[dict[str, Any]]:
    """Records of a flow, the coarsest grid first."""

    def run(cell: float) -> tuple[Result, float, float]:
        choice = Variation(device, arguments={"device": device}, backend=backend)
        return [flowed(cell, choice, site) for _ in range(2)][1]

    cells, finest = CELLS[site]
    exact, records = run(finest)[0], []
    for cell in cells:
        result, _, wall = run(cell)
        work = {"particles": result.n_particles, "steps": result.steps, "seconds": wall - result.timing["setup"]}
        row = {"error": distance(result, exact), "runout": runout_of(result, site), **work}
        records.append({"problem": site, "cell": cell, "reference": finest, **row})
        print(json.dumps(records[-1]), flush=True)
    return records


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", default="hash")
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--sites", nargs="*", default=list(CELLS))
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--out", type=Path, required=True)
    a = parser.parse_args()
    name = wp.get_device(a.device).name if a.backend == "hash" else a.backend
    records = [record for site in a.sites for record in errors(site, a.backend, a.device)]
    a.out.write_text(json.dumps({"device": name, "warp": wp.__version__, "commit": a.commit, "records": records}, indent=1))


if __name__ == "__main__":
    main()
