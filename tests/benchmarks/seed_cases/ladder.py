"""Sparsity ladder: two bodies ever farther apart, with the sparse index and with a dense grid of the same kernels.

Each comparison favours the dense grid. It needs no index, so that its time is that of the step alone, and on a GPU without
the sort that belongs to the index; the time of the sparse grid has both. Both take turns in one run.
"""

from collections.abc import Sequence
from typing import Any

from runout.backends.protocol import INDEXES
from runout.errors import BudgetError, CapacityError
from runout.studies.sloping_layer import Layer
from runout.studies.timing import Case, TimedRun, take_turns
from tests.benchmarks.seed_cases.blocks import count_blocks
from tests.benchmarks.seed_cases.published import SPARSITIES

RUNGS = (1.0, SPARSITIES[0], SPARSITIES[1], 30.0, 100.0, SPARSITIES[2], 600.0)  # by blocks, the last exceeds the one before it
PARTICLES = {"cpu": 100_000, "gpu": 1_000_000}
FEW, FEW_RUNGS = 4_000, (1.0, SPARSITIES[1])
REPEATS, FEW_REPEATS = 5, 2


def climb(device: str, full: bool) -> list[dict[str, Any]]:
    """One row a rung, see :func:`rung`; a rung whose dense grid does not fit into the memory has a sparse part only."""
    particles = PARTICLES["cpu" if device == "cpu" else "gpu"] if full else FEW
    return [rung(s, particles, device, REPEATS if full else FEW_REPEATS) for s in (RUNGS if full else FEW_RUNGS)]


def rung(sparsity: float, particles: int, device: str, repeats: int) -> dict[str, Any]:
    """Sparse and dense steps of two bodies whose box has ``sparsity`` times their volume, by turns.

    Returns
    -------
    dict
        ``sparsity`` of the volumes, ``particles``, and for each index the seconds of a step, its share of ``index`` seconds,
        ``bytes`` and ``blocks`` held; ``measured_sparsity``: blocks of the dense grid over blocks of the sparse one.
    """
    layer = Layer(particles, sparsity=sparsity, aligned=True)
    runs = _loaded([Case(layer, 1, kind, device, observed=False) for kind in INDEXES])
    row: dict[str, Any] = {"sparsity": sparsity, "particles": runs[0].n}
    for run, m in zip(runs, take_turns(runs, repeats), strict=True):
        row[run.case.index] = {**_times(m), "bytes": m["memory"]["bytes"], "blocks": count_blocks(run.engine).occupied}
    if "dense" in row:
        row["measured_sparsity"] = row["dense"]["blocks"] / row["sparse"]["blocks"]
        row["speed_up"] = row["dense"]["step"] / (row["sparse"]["step"] + row["sparse"]["index"])
        row["memory_ratio"] = row["dense"]["bytes"] / row["sparse"]["bytes"]
    return row


def _loaded(cases: Sequence[Case]) -> list[TimedRun]:
    """The cases that fit into the memory; the sparse one must."""
    runs = [TimedRun(cases[0])]
    for case in cases[1:]:
        try:
            runs.append(TimedRun(case))
        except (BudgetError, CapacityError, MemoryError):
            continue
    return runs


def _times(m: dict[str, Any]) -> dict[str, float]:
    """Seconds of a step without its index, and those of the index spread over the steps."""
    index = m["ns_per_particle_step"]["index"] * 1e-9 * m["particles"]
    return {"step": m["particles"] / m["rate_of_steps"] - index, "index": index}
