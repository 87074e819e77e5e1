"""Runs of the synthetic site by cell size: time, steps, memory of device and host, blocks, sparsity and run-out."""

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np

from runout.backends.hash.index import MARGIN
from runout.backends.protocol import INDEXES, get_backend
from runout.errors import BudgetError, CapacityError
from runout.forecast.memory import Extent, expected_memory
from runout.model.numerics import Numerics, Scheme
from runout.simulation.run import Run, RunControl
from runout.simulation.scenario import build_scene
from runout.studies.timing import memory_of
from tests.benchmarks.seed_cases import synthetic_site as site
from tests.benchmarks.seed_cases.blocks import NODES, BlockCount, box_of_run, count_blocks
from tests.benchmarks.seed_cases.memory_peak import card_used, forget_host_peak, host_peak

PER_CELL = (2, 2, 2)
CELLS = {"cpu": (10.0, 8.0), "gpu": (10.0, 8.0, 6.0, 4.0, 2.0)}  # [m], full size, the coarsest first
COARSE, COARSE_TIME = (40.0,), 20.0  # [m], [s]
THREADS = 1  # of the CPU: its time is then that of the work, whatever else the machine does
TURNS, TRANSFERS = 5, 40  # series of the dense control, and transfers of each


@dataclass
class Watch:
    """What a run holds whenever its ledger gets a row."""

    engine: Any
    particles: int
    blocks: list[BlockCount] = field(default_factory=list)
    nbytes: float = 0.0

    def look(self, done: float = 0.0) -> None:
        """Count blocks and bytes now."""
        self.blocks.append(count_blocks(self.engine))
        self.nbytes = max(self.nbytes, memory_of(self.engine, self.particles)["bytes"])


def forecasts() -> list[dict[str, Any]]:
    """One row a cell size of a GPU: the forecast of :mod:`runout.forecast.memory` for the start of the run, which needs no GPU.

    ``cell`` [m], ``particles``, ``nodes`` of all blocks, ``device_bytes`` and ``host_bytes``.
    """
    return [_forecast(cell) for cell in CELLS["gpu"]]


def _forecast(cell: float) -> dict[str, Any]:
    ground, extents = site.terrain(), list[Extent]()
    build_scene(
        ground,
        site.release(ground),
        site.ROCK_AND_ICE,
        site.BASAL_ANGLE,
        Numerics(cell_size=cell, particles_per_cell=PER_CELL),
        accept=extents.append,
        in_chunks=True,
    )
    forecast = expected_memory(extents[0], ground.elevation.size, Scheme(precision="float32"), on_card())
    counts = {"particles": extents[0].particles, "nodes": NODES * extents[0].nodes_on_device}
    return {"cell": cell, **counts, "device_bytes": forecast.backend, "host_bytes": forecast.host}


def on_card() -> Any:
    """What :func:`runout.forecast.memory.expected_memory` asks of a backend on a GPU."""
    return SimpleNamespace(device=SimpleNamespace(is_cuda=True))


def by_cell_size(device: str, full: bool) -> list[dict[str, Any]]:
    """One row a cell size, see :func:`one_run`; kernels are compiled or loaded before."""
    cells = CELLS["cpu" if device == "cpu" else "gpu"] if full else COARSE
    one_run(COARSE[0], device, 1.0)
    rows = []
    for cell in cells:
        row = one_run(cell, device, site.END_TIME if full else COARSE_TIME)
        rows.append(row | ({} if device == "cpu" else dense_control(cell, device, row["box_low"], row["box_high"])))
    return rows


def one_run(cell: float, device: str, end_time: float) -> dict[str, Any]:
    """A run with cells of ``cell`` [m].

    Returns
    -------
    dict
        ``cell`` [m], ``particles``, ``steps``, ``stop_reason``; ``seconds`` of the run and ``setup`` [s]: processor time on the
        CPU, wall time on a GPU; ``backend_bytes``: largest memory of the arrays of particles, blocks and index; ``card_bytes``:
        memory in use on the card, None on a CPU; ``host_bytes``: largest resident memory of the process; blocks, nodes and
        sparsity, the largest and at the end; ``runout`` [m] of 99 % of the deposit from the top of the release, ``max_speed``
        [m/s], ``max_deposit`` [m], ``escaped`` and ``mass_error`` [1].
    """
    forget_host_peak()
    clock = time.process_time if device == "cpu" else time.perf_counter
    started = clock()
    ground = site.terrain()
    engine = get_backend("scan" if device == "cpu" else "hash", device, THREADS)
    scene, particles = site_scene(ground, cell)
    watch = Watch(engine, len(particles))
    run = Run(engine, scene, RunControl(end_time), watch.look, None)
    run.start(particles)
    loaded = clock()
    watch.look()
    run.go()
    return {
        "cell": cell,
        "particles": watch.particles,
        "seconds": clock() - loaded,
        "setup": loaded - started,
        "end_time": run.time,
        "backend_bytes": watch.nbytes,
        "card_bytes": None if device == "cpu" else card_used(),
        "host_bytes": host_peak(),
        **_blocks(watch.blocks),
        **_outcome(run, ground, watch.particles),
    }


