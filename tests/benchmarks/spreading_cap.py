"""Error of thickness of the spreading cap (F3) against wall time, in cells of any shape, on a grid that leans or not.

    python tests/benchmarks/spreading_cap.py hash cuda:0 4 2:3 4/0.5:2x4 [--lean 0 20 35]

Backend, device, and cells: their size [m], their height behind a slash where that is another, and behind a colon the particles
along an axis where these are not two, in plan and through the depth. ``--lean``: angles [deg] by which the grid is less steep than
the plane of 35 degrees; with 35 it is level, as on terrain. Prints one line a run: relative L2 of thickness at 5 s, particles,
steps, particle-steps and seconds of the steps, the second run of two so that nothing is compiled in it. Single precision.
"""

import argparse
import time

import numpy as np

from runout.backends.protocol import Backend, get_backend
from runout.model.scene import Scene
from runout.studies.verification_cases.dam_breaks import as_one, relative
from runout.studies.verification_cases.shallow_water import SpreadingCap
from runout.studies.verification_cases.spreading_cap import BED, END, EXTENT, START, Cells, Lean, whole

STEPS = 10  # of one length
SQUARE, SUB = 8.0, 4  # [m] over which thickness is averaged where the grid leans; parts of a particle's width along each axis


def cells_of(text: str) -> Cells:
    """Cells as the command line states them."""
    shape, _, particles = text.partition(":")
    size, _, height = shape.partition("/")
    plan, _, depth = (particles or "2").partition("x")
    return Cells(float(size), float(height or size), int(plan), int(depth or plan))


def timed(
    backend: str, device: str, cells: Cells, lean_deg: float = 0.0, threads: int | None = None
) -> tuple[float, int, int, float]:
    """Relative L2 of thickness, particles, steps, seconds."""
    scene, p, cap, lean = whole(cells, as_one(BED), "float32", lean_deg)
    engine = get_backend(backend, device, threads)
    engine.load(scene, p)
    now, steps, started = 0.0, 0, time.perf_counter()
    while now < END * (1 - 1e-9):
        dt = min(0.95 * engine.stable_step(), (END - now) / STEPS)
        for _ in range(STEPS):
            engine.step(dt)
        now, steps = now + STEPS * dt, steps + STEPS
    engine.ledger()  # a device is done
    seconds = time.perf_counter() - started
    error = on_plane(engine, scene, cap, lean, cells) if lean_deg else on_raster(engine, scene, cap)
    return error, len(p), steps, seconds


def on_raster(engine: Backend, scene: Scene, cap: SpreadingCap) -> float:
    """Relative L2 of thickness on the columns of the grid."""
    size = scene.spacing[0]
    x = (np.arange(scene.raster.columns) + 0.5) * size - START
    y = (np.arange(scene.raster.rows)[::-1] + 0.5) * size - EXTENT[1] / 2
    return relative(engine.columns().volume / size**2, cap.thickness(x[None, :], y[:, None], END), 2)


def on_plane(engine: Backend, scene: Scene, cap: SpreadingCap, lean: Lean, cells: Cells) -> float:
    """Relative L2 of thickness normal to the plane, averaged over squares; a particle counts over its width."""
    p, width = engine.particles(), cells.size / cells.plan
    place = p.position(np.array(scene.spacing))
    along, across = lean.along(place[:, 0], place[:, 2]), place[:, 1] - EXTENT[1] / 2
    edges = np.arange(-19, 24) * SQUARE, np.arange(-14, 15) * SQUARE
    parts = ((np.arange(SUB) + 0.5) / SUB - 0.5) * width
    volume = p.mass / scene.materials[0].density / SUB**2
    found = sum(np.histogram2d(along + i, across + j, edges, weights=volume)[0] for i in parts for j in parts) / SQUARE**2
    fine = [np.arange(e[0], e[-1]) + 0.5 for e in edges]
    exact = cap.thickness(fine[0][:, None], fine[1][None, :], END)
    squares = exact.reshape(found.shape[0], int(SQUARE), found.shape[1], int(SQUARE)).mean((1, 3))
    return relative(found, squares, 2)


def main() -> None:
    """Measure what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("backend")
    parser.add_argument("device")
    parser.add_argument("cells", nargs="+", type=cells_of)
    parser.add_argument("--lean", nargs="*", type=float, default=[0.0])
    parser.add_argument("--threads", type=int)
    a = parser.parse_args()
    for lean in a.lean:
        for cells in a.cells:
            timed(a.backend, a.device, cells, lean, a.threads)
            error, n, steps, seconds = timed(a.backend, a.device, cells, lean, a.threads)
            given = f"{a.backend} {a.device} {cells}, lean {lean:g} deg"
            print(f"{given}: L2 {error:.4f}, {n} particles, {steps} steps, {n * steps:.2g} in all, {seconds:.2f} s", flush=True)


if __name__ == "__main__":
    main()
