"""Sets how long a thread that waits for others keeps its core."""

import os
from collections.abc import MutableMapping

SPINS = 10_000  # turns of the loop in which a thread of libgomp waits, of its own 300,000: 0.2 of 7 ms where it was measured
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
