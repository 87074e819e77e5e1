"""Heights of particles above each other, staggered from column to column: ordered dither."""

import numpy as np

ORDER = np.array([[0, 2], [3, 1]])  # neighbours lie as far apart as can be
LEVELS = ORDER.size
CLOSE = 1e-9  # share of a layer by which round-off may miss


def shares(index: np.ndarray) -> np.ndarray:
    """Where in its layer a column's particles lie, from 0 at the bottom to 1 [1].

    Four levels, each once in every two by two columns: these together have four times as many particles above each other as one
    of them has. The lowest lies half a level above the bottom. The order is that of Bayer (1973, An optimum method for two-level
    rendition of continuous-tone pictures).

    Parameters
    ----------
    index : ndarray (n, 2)
        Of the columns, east and north.
    """
    return (ORDER[index[:, 0] % 2, index[:, 1] % 2] + 0.5) / LEVELS


def layered(index: np.ndarray, thickness: np.ndarray, layer: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which column (n,), height above its bottom [m] and own height [m] of particles that fill columns.

    Parameters
    ----------
    index : ndarray (m, 2)
        Of the columns, east and north.
    thickness : ndarray (m,)
        Of the columns [m]; each is divided into equal layers, one at least.
    layer : float
        About what a layer measures [m]; half of one more makes another layer.
    """
    rows = np.maximum(1, np.floor(thickness / layer + 0.5 + CLOSE)).astype(np.int64)  # round-off never tips a half
    column = np.repeat(np.arange(len(rows)), rows)
    row = np.arange(len(column)) - np.repeat(np.cumsum(rows) - rows, rows)
    height = (thickness / rows)[column]
    return column, (row + shares(index)[column]) * height, height


def half_size(height: np.ndarray) -> np.ndarray:
    """Half the distance [m] of two levels, of layers of a ``height`` (n,) [m]: the lowest particles touch the ground with it."""
    return 0.5 * height / LEVELS
