"""Time that pore pressure takes of a step on the backend scan with one thread, by kernel and by how a mass drains.

    python tests/benchmarks/pore_share.py                       # all cases, transfers of 4 substeps and of 1
    python tests/benchmarks/pore_share.py diffusivity births --particles 100000 --steps 200 --substeps 4

The same layer in motion is dry, or wet with a pressure so small that it moves alike. Cases and their dry counterparts take turns;
every kernel is timed by processor time in every step, and the kernels of a step are added up. Prints the least and the median time
[ns] a particle and substep of the dry layer, and what a wet one takes more: by the least times, and by the median of the
differences of steps that follow each other.
"""

import argparse
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from runout.backends.scan.backend import ScanBackend
from runout.model.particles import Particles
from runout.model.pore_pressure import PorePressure
from runout.model.scene import Scene
from runout.studies.sloping_layer import SAND, Layer
from runout.studies.timing import STEP_SHARE

UNTIMED_STEPS = 10
SMALL = 1e-9  # excess of the ratio
DECAYS, OTHER = (PorePressure(ratio=SMALL, decay_time=seconds) for seconds in (5.0, 8.0))
DRAINS = PorePressure(ratio=SMALL, diffusivity=1e-3)
CASES: dict[str, tuple[PorePressure, ...]] = {
    "decay": (DECAYS,), "ratios": (DECAYS,), "two": (DECAYS, OTHER), "diffusivity": (DRAINS,), "births": (DRAINS,),
}  # fmt: skip
SHOWN = (
    "grid_to_particles", "substep", "solve_contacts", "particles_to_nodes_over_ground", "thin_layers", "others", "step",
)  # fmt: skip
ROUNDS = 6  # of runs that load anew: where arrays lie in memory counts too


def scene_of(case: str, wet: bool, particles: int, substeps: int) -> tuple[Scene, Particles]:
    """The layer; of ``two`` releases the halves belong to one each, of ``births`` a tenth of the particles joined late."""
    scene, p = Layer(particles, depth=4).build()
    pores = CASES[case]
    several = len(pores) > 1
    scene = replace(
        scene, substeps=substeps, materials=(SAND, replace(SAND, density=SAND.density)) if several else scene.materials,
        friction=scene.friction * len(pores), pore_pressure=pores if wet else (),
    )  # fmt: skip
    rng = np.random.default_rng(1)
    if several:
        p.release[len(p) // 2 :] = 1
    if wet:
        p.pore_excess[:], p.pore_left[:] = SMALL, 1.0
        if case in ("births", "ratios"):
            p.pore_excess[:] *= rng.choice([0.5, 1.0], len(p))
        if case == "births":
            p.pore_left[:] = rng.choice([0.7, 1.0], len(p))
    return scene, p


class Timed:
    """A layer in motion whose kernels note how long the calls of each step took."""

    def __init__(self, case: str, wet: bool, particles: int, substeps: int):
        scene, p = scene_of(case, wet, particles, substeps)
        self.n, self.substeps = len(p), substeps
        self.engine = ScanBackend(1)
        self.engine.load(scene, p)
        self.dt = STEP_SHARE * self.engine.stable_step()
        self.seconds: dict[str, list[float]] = defaultdict(list)
        k = self.engine.k
        self.engine.k = SimpleNamespace(**{name: self._noting(name, kernel) for name, kernel in vars(k).items()})
        for _ in range(UNTIMED_STEPS):
            self.step()
        self.seconds.clear()

    def _noting(self, name: str, kernel: Any) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            started = time.process_time()
            result = kernel(*arguments)
            self.now[name] = self.now.get(name, 0.0) + time.process_time() - started
            return result

        return timed

    def step(self) -> None:
        self.now: dict[str, float] = {}
        started = time.process_time()
        self.engine.step(self.dt, self.substeps)
        whole = time.process_time() - started
        self.now |= {"others": sum(spent for name, spent in self.now.items() if name not in SHOWN), "step": whole}
        for name in SHOWN:
            self.seconds[name].append(1e9 * self.now.get(name, 0.0) / self.n / self.substeps)


def compare(cases: list[str], particles: int, steps: int, substeps: int) -> None:
    """Measure and print one table."""
    times_of: dict[str, list[dict[str, list[float]]]] = {case: [defaultdict(list), defaultdict(list)] for case in cases}
    for _ in range(ROUNDS):
        runs = {case: [Timed(case, wet, particles, substeps) for wet in (False, True)] for case in cases}
        for turn in range(steps // ROUNDS):
            for case in cases[:: 1 - 2 * (turn % 2)]:
                for run in runs[case][:: 1 - 2 * (turn // 2 % 2)]:
                    run.step()
        for case in cases:
            for run, times in zip(runs[case], times_of[case], strict=True):
                for name in SHOWN:
                    times[name] += run.seconds[name]
    print(f"transfers of {substeps}; {runs[cases[0]][0].n} particles; ns a particle and substep")
    print(f"{'case':>12} {'':>14}", *(f"{name:>30}" for name in SHOWN), f"{'% of a step':>30}")
    for case, (dry, wet) in times_of.items():
        a, b = ({name: np.array(times[name]) for name in SHOWN} for times in (dry, wet))
        lowest = {name: b[name].min() - a[name].min() for name in SHOWN}
        paired = {name: float(np.median(b[name] - a[name])) for name in SHOWN}
        base = {name: a[name].min() for name in SHOWN}
        for label, row in (("dry, least", base), ("more, least", lowest), ("more, paired", paired)):
            parts = sum(row[name] for name in SHOWN[:-2])
            share = 100.0 * parts / (base["step"] if "least" in label else float(np.median(a["step"])))
            print(f"{case:>12} {label:>14}", *(f"{row[name]:30.3f}" for name in SHOWN), f"{share:30.2f}", flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("cases", nargs="*", help=", ".join(CASES) + "; all of them by default")
    parser.add_argument("--particles", type=int, default=32_000)
    parser.add_argument("--steps", type=int, default=120)
    parser.add_argument("--substeps", type=int, nargs="+", default=[4, 1])
    chosen = parser.parse_args()
    for substeps in chosen.substeps:
        compare(chosen.cases or list(CASES), chosen.particles, chosen.steps, substeps)


if __name__ == "__main__":
    main()
