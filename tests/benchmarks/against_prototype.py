"""Speed of the scan backend with everything on against a prototype of the bare transfers and law.

    python tests/benchmarks/against_prototype.py --against FILE [--threads 1 2] [--rounds 12]

The prototype moves the same number of particles without sort, index, contact and ledger. Both run in turns in one process,
a few steps each, and the least time of a stage counts: other work on the machine then disturbs both alike. Only ratios mean
something.
"""

import argparse
import importlib.util
import os
import sys
import tempfile
import time
from pathlib import Path
from types import ModuleType

import numba
import numpy as np

from runout import DruckerPrager
from runout.backends.scan.backend import ScanBackend
from runout.model.particles import Particles
from runout.model.scene import STANDARD_GRAVITY, Raster, Scene
from runout.model.surface import Surface

SAND = DruckerPrager(density=2000.0, youngs_modulus=2e7, poisson_ratio=0.3, friction_angle=30.0)
SPACING = (0.5, 0.5, 0.5)
SHAPES = {
    "1.05 M, 32 cells thick": (64, 64, 32),
    "0.41 M, 25 thick": (64, 32, 25),
    "0.41 M, 4 thick": (160, 80, 4),
    "0.41 M, 2 thick": (160, 160, 2),
}
SLOPE = 0.45
STEPS = 6  # of each in one turn


def load_prototype(path: Path) -> ModuleType:
    """The prototype as a module; it imports what lies beside it."""
    sys.path.insert(0, str(path.parent))
    os.environ.setdefault("NUMBA_CACHE_DIR", str(Path(tempfile.gettempdir()) / "prototype-cache"))
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Prototype:
    """The prototype's step on a box of particles at 8 per cell that vibrate in place."""

    def __init__(self, module: ModuleType, cells: tuple[int, int, int]):
        self.m, rng = module, np.random.default_rng(0)
        frac, self.n, self.nbr, self.rnbr, self.cs, self.nown, self.nall, _ = module.build27(*cells, 8, rng)
        v = rng.normal(0, 1, (3, self.n)).astype(np.float32)
        c = rng.normal(0, 0.1, (9, self.n)).astype(np.float32)
        strain = np.zeros((6, self.n), np.float32)
        strain[:3] = -1e-3
        rec, state = module.records(frac, v, c, strain, np.ones(self.n, np.float32), self.n)
        self.rec, self.state = rec.reshape(-1), state.reshape(-1)
        self.arena = np.zeros((self.nown, module.ARENA), np.float32)
        self.grid = np.zeros(self.nall * 256, np.float32)

    def step(self, seconds: dict[str, float]) -> None:
        """One step; adds the seconds of its stages."""
        m, zero = self.m, np.float32(0)
        marks = [time.perf_counter()]
        m.p2g(self.rec, self.cs, self.nown, self.arena)
        m.grid_update(self.arena.reshape(-1), self.rnbr, self.nall, self.grid, np.float32(-0.00981))
        marks.append(time.perf_counter())
        m.g2p_update(self.rec, self.state, self.cs, self.nown, self.grid, self.nbr, m.dt, m.h, m.lam, m.mu, m.alpha, zero)
        marks.append(time.perf_counter())
        for name, a, b in zip(("p2g", "g2p"), marks, marks[1:], strict=False):
            seconds[name] = seconds.get(name, 0.0) + b - a


