"""Time of every launch of a step and of a sort with a new index, by events of the device: what a change of a kernel is judged by.

    python tests/benchmarks/gpu_launches.py cuda:0 [SIZE [PARTICLES OF A CELL ABOVE EACH OTHER [COURANT NUMBER]]]

Prints the throughput twice over 128 steps, then milliseconds a launch, medians of 14 steps after a sort, and of one sort; and what
contact takes of a step: finding and solving it of the launches, and with its part of a sort of a step with its share of that.
Run it for two commits in turn on one card and host: the sort waits for the host where that is slow.
"""

import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parent))

from gpu_throughput import LAYERS, STEP, layer, loaded

from runout.backends.hash.step import enqueue
from runout.model.limits import CFL

STEPS = 14  # fewer than to the next sort
log: list[tuple[str, Any]] = []


def marked(name: str = "start") -> None:
    """Note the present moment on the device."""
    event = wp.Event(enable_timing=True)
    wp.record_event(event)
    log.append((name, event))


def watched(call: Callable[..., Any], name: str = "") -> Callable[..., Any]:
    """The same call, noted when it is done."""

    def noted(*arguments: Any, **options: Any) -> Any:
        value = call(*arguments, **options)
        marked(name or arguments[0].key)
        return value

    return noted


def told(title: str, steps: int) -> dict[str, float]:
    """Print the time [ms] between the marks by name, medians over launches times their number in a step, and forget them."""
    wp.synchronize()
    times: dict[str, list[float]] = {}
    for (_, before), (name, after) in pairwise(log):
        times.setdefault(name, []).append(wp.get_event_elapsed_time(before, after))
    sums = {name: float(np.median(taken)) * len(taken) / steps for name, taken in times.items()}
    print(f"{title} {sum(sums.values()):.3f} ms:", ", ".join(f"{name} {ms:.3f}" for name, ms in sums.items()))
    log.clear()
    return sums


def ground_of_a_sort(backend: Any, turns: int = 20) -> float:
    """Time [ms] that a sort takes for the ground, as a graph; the nodes hold what it leaves there until the next sort."""
    with wp.ScopedCapture() as capture:
        parts = backend.parts
        parts.ground.cut(parts.k, parts.index, parts.nodes, parts.scenes)
    wp.capture_launch(capture.graph)
    begin, end = wp.Event(enable_timing=True), wp.Event(enable_timing=True)
    wp.record_event(begin)
    for _ in range(turns):
        wp.capture_launch(capture.graph)
    wp.record_event(end)
    wp.synchronize()
    return float(wp.get_event_elapsed_time(begin, end)) / turns


def main() -> None:
    """Measure and print."""
    size, upwards, courant = (sys.argv[2:] + ["10M", "2", str(STEP * CFL)][len(sys.argv[2:]) :])[:3]
    scene, p = layer(*LAYERS[size], upwards=int(upwards))
    backend = loaded(sys.argv[1], scene, p)
    share = float(courant) / CFL
    backend.steps(share * backend.stable_step(), 68)
    sorts = backend.counters.rebuilds
    for _ in range(2):
        dt = share * backend.stable_step()  # the flow gains speed
        started = time.perf_counter()
        backend.steps(dt, 128)
        print(f"{128 * len(p) / (time.perf_counter() - started) / 1e9:.3f} G particle-steps/s")
    between = 256 / (backend.counters.rebuilds - sorts)
    backend.steps(share * backend.stable_step(), 2)
    with wp.ScopedDevice(sys.argv[1]):
        ground = ground_of_a_sort(backend)
        whole = np.inf
        for _ in range(8):  # the first are launched one by one, then come two that record a graph, and graphs
            started = time.perf_counter()
            backend._rebuild()
            launched = time.perf_counter()
            backend._settle()
            ends = [1e3 * (end - started) for end in (launched, time.perf_counter())]
            whole = min(whole, ends[1])
            print(f"sort: the host is free after {ends[0]:.2f} ms, the device after {ends[1]:.2f} ms")
        parts = backend.parts
        backend.graphs.enabled = False
        parts.scenes.group.left.fill_(2 * STEPS)
        parts.status.flags.zero_()
        enqueue(parts), enqueue(parts)
        wp.synchronize()
        wp.launch, wp.launch_tiled, wp.copy = watched(wp.launch), watched(wp.launch_tiled), watched(wp.copy, "copy")
        marked()
        for _ in range(STEPS):
            enqueue(parts)
        step = told("step", STEPS)
        marked()
        backend._rebuild()
        told("sort", 1)
        backend._settle()
    contact = sum(step[name] for name in ("find_contacts", "solve_contacts") if name in step)
    launches = sum(step.values())
    with_sorts = 100 * (contact + ground / between) / (launches + whole / between)
    print(f"contact {contact:.3f} of {launches:.3f} ms, {100 * contact / launches:.1f} %;")
    print(f"    with {ground:.2f} for the ground in a sort of {whole:.2f} ms, one every {between:.1f} steps, {with_sorts:.1f} %")
    assert np.isfinite(backend.ledger().kinetic_energy)


if __name__ == "__main__":
    main()
