"""Values for cells whose elevation is unknown, where a formula needs some number and no physics will use it."""

import numpy as np


def filled(elevation: np.ndarray, cell_size: tuple[float, float]) -> np.ndarray:
    """Elevation (rows, columns) [m] with unknown cells given the value of the nearest known one."""
    unknown = np.isnan(elevation)
    return elevation[_nearest(unknown, cell_size)] if unknown.any() else np.array(elevation)


def continued(elevation: np.ndarray, cell_size: tuple[float, float], reach: float) -> np.ndarray:
    """Elevation (rows, columns) [m] with the slope of the known cells continued into the unknown ones.

    Point reflection at the nearest known cell, as beyond the rim of the raster: planes stay planes up to ``reach`` [m] from the
    known cells, so that an open edge neither dams nor drains the flow before it. Farther out the value stays constant.
    """
    unknown = np.isnan(elevation)
    if not unknown.any():
        return elevation
    nearest = _nearest(unknown, cell_size)
    z = elevation[nearest]
    here = np.stack(np.nonzero(unknown))
    edge = np.stack([axis[unknown] for axis in nearest])
    steps = edge - here
    length = np.hypot(steps[0] * cell_size[1], steps[1] * cell_size[0])
    mirrored = edge + np.rint(steps * np.minimum(1.0, reach / length)).astype(np.int64)
    inside = [np.clip(index, 0, count - 1) for index, count in zip(mirrored, elevation.shape, strict=True)]
    beyond = 2.0 * z[tuple(edge)] - z[tuple(inside)]
    z[unknown] = beyond
    return z  # type: ignore[no-any-return]


def _nearest(unknown: np.ndarray, cell_size: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Row and column (rows, columns) of the known cell that is nearest to each cell."""
    from scipy import ndimage

    sampling = (cell_size[1], cell_size[0])
    row, column = ndimage.distance_transform_edt(unknown, sampling=sampling, return_distances=False, return_indices=True)
    return row, column