def site_scene(ground: Any, cell: float) -> Any:
    """Scene and particles of the site with cells of ``cell`` [m]."""
    return build_scene(
        ground,
        site.release(ground),
        site.ROCK_AND_ICE,
        site.BASAL_ANGLE,
        Numerics(cell_size=cell, particles_per_cell=PER_CELL),
        in_chunks=True,
    )


def dense_control(cell: float, device: str, low: Sequence[int], high: Sequence[int]) -> dict[str, Any]:
    """Substeps of the start of the run on a GPU, over the blocks that hold mass and over all blocks of the box of the whole flow.

    Parameters
    ----------
    cell : float
        Width of a cell [m].
    device : str
        "cuda:N".
    low, high : sequence of int
        First and last block of the box along each axis.

    Returns
    -------
    dict
        For "sparse" and "dense": seconds of a substep, the median of :data:`TURNS` series that take turns, sorts included; blocks
        and bytes held. Empty for a dense grid that does not fit.
    """
    engines = {}
    for index in INDEXES:
        scene, particles = site_scene(site.terrain(), cell)
        engine = get_backend("hash", device, index=index)
        try:
            with patch("runout.backends.hash.batch.box_around", lambda nodes: _nodes_of_box(low, high)):
                engine.load(scene, particles)
        except (BudgetError, CapacityError, MemoryError):
            return {}
        engines[index] = engine
    seconds: dict[str, list[float]] = {index: [] for index in engines}
    dt = 0.5 * engines["sparse"].stable_step()
    for turn in range(TURNS + 1):
        for index, engine in engines.items():
            started = time.perf_counter()
            engine.steps(dt, TRANSFERS, substeps=scene.substeps)
            engine.stable_step()  # waits for the device
            if turn:
                seconds[index].append((time.perf_counter() - started) / (TRANSFERS * scene.substeps))
    return {
        f"{index}_{name}": value
        for index, engine in engines.items()
        for name, value in (
            ("seconds", statistics.median(seconds[index])),
            ("blocks", count_blocks(engine).occupied),
            ("bytes", memory_of(engine, len(particles))["bytes"]),
        )
    }


def _nodes_of_box(low: Sequence[int], high: Sequence[int]) -> np.ndarray:
    """A node (blocks, 3) int32 inside each block of a box."""
    shape = tuple(np.subtract(high, low) + 1)
    place = np.stack(np.unravel_index(np.arange(np.prod(shape)), shape), axis=1) + np.asarray(low)
    return (4 * place + MARGIN).astype(np.int32)


def _blocks(counts: list[BlockCount]) -> dict[str, Any]:
    """Blocks, nodes and sparsity of a run: most, and at the end; sparsity at the start too."""
    largest = max(b.occupied for b in counts)
    low, high = box_of_run(counts)
    return {
        "blocks": largest,
        "box_low": low,
        "box_high": high,
        "nodes": NODES * largest,
        "blocks_at_end": counts[-1].occupied,
        "sparsity_at_start": counts[0].sparsity,
        "sparsity": max(b.sparsity for b in counts),
        "sparsity_at_end": counts[-1].sparsity,
    }


def _outcome(run: Run, ground: Any, particles: int) -> dict[str, Any]:
    """Steps, run-out and books of a finished run."""
    result = run.result(ground, particles, 0.0, brought=False)
    deposit, series = result.fields["deposit_thickness"], result.series
    mass = np.asarray(series["mass"]) + np.asarray(series["escaped_mass"])
    return {
        "steps": result.steps,
        "stop_reason": result.stop_reason,
        "active_blocks": int(np.max(series["active_blocks"])),
        "runout": site.path_length(deposit, ground),
        "max_deposit": float(np.nanmax(deposit)),
        "max_speed": float(np.nanmax(result.fields["max_speed"])),
        "escaped": float(series["escaped_mass"][-1] / mass[0]),
        "mass_error": float(np.abs(mass / mass[0] - 1).max()),
    }
