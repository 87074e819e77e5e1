"""Heights of particles above each other, staggered from column to column: ordered dither."""

import numpy as np

ORDER = np.array([[0, 2], [3, 1]])  # neighbours lie as far apart as can be
LEVELS = ORDER.size


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


def half_size(height: np.ndarray) -> np.ndarray:
    """Half the distance [m] of two levels, of layers of a ``height`` (n,) [m]: the lowest particles touch the ground with it."""
    return 0.5 * height / LEVELS
