"""Error of thickness of the spreading cap (F3) against wall time: ``python tests/benchmarks/spreading_cap.py hash cuda:0 4 2 1``.

Backend, device, and spacings [m], each with the particles along an axis of a cell where that is not two: ``2:3``. Prints one line a
spacing: relative L2 of thickness at 5 s, particles, steps, and seconds of the steps, the second run of two so that nothing is
compiled in it. Single precision.
"""

import sys
import time

import numpy as np

from pipelines.verification_cases.dam_breaks import as_one, relative
from pipelines.verification_cases.spreading_cap import BED, END, EXTENT, START, whole
from runout.backends.protocol import get_backend

STEPS = 10  # of one length


def timed(backend: str, device: str, spacing: float, per_axis: int) -> tuple[float, int, int, float]:
    """Relative L2 of thickness, particles, steps, seconds."""
    scene, p, cap = whole(spacing, as_one(BED), "float32", per_axis)
    engine = get_backend(backend, device)
    engine.load(scene, p)
    now, steps, started = 0.0, 0, time.perf_counter()
    while now < END * (1 - 1e-9):
        dt = min(0.95 * engine.stable_step(), (END - now) / STEPS)
        for _ in range(STEPS):
            engine.step(dt)
        now, steps = now + STEPS * dt, steps + STEPS
    volume = engine.columns().volume
    seconds = time.perf_counter() - started
    x = (np.arange(scene.raster.columns) + 0.5) * spacing - START
    y = (np.arange(scene.raster.rows)[::-1] + 0.5) * spacing - EXTENT[1] / 2
    return relative(volume / spacing**2, cap.thickness(x[None, :], y[:, None], now), 2), len(p), steps, seconds


def main() -> None:
    """Measure what the command line names."""
    backend, device, *spacings = sys.argv[1:]
    for stated in spacings:
        size, _, count = stated.partition(":")
        spacing, per_axis = float(size), int(count or 2)
        timed(backend, device, spacing, per_axis)
        error, particles, steps, seconds = timed(backend, device, spacing, per_axis)
        given = f"{backend} {device} h = {spacing:g} m, {per_axis} particles an axis"
        print(f"{given}: L2 {error:.4f}, {particles} particles, {steps} steps, {seconds:.2f} s", flush=True)


if __name__ == "__main__":
    main()
