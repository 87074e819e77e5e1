"""The benchmark of a step in turns with the kernels of the prototype, which has no index, sort, contact or observers.

    python -m tests.benchmarks.prototype SCRIPT bench.json [--full]

It writes the record of `runout bench` with the study `against`.
"""

import argparse
import hashlib
import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from runout.errors import ConfigError
from runout.io.atomic import write_json
from runout.model.scene import STANDARD_GRAVITY
from runout.studies import work_precision
from runout.studies.sloping_layer import SAND, SPACING, Layer
from runout.studies.timing import Case, TimedRun, clock_of, take_turns

SIZES = 400_000, 1_000_000  # particles
STEP = 1e-3  # [s]
STEPS = 20  # of one repetition
KERNELS = ("p2g", "grid_update", "g2p_update", "ARENA", "TILE", "nb")
UP = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def load_prototype(path: Path) -> ModuleType:
    """The script as a module; its compiled kernels are cached by the contents of the scripts beside it.

    Raises
    ------
    ConfigError
        If there is no such file, or it is another kind of script.
    """
    from runout.backends.compile import cache_folder

    if not path.is_file():
        raise ConfigError(f"{path}: does not exist; name the prototype script, such as numba_simd_step.py")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ConfigError(f"{path}: is no Python script")
    module = importlib.util.module_from_spec(spec)
    sources = hashlib.sha256(b"".join(p.read_bytes() for p in sorted(path.parent.glob("*.py"))))
    writes, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    sys.path.insert(0, str(path.parent))
    sys.modules[path.stem] = module  # numba looks it up when it loads a cached kernel
    try:
        with cache_folder(f"prototype_{sources.hexdigest()[:16]}"):
            spec.loader.exec_module(module)
    except (ImportError, SyntaxError) as error:
        raise ConfigError(f"{path}: cannot be imported ({error}); keep vec.py beside it") from error
    finally:
        sys.path.remove(str(path.parent))
        sys.dont_write_bytecode = writes
    missing = [name for name in KERNELS if not hasattr(module, name)]
    if missing:
        raise ConfigError(f"{path}: has no {', '.join(missing)}; name the prototype script numba_simd_step.py")
    return module


class PrototypeRun:
    """The prototype on the particles of a layer, which stay in their cells (see :class:`runout.studies.timing.Course`)."""

    def __init__(self, module: ModuleType, layer: Layer, threads: int):
        self.module, self.layer, self.threads = module, layer, threads
        _, particles = layer.build()
        order, layout = block_layout(particles.node)
        self.up, self.down, self.cells = layout
        self.n, owners, blocks = len(order), len(self.up), len(self.down)
        self.rec = np.zeros((self.n + module.TILE, 16), np.float32)
        self.rec[: self.n, 0] = particles.mass[order]
        self.rec[: self.n, 1:4] = (particles.mass[:, None] * particles.velocity)[order]
        self.rec[: self.n, 4::4] = particles.offset[order]
        self.state = np.zeros((self.n + module.TILE, 8), np.float32)
        self.state[: self.n, 2], self.state[: self.n, 6] = particles.strain[order, 2] / 2, particles.volume[order]
        self.arena, self.grid = np.zeros((owners, module.ARENA), np.float32), np.zeros(blocks * 256, np.float32)
        self.seconds: list[float] = []
        self._step()

    def _step(self) -> None:
        real, m = np.float32, self.module
        m.nb.set_num_threads(self.threads)
        m.p2g(self.rec.reshape(-1), self.cells, len(self.up), self.arena)
        m.grid_update(self.arena.reshape(-1), self.down, len(self.down), self.grid, real(-STEP * STANDARD_GRAVITY))
        m.g2p_update(
            self.rec.reshape(-1), self.state.reshape(-1), self.cells, len(self.up), self.grid, self.up, real(STEP), real(SPACING),
            real(SAND.lame_lambda), real(SAND.shear_modulus), real(0.3), real(0.0),
        )  # fmt: skip

    def repeat(self) -> None:
        """Some steps."""
        clock = clock_of(Case(self.layer, self.threads))
        for _ in range(STEPS):
            started = clock()
            self._step()
            self.seconds.append(clock() - started)

    def measured(self) -> dict[str, Any]:
        """Case and particle-steps per second of the best step."""
        case = {"particles": self.layer.particles, "depth": self.layer.depth, "threads": self.threads, "prototype": True}
        return {"case": case, "particles": self.n, "rate": self.n / min(self.seconds)}


def block_layout(node: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Order of particles with first nodes (n, 3) by block and cell, and the prototype's index of their blocks.

    The index: node blocks above each owner (owners, 8), owners below each node block (blocks, 8) or -1, first particle of
    each cell (64 owners + 1,).
    """
    node = node - node.min(axis=0) + 8
    key = _key(node >> 2)
    cell = (node & 3) @ np.array([16, 4, 1])
    order = np.lexsort((cell, key))
    owners = np.unique(key)
    reached = np.unique((owners[:, None] + _key(UP)).ravel())
    blocks = np.concatenate([owners, np.setdiff1d(reached, owners)])
    by_key = np.argsort(blocks)
    up = by_key[np.searchsorted(blocks[by_key], owners[:, None] + _key(UP))].astype(np.int32)
    below = blocks[:, None] - _key(UP)
    number = np.minimum(np.searchsorted(owners, below), len(owners) - 1)
    down = np.where(owners[number] == below, number, -1).astype(np.int32)
    place = np.searchsorted(owners, key) * 64 + cell
    return order, (up, down, np.searchsorted(place[order], np.arange(len(owners) * 64 + 1)))


def _key(block: np.ndarray) -> np.ndarray:
    return block.astype(np.int64) @ np.array([1 << 40, 1 << 20, 1])


def against(prototype: Any, choices: work_precision.Choices) -> list[dict[str, Any]]:
    """The prototype and runout on the same particles, each with one and more threads, in turns."""
    done = []
    for size in choices.sizes or SIZES:
        layer = Layer(size, depth=work_precision.DEEP)
        timed_runs: list[Any] = [PrototypeRun(prototype, layer, t) for t in choices.usable_threads]
        timed_runs += [TimedRun(Case(layer, t, device=choices.device)) for t in choices.usable_threads]
        done += take_turns(timed_runs, choices.repetitions)
    return done


def ratios(measurements: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rate with everything on over that of the prototype, which leaves out index, sort, contact and observers."""
    theirs = {(m["particles"], m["case"]["threads"]): m["rate"] for m in measurements if "prototype" in m["case"]}
    own = [m for m in measurements if "prototype" not in m["case"]]
    return [
        {"particles": m["particles"], "threads": t, "ratio": m["rate"] / theirs[m["particles"], t]}
        for m in own
        for t in [m["case"]["threads"]]
    ]


def main() -> None:
    """Measure all studies of the benchmark and that of the prototype; write their record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("script", type=Path)
    parser.add_argument("json", type=Path)
    parser.add_argument("--full", action="store_true")
    chosen = parser.parse_args()
    prototype, choices = load_prototype(chosen.script), work_precision.Choices(full=chosen.full)
    content = work_precision.measured(choices)
    content["studies"]["against"] = against(prototype, choices)
    content["ratios"]["against"] = ratios(content["studies"]["against"])
    work_precision.report(content)
    print(write_json(content, chosen.json))


if __name__ == "__main__":
    main()
