"""Throughput of the hash backend: a Drucker-Prager layer that slides down a plane, at several sizes.

    python tests/benchmarks/gpu_throughput.py --device cuda:0 --out throughput.json [--quick] [--spike STEP.py]

Checks first that the device agrees with the CPU at a small size, repeats itself bit by bit in deterministic mode, goes on from a
checkpoint bit by bit, and gives the same with and without a graph. Then measures, beside a control with scalar atomic sums.
Prints a table; the JSON holds one record a configuration. ``--spike`` is another program that steps 10.24 M particles on the
device named by its argument and prints a line with their number, ``p2g T ms`` and ``step T ms = R G``; it runs in between.
"""

import argparse
import json
import platform
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).parents[2]))

from runout import DruckerPrager
from runout.backends.hash import step
from runout.backends.hash.backend import bytes_needed
from runout.backends.hash.batch import SORTS_BEFORE, Batch
from runout.backends.protocol import get_backend
from runout.model.limits import CFL
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.release import arrangement
from tests.benchmarks.gpu_additions import ADDITIONS
from tests.benchmarks.gpu_naive import measure_naive

CELL = 2.0  # [m]
SLOPE = np.radians(20.0)
STEP = 0.4 / CFL  # of the stable step: the Courant number of all records
MATERIAL = DruckerPrager(density=2000.0, youngs_modulus=1e7, poisson_ratio=0.3, friction_angle=30.0)
LAYERS = {  # cells along x, y and through the thickness; 8 particles a cell
    "0.1M": (56, 56, 4),
    "0.3M": (100, 100, 4),
    "1M": (180, 180, 4),
    "2.6M thin": (400, 400, 2),
    "6.4M": (450, 450, 4),
    "10M": (400, 400, 8),
    "64M": (1000, 1000, 8),
    "100M": (1250, 1250, 8),
}
SERIES = 3  # timed series of steps, of which the record takes the median
LONGER, FEW = 4, 500_000  # times as many steps in a series where there are fewer particles than this
STAGES = ("p2g", "nodes and contact", "g2p", "cells")
MEMBER = (56, 56, 4)  # a scene of the batching curve: 100 352 particles
MEMBERS = (1, 4, 16, 64)
QUICK = {"0.02M": (25, 25, 4), "0.3M": LAYERS["0.3M"]}
ON_CPU = {"0.02M": (25, 25, 4)}


def layer(nx: int, ny: int, nz: int, precision: str = "float32", upwards: int = 2) -> tuple[Scene, Particles]:
    """Scene and particles of a layer of nx x ny x nz cells on a plane, moving downhill; 2 x 2 x ``upwards`` a cell."""
    margin = 24
    plane = -np.tan(SLOPE) * CELL * np.arange(nx + 2 * margin + 1)[:, None] + np.zeros(ny + 2 * margin + 1)
    surface = Surface.through(plane, (CELL, CELL))
    raster = Raster(ny + 2 * margin, nx + 2 * margin, (CELL, CELL))
    scene = Scene((CELL, CELL, CELL), surface, raster, (MATERIAL,), (np.tan(np.radians(15.0)),), precision=precision)
    half, own = CELL / 2, CELL / upwards
    i, j, k = np.indices((2 * nx, 2 * ny, upwards * nz)).reshape(3, -1)
    x, y = (i + 0.5) * half + margin * CELL, (j + 0.5) * half + margin * CELL
    z = (k + arrangement.shares(np.column_stack([i, j]))) * own - np.tan(SLOPE) * x
    p = Particles.at(np.column_stack([x, y, z]), np.full(3, CELL))
    p.volume[:] = half * half * own
    p.mass[:] = MATERIAL.density * half * half * own
    p.radius[:] = arrangement.half_size(own) * np.cos(SLOPE)
    rng = np.random.default_rng(0)
    p.velocity[:] = rng.normal(0.0, 0.05, (len(p), 3)) + 3.0 * np.array([np.cos(SLOPE), 0.0, -np.sin(SLOPE)])
    return scene, p


def loaded(device: str, scene: Scene, particles: Particles, deterministic: bool = False) -> Any:
    """A backend that has taken over a scene."""
    backend: Any = get_backend("hash", device, deterministic=deterministic)
    backend.load(scene, particles)
    return backend


def largest_difference(a: Particles, b: Particles) -> dict[str, float]:
    """Largest difference of each part of the state, relative to its largest value."""
    largest = {"position": float(np.abs((a.node - b.node) + (a.offset - b.offset)).max())}
    for name in ("velocity", "affine", "strain"):
        x, y = getattr(a, name), getattr(b, name)
        largest[name] = float(np.abs(x - y).max() / np.abs(x).max())
    return largest


