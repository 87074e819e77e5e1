"""Checks arrays and numbers of callers: real numbers, or one clear error; and the window of an array that is in use."""

from typing import Any

import numpy as np

from runout.errors import InputError

REAL = "iuf"  # kinds of NumPy types that are real numbers; bool is excluded
LARGEST_TEXT = 80  # characters of a value in a message


def real_array(values: Any, what: str, error: type[InputError]) -> np.ndarray:
    """A new float64 array of real numbers, of the shape of the values; masked values become NaN.

    Raises the given error for anything else; ``what`` names the values in its message, with their source.
    """
    try:
        array: Any = np.ma.asarray(values)
        if array.dtype.kind == "O":
            array = array.astype(np.float64)
    except (TypeError, ValueError, OverflowError) as cause:
        raise error(f"{what} is {shown(values)}; an array of numbers is needed") from cause
    if array.dtype.kind not in REAL:
        raise error(f"{what} is an array of {array.dtype}; an array of real numbers is needed")
    return np.array(np.ma.filled(array.astype(np.float64), np.nan))


def real_pair(value: Any, what: str, error: type[InputError]) -> tuple[float, float]:
    """Two finite numbers from two, or from one that is used twice; raises an error for anything else."""
    numbers = real_array(value, what, error)
    if numbers.shape not in ((), (1,), (2,)) or not np.isfinite(numbers).all():
        raise error(f"{what} is {shown(value)}; one or two finite numbers are needed")
    first, second = np.broadcast_to(numbers, 2)
    return float(first), float(second)


def window_of(cells: np.ndarray, margin: tuple[int, int] = (0, 0)) -> tuple[slice, slice]:
    """Rows and columns that hold all cells that are not 0, and a margin of rows and columns around them; all if all are 0."""
    spans = []
    for axis, more, size in zip((1, 0), margin, cells.shape, strict=True):
        used = np.flatnonzero(cells.any(axis=axis))
        spans.append(slice(max(0, int(used[0]) - more), min(size, int(used[-1]) + 1 + more)) if used.size else slice(0, size))
    return spans[0], spans[1]


def shown(value: Any) -> str:
    """A value as text for a message, shortened if it is long."""
    text = repr(value)
    return text if len(text) <= LARGEST_TEXT else f"{text[:LARGEST_TEXT]} ..."
