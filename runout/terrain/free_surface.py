"""The free surface of a release: the natural ground, or the top of what lies on it."""

from dataclasses import replace

import numpy as np

from runout.model.release import Placement, Release
from runout.model.surface import Surface
from runout.terrain.fill import filled
from runout.terrain.sdf import sliding_surface

AROUND = 3  # cells of the grid around the release that its surface may look at


def free_surface(release: Release, spacing: tuple[float, float]) -> tuple[Surface, tuple[float, float]]:
    """Free surface of a release, smooth on a lattice of about ``spacing`` [m], and the local position of its origin [m].

    At its rim a mass on the ground may end with a step; the surface goes on there as inside, since a step is no slope.
    """
    terrain, (rows, columns) = release.terrain, _window(release, spacing)
    elevation = filled(terrain.elevation[rows, columns], terrain.cell_size)
    if release.placement is Placement.ON_SURFACE:
        elevation = elevation + _continued(release.thickness[rows, columns], terrain.cell_size)
    origin = (columns.start * terrain.cell_size[0], (terrain.shape[0] - rows.stop) * terrain.cell_size[1])
    return sliding_surface(replace(terrain, elevation=elevation), None, spacing), origin


def _window(release: Release, spacing: tuple[float, float]) -> tuple[slice, slice]:
    """Rows and columns of the terrain around a release."""
    window = []
    for axis, size in ((0, 1), (1, 0)):
        used = np.flatnonzero((release.thickness > 0).any(axis=1 - axis))
        more = 3 + int(np.ceil(AROUND * spacing[size] / release.terrain.cell_size[size]))
        window.append(slice(max(0, int(used[0]) - more), min(release.terrain.shape[axis], int(used[-1]) + 1 + more)))
    return window[0], window[1]


def _continued(thickness: np.ndarray, cell_size: tuple[float, float]) -> np.ndarray:
    """Thickness (rows, columns) [m] of the cells that lie wholly inside, and beyond them that of the nearest one."""
    from scipy import ndimage

    inside = ndimage.binary_erosion(thickness > 0, np.ones((3, 3)), border_value=1)
    return filled(np.where(inside if inside.any() else thickness > 0, thickness, np.nan), cell_size)
