"""Where the boundary of a modelled area lies beside an observed outline: a mean distance for each part of the outline.

The outline is cut into parts of equal length, of which the first one has the front in its middle. A cell belongs to the part that
its centre is nearest to. The distance of a part is the area that the model reaches beyond the outline, less the area that it does
not reach inside of it, over the length of the part. It changes smoothly with the parameters, unlike the critical success index or
the symmetric difference, which have a kink where the areas agree. The sum of distance times length is the difference of the areas.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from runout.report.members import Reach

PARTS = 8
FRONT = 0.95  # share of the largest distance from the release from which a point belongs to the front
STEPS = 64  # points along each part, from which the distances of cells are taken


@dataclass(frozen=True)
class OutlineParts:
    """Parts of an observed outline on the cells of a grid."""

    nearest: np.ndarray  # (rows, columns) of int: part that each cell belongs to, from 0
    observed: np.ndarray  # (rows, columns): share of each cell inside the outline [1]
    length: float  # length of each part [m]
    cell_area: float  # [m2]

    @classmethod
    def of(cls, outline: Any, observed: np.ndarray, reach: "Reach") -> "OutlineParts":
        """Parts of an outline (Polygon or MultiPolygon in map coordinates); holes have no part of their own."""
        from scipy.spatial import KDTree

        points, length = _along(outline)
        front = _front(_distances(points, reach))
        part = ((np.arange(len(points)) - front + STEPS // 2) // STEPS) % PARTS
        easting, northing = np.meshgrid(reach.easting, reach.northing)
        nearest = KDTree(points).query(np.column_stack([easting.ravel(), northing.ravel()]))[1]
        return cls(part[nearest].reshape(easting.shape), np.nan_to_num(observed), length / PARTS, reach.cell_area)

    def distances(self, shares: np.ndarray) -> np.ndarray:
        """Mean distance (parts,) [m] of the boundary of reached shares (rows, columns) from the outline, positive beyond it."""
        difference = np.nan_to_num(shares) - self.observed
        areas = np.bincount(self.nearest.ravel(), difference.ravel(), PARTS) * self.cell_area
        return areas / self.length  # type: ignore[no-any-return]


def _along(outline: Any) -> tuple[np.ndarray, float]:
    """Equally spaced points (parts times steps, 2) along the exterior rings of an outline, and the length of the rings [m]."""
    import shapely
    from shapely.geometry.polygon import orient

    rings = [shapely.get_exterior_ring(orient(part)) for part in shapely.get_parts(outline).tolist()]
    ends = np.cumsum([ring.length for ring in rings])
    places = (np.arange(PARTS * STEPS) + 0.5) / (PARTS * STEPS) * ends[-1]
    of_ring = np.searchsorted(ends, places, side="right").clip(max=len(rings) - 1)
    starts = np.concatenate([[0.0], ends[:-1]])
    points = [shapely.line_interpolate_point(rings[k], s - starts[k]) for k, s in zip(of_ring, places, strict=True)]
    return shapely.get_coordinates(points), float(ends[-1])


def _front(distances: np.ndarray) -> int:
    """Place among points (n,) along rings in the middle of those that are nearly as far from the release as the farthest one."""
    places = np.flatnonzero(distances >= FRONT * distances.max())
    turns = np.exp(2j * np.pi * places / len(distances))
    return round(float(np.angle(turns.mean())) / (2.0 * np.pi) * len(distances)) % len(distances)


def _distances(points: np.ndarray, reach: "Reach") -> np.ndarray:
    """Distance [m] from the release at points (n, 2): that of their cells; beyond the grid, of the cells at its edge."""
    columns = np.abs(points[:, :1] - reach.easting).argmin(axis=1)
    rows = np.abs(points[:, 1:] - reach.northing).argmin(axis=1)
    return reach.distance[rows, columns]  # type: ignore[no-any-return]
