"""Flow path of a release, and the places on it where depth averaging fits least: steps, mouths of channels, structures."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from runout.slopes.drainage import Drainage

STEEP_DEG = 45.0  # a step is steeper, over two cells
SIDE, SIDE_CELLS = 50.0, 5  # [m] and cells: the sides of a channel are looked for within the larger of the two
FEWEST_CONFINED = 3  # cells of a channel that a flow leaves


@dataclass(frozen=True)
class Standing:
    """Something that stands on the ground."""

    # kind, name: "structure" or "obstacle"; its name, which may be empty
    kind: str
    name: str
    outline: Any  # shapely geometry: in map coordinates
    height: float  # of the top above the ground, where it is highest [m]; negative for a basin
    clearance: float | None = None  # of the underside above the ground [m]; None for one without an opening below

    def title(self) -> str:
        """Kind, name and height in words."""
        size = f"{abs(self.height):.3g} m {'high' if self.height >= 0 else 'deep'}"
        below = f", {self.clearance:.3g} m free below" if self.clearance else ""
        return f"{self.kind}{f' {self.name!r}' if self.name else ''}, {size}{below}"

    def meeting(self, thickness: float) -> str:
        """What a flow of ``thickness`` [m] may do there."""
        if self.clearance and thickness < self.clearance:
            return "runs under it"
        if thickness > abs(self.height):
            return "is higher than it"
        return "fills the opening below it" if self.clearance else "runs against it" if self.height >= 0 else "runs into it"


@dataclass(frozen=True)
class Feature:
    """A place on the flow path."""

    kind: str  # "steep step", "leaves a channel", "structure" or "obstacle"
    # easting, northing, distance: place, and distance along the path [m]
    easting: float
    northing: float
    distance: float
    size: float  # height of a step, thickness of the flow elsewhere [m]
    standing: Standing | None = None  # the structure or obstacle that the flow reaches

    def attributes(self) -> dict[str, str | float]:
        """Values by name and unit."""
        place = {"easting": self.easting, "northing": self.northing}
        name = self.standing.name if self.standing else ""
        return {"kind": self.kind, "name": name, **place, "distance_m": self.distance, "size_m": self.size}

    def label(self) -> str:
        """A short label."""
        return self.standing.name or self.kind if self.standing else self.kind

    def words(self) -> str:
        """The feature in words."""
        at = f"at {self.distance:.0f} m (easting {self.easting:.0f}, northing {self.northing:.0f})"
        if self.standing:
            return f"{self.standing.title()}, {at}: {self.size:.3g} m of flow {self.standing.meeting(self.size)}"
        return f"{self.kind} {at}, {self.size:.3g} m {'high' if self.kind == 'steep step' else 'of flow'}"


@dataclass(frozen=True)
class FlowPath:
    """Path of the water from the thickest cell of a release, as far as the flow goes."""

    cells: np.ndarray  # (n, 2) of int: rows and columns, downstream
    distance: np.ndarray  # (n,): along the path [m]
    confined: np.ndarray  # (n,) of bool: whether the ground rises above the flow on both sides

    def points(self, drained: "Drainage") -> np.ndarray:
        """Easting and northing (n, 2) [m]."""
        return np.column_stack([drained.terrain.easting[self.cells[:, 1]], drained.terrain.northing[self.cells[:, 0]]])


def flow_path(drained: "Drainage", release: np.ndarray, peak: np.ndarray, least: float) -> FlowPath:
    """The path on the cells where the flow is thicker than ``least`` [m]; maps are (rows, columns) [m]."""
    columns = drained.terrain.shape[1]
    receiver, flow = drained.receiver.ravel(), (np.nan_to_num(peak) > least).ravel()
    cell, path, dry = _start(receiver.reshape(release.shape), np.nan_to_num(release)), list[int](), 0
    while dry < FEWEST_CONFINED:
        path.append(cell)
        following = int(receiver[cell])
        if following == cell:
            break
        cell = following
        dry = 0 if flow[cell] else dry + 1
    last = max((k for k, one in enumerate(path) if flow[one]), default=0)
    cells = np.column_stack(np.divmod(np.array(path[: last + 1]), columns))
    steps = np.hypot(*(np.diff(cells, axis=0) * drained.terrain.cell_size[::-1]).T)
    return FlowPath(cells, np.concatenate([[0.0], np.cumsum(steps)]), _confined(drained, cells, peak))


def _start(receiver: np.ndarray, release: np.ndarray) -> int:
    """Thickest cell of a release; the one nearest to its centre of mass among equals. Cells that drain over the rim come last."""
    inner = receiver != np.arange(receiver.size).reshape(receiver.shape)
    worth = release * (1.0 + inner)
    cells = np.argwhere(worth >= (1.0 - 1e-3) * worth.max())
    centre = np.argwhere(release > 0).T @ release[release > 0] / release.sum()
    row, column = cells[np.argmin(((cells - centre) ** 2).sum(axis=1))]
    return int(row * receiver.shape[1] + column)


def _confined(drained: "Drainage", cells: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """Whether the ground rises above the flow on both sides of the path, at right angles to its mean direction."""
    ground, (dx, dy) = drained.terrain.elevation, drained.terrain.cell_size
    reach = np.arange(1, max(SIDE_CELLS, math.ceil(SIDE / max(dx, dy))) + 1)
    confined = np.zeros(len(cells), bool)
    for k, (row, column) in enumerate(cells):
        direction = cells[min(k + 2, len(cells) - 1)] - cells[max(k - 2, 0)]
        length = float(np.hypot(*direction))
        if length == 0.0:
            continue
        across = np.array([-direction[1], direction[0]]) / length
        surface = ground[row, column] + np.nan_to_num(peak[row, column])
        confined[k] = all(_rises(ground, (row, column), side * across, reach, surface) for side in (1.0, -1.0))
    return confined


def _rises(ground: np.ndarray, start: tuple[int, int], across: np.ndarray, reach: np.ndarray, surface: float) -> bool:
    places = np.rint(np.array(start) + reach[:, None] * across).astype(int)
    inside = ((places >= 0) & (places < ground.shape)).all(axis=1)
    heights = ground[places[inside, 0], places[inside, 1]]
    return bool((heights > surface).any())


def features(drained: "Drainage", path: FlowPath, peak: np.ndarray, standing: Sequence[Standing]) -> list[Feature]:
    """Steps, mouths of channels and reached structures, by their distance along the path.

    ``peak`` (rows, columns): largest flow thickness [m]. ``standing``: structures and obstacles of the site.
    """
    places = [*_steps(drained, path), *_mouths(drained, path, peak), *_reached(drained, path, peak, standing)]
    return sorted(places, key=lambda one: one.distance)


def _place(drained: "Drainage", path: FlowPath, k: int, kind: str, size: float) -> Feature:
    east, north = path.points(drained)[k]
    return Feature(kind, float(east), float(north), float(path.distance[k]), float(size))


def _steps(drained: "Drainage", path: FlowPath) -> list[Feature]:
    """Runs of the path that are steeper than :data:`STEEP_DEG`, the terrain's sinks filled."""
    z = drained.filled[tuple(path.cells.T)]
    if len(z) < 3:
        return []
    steep = (z[:-2] - z[2:]) > math.tan(math.radians(STEEP_DEG)) * (path.distance[2:] - path.distance[:-2])
    return [_place(drained, path, start, "steep step", z[start] - z[end + 1]) for start, end in _runs(steep)]


