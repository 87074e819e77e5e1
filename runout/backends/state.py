"""Attributes of an object as plain arrays, and back: what a checkpoint holds of a backend and of a run."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

State = dict[str, np.ndarray]
KEPT = (np.ndarray, np.generic, bool, int, float)


def arrays_of(owner: object, omit: Collection[str] = (), prefix: str = "") -> State:
    """Every array and number among the attributes of an object by name, numbers as arrays without dimension.

    What is neither (a scene, kernels, lists) is not kept. Arrays are not copied: write them before the object goes on.

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
    """An array as it is, or the number of Python or NumPy that an array without dimension was made of."""
    if value.ndim:
        return value
    return value.item() if value.dtype in (np.float64, np.int64, np.bool_) else value[()]


def put_arrays(owner: object, state: Mapping[str, np.ndarray], prefix: str = "") -> None:
    """Set the attributes of an object to what :func:`arrays_of` gave."""
    for name, value in part(state, prefix).items():
        setattr(owner, name, plain(value))
