"""The domain of a scene: its raster without the cells that have no elevation. Mass that leaves it is booked as escaped.

Only particles of blocks near the edge of the domain are tested.
"""

import math

import numpy as np

from runout.backends.scan.groups import Domain
from runout.model.scene import Scene

BEFORE, BEHIND = 2, 8  # cells west and south of the first cell of a block, and east and north, that its particles may reach


def domain_of(scene: Scene, corner: np.ndarray) -> Domain:
    """The domain of a scene, counted from the node ``corner`` (3,)."""
    raster, spacing = scene.raster, np.array(scene.spacing[:2])
    cell = np.array(raster.cell_size) / spacing
    size = np.array([raster.columns, raster.rows]) * np.array(raster.cell_size) / spacing
    limits = np.stack([-corner[:2], size - corner[:2]], axis=1).ravel()
    unknown = np.zeros((1, 1), np.bool_) if scene.unknown is None else np.ascontiguousarray(scene.unknown)
    sums = np.pad(np.cumsum(np.cumsum(unknown, axis=0, dtype=np.int64), axis=1), ((1, 0), (1, 0)))
    return Domain(np.concatenate([limits, cell]).astype(np.float64), unknown, sums)


def blocks_at_edge(domain: Domain, bxyz: np.ndarray) -> np.ndarray:
    """Whether particles of blocks (n, 3) may leave the domain before the index is rebuilt."""
    first, limits = 4 * bxyz[:, :2], domain.limits
    beside = ((first - BEFORE < limits[:4:2]) | (first + BEHIND > limits[1:4:2])).T
    if not domain.sums[-1, -1]:
        return beside[0] | beside[1]  # type: ignore[no-any-return]
    low, high = (
        np.clip(np.floor((first + by - limits[:4:2]) / limits[4:]).astype(np.int64), 0, np.array(domain.unknown.shape))
        for by in (-BEFORE, BEHIND + limits[4:])
    )
    (i, j), (k, m), s = low.T, high.T, domain.sums
    return beside[0] | beside[1] | (s[k, m] - s[i, m] - s[k, j] + s[i, j] > 0)  # type: ignore[no-any-return]


def _lies_in_domain(bxyz, b, c, rec, slot, domain):
    """Whether a particle whose cell has the coordinates ``c`` relative to a block lies in the domain."""
    limits, unknown = domain.limits, domain.unknown
    x = 4 * bxyz[b, 0] + c[0] + np.float64(rec[slot, 4])
    y = 4 * bxyz[b, 1] + c[1] + np.float64(rec[slot, 8])
    if not (x >= limits[0] and x <= limits[1] and y >= limits[2] and y <= limits[3]):
        return False
    i = min(np.int64(math.floor((x - limits[0]) / limits[4])), unknown.shape[0] - 1)
    j = min(np.int64(math.floor((y - limits[2]) / limits[5])), unknown.shape[1] - 1)
    return not unknown[i, j]
