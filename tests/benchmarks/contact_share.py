"""Share of a step that contact with the ground takes in moving layers of some depths, on the backend scan with one thread.

    python tests/benchmarks/contact_share.py                  # layers of 4 and 8 cells, 100,000 particles
    python tests/benchmarks/contact_share.py 2 3 16 --steps 120 --upwards 4

Every kernel is timed by processor time in every step. Contact is what its own kernels take, and what those that serve the ground as
well take more than their counterparts of a scene without one, which are called on the same state before each step. The depths
take turns. Prints medians [ns] a particle and step: only ratios within a run mean something.
"""

import argparse
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from runout.backends.scan import grid
from runout.studies.sloping_layer import Layer
from runout.studies.timing import Case, TimedRun

UNTIMED_STEPS = 20
WITH_GROUND = {"finding": ("particles_to_nodes_over_ground", "particles_to_nodes")}  # and its counterpart without a ground
OWN = {"impulses": "solve_contacts"}


class Timed:
    """A layer in motion whose kernels note how long each call took."""

    def __init__(self, depth: int, particles: int, upwards: int):
        self.depth, self.timed = depth, TimedRun(Case(Layer(particles, depth=depth, upwards=upwards)))
        self.timed.advance(UNTIMED_STEPS)
        self.seconds: dict[str, list[float]] = defaultdict(list)
        engine = self.timed.engine
        engine.k = SimpleNamespace(**{name: self._noting(name, kernel) for name, kernel in vars(engine.k).items()})

    def _noting(self, name: str, kernel: Any) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            started = time.process_time()
            result = kernel(*arguments)
            self.seconds[name].append(time.process_time() - started)
            return result

        return timed

    def step(self) -> None:
        """A step, after the kernels that a scene without ground would call."""
        e = self.timed.engine
        grid.fill(e.k, e.store, e.index.blocks, e.workspace, e.tables)
        started = time.process_time()
        self.timed.advance(1)
        self.seconds["step"].append(time.process_time() - started)

    def row(self) -> dict[str, float]:
        """Medians [ns] a particle of a step, of the parts of contact, and the share of their sum."""
        ns = {name: 1e9 * float(np.median(seconds)) / self.timed.n for name, seconds in self.seconds.items()}
        parts = {part: ns[kernel] - ns[plain] for part, (kernel, plain) in WITH_GROUND.items()}
        parts |= {part: ns[kernel] for part, kernel in OWN.items()}
        return {"step": ns["step"], **parts, "share": sum(parts.values()) / ns["step"]}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("depths", nargs="*", type=int, default=[4, 8], help="cells through the layer")
    parser.add_argument("--particles", type=int, default=100_000)
    parser.add_argument("--steps", type=int, default=80)
    parser.add_argument("--upwards", type=int, default=2, help="particles of a cell above each other; two lie beside each other")
    chosen = parser.parse_args()
    layers = [Timed(depth, chosen.particles, chosen.upwards) for depth in chosen.depths]
    for turn in range(chosen.steps):
        for layer in layers[:: 1 if turn % 2 else -1]:
            layer.step()
    rows = {layer.depth: layer.row() for layer in layers}
    print("cells ", *(f"{name:>9}" for name in next(iter(rows.values()))))
    for depth, row in rows.items():
        print(f"{depth:<6}", *(f"{value:9.3f}" if name == "share" else f"{value:9.2f}" for name, value in row.items()))


if __name__ == "__main__":
    main()
