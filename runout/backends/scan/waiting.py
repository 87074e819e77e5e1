"""How long threads that wait for each other keep their cores."""

import os
from collections.abc import MutableMapping

SPINS = 10_000  # turns of the loop in which a thread of libgomp waits, of its own 300,000: 0.2 of 7 ms where it was measured
CHOSEN = ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")  # by which users say how threads wait


def wait_briefly(environment: MutableMapping[str, str] = os.environ) -> None:
    """Let threads sleep soon that wait for others, unless the environment says how they wait.

    A thread that waits in a loop keeps its core from the very thread that it waits for, where other programs take a core: each
    parallel part of a step then lasts as long as the loop. Between two such parts less time passes than the threads wait now.
    The library reads the variable when it is loaded, which numba does when it first calls a parallel kernel.
    """
    if not any(name in environment for name in CHOSEN):
        environment["GOMP_SPINCOUNT"] = str(SPINS)
