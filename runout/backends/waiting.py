"""Sets how long a thread that waits for others, or for a GPU, keeps its core."""

import os
import time
from collections.abc import MutableMapping
from typing import Any

SPINS = 10_000  # turns of the loop in which a thread of libgomp waits, of its own 300,000: 0.2 of 7 ms where it was measured
LOOPED, NAP, LONGEST = 5e-4, 5e-5, 1.0  # [s] that a thread loops for a GPU, that it sleeps then each time, and that all takes
CHOSEN = ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")  # by which users say how threads wait


def wait_briefly(environment: MutableMapping[str, str] = os.environ) -> None:
    """Let waiting threads sleep after a short time, unless the environment says how threads wait.

    A waiting thread that loops keeps its core. Where other programs use cores too, that may be the core of the thread it waits for:
    each parallel part of a step then lasts as long as the loop. The time set here is longer than the time between two parallel
    parts of a step. Beside a GPU the host has a parallel part every few milliseconds, when it raises the maps: threads would loop
    all the time. The library reads the variable when numba first calls a parallel kernel.
    """
    if not any(name in environment for name in CHOSEN):
        environment["GOMP_SPINCOUNT"] = str(SPINS)


def wait_for(event: Any) -> None:
    """Wait until a GPU has come to an ``event`` of warp.

    The wait of the driver keeps the core. Here the thread loops for a short time, then it looks between short sleeps. An event that
    has failed never comes: the driver waits for one that takes long, and raises the error.
    """
    import warp as wp

    began = time.perf_counter()
    while not event.is_complete and (waited := time.perf_counter() - began) < LONGEST:
        if waited > LOOPED:
            time.sleep(NAP)
    wp.synchronize_event(event)
