"""Time of a substep of a transfer on a GPU: the layers of ``gpu_throughput``, with 1 and 4 substeps a transfer.

    python tests/benchmarks/gpu_substeps.py --device cuda:0 --commit COMMIT --out gpu_substeps.json

The numbers of substeps take turns on the same device, so that its clock and its host are alike for all. A record a size holds the
median nanoseconds of a particle in a substep, sorts included, and the bytes of a particle. Before, a small collapse is
compared with the reference in float64, in both orders of sums; and with one substep with a scene that may have no more, to the bit.
"""

import argparse
import json
import statistics
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).parents[2]))

from runout import DruckerPrager
from runout.backends.protocol import get_backend
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from tests.benchmarks.gpu_throughput import LAYERS, STEP, layer, loaded, record_sorts

SUBSTEPS = (1, 4)  # of a transfer
STEPS = {"0.1M": 64, "0.3M": 64, "1M": 64, "10M": 32}  # substeps of a turn; after many, the layer leaves the raster
TURNS = 7
SAND = DruckerPrager(density=1800.0, youngs_modulus=2e6, poisson_ratio=0.25, friction_angle=30.0)


def prepared(device: str, size: str, most: int) -> tuple[Any, float]:
    """A backend that has recorded its graphs, and its time step [s]."""
    scene, p = layer(*LAYERS[size])
    backend = loaded(device, replace(scene, substeps=most), p)
    dt = STEP * backend.stable_step()
    backend.steps(dt, 4 + STEPS[size] // (4 * most), substeps=most)
    record_sorts(backend)
    backend.steps(dt, STEPS[size] // (4 * most), substeps=most)
    return backend, dt


def nanoseconds(backend: Any, dt: float, steps: int, most: int) -> float:
    """Nanoseconds of a particle in a substep, the device idle before and after."""
    before = backend.counters.particle_steps
    wp.synchronize_device(backend.device)
    started = time.perf_counter()
    backend.steps(dt, steps // most, substeps=most)
    wp.synchronize_device(backend.device)
    return 1e9 * (time.perf_counter() - started) / (backend.counters.particle_steps - before)  # type: ignore[no-any-return]


def measure(device: str, size: str) -> dict[str, Any]:
    """The record of a size."""
    batches = {most: prepared(device, size, most) for most in SUBSTEPS}
    turns = [{most: nanoseconds(*one, STEPS[size], most) for most, one in batches.items()} for _ in range(TURNS)]
    found = {most: statistics.median(turn[most] for turn in turns) for most in SUBSTEPS}
    each = {most: one.memory_bytes() / one.parts.store.n for most, (one, _) in batches.items()}
    return {"name": size, "particles": 8 * int(np.prod(LAYERS[size])), "nanoseconds": found, "bytes_a_particle": each}


def collapse(most: int) -> tuple[Scene, Particles]:
    """A small column that collapses and slides down rough ground."""
    x, y = np.meshgrid(2.0 * np.arange(41), 2.5 * np.arange(31), indexing="ij")
    surface = Surface.through(0.8 * np.sin(0.5 * x) * np.cos(0.4 * y) - 0.2 * x, (2.0, 2.5))
    axes = (np.arange(n) * 0.5 + 0.25 for n in (8, 8, 8))
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + np.array((24.0, 30.0, 0.05))
    places[:, 2] += surface.elevation(places[:, 0], places[:, 1])
    p = Particles.at(places, np.ones(3))
    p.volume[:], p.radius[:], p.velocity[:] = 0.125, 0.25, (6.0, 1.0, -1.0)
    p.mass[:] = SAND.density * p.volume
    return Scene((1.0, 1.0, 1.0), surface, Raster(30, 40, (2.0, 2.5)), (SAND,), (0.4,), precision="float64", substeps=most), p


def velocities(engine: Any, most: int, number: int) -> np.ndarray:
    """Velocities [m/s] of the collapse after 20 transfers."""
    engine.load(*collapse(most))
    for _ in range(20):
        engine.step(4e-3, number)
    return engine.particles().velocity  # type: ignore[no-any-return]


def parity(device: str) -> dict[str, float]:
    """Largest difference from the reference over the largest velocity, by what is compared."""
    errors = {}
    for number in SUBSTEPS:
        expected = velocities(get_backend("reference"), max(SUBSTEPS), number)
        for ordered in (False, True):
            got = velocities(get_backend("hash", device, deterministic=ordered), max(SUBSTEPS), number)
            errors[f"{number} substeps, {ordered=}"] = float(np.abs(got - expected).max() / np.abs(expected).max())
    one, other = (velocities(get_backend("hash", device, deterministic=True), most, 1) for most in (1, max(SUBSTEPS)))
    return errors | {"1 substep of 4 over 1 of 1": float(np.abs(one - other).max())}


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--sizes", nargs="*", default=list(STEPS), choices=list(STEPS))
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    report: dict[str, Any] = {"device": wp.get_device(a.device).name, "warp": wp.__version__, "commit": a.commit}
    report |= {"parity": parity(a.device), "records": []}
    print(report["parity"], flush=True)
    for size in a.sizes:
        report["records"].append(measure(a.device, size))
        print(size, {most: f"{ns:.3f} ns" for most, ns in report["records"][-1]["nanoseconds"].items()}, flush=True)
        if a.out:
            a.out.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
