"""Limits of the processor: copy bandwidth and rate of multiply-adds, measured with numba, as the kernels are compiled."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import get_num_threads, njit, prange, set_num_threads

COPIED = 2**25  # float32 numbers: 128 MiB an array, larger than caches
CHUNK = 2**16  # numbers that a thread copies at a time
FMA_NUMBERS = 4096  # of one pass; they stay in the first-level cache
FMA_CHAIN = 16  # multiply-adds of a number in one pass; longer chains fill the scheduler and wait for each other
FMA_PASSES = 4000
OPTIONS: dict[str, Any] = {"error_model": "numpy", "boundscheck": False, "fastmath": {"contract"}}


@njit(parallel=True, **OPTIONS)
def _copy(source, target):
    for chunk in prange(source.size // CHUNK):
        for k in range(np.uint64(chunk * CHUNK), np.uint64((chunk + 1) * CHUNK)):
            target[k] = source[k]


@njit(forceinline=True, **OPTIONS)
def _four(x, a, b):
    return (((x * a + b) * a + b) * a + b) * a + b


@njit(forceinline=True, **OPTIONS)
def _sixteen(x, a, b):
    return _four(_four(_four(_four(x, a, b), a, b), a, b), a, b)


@njit(parallel=True, **OPTIONS)
def _multiply_add(x, a, b, passes):
    for row in prange(x.shape[0]):
        own = x[row]
        for _ in range(passes):
            for k in range(np.uint64(own.size)):
                own[k] = _sixteen(own[k], a, b)


def copy_bandwidth(threads: int, repetitions: int = 5) -> float:
    """Bandwidth of a copy of arrays larger than the caches [bytes/s]: bytes read plus bytes written, best of ``repetitions``."""
    source, target = np.ones(COPIED, np.float32), np.zeros(COPIED, np.float32)
    return 2 * source.nbytes / _best(lambda: _copy(source, target), threads, repetitions)


def multiply_add_rate(threads: int, repetitions: int = 5) -> float:
    """Bound of multiply-adds of float32 numbers in registers [1/s]: that of one thread, best of ``repetitions``, times ``threads``.

    One thread is measured by its processor time. The wall time of several counts what else runs, and is no bound.
    """
    x = np.full((1, FMA_NUMBERS), 0.5, np.float32)
    work = x.size * FMA_CHAIN * FMA_PASSES
    return threads * work / _best(lambda: _multiply_add(x, np.float32(0.999), np.float32(0.001), FMA_PASSES), 1, repetitions)


def _best(work: Callable[[], None], threads: int, repetitions: int) -> float:
    """Shortest time [s]; the first call compiles and does not count."""
    clock = time.process_time if threads == 1 else time.perf_counter  # so that other work on the machine hardly counts
    before, seconds = get_num_threads(), []
    set_num_threads(threads)
    try:
        work()
        for _ in range(repetitions):
            started = clock()
            work()
            seconds.append(clock() - started)
    finally:
        set_num_threads(before)
    return min(seconds)
