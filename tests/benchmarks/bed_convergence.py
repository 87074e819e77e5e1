"""How results with an erodible bed depend on births, updates and cells, in the scenes of ``bed_valley.py``.

    RUNOUT_DATA=DATA python tests/benchmarks/bed_convergence.py                   # births and updates, three seeds
    python tests/benchmarks/bed_convergence.py --scenes valley --cells 5 3.5 2.5 --end 40

Prints differences from births five times as often, or from the smallest cells: of the mass taken up, with its range over the seeds,
and of maps (relative L1); in brackets those of two seeds.
"""

import argparse
import sys
from itertools import combinations
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

import runout
from runout.simulation import erosion
from tests.benchmarks import bed_valley

MAPS = "max_flow_thickness", "deposit_thickness", "eroded_depth"
OFTEN = 0.05, 2.0  # particles that a pool may owe, cells between two updates
CHOICES = (0.4, 2.0), (0.25, 2.0), (0.25, 0.5), (0.1, 2.0)
Outcome = tuple[float, dict[str, np.ndarray]]


def run(scene: str, cell: float, end: float, seed: int) -> Outcome:
    """Volume [m3] that is taken up, and maps."""
    terrain, release = bed_valley.SCENES[scene]()
    result = runout.simulate(
        terrain, release, bed_valley.SOIL, basal_friction_angle=bed_valley.FRICTION, cell_size=cell, end_time=end, threads=1,
        seed=seed, bed=runout.Bed(bed_valley.BED),
    )  # fmt: skip
    volume = float(result.ledger["entrained_mass"][-1]) / bed_valley.SOIL.density
    return volume, {name: np.nan_to_num(result.maps[name].values) for name in MAPS}


def differences(pairs: list[tuple[Outcome, Outcome]]) -> str:
    """Mean differences [%] of maps over pairs."""
    each = {name: [100.0 * np.abs(a[name] - b[name]).sum() / b[name].sum() for (_, a), (_, b) in pairs] for name in MAPS}
    return ", ".join(f"{name} {np.mean(values):.1f} %" for name, values in each.items())


def by_births(scene: str, end: float, seeds: int) -> None:
    """Compare choices of births and updates with births five times as often."""

    def runs(late: float, travel: float) -> list[Outcome]:
        erosion.LATE, erosion.TRAVEL = late, travel
        return [run(scene, bed_valley.CELL, end, seed) for seed in range(seeds)]

    often = runs(*OFTEN)
    for choice in CHOICES:
        by_seed = runs(*choice)
        pairs = list(zip(by_seed, often, strict=True))
        mass = [100.0 * (a / b - 1.0) for (a, _), (b, _) in pairs]
        mass_range = f"{np.mean(mass):+.1f} % ({min(mass):+.1f} to {max(mass):+.1f})"
        of_seeds = differences(list(combinations(by_seed, 2)))
        print(f"{scene} {choice}: mass {mass_range}, {differences(pairs)} ({of_seeds})", flush=True)


def by_cells(scene: str, end: float, cells: list[float]) -> None:
    """Compare cells [m] with the smallest ones."""
    by_cell = {cell: run(scene, cell, end, 0) for cell in sorted(cells)}
    finest = by_cell[min(cells)]
    for cell, one in by_cell.items():
        mass = f"{one[0]:.0f} m3 ({100.0 * (one[0] / finest[0] - 1.0):+.1f} %)"
        print(f"{scene} cells of {cell:g} m: {mass}, {differences([(one, finest)])}", flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--scenes", nargs="+", default=list(bed_valley.SCENES), choices=list(bed_valley.SCENES))
    parser.add_argument("--end", type=float, default=400.0, help="longest simulated time [s]")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--cells", type=float, nargs="+", help="compare these cells [m] in place of births")
    chosen = parser.parse_args()
    for scene in chosen.scenes:
        if chosen.cells:
            by_cells(scene, chosen.end, chosen.cells)
        else:
            by_births(scene, chosen.end, chosen.seeds)


if __name__ == "__main__":
    main()
