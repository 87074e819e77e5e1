"""Heights of particles, staggered from column to column by ordered dither."""

import numpy as np

ORDER = np.array([[0, 2], [3, 1]])  # levels of neighbours differ as much as possible
LEVELS = ORDER.size
CLOSE = 1e-9  # round-off as a share of a layer
PLASTIC = 0.7548776662466927, 0.5698402909980532  # steps of a sequence of low discrepancy in the plane (Roberts 2018)


def shares(index: np.ndarray) -> np.ndarray:
    """Position of the particles of a column within their layer, from 0 at the bottom to 1 [1].

    There are four levels, each once in every two by two columns. Together these have four times as many heights of particles as
    one column. The lowest level lies half a level above the bottom. The order is that of Bayer (1973, An optimum method for
    two-level rendition of continuous-tone pictures).

    ``index`` (n, 2): of the columns, east and north.
    """
    return (ORDER[index[:, 0] % 2, index[:, 1] % 2] + 0.5) / LEVELS


def rows(thickness: np.ndarray, layer: float) -> np.ndarray:
    """Layers (m,) of about ``layer`` [m] into which columns of a thickness (m,) [m] are divided, at least one."""
    return np.maximum(1, np.floor(thickness / layer + 0.5 + CLOSE)).astype(np.int64)  # a half is rounded up in spite of round-off


def layered(index: np.ndarray, thickness: np.ndarray, layer: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Column (n,), height above its bottom (n,) [m] and layer height (n,) [m] of particles that fill columns.

    Parameters
    ----------
    index : ndarray (m, 2)
        Of the columns, east and north.
    thickness : ndarray (m,)
        Of the columns [m]; each is divided into equal layers, one at least.
    layer : float
        Nominal height of a layer [m]; the number of layers is rounded to the nearest.
    """
    count = rows(thickness, layer)
    column = np.repeat(np.arange(len(count)), count)
    row = np.arange(len(column)) - np.repeat(np.cumsum(count) - count, count)
    height = (thickness / count)[column]
    return column, (row + shares(index)[column]) * height, height


def half_size(height: np.ndarray) -> np.ndarray:
    """Half the distance [m] of levels for layers of ``height`` (n,) [m]; with this radius the lowest particles touch the ground."""
    return 0.5 * height / LEVELS
