"""Coordinates along and across a thalweg, and the errors of front and sides of a flow in them."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from runout.errors import ObservationError


@dataclass(frozen=True)
class Thalweg:
    """A line that the flow follows, from above the release to beyond the front.

    Coordinates of a point are s, the length along the line to the nearest point of it, and l, the distance from there, positive
    on the left when looking downstream. This is the system of AIMEC (Fischer 2013, Nat. Hazards Earth Syst. Sci. 13:1655)
    without its raster: each cell keeps its area. Beyond both ends the line goes on straight: s is below 0 or above its length.
    In the wedge outside of a bend all points have the s of the vertex. Inside a bend a point belongs to the nearer of the two
    branches.

    Attributes
    ----------
    points : ndarray (n, 2)
        Vertices [m], in map coordinates, downstream.

    Raises
    ------
    ObservationError
        If there are fewer than two different points, one is not finite, or the line crosses itself.
    """

    points: np.ndarray

    def __post_init__(self) -> None:
        points = np.asarray(self.points, np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
            raise ObservationError(f"thalweg: its points have the shape {points.shape}; finite points (n, 2) are needed")
        moved = np.ones(len(points), bool)
        moved[1:] = np.hypot(*np.diff(points, axis=0).T) > 0
        if moved.sum() < 2:
            raise ObservationError("thalweg: fewer than two different points; draw it from above the release to beyond the front")
        object.__setattr__(self, "points", points[moved])
        self._require_simple()

    def _require_simple(self) -> None:
        """Raise an error with the place if the line crosses itself: a place there would have two lengths along it."""
        import shapely

        line = shapely.LineString(self.points)
        if shapely.is_simple(line):
            return
        ends = shapely.get_coordinates(shapely.boundary(shapely.get_parts(shapely.node(line))))
        crossings = [end for end in ends if not (end == self.points[[0, -1]]).all(axis=1).any()]
        where = "{:.6g} east, {:.7g} north".format(*(crossings or [self.points[0]])[0])
        raise ObservationError(f"thalweg: the line crosses itself at {where}; draw it without a loop")

    @cached_property
    def vertex_s(self) -> np.ndarray:
        """Length along the line to each vertex (n,) [m]."""
        return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.points, axis=0).T))])

    @property
    def length(self) -> float:
        """Length of the line [m]."""
        return float(self.vertex_s[-1])

    @cached_property
    def directions(self) -> np.ndarray:
        """Unit vectors (n - 1, 2) of the segments, downstream."""
        steps = np.diff(self.points, axis=0)
        return steps / np.hypot(*steps.T)[:, None]  # type: ignore[no-any-return]

    def coordinates(self, easting: Any, northing: Any) -> tuple[np.ndarray, np.ndarray]:
        """s and l [m] of points; arrays of one shape, in map coordinates [m]."""
        import shapely

        x, y = np.broadcast_arrays(np.asarray(easting, np.float64), np.asarray(northing, np.float64))
        place = np.column_stack([x.ravel(), y.ravel()]) - self.points[0]
        line = shapely.LineString(self.points - self.points[0])
        nearest = shapely.line_locate_point(line, shapely.points(place))
        segment = np.clip(np.searchsorted(self.vertex_s, nearest, "right") - 1, 0, len(self.directions) - 1)
        s, across = self._beside(place, segment)
        round_off = 1e-9 * self.length  # of the length that shapely finds
        inside = (nearest > round_off) & (nearest < self.length - round_off)
        distance = shapely.distance(line, shapely.points(place))
        return (
            np.where(inside, nearest, s).reshape(x.shape),
            np.where(inside, np.copysign(distance, across), across).reshape(x.shape),
        )

    def _beside(self, place: np.ndarray, segment: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """s and l of points (n, 2) from the first vertex, each by the straight line through its segment."""
        direction, offset = self.directions[segment], place - (self.points - self.points[0])[segment]
        s = self.vertex_s[segment] + (offset * direction).sum(axis=1)
        return s, direction[:, 0] * offset[:, 1] - direction[:, 1] * offset[:, 0]

    def resampled(self, spacing: float) -> "Thalweg":
        """The line with further vertices, at most ``spacing`` [m] apart."""
        import shapely

        if not spacing > 0:
            raise ObservationError(f"thalweg: the spacing is {spacing:g} m; it must be above 0")
        return Thalweg(shapely.get_coordinates(shapely.segmentize(shapely.LineString(self.points), spacing)))

    def at(self, s: Any) -> np.ndarray:
        """Map coordinates (..., 2) [m] of places on the line and its straight continuations."""
        s = np.asarray(s, np.float64)
        segment = np.clip(np.searchsorted(self.vertex_s, s, "right") - 1, 0, len(self.directions) - 1)
        return self.points[segment] + (s - self.vertex_s[segment])[..., None] * self.directions[segment]  # type: ignore[no-any-return]


@dataclass(frozen=True)
class ThalwegErrors:
    """Errors of the outline of a flow along and across a thalweg.

    Attributes
    ----------
    modelled_front, observed_front : float
        Farthest s [m] that the flow reaches; NaN if it reaches no cell.
    lateral_error : float
        Mean absolute difference [m] of the left and right edges, over the stretch that both flows reach; 0 is best.
    lateral_shift : float
        Mean displacement [m] of the middle between the edges, positive to the left; 0 is best.
    width_bias : float
        Modelled over observed mean width on that stretch [1], each by the area of the cells; 1 is best.
    stretch : float
        Length [m] of that stretch; the three are NaN if it is 0.
    outside : int
        Reached cells that lie farther than the half width from the line and are in no number.
    observed_width : float
        Mean width [m] of the observed flow on that stretch.
    """

    modelled_front: float
    observed_front: float
    lateral_error: float
    lateral_shift: float
    width_bias: float
    stretch: float
    outside: int
    observed_width: float = math.nan

    @property
    def front_error(self) -> float:
        """Modelled minus observed front [m], positive where the model goes too far; 0 is best."""
        return self.modelled_front - self.observed_front


def thalweg_errors(
    thalweg: Thalweg,
    easting: np.ndarray,
    northing: np.ndarray,
    modelled: np.ndarray,
    observed: np.ndarray,
    *,
    spacing: float | None = None,
    half_width: float = math.inf,
) -> ThalwegErrors:
    """Errors of front and sides of a flow.

    Parameters
    ----------
    thalweg : Thalweg
    easting, northing : ndarray (columns,), (rows,)
        Cell centres [m].
    modelled, observed : ndarray (rows, columns)
        Reached share of each cell; a cell counts from a half on. Cells that one of the two does not know (NaN) do not count.
    spacing : float, optional
        Width [m] of the intervals of s in which the edges are compared; by default twice the diagonal of a cell.
    half_width : float
        Largest distance [m] from the line that counts.

    Returns
    -------
    ThalwegErrors
        Positions are those of cell centres: they are known to half a cell.
    """
    m, o = np.asarray(modelled, np.float64), np.asarray(observed, np.float64)
    known = np.isfinite(m) & np.isfinite(o)
    reach = [np.where(known, share, 0.0) >= 0.5 for share in (m, o)]
    rows, columns = np.nonzero(reach[0] | reach[1])
    s, across = thalweg.coordinates(easting[columns], northing[rows])
    near = np.abs(across) <= half_width
    flows = [(s[near & one[rows, columns]], across[near & one[rows, columns]]) for one in reach]
    cell = float(np.diff(easting[:2])[0]), float(np.diff(northing[:2])[0])
    fronts = [float(s.max()) if s.size else math.nan for s, _ in flows]
    error, shift, bias, stretch, cells = _sides(flows, spacing or 2.0 * math.hypot(*cell))
    width = cells * abs(cell[0] * cell[1]) / stretch if stretch else math.nan
    return ThalwegErrors(fronts[0], fronts[1], error, shift, bias, stretch, int((~near).sum()), width)


def _sides(flows: list[tuple[np.ndarray, np.ndarray]], spacing: float) -> tuple[float, float, float, float, float]:
    """Lateral error, shift, width bias and length of the common stretch of two flows (s, l), and the cells of the second there."""
    edges = [_edges(s, across, spacing) for s, across in flows]
    common = sorted(set(edges[0]) & set(edges[1]))
    if not common:
        return math.nan, math.nan, math.nan, 0.0, math.nan
    (ml, mr), (ol, orr) = (np.array([e[k] for k in common]).T for e in edges)
    error = 0.5 * float(np.abs(ml - ol).mean() + np.abs(mr - orr).mean())
    shift = 0.5 * float((ml + mr - ol - orr).mean())
    first, last = max(s.min() for s, _ in flows), min(s.max() for s, _ in flows)
    cells = [float(((s >= first) & (s <= last)).sum()) for s, _ in flows]
    return error, shift, cells[0] / cells[1] if cells[1] else math.nan, spacing * len(common), cells[1]


def _edges(s: np.ndarray, across: np.ndarray, spacing: float) -> dict[int, tuple[float, float]]:
    """Left and right edge of a flow in each interval of s that it reaches."""
    interval = np.floor(s / spacing).astype(np.int64)
    intervals, place = np.unique(interval, return_inverse=True)
    left, right = np.full(len(intervals), -np.inf), np.full(len(intervals), np.inf)
    np.maximum.at(left, place, across)
    np.minimum.at(right, place, across)
    return {int(k): (float(a), float(b)) for k, a, b in zip(intervals, left, right, strict=True)}