def _mouths(drained: "Drainage", path: FlowPath, peak: np.ndarray) -> list[Feature]:
    """Ends of confined runs within the path."""
    ends = [end for start, end in _runs(path.confined) if end - start >= FEWEST_CONFINED and end < len(path.cells)]
    return [_place(drained, path, k, "leaves a channel", peak[tuple(path.cells[k])]) for k in ends]


def _runs(values: np.ndarray) -> list[tuple[int, int]]:
    """First index, and index after the last, of runs of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], values, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _reached(drained: "Drainage", path: FlowPath, peak: np.ndarray, standing: Sequence[Standing]) -> list[Feature]:
    """Structures and obstacles whose cells the flow reaches, at the nearest point of the path."""
    import shapely

    terrain, reached = drained.terrain, []
    points = path.points(drained)
    rows, columns = np.nonzero(np.nan_to_num(peak) > 0)
    wet = shapely.points(terrain.easting[columns], terrain.northing[rows])
    for one in standing:
        outline = one.outline
        near = outline.buffer(max(terrain.cell_size))
        inside = shapely.contains(near, wet)
        if inside.any():
            at = int(np.argmin(np.hypot(*(points - np.array(outline.centroid.coords[0])).T)))
            thickest = float(peak[rows[inside], columns[inside]].max())
            place = outline.centroid
            reached.append(Feature(one.kind, place.x, place.y, float(path.distance[at]), thickest, one))
    return reached
