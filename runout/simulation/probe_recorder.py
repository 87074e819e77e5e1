"""Observer of a run that records time series at points and cross-sections, from the same columns as the maps.

A point has the values of the cell that holds it. The volume that passes a cross-section is the flux of volume through the line,
summed over all observations of the run. The flux is the momentum of the particles over their density. Each particle is a box of one
grid cell, bilinear between the cells of the lattice. The footprints of the maps are not used: their size follows the number of
particles around, so that a sum over them does not balance. Boxes only move. Widths and depths are those of the maps, which count
the volume that flows. A particle has come to its place with the velocity of its last step. So the flux of that step is taken from
the boxes half a step upstream.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from runout.backends import footprints
from runout.backends.compile import array_binding
from runout.backends.protocol import BoxSums, RasterSums
from runout.backends.state import State
from runout.model.probes import CrossSection, Probe, Probes, ProbeSeries, cell_of
from runout.model.registered_law import for_arrays
from runout.model.scene import Scene
from runout.model.terrain import Terrain
from runout.quantities import ARRIVAL, peak_quantities

PIECES = 4  # pieces of a line in the shorter side of a cell
TINY = np.finfo(float).tiny
AROUND = np.array([(i, j) for i in (-1.0, 0.0, 1.0) for j in (-1.0, 0.0, 1.0)]).T  # a cell and its neighbours, (2, 9)
DISCHARGE, PASSED, WIDTH, DEPTH = "discharge", "passed_volume", "flow_width", "largest_thickness"
OF_POINT, OF_LINE = 3, 3  # numbers of an observation: depth, speed, density; flux, width, largest thickness


@dataclass(frozen=True)
class Pieces:
    """Pieces of all cross-sections, shorter than a cell of the lattice, and the cells around each."""

    owner: np.ndarray  # (n,): number of the cross-section
    normals: np.ndarray  # (2, n): normals to the left times the lengths [m]
    cells: np.ndarray  # (2, m): row from the south and column of all cells around pieces, each once
    around: np.ndarray  # (9, n): places among these of the cells around a piece
    apart: np.ndarray  # (2, 9, n): distance east and north from the middles of these to the piece [cells]

    @classmethod
    def of(cls, lines: tuple[CrossSection, ...], cell: tuple[float, float]) -> "Pieces":
        """Pieces of lines on cells of a size [m]."""
        places, normals, lengths = zip(*(line.samples(min(cell) / PIECES) for line in lines), strict=True)
        owner = np.repeat(np.arange(len(lines)), [len(part) for part in lengths])
        at = (np.concatenate(places) / np.array(cell)).T[:, None]
        place = np.floor(at) + AROUND[..., None]
        cells, around = np.unique(place[::-1].reshape(2, -1).astype(np.int64), axis=1, return_inverse=True)
        scaled = (np.concatenate(normals) * np.concatenate(lengths)[:, None]).T
        return cls(owner, scaled, cells, around.reshape(place.shape[1:]), at - (place + 0.5))


class ProbeRecorder:
    """Records the flow at points and through cross-sections at every observation of a run.

    Parameters
    ----------
    scene : Scene
    probes : Probes
        Probes in local coordinates, see :meth:`runout.model.probes.Probes.on`.
    arrival_threshold : float
        Thickness [m] from which a column has a speed, and a line is covered.
    on_lattice : bool
        Whether columns are those of the lattice of :mod:`runout.backends.footprints`, not those of the raster.
    """

    def __init__(self, scene: Scene, probes: Probes, arrival_threshold: float, on_lattice: bool):
        self.probes, self.arrival_threshold = probes, arrival_threshold
        raster = scene.raster
        self.cell = footprints.lattice_cell(scene) if on_lattice else raster.cell_size
        self.shape = footprints.lattice_shape(raster, self.cell) if on_lattice else (raster.rows, raster.columns)
        self.from_south, self.area = on_lattice, self.cell[0] * self.cell[1]
        self.point_cells = _joined([_cells_of_point(p, scene, self.cell) for p in probes.points])
        self.point_area = raster.cell_size[0] * raster.cell_size[1]
        self.lattice_cell = footprints.lattice_cell(scene)
        self.pieces = Pieces.of(probes.cross_sections, self.lattice_cell) if probes.cross_sections else None
        self.line_cells = _joined([_lengths(line, self.cell, self.shape) for line in probes.cross_sections])
        self.times: list[float] = []
        self.steps: list[float] = []  # [s]
        self.rows: list[np.ndarray] = []

    def observe(self, time: float, columns: RasterSums, dt: float) -> None:
        """Note the columns at one time [s], after a step of ``dt`` [s]."""
        self.times.append(time)
        self.steps.append(dt)
        self.rows.append(np.concatenate([self._at_points(columns), self._at_lines(columns, dt)]))

    def state(self) -> State:
        """All observations as arrays by name, for :meth:`restore`."""
        return {"time": np.array(self.times), "dt": np.array(self.steps), "rows": np.array(self.rows)}

    def restore(self, state: State) -> None:
        """Restore the observations from :meth:`state`."""
        self.times, self.steps, self.rows = state["time"].tolist(), state["dt"].tolist(), list(state["rows"])

    def _gathered(self, columns: RasterSums, place: np.ndarray) -> np.ndarray:
        """Volume, flowing volume [m3], mass [kg] and momentum (3) [kg m/s] (6, n) of columns at cells (2, n) from the south."""
        row = place[0] if self.from_south else self.shape[0] - 1 - place[0]
        lanes = columns.volume, columns.depth_volume, columns.mass, *np.moveaxis(columns.momentum, -1, 0)
        return _at(lanes, row - columns.row, place[1] - columns.column)

    def _at_points(self, columns: RasterSums) -> np.ndarray:
        """Depth [m], speed [m/s] and density [kg/m3] of the points, one after another."""
        owner, place, share = self.point_cells
        if not len(self.probes.points):
            return np.zeros(0)
        sums = self._gathered(columns, place) * share
        volume, flowing, mass, *momentum = (np.bincount(owner, values, len(self.probes.points)) for values in sums)
        speed = array_binding().flow_columns.column_speed(np.maximum(mass, TINY), *momentum)
        return np.concatenate([flowing / self.point_area, speed, mass / np.maximum(volume, TINY)])

    def _at_lines(self, columns: RasterSums, dt: float) -> np.ndarray:
        """Flux [m3/s], covered width [m] and largest thickness [m] of the lines, one after another."""
        count = len(self.probes.cross_sections)
        if self.pieces is None:
            return np.zeros(0)
        flux = np.bincount(self.pieces.owner, self._flux(self.pieces, columns.boxes, dt), count)
        crossed, cell, length = self.line_cells
        depth = self._gathered(columns, cell)[1] / self.area
        width = np.bincount(crossed, length * (depth >= self.arrival_threshold), count)
        largest = np.zeros(count)
        np.maximum.at(largest, crossed, depth)
        return np.concatenate([flux, width, largest])

    def _flux(self, pieces: Pieces, boxes: BoxSums | None, dt: float) -> np.ndarray:
        """Flux of volume [m3/s] through every piece of the lines, during the step of ``dt`` [s] before.

        Bilinear between the sums in the nine cells around, each half a step upstream of where it is now.
        """
        if boxes is None:
            return np.zeros(len(pieces.owner))
        (row, column), cell = pieces.cells, np.array(self.lattice_cell)
        volume, east, north, mass = _at((*boxes.sums[:3], boxes.mass), row - boxes.row, column - boxes.column)
        velocity = np.array((east, north)) / np.maximum(mass, TINY)
        moved = 0.5 * dt * velocity / cell[:, None]
        share_x, share_y = np.maximum(1.0 - np.abs(pieces.apart + np.take(moved, pieces.around, axis=1)), 0.0)
        flux_east, flux_north = np.take(volume * velocity / cell.prod(), pieces.around, axis=1)
        crossing = flux_east * pieces.normals[0] + flux_north * pieces.normals[1]
        return (share_x * share_y * crossing).sum(axis=0)  # type: ignore[no-any-return]

    def series(self, end_time: float, terrain: Terrain, maps: Mapping[str, np.ndarray]) -> ProbeSeries:
        """What has been recorded, on the times of :meth:`runout.model.probes.Probes.times`.

        Parameters
        ----------
        end_time : float
            Latest end of the run [s]; it may have ended earlier, at rest.
        terrain : Terrain
        maps : mapping of str to ndarray (rows, columns)
            Maps of the run.
        """
        probes, time, known = self.probes.at(terrain), self.probes.times(end_time), np.array(self.times)
        rows, points, lines = np.array(self.rows), len(self.probes.points), len(self.probes.cross_sections)
        of_points, of_lines = rows[:, : OF_POINT * points], rows[:, OF_POINT * points :]
        sections = self._section_series(of_lines.reshape(len(rows), OF_LINE, lines), known, time)
        return ProbeSeries(
            probes, terrain, time, self._point_series(of_points.reshape(len(rows), OF_POINT, points), known, time), sections,
            _at_cells(probes.points, terrain, maps), _along(probes.cross_sections, terrain, maps, sections[DISCHARGE]),
        )  # fmt: skip

    def _point_series(self, rows: np.ndarray, known: np.ndarray, time: np.ndarray) -> dict[str, np.ndarray]:
        depth, speed, density = np.moveaxis(rows, 1, 0)
        moving, series = depth >= self.arrival_threshold, {}
        for quantity in peak_quantities():
            values = for_arrays(quantity.formula)(depth, speed, density)
            if quantity.stem == "flow_thickness":
                series[quantity.stem] = _resampled(values, known, time)
            else:
                series[quantity.stem] = _resampled(np.where(moving, values, 0.0), known, time, at_rest=0.0)
        return series

    def _section_series(self, rows: np.ndarray, known: np.ndarray, time: np.ndarray) -> dict[str, np.ndarray]:
        flux, width, largest = np.moveaxis(rows, 1, 0)
        of_flux = np.append(known - 0.5 * np.array(self.steps), known[-1])
        flux = np.concatenate([flux, flux[-1:]])
        between = 0.5 * (flux[1:] + flux[:-1]) * np.diff(of_flux)[:, None]
        passed = _resampled(np.concatenate([np.zeros_like(flux[:1]), np.cumsum(between, axis=0)]), of_flux, time)
        discharge = np.zeros_like(passed)
        discharge[:, 1:] = np.diff(passed, axis=1) / np.diff(time)
        return {
            DISCHARGE: discharge, PASSED: passed, WIDTH: _resampled(width, known, time), DEPTH: _resampled(largest, known, time),
        }  # fmt: skip


Cells = tuple[np.ndarray, np.ndarray, np.ndarray]  # numbers of their probes (n,), places (2, n), weights (n,)


def _at(lanes: Sequence[np.ndarray], row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Values (lanes, n) of each of the ``lanes`` (rows, columns) in cells; 0 beyond them."""
    rows, columns = lanes[0].shape
    values, inside = np.zeros((len(lanes), len(row))), (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    at = row[inside], column[inside]
    for k, lane in enumerate(lanes):
        values[k, inside] = lane[at]
    return values


def _joined(several: list[tuple[np.ndarray, np.ndarray]]) -> Cells:
    """Cells of all probes, one after another."""
    if not several:
        return np.zeros(0, np.int64), np.zeros((2, 0), np.int64), np.zeros(0)
    owner = np.repeat(np.arange(len(several)), [place.shape[1] for place, _ in several])
    return owner, np.concatenate([place for place, _ in several], axis=1), np.concatenate([weights for _, weights in several])


def _cells_of_point(point: Probe, scene: Scene, cell: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Cells (row from the south, column) (2, n) under the raster cell that holds a point, and the parts of them in it."""
    size = scene.raster.cell_size
    along = [_parts(int(np.floor(x / s)) * s, s, c) for x, s, c in zip((point.easting, point.northing), size, cell, strict=True)]
    (columns, across), (rows, up) = along
    place = np.stack(np.meshgrid(rows, columns, indexing="ij")).reshape(2, -1)
    return place, np.outer(up, across).ravel()


def _parts(low: float, size: float, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Cells of length ``cell`` [m] that an interval from ``low`` on meets, and the parts of them inside it."""
    number = np.arange(int(np.floor(low / cell + 1e-9)), int(np.ceil((low + size) / cell - 1e-9)))
    part = np.minimum((number + 1) * cell, low + size) - np.maximum(number * cell, low)
    return number, np.clip(part / cell, 0.0, 1.0)


def _lengths(line: CrossSection, cell: tuple[float, float], shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Cells (row from the south, column) (2, n) that a line crosses, and its length in each [m]."""
    places, _, lengths = line.samples(min(cell) / PIECES)
    column, row = (np.clip((places[:, d] / cell[d]).astype(np.int64), 0, shape[1 - d] - 1) for d in (0, 1))
    cells, owner = np.unique(row * shape[1] + column, return_inverse=True)
    return np.stack(np.divmod(cells, shape[1])), np.bincount(owner, lengths, len(cells))


def _resampled(values: np.ndarray, observed: np.ndarray, time: np.ndarray, at_rest: float | None = None) -> np.ndarray:
    """Values (n, times) from those (observations, n) at ``observed`` times; after the last one ``at_rest``, or the last value."""
    if not values.shape[1]:
        return np.zeros((0, len(time)))
    resampled = np.stack([np.interp(time, observed, series) for series in values.T])
    if at_rest is not None:
        resampled[:, time > observed[-1] * (1 + 1e-9)] = at_rest
    return resampled


def _at_cells(points: tuple[Probe, ...], terrain: Terrain, maps: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Values (points,) of the maps in the cells that hold the points."""
    row, column = cell_of(terrain, np.array([p.vertices[0] for p in points]).reshape(-1, 2))
    return {name: values[row, column] for name, values in maps.items()}


def _along(
    lines: tuple[CrossSection, ...], terrain: Terrain, maps: Mapping[str, np.ndarray], discharge: np.ndarray
) -> dict[str, np.ndarray]:
    """Largest discharge (lines,) [m3/s], and largest thickness [m] and first arrival [s] of the cells that each line crosses."""
    cells = [cell_of(terrain, line.samples(min(terrain.cell_size) / PIECES)[0]) for line in lines]
    arrivals = [maps[ARRIVAL][at] for at in cells]
    thickness = peak_quantities()[0].member_map
    return {
        "max_discharge": discharge.max(axis=1, initial=0.0),
        thickness: np.array([maps[thickness][at].max() for at in cells]),
        ARRIVAL: np.array([np.nanmin(a) if np.isfinite(a).any() else np.nan for a in arrivals]),
    }
