"""Converts attributes of an object to plain arrays and back, for checkpoints of a backend and a run."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

State = dict[str, np.ndarray]
KEPT = (np.ndarray, np.generic, bool, int, float)


def arrays_of(owner: object, omit: Collection[str] = (), prefix: str = "") -> State:
    """All arrays and numbers among the attributes of an object, by name; numbers become arrays without dimension.

    Other attributes (a scene, kernels, lists) are left out. Arrays are not copied: write them before the object changes.

    Parameters
    ----------
    owner : object
    omit : collection of str
        Attributes to leave out.
    prefix : str
        Put before each name.
    """
    kept = {name: value for name, value in vars(owner).items() if name not in omit}
    return {prefix + name: np.asarray(value) for name, value in kept.items() if isinstance(value, KEPT)}


def part(state: Mapping[str, np.ndarray], prefix: str) -> State:
    """The entries of a state that start with ``prefix``, without it."""
    return {name.removeprefix(prefix): value for name, value in state.items() if name.startswith(prefix)}


def plain(value: np.ndarray) -> Any:
    """The array, or for an array without dimension its number."""
    if value.ndim:
        return value
    return value.item() if value.dtype in (np.float64, np.int64, np.bool_) else value[()]


def put_arrays(owner: object, state: Mapping[str, np.ndarray], prefix: str = "") -> None:
    """Set the attributes of an object from the result of :func:`arrays_of`."""
    for name, value in part(state, prefix).items():
        setattr(owner, name, plain(value))
