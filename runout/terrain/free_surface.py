"""The free surface of a release: the natural ground, or the top of what lies on it."""

import math
from dataclasses import dataclass, replace

import numpy as np

from runout.model.arrays import window_of
from runout.model.release import Release
from runout.model.surface import Surface
from runout.terrain.open_edge import filled
from runout.terrain.sdf import raster_surface

AROUND = 3  # cells of the grid around the release that its surface looks at


@dataclass(frozen=True)
class FreeSurface:
    """Slopes of the free surface of a release, smooth on the scale of the grid."""

    ground: Surface  # natural ground around the release
    origin: tuple[float, float]  # local position of its south-west corner [m]
    cell_size: tuple[float, float]  # cells of the terrain, east and north [m]
    # (2, nx, ny): slopes east and north of the thickness of what lies on the ground [1], from the south-west corner
    thickness_slopes: np.ndarray | None

    def slopes(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Slopes east and north (n,) [1] at local positions (n,) [m]."""
        x, y = x - self.origin[0], y - self.origin[1]
        _, east, north = self.ground.evaluate(x, y)
        if self.thickness_slopes is None:
            return east, north
        places = zip((x, y), self.cell_size, self.thickness_slopes.shape[1:], strict=True)
        i, j = (np.clip((place / size).astype(np.int64), 0, count - 1) for place, size, count in places)
        return east + self.thickness_slopes[0, i, j], north + self.thickness_slopes[1, i, j]


def free_surface(release: Release, spacing: tuple[float, float]) -> FreeSurface:
    """The free surface of a release, on a grid of ``spacing`` [m] in plan."""
    terrain, (rows, columns) = release.terrain, _window(release, spacing)
    ground = replace(terrain, elevation=filled(terrain.elevation[rows, columns], terrain.cell_size))
    origin = (columns.start * terrain.cell_size[0], (terrain.shape[0] - rows.stop) * terrain.cell_size[1])
    slopes = None
    heap = release.heap[rows, columns]
    if heap.any():
        slopes = _slopes(heap[::-1].T, terrain.cell_size, spacing)
    return FreeSurface(raster_surface(ground, None, spacing), origin, terrain.cell_size, slopes)


def _window(release: Release, spacing: tuple[float, float]) -> tuple[slice, slice]:
    """Rows and columns of the terrain around a release."""
    (dx, dy), cells = release.terrain.cell_size, release.thickness > 0
    return window_of(cells, margin=(3 + math.ceil(AROUND * spacing[1] / dy), 3 + math.ceil(AROUND * spacing[0] / dx)))


def _slopes(thickness: np.ndarray, cell_size: tuple[float, float], spacing: tuple[float, float]) -> np.ndarray:
    """Slopes (2, nx, ny) [1] of a thickness (nx, ny) [m] between cells wholly inside, averaged over a cell of the grid.

    At its rim a mass may end with a step, which is no slope: cells there take that of the nearest ones inside.
    """
    from scipy import ndimage

    inside = ndimage.binary_erosion(thickness > 0, np.ones((3, 3)), border_value=1)
    known = np.where(inside if inside.any() else thickness > 0, thickness, np.nan)
    slopes = np.zeros((2, *thickness.shape))
    for axis, size in enumerate(cell_size):
        steps = np.diff(known, axis=axis, prepend=np.nan, append=np.nan) / size
        both = np.stack([steps.take(range(n, n + thickness.shape[axis]), axis) for n in (0, 1)])
        count = np.isfinite(both).sum(axis=0)
        mean = np.where(count > 0, np.nansum(both, axis=0) / np.maximum(count, 1), np.nan)
        if count.any():
            whole = [max(1, round(h / cell)) for h, cell in zip(spacing, cell_size, strict=True)]
            slopes[axis] = ndimage.uniform_filter(filled(mean, cell_size[::-1]), whole, mode="nearest")
    return slopes