def slab(cells: tuple[int, int, int], speed: float = 8.0) -> tuple[Scene, Particles]:
    """A slab that slides down a rough plane under gravity, sheared over its depth."""
    h = np.array(SPACING)
    rng = np.random.default_rng(0)
    axes = [np.arange(2 * n) * 0.5 + 0.25 for n in cells]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    depth = x[:, 2] / cells[2]
    x[:, :2] += rng.uniform(-0.1, 0.1, (len(x), 2))
    x = x * h + np.array([50.0, 50.0, 0.0])
    load = SAND.density * STANDARD_GRAVITY * (cells[2] * h[2] - x[:, 2])
    length = (cells[0] + 400) * SPACING[0]
    lattice = np.arange(0.0, max(length, (cells[1] + 200) * SPACING[1]) + 20, 1.0) - 10
    wavy = np.sin(lattice / 5.0)[:, None] * np.cos(lattice / 7.0)[None, :]
    surface = Surface.through(-SLOPE * lattice[:, None] + 0.2 * wavy, (1.0, 1.0), (-10.0, -10.0))
    x[:, 2] += surface.elevation(x[:, 0], x[:, 1])
    p = Particles.at(x, h)
    p.velocity[:, 0] = speed * (0.7 + 0.3 * depth)
    p.velocity[:, 2] = -SLOPE * p.velocity[:, 0]
    p.volume[:] = np.prod(h) / 8
    p.mass[:] = SAND.density * p.volume
    p.radius[:] = h[2] / 4
    p.strain[:, 2] = -2.0 * load / (SAND.lame_lambda + 2.0 * SAND.shear_modulus)
    raster = Raster(int((cells[1] + 200) * SPACING[1] / 2), int(length / 2), (2.0, 2.0))
    return Scene(SPACING, surface, raster, (SAND,), (0.3,)), p


def in_turns(cells: tuple[int, int, int], prototype: ModuleType, threads: int, rounds: int, index: str):
    """Number of particles, least seconds a step and stage of the prototype and of the backend, and the backend."""
    numba.set_num_threads(threads)
    other = Prototype(prototype, cells)
    backend = ScanBackend(threads, index)
    scene, p = slab(cells)
    backend.load(scene, p)
    dt = 0.9 * backend.stable_step()
    best: tuple[dict, dict] = ({}, {})
    for turn in range(rounds + 1):
        numba.set_num_threads(threads)
        spent: tuple[dict, dict] = ({}, {})
        for _ in range(STEPS):
            other.step(spent[0])
        before = dict(backend.counters.seconds)
        for _ in range(STEPS):
            backend.step(dt)
        spent[1].update({k: v - before.get(k, 0.0) for k, v in backend.counters.seconds.items()})
        for least, now in zip(best, spent, strict=True):
            for k, v in now.items():
                if turn:
                    least[k] = min(least.get(k, np.inf), v / STEPS)
        if turn == 0:
            start = dict(backend.counters.seconds), backend.counters.steps
    steps = backend.counters.steps - start[1]
    best[1]["index"] = (backend.counters.seconds["index"] - start[0]["index"]) / steps  # rare: its mean counts
    return other.n, best, backend


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, required=True, metavar="FILE")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--index", default="sparse")
    parser.add_argument("--only", default="")
    choice = parser.parse_args()
    prototype = load_prototype(choice.against)
    for name, cells in SHAPES.items():
        for threads in choice.threads:
            if choice.only not in name:
                continue
            report(name, threads, *in_turns(cells, prototype, threads, choice.rounds, choice.index))


def report(name: str, threads: int, n: int, best: tuple[dict, dict], backend) -> None:
    """Lines of one case."""
    other, own = best
    a, b = sum(other.values()), sum(own.values())
    stages, theirs = ({k: round(1e9 * v * threads / n, 1) for k, v in row.items()} for row in (own, other))
    print(f"{name}, {threads} thread(s): {a / b:.2f} of the prototype; {n / b / 1e6:.1f} M particle-steps/s, it {n / a / 1e6:.1f}")
    print(f"    thread-ns a particle {stages}; prototype {theirs}")
    memory, nodes = sum(backend.memory().values()), 64 * int((backend.index.held > 0).sum())
    touching = backend.ledger().contact_particles
    print(
        f"    contact {100 * own['contact'] / b:.0f} % of a step with {touching} contacts; {backend.counters.rebuilds} rebuilds; "
        f"{(memory - 64 * nodes) / n:.0f} bytes a particle beside 64 an active node",
        flush=True,
    )


if __name__ == "__main__":
    main()
