"""Time of every launch of a step and of a sort with a new index, by events of the device: what a change of a kernel is judged by.

    python tests/benchmarks/gpu_launches.py cuda:0 [SIZE [PARTICLES OF A CELL ABOVE EACH OTHER]]

Prints the throughput twice over 128 steps, then milliseconds a launch, medians of 14 steps after a sort, and of one sort.
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
        found = call(*arguments, **options)
        marked(name or arguments[0].key)
        return found

    return noted


def told(title: str, steps: int) -> None:
    """Print the time between the marks by name, medians over launches times their number in a step, and forget them."""
    wp.synchronize()
    times: dict[str, list[float]] = {}
    for (_, before), (name, after) in pairwise(log):
        times.setdefault(name, []).append(wp.get_event_elapsed_time(before, after))
    sums = {name: float(np.median(taken)) * len(taken) / steps for name, taken in times.items()}
    print(f"{title} {sum(sums.values()):.3f} ms:", ", ".join(f"{name} {ms:.3f}" for name, ms in sums.items()))
    log.clear()


def main() -> None:
    """Measure and print."""
    size, upwards = (sys.argv[2:] + ["10M", "2"][len(sys.argv[2:]) :])[:2]
    scene, p = layer(*LAYERS[size], upwards=int(upwards))
    backend = loaded(sys.argv[1], scene, p)
    dt = STEP * backend.stable_step()
    backend.steps(dt, 68)
    for _ in range(2):
        started = time.perf_counter()
        backend.steps(dt, 128)
        print(f"{128 * len(p) / (time.perf_counter() - started) / 1e9:.3f} G particle-steps/s")
    with wp.ScopedDevice(sys.argv[1]):
        for _ in range(8):  # the first are launched one by one, then come two that record a graph, and graphs
            started = time.perf_counter()
            backend._rebuild()
            launched = time.perf_counter()
            backend._settle()
            ends = [1e3 * (end - started) for end in (launched, time.perf_counter())]
            print(f"sort: the host is free after {ends[0]:.2f} ms, the device after {ends[1]:.2f} ms")
        backend.graphs = False
        backend.left.fill_(2 * STEPS)
        backend.flags.zero_()
        backend._enqueue(), backend._enqueue()
        wp.synchronize()
        wp.launch, wp.launch_tiled, wp.copy = watched(wp.launch), watched(wp.launch_tiled), watched(wp.copy, "copy")
        marked()
        for _ in range(STEPS):
            backend._enqueue()
        told("step", STEPS)
        marked()
        backend._rebuild()
        told("sort", 1)
        backend._settle()
    assert np.isfinite(backend.ledger().kinetic_energy)


if __name__ == "__main__":
    main()
