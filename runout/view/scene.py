"""What a picture in three dimensions shows: the ground, the frames of a flow, outlines and structures."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

MOST_CELLS = 250_000  # of the ground; a larger window is averaged over blocks of cells
LEAST_CELLS, MOST_FINER = 120_000, 8  # of a smaller window, which is interpolated, and parts of a side of its cells
LEAST_SHOWN = 0.1  # [m]
RIM = 0.5  # share of covered ground at the rim of the flow
Span = tuple[np.ndarray, np.ndarray, bool]  # lowest and highest elevation (rows, columns) of a structure [m]; whether it hangs
Mesh = tuple[np.ndarray, np.ndarray]  # points (n, 3) in map coordinates [m], and triangles (m, 3) of their numbers


@dataclass(frozen=True)
class FlowScene:
    """Ground and frames of a flow on the cells of a window, row 0 in the north."""

    # easting, northing: (columns,): cell centres [m]; northing descends
    easting: np.ndarray
    northing: np.ndarray
    # (rows, columns): elevation below the flow [m]: the sliding surface of an excavated release, the terrain elsewhere; NaN where
    # unknown
    ground: np.ndarray
    times: np.ndarray  # (frames,) [s]
    # thickness, speed: (frames, rows, columns): vertical thickness [m] and speed [m/s]; NaN or 0 where there is no flow
    thickness: np.ndarray
    speed: np.ndarray
    title: str = ""  # first line of the picture
    least_thickness: float = LEAST_SHOWN  # thinner flow is not drawn [m]
    outlines: Sequence[np.ndarray] = ()  # (n, 2): closed lines in map coordinates [m]: outlines of releases
    meshes: Mapping[str, Mesh] = field(default_factory=dict)  # structures by name
    # (frames, rows, columns): height above the ground [m] of the structure that the flow lies on, 0 elsewhere
    lift: np.ndarray | None = None
    # (frames, n, 4): easting, northing, elevation [m] and speed [m/s]; NaN for particles that are no longer there
    particles: np.ndarray | None = None
    # (height, width, 3) of uint8: picture of exactly the window, north up, instead of the hillshade
    image: np.ndarray | None = None
    crs: str | None = None  # coordinate system as WKT

    @property
    def cell_size(self) -> tuple[float, float]:
        """Size of a cell east-west and north-south [m]."""
        return float(self.easting[1] - self.easting[0]), float(self.northing[0] - self.northing[1])

    @property
    def origin(self) -> tuple[float, float]:
        """Map coordinates [m] of the local origin, the south-western cell centre."""
        return float(self.easting[0]), float(self.northing[-1])

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """West, south, east and north of the outer cell centres [m]."""
        return float(self.easting[0]), float(self.northing[-1]), float(self.easting[-1]), float(self.northing[0])

    @property
    def reached(self) -> np.ndarray:
        """Cells (rows, columns) that are covered in any frame."""
        return np.nanmax(np.nan_to_num(self.thickness), axis=0) >= self.least_thickness

    def points(self) -> np.ndarray:
        """Local positions (rows, columns, 3) [m] of the ground; unknown cells lie at its lowest elevation."""
        x, y = np.meshgrid(self.easting - self.origin[0], self.northing - self.origin[1])
        return np.stack([x, y, np.where(np.isfinite(self.ground), self.ground, np.nanmin(self.ground))], axis=-1)

    def local(self, points: np.ndarray) -> np.ndarray:
        """Local positions (n, 3) [m] of map positions (n, 3) [m]."""
        return np.asarray(points, np.float64) - np.array([*self.origin, 0.0])

    def draped(self, line: np.ndarray, elevation: np.ndarray) -> np.ndarray:
        """A line (n, 2) in map coordinates on a surface (rows, columns) [m], (m, 3) local [m], with points on each cell."""
        from scipy.ndimage import map_coordinates

        line = np.asarray(line, np.float64)
        length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        steps = np.linspace(0.0, length[-1], max(2, int(2 * length[-1] / min(self.cell_size))))
        x, y = (np.interp(steps, length, line[:, k]) - self.origin[k] for k in (0, 1))
        place = [len(self.northing) - 1 - y / self.cell_size[1], x / self.cell_size[0]]
        return np.column_stack([x, y, map_coordinates(elevation, place, order=1, mode="nearest")])

    def frames(self, count: int | None) -> "FlowScene":
        """The scene with ``count`` of its frames, evenly chosen, first and last included; all if it has no more."""
        if count is None or count >= len(self.times):
            return self
        chosen = chosen_frames(len(self.times), count)
        some: dict[str, Any] = {name: getattr(self, name)[chosen] for name in ("times", "thickness", "speed")}
        some |= {name: None if getattr(self, name) is None else getattr(self, name)[chosen] for name in ("lift", "particles")}
        return replace(self, **some)

    def coarsened(self, most: int = MOST_CELLS) -> "FlowScene":
        """The scene with means over square blocks, so that it has at most ``most`` cells."""
        block = block_of(self.ground.size, most)
        if block < 2:
            return self
        names = ("easting", "northing", "ground", "thickness", "speed")
        maps: dict[str, Any] = {name: block_means(getattr(self, name), block) for name in names}
        return replace(self, **maps)

    def refined(self, least: int = LEAST_CELLS) -> "FlowScene":
        """The scene on a finer grid, so that a flow of few cells has no stepped rim.

        The ground is a cubic spline; thickness and speed are linear between cell centres, up to a rim that a quadratic B-spline of
        the covered cells rounds. The number of cells is at least ``least``, or 64 for each cell if that is less.
        """
        finer = min(MOST_FINER, int(np.ceil(np.sqrt(least / self.ground.size))))
        if finer < 2:
            return self
        rows, columns = ((n - 1) * finer + 1 for n in self.ground.shape)
        whole = np.isfinite(self.ground).all()
        ground = _resampled(self.ground, (rows, columns), order=3 if whole else 1)
        frames = [self._finer_frame(frame, (rows, columns)) for frame in range(len(self.times))]
        thickness, speed = np.array(frames, np.float32).reshape(-1, 2, rows, columns).swapaxes(0, 1)
        west, south, east, north = self.extent
        axes: dict[str, Any] = {"easting": np.linspace(west, east, columns), "northing": np.linspace(north, south, rows)}
        lift = None if self.lift is None else np.stack([_resampled(values, (rows, columns)) for values in self.lift])
        return replace(self, ground=ground, thickness=thickness, speed=speed, lift=lift, **axes)

    def _finer_frame(self, frame: int, shape: tuple[int, int]) -> list[np.ndarray]:
        """Thickness and speed of a frame on a finer grid."""
        from scipy.ndimage import uniform_filter

        wet = np.nan_to_num(self.thickness[frame]) >= self.least_thickness
        covered = _resampled(wet.astype(float), shape, order=2, prefilter=False) >= RIM
        share = np.maximum(uniform_filter(wet.astype(float), 3), 1e-9)
        finer = []
        for values in (self.thickness[frame], self.speed[frame]):
            inside = np.where(wet, np.nan_to_num(values), 0.0)
            beside = uniform_filter(inside, 3) / share  # mean of the covered cells around
            finer.append(np.where(covered, _resampled(np.where(wet, inside, beside), shape), 0.0))
        return [np.where(covered, np.maximum(finer[0], self.least_thickness), 0.0), finer[1]]

    def save(self, path: Path) -> None:
        """Write the scene to an archive of NumPy."""
        content: dict[str, Any] = {name: getattr(self, name) for name in _PLAIN if getattr(self, name) is not None}
        content |= {f"outline_{k}": line for k, line in enumerate(self.outlines)}
        for name, (points, faces) in self.meshes.items():
            content |= {f"points_{name}": points, f"faces_{name}": faces}
        np.savez(path, **content)

    @classmethod
    def load(cls, path: Path) -> "FlowScene":
        """The scene of an archive of :meth:`save`."""
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        plain = {name: value[()] if value.ndim == 0 else value for name, value in arrays.items() if name in _PLAIN}
        names = [name.removeprefix("points_") for name in arrays if name.startswith("points_")]
        return cls(
            **plain,
            outlines=[arrays[name] for name in arrays if name.startswith("outline_")],
            meshes={name: (arrays[f"points_{name}"], arrays[f"faces_{name}"]) for name in names},
        )


_PLAIN = tuple(f.name for f in fields(FlowScene) if f.name not in ("outlines", "meshes"))


def _resampled(values: np.ndarray, shape: tuple[int, int], order: int = 1, prefilter: bool = True) -> np.ndarray:
    """Values at the nodes of a finer grid with the same corners."""
    from scipy.ndimage import zoom

    factors = [n / m for n, m in zip(shape, values.shape, strict=True)]
    finer: np.ndarray = zoom(values, factors, order=order, mode="nearest", prefilter=prefilter)
    return finer


def chosen_frames(frames: int, count: int | None) -> np.ndarray:
    """Numbers of ``count`` of some frames, evenly chosen, first and last included; of all if there are no more."""
    if count is None or count >= frames:
        return np.arange(frames)
    return np.unique(np.linspace(0, frames - 1, count).round().astype(int))


def block_of(cells: int, most: int = MOST_CELLS) -> int:
    """Side of the blocks, in cells, over which maps of so many cells are averaged for a picture."""
    return max(1, math.ceil(math.sqrt(cells / most)))


def block_means(values: np.ndarray, block: int) -> np.ndarray:
    """Means over blocks along the last axis, or the last two of maps; incomplete blocks at the end are left out."""
    for axis in range(max(0, values.ndim - 2), values.ndim):
        whole = values.shape[axis] // block
        values = np.take(values, np.arange(whole * block), axis=axis)
        shape = (*values.shape[:axis], whole, block, *values.shape[axis + 1 :])
        values = values.reshape(shape).mean(axis=axis + 1)
    return values


def on_structures(scene: FlowScene, spans: Sequence[Span]) -> FlowScene:
    """The scene with the flow on the tops of structures where its particles lie there.

    Maps of thickness do not say whether the flow runs over a roof or below it; particles do.

    ``spans``: of the structures at the cells of the scene: NaN where they are not.
    """
    if not spans or scene.particles is None:
        return scene
    lift = np.zeros(scene.thickness.shape, np.float32)
    mean = [_mean_elevation(scene, frame) for frame in range(len(scene.times))]
    for low, high, hangs in spans:
        carried = 0.5 * (low + high) if hangs else high
        for frame, elevation in enumerate(mean):
            above = np.nan_to_num(elevation, nan=-np.inf) > np.nan_to_num(carried, nan=np.inf)
            if above.any():
                roof = _beside(above) & np.isfinite(high)
                lift[frame][roof] = np.maximum(lift[frame][roof], (high - scene.ground)[roof])
    return replace(scene, lift=lift)


def _mean_elevation(scene: FlowScene, frame: int) -> np.ndarray:
    """Mean elevation (rows, columns) [m] of the particles of a frame; NaN where there is none."""
    assert scene.particles is not None
    present = scene.particles[frame][np.isfinite(scene.particles[frame]).all(axis=1)]
    (rows, columns), (dx, dy) = scene.ground.shape, scene.cell_size
    points = scene.local(present[:, :3])
    column, row = np.rint(points[:, 0] / dx).astype(int), rows - 1 - np.rint(points[:, 1] / dy).astype(int)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    cell = row[inside] * columns + column[inside]
    count = np.bincount(cell, minlength=rows * columns)
    total = np.bincount(cell, points[inside, 2], rows * columns)
    return np.divide(total, count, out=np.full(rows * columns, np.nan), where=count > 0).reshape(rows, columns)


def _beside(mask: np.ndarray) -> np.ndarray:
    """The cells of a mask and those around them."""
    around = np.pad(mask, 1)
    rows, columns = mask.shape
    return np.any([around[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0)  # type: ignore[no-any-return]
