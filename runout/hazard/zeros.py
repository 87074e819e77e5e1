"""Zeros that take memory only where they change."""

import math
import mmap
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import DTypeLike


def zeros_by_page(shape: tuple[int, ...], dtype: DTypeLike) -> np.ndarray[Any, Any]:
    """Zeros of which a page of the system, 4 KiB on most, takes memory with the first value that changes in it.

    ``numpy.zeros`` asks Linux for pages of 2 MiB in arrays above 4 MiB. A flow in a few rows of a map then takes most of the map.
    Without that choice of pages, as on other systems, they are those of ``numpy.zeros``.
    """
    if not hasattr(mmap, "MADV_NOHUGEPAGE"):
        return np.zeros(shape, dtype)
    values = math.prod(shape)
    size = max(1, values * np.dtype(dtype).itemsize)
    try:
        memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError as cause:
        raise MemoryError(f"{size} bytes for maps of {shape} cells") from cause
    with suppress(OSError):  # of a kernel without huge pages
        memory.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(memory, dtype, values).reshape(shape)
