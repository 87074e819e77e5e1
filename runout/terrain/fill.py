"""Values for cells whose elevation is unknown, where a formula needs some number and no physics will use it."""

import numpy as np


def filled(elevation: np.ndarray, cell_size: tuple[float, float]) -> np.ndarray:
    """Elevation (rows, columns) [m] with unknown cells given the value of the nearest known one."""
    unknown = np.isnan(elevation)
    if not unknown.any():
        return np.array(elevation)
    from scipy import ndimage

    sampling = (cell_size[1], cell_size[0])
    nearest = ndimage.distance_transform_edt(unknown, sampling=sampling, return_distances=False, return_indices=True)
    return elevation[tuple(nearest)]