def same_bits(a: Particles, b: Particles) -> bool:
    """Whether two states are equal bit by bit."""
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in vars(a))


def check(device: str) -> dict[str, Any]:
    """Agreement with the CPU, repeatability, graph against no graph, and the budget of mass and energy, at 20 000 particles."""
    content: dict[str, Any] = {}
    scene, p = layer(25, 25, 4, "float64")
    for precision, steps in (("float64", 1), ("float64", 100), ("float32", 100)):
        ends = []
        for place in ("cpu", device):
            backend = loaded(place, replace(scene, precision=precision), p)
            first = backend.ledger()
            backend.steps(0.5 * backend.stable_step(), steps)
            ends.append((backend.particles(), backend.ledger()))
        content[f"{precision}, {steps} steps"] = largest_difference(ends[0][0], ends[1][0])
    row = ends[1][1]
    assert row.contact_particles > 500, row.contact_particles
    content["mass error"] = abs(row.mass + row.escaped_mass - p.mass.sum()) / p.mass.sum()
    parts = ("kinetic_energy", "potential_energy", "elastic_energy", "basal_dissipation", "plastic_dissipation")
    stored = [sum(getattr(r, part) for part in parts) for r in (first, row)]
    content["energy not booked, of the kinetic"] = (stored[0] - stored[1]) / first.kinetic_energy
    runs = []
    for graphs in (True, True, False):
        backend = loaded(device, replace(scene, precision="float32"), p, deterministic=True)
        backend.graphs.enabled = graphs and backend.device.is_cuda
        backend.steps(0.5 * backend.stable_step(), 100)
        runs.append(backend.particles())
    whole, half = (loaded(device, replace(scene, precision="float32"), p, deterministic=True) for _ in range(2))
    dt = 0.5 * whole.stable_step()
    for backend in (whole, half):
        backend.steps(dt, 60)
    resumed: Any = get_backend("hash", device, deterministic=True)
    resumed.restore(half.parts.scenes.scenes[0], half.checkpoint())
    for backend in (whole, resumed):
        backend.steps(dt, 60)
    content["goes on from a checkpoint bit by bit"] = same_bits(whole.particles(), resumed.particles())
    content["repeats bit by bit"] = same_bits(runs[0], runs[1])
    content["graph gives the bits of launches"] = same_bits(runs[0], runs[2])
    return content


def seconds_of(work: Callable[[], Any]) -> float:
    """Median of the seconds that repeats of the same work take."""
    taken = []
    for _ in range(SERIES):
        started = time.perf_counter()
        work()
        taken.append(time.perf_counter() - started)
    return statistics.median(taken)


def record_sorts(batch: Any) -> None:
    """Sort until the graphs of a sort are recorded, for either place of the rows."""
    with wp.ScopedDevice(batch.device):
        for _ in range(2 * SORTS_BEFORE + 2):
            batch._rebuild(), batch._settle()


def find_and_move(parts: Any) -> None:
    """Contacts and velocities of the nodes, one stage of the records."""
    step.find_contacts(parts)
    step.move_nodes(parts)


def stages(backend: Any, steps: int) -> dict[str, float]:
    """Mean seconds of the stages of a step, by events between the launches (no graph), and of a sort with a new index."""
    names = STAGES
    works = (step.particles_to_grid, find_and_move, step.grid_to_particles, step.list_cells)
    sums = dict.fromkeys(names, 0.0)
    record_sorts(backend)  # or a particle might leave the index within the steps
    with wp.ScopedDevice(backend.device):
        parts = backend.parts
        parts.scenes.group.left.fill_(steps)
        for _ in range(steps):
            marks = [mark(backend)]
            for work in works:
                work(parts)
                marks.append(mark(backend))
            wp.synchronize_device(backend.device)
            for name, before, after in zip(names, marks[:-1], marks[1:], strict=True):
                sums[name] += between(before, after) / steps
        before = mark(backend)
        backend._rebuild()
        after = mark(backend)
        backend._settle()
        backend.columns(), backend.ledger()
        started = time.perf_counter()
        backend.flow_columns(), backend.ledger()
    return {**sums, "sort and index": between(before, after), "an observation": time.perf_counter() - started}


def mark(backend: Any) -> Any:
    """The present moment on the device."""
    if not backend.device.is_cuda:
        return time.perf_counter()
    event = wp.Event(enable_timing=True)
    wp.record_event(event)
    return event


