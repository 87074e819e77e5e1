"""Blocks at a cut that divides the synthetic site in two: what two cards would exchange in each substep.

    python -m tests.benchmarks.halo [CELL ...]

The site runs for 60 s on the CPU, by default with cells of 20, 14 and 10 m. Whenever its ledger gets a row, the blocks are counted
by their column across the path. The script prints the share of the column in which half of all blocks is reached: mean and largest
over the run.
"""

import sys
from typing import Any

import numpy as np

from runout.backends.protocol import get_backend
from runout.simulation.run import Run, RunControl
from tests.benchmarks.seed_cases import synthetic_site as site
from tests.benchmarks.seed_cases.site_runs import site_scene

CELLS, END_TIME = (20.0, 14.0, 10.0), 60.0  # [m], [s]


def shares_at_the_cut(cell: float) -> np.ndarray:
    """Share of all blocks (rows of the ledger,) that lie in the column at the middle, with cells of ``cell`` [m]."""
    engine: Any = get_backend("scan", "cpu", 1)
    scene, particles = site_scene(site.terrain(), cell)
    shares: list[float] = []

    def look(done: float = 0.0) -> None:
        blocks = engine.index.blocks
        across = blocks.bxyz[: blocks.nall, 0].astype(int)
        counts = np.bincount(across - across.min())
        middle = np.searchsorted(np.cumsum(counts), counts.sum() / 2)
        shares.append(float(counts[middle] / counts.sum()))

    run = Run(engine, scene, RunControl(END_TIME), look, None)
    run.start(particles)
    run.go()
    return np.array(shares)


if __name__ == "__main__":
    for width in [float(text) for text in sys.argv[1:]] or CELLS:
        shares_of_run = shares_at_the_cut(width)
        print(f"{width:g} m: mean {100 * shares_of_run.mean():.1f} %, largest {100 * shares_of_run.max():.1f} % of all blocks")
