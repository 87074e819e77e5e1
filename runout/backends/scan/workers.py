"""Threads of a backend, and a buffer for one block of particles for each of them."""

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.backends.scan.groups import Buffers
from runout.backends.scan.state import PADDING, bytes_of

PARTICLES_PER_THREAD = 10_000  # below, waiting for each other costs more than threads gain


@dataclass
class Workers:
    """Threads that share the work."""

    # allowed, threads: most threads, and those in use
    allowed: int
    threads: int
    buffers: Buffers

    @classmethod
    def at_most(cls, threads: int | None) -> "Workers":
        """``threads``, by default all that the process may use."""
        import numba

        settings: Any = numba.config
        available = min(settings.NUMBA_NUM_THREADS, len(os.sched_getaffinity(0)))
        return cls(min(threads or available, available), 1, _buffers(1, 0, np.float32))

    def divide(self, particles: int) -> None:
        """Use as many threads as pay for so many particles."""
        self.threads = max(1, min(self.allowed, particles // PARTICLES_PER_THREAD))

    def fit(self, fullest: int, real: Any) -> None:
        """Make buffers that hold the fullest block, and some more."""
        self.buffers = _buffers(self.threads, int(1.25 * fullest) + 2 * PADDING, real)

    def too_small(self, fullest: int) -> bool:
        """Whether the buffers have no room for the fullest block."""
        return fullest + PADDING > self.buffers.rec.shape[1]

    def memory(self) -> dict[str, int]:
        """Bytes by array."""
        return bytes_of(self.buffers)


def _buffers(threads: int, particles: int, real: Any) -> Buffers:
    shape = threads, particles
    records, states = (np.empty((*shape, width), real) for width in (16, 8))
    return Buffers(records, states, np.empty(shape, np.int32), np.empty(shape, np.uint8), np.empty(shape, real))