def between(before: Any, after: Any) -> float:
    """Seconds between two moments."""
    return after - before if isinstance(after, float) else wp.get_event_elapsed_time(before, after) / 1e3


def copy_bandwidth(device: str) -> float:
    """Bytes read and written a second by a copy within the device."""
    with wp.ScopedDevice(device):
        a, b = (wp.zeros(2**27, dtype=wp.float32) for _ in range(2))
        wp.copy(b, a)
        wp.synchronize_device(device)
        started = time.perf_counter()
        for _ in range(10):
            wp.copy(b, a)
        wp.synchronize_device(device)
        return 10 * 2 * 4 * 2**27 / (time.perf_counter() - started)


def allocated(device: str) -> int:
    """Bytes that are taken from the pool of a device now."""
    card = wp.get_device(device)
    return int(wp.get_mempool_used_mem_current(card)) if card.is_cuda and wp.is_mempool_enabled(card) else 0


def measure(device: str, name: str, cells: tuple[int, int, int], steps: int, **options: Any) -> dict[str, Any]:
    """One record: throughput with everything on, memory, stages."""
    graph, deterministic, precision = options["graph"], options["deterministic"], options["precision"]
    scene, p = layer(*cells, precision)
    scene = ADDITIONS[options.get("addition", "none")](scene, p.position(np.full(3, CELL))[:, 0].max())
    before = allocated(device)
    backend = loaded(device, scene, p, deterministic)
    taken_up = allocated(device) - before
    backend.graphs.enabled = graph and backend.device.is_cuda
    if "steps_per_sort" in options:
        backend._steps_per_sort = lambda left: options["steps_per_sort"]
    dt = STEP * backend.stable_step()
    backend.steps(dt, 4)
    backend.steps(dt, steps // 4)  # the graph of a step is recorded here
    record_sorts(backend)
    rebuilds = backend.counters.rebuilds
    taken = seconds_of(lambda: backend.steps(dt, steps))
    row = backend.ledger()
    assert abs(row.mass + row.escaped_mass - p.mass.sum()) < 1e-6 * p.mass.sum()
    assert np.isfinite(row.kinetic_energy)
    record = {
        "name": name, "particles": len(p), "particle_steps_per_second": len(p) * steps / taken, "steps": steps,
        "bytes_per_particle": backend.bytes_used() / len(p), "allocated_bytes": taken_up,
        "forecast_bytes": bytes_needed(len(p), backend.parts.index.nall, precision, deterministic),
        "blocks": backend.parts.index.nall, "owners": backend.parts.index.nown,
        "room": backend.parts.index.capacity, "active_blocks": row.active_blocks, "contact_particles": row.contact_particles,
        "rebuilds": (backend.counters.rebuilds - rebuilds) / SERIES, "seconds": taken, **options,
    }  # fmt: skip
    record["stage_seconds"] = stages(backend, 10)
    return record


def measure_batch(device: str, members: int, steps: int) -> dict[str, Any]:
    """One record: scenes of 100 000 particles in one launch, each with its own ground, friction and time step."""
    scenes = []
    for n in range(members):
        scene, p = layer(*MEMBER)
        scenes.append((replace(scene, friction=(np.tan(np.radians(12.0 + 6.0 * n / members)),)), p))
    together = Batch(scenes, device)
    dt = [STEP * together.stable_step(n) * (1.0 - 0.2 * n / members) for n in range(members)]
    together.advance(dt, [steps // 4 + 4] * members)
    record_sorts(together)
    taken = seconds_of(lambda: together.advance(dt, [steps] * members))
    rows = together.ledgers()
    mass = sum(p.mass.sum() for _, p in scenes)
    assert abs(sum(row.mass + row.escaped_mass for row in rows) - mass) < 1e-6 * mass
    particles = sum(len(p) for _, p in scenes)
    return {
        "name": f"{members} scenes", "members": members, "particles": particles, "steps": steps, "seconds": taken,
        "particle_steps_per_second": particles * steps / taken, "bytes_per_particle": together.bytes_used() / particles,
        "graph": True, "deterministic": False, "precision": "float32", "stage_seconds": {},
    }  # fmt: skip


def driver() -> str:
    """Version of the graphics driver, if its tool is there."""
    try:
        asked = ["nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader"]
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.split()[0]
    except (OSError, subprocess.CalledProcessError, IndexError):
        return "unknown"


def configurations(device: str, quick: bool) -> list[tuple[str, tuple[int, int, int], dict[str, Any]]]:
    """What is measured."""
    plain = {"graph": True, "deterministic": False, "precision": "float32"}
    sizes = (ON_CPU if device == "cpu" else QUICK) if quick else LAYERS
    wanted = [(name, cells, plain) for name, cells in sizes.items()]
    middle = "10M" if "10M" in sizes else list(sizes)[-1]
    for change in ({"graph": False}, {"deterministic": True}, {"precision": "float64"}):
        wanted.append((middle, sizes[middle], plain | change))
    if not quick:
        wanted += [("0.3M", LAYERS["0.3M"], plain | {"graph": False})]
        wanted += [("1M", LAYERS["1M"], plain | {"steps_per_sort": n}) for n in (2, 4, 8, 16)]
        wanted += [("1M", LAYERS["1M"], plain | {"addition": name}) for name in ADDITIONS]
    return wanted


def measure_spike(path: Path, device: str) -> dict[str, Any]:
    """A record from another program, which is ended once it has told of 10.24 M particles."""
    asked = [sys.executable, str(path), device]
    with subprocess.Popen(asked, stdout=subprocess.PIPE, text=True) as program:
        for line in program.stdout or ():
            match = re.search(r"10\.24 M particles.*p2g ([\d.]+) ms.*?step ([\d.]+) ms = ([\d.]+) G", line)
            if match:
                program.kill()
                break
        else:
            raise RuntimeError(f"{path} printed no line of 10.24 M particles")
    return {
        "name": path.stem, "particles": 10_240_000, "particle_steps_per_second": 1e9 * float(match[3]), "precision": "float32",
        "graph": False, "deterministic": False, "control": True, "bytes_per_particle": None, "steps": 20,
        "seconds": 20e-3 * float(match[2]), "stage_seconds": {"p2g": 1e-3 * float(match[1])},
    }  # fmt: skip


def table_row(r: dict[str, Any]) -> str:
    """One line of the table."""
    sorts = f" sort every {r['steps_per_sort']}" if "steps_per_sort" in r else ""
    options = f"{r['precision']}{' graph' if r['graph'] else ''}{' deterministic' if r['deterministic'] else ''}{sorts}"
    options += f" {r['addition']}" if "addition" in r else ""
    split = ", ".join(f"{k} {1e3 * v:.3f}" for k, v in r["stage_seconds"].items())
    rate = r["particle_steps_per_second"] / 1e9
    return f"{r['name']:>10} {r['particles']:>9} {rate:8.3f} G/s {r['bytes_per_particle'] or 0:6.1f} B  {options:<28} [ms] {split}"


def main() -> None:
    """Check, measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--quick", action="store_true", help="two small sizes")
    parser.add_argument("--sizes", nargs="*", help=f"of {', '.join(LAYERS)}")
    parser.add_argument("--skip", nargs="*", default=(), help="sizes left out")
    parser.add_argument("--steps", type=int, default=256)
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--no-check", action="store_true")
    parser.add_argument("--spike", type=Path)
    a = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    card = wp.get_device(a.device)
    report: dict[str, Any] = {
        "device": card.name, "warp": wp.__version__, "driver": driver() if card.is_cuda else "", "host": platform.machine(),
        "commit": a.commit, "records": [],
    }  # fmt: skip
    if not a.no_check:
        report["check"] = check(a.device)
        print(json.dumps(report["check"], indent=1), flush=True)
    report["copy_bytes_per_second"] = copy_bandwidth(a.device)
    print(f"{card.name}: copy {report['copy_bytes_per_second'] / 1e12:.2f} TB/s", flush=True)
    steps = min(a.steps, 32) if not card.is_cuda else a.steps
    for name, cells, options in configurations(a.device, a.quick):
        if name not in a.skip and (not a.sizes or name in a.sizes):
            longer = LONGER if 8 * np.prod(cells) < FEW else 1
            report["records"].append(measure(a.device, name, cells, steps * longer, **options))
            print(table_row(report["records"][-1]), flush=True)
            if a.out:
                a.out.write_text(json.dumps(report, indent=1))
    scene, p = layer(*LAYERS["0.3M" if a.quick else "10M"])
    report["records"].append(measure_naive(a.device, scene, p, min(steps, 32)))
    print(table_row(report["records"][-1]), flush=True)
    if a.spike:
        report["records"].append(measure_spike(a.spike, a.device))
        print(table_row(report["records"][-1]), flush=True)
    for members in () if a.sizes else MEMBERS[: 2 if a.quick else None]:
        report["records"].append(measure_batch(a.device, members, steps))
        print(table_row(report["records"][-1]), flush=True)
    if a.out:
        a.out.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
