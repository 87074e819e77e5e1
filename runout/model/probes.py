"""Probes of a run: points and cross-sections at which time series of the flow are recorded, and these series."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import Any

import numpy as np

from runout.errors import ConfigError, Problem
from runout.model.readers import reader
from runout.model.terrain import Terrain

Vertices = tuple[tuple[float, float], ...]
LONGEST_NAME = 64  # characters of a name
REACHES = np.array((1.0, 4.0, 16.0, 64.0))  # cells on either side of a line where its lower side is looked for
LEVEL = 0.01  # slope across a line that counts as level


@dataclass(frozen=True)
class Probe:
    """A point."""

    name: str  # name in files and figures
    # easting, northing: map coordinates [m]
    easting: float
    northing: float
    source: str = "probes"  # where it was read, for messages

    @property
    def vertices(self) -> Vertices:
        """The point itself."""
        return ((self.easting, self.northing),)


@dataclass(frozen=True)
class CrossSection:
    """A line across a flow."""

    name: str  # name in files and figures
    vertices: Vertices  # map coordinates [m], two different ones at least
    source: str = "cross-sections"  # where it was read, for messages

    @property
    def length(self) -> float:
        """Length in the plan [m]."""
        return float(np.hypot(*np.diff(np.array(self.vertices), axis=0).T).sum())

    @property
    def middle(self) -> tuple[float, float]:
        """Place half way along the line."""
        places, _, lengths = self.samples(self.length / 64.0)
        half = int(np.searchsorted(np.cumsum(lengths), 0.5 * self.length))
        return float(places[half, 0]), float(places[half, 1])

    def samples(self, spacing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Middles (n, 2), normals (n, 2) to the left, and lengths (n,) [m] of pieces of at most ``spacing`` [m]."""
        places, normals, lengths = [], [], []
        vertices = np.array(self.vertices)
        for start, step in zip(vertices, np.diff(vertices, axis=0), strict=False):
            length = float(np.hypot(*step))
            count = max(1, int(np.ceil(length / spacing)))
            places.append(start + (np.arange(count)[:, None] + 0.5) / count * step)
            normals.append(np.broadcast_to(np.array((-step[1], step[0])) / max(length, 1e-300), (count, 2)))
            lengths.append(np.full(count, length / count))
        return np.concatenate(places), np.concatenate(normals), np.concatenate(lengths)


@dataclass(frozen=True)
class Probes:
    """Points and cross-sections at which a run records time series.

    Parameters
    ----------
    points : sequence of Probe, or mapping of str to (float, float)
        Points, or map coordinates (easting, northing) [m] by name.
    cross_sections : sequence of CrossSection, or mapping of str to sequence of (float, float)
        Lines, or their vertices by name.
    interval : float, optional
        Time from one value of a series to the next [s]; by default a 200th of the end time.
    changes : tuple of str
        Assumptions of the reader, one sentence each.

    Raises
    ------
    ConfigError
        With all problems: no probe, a name twice or empty, a line with fewer than two different vertices, an interval not above 0.

    Examples
    --------
    >>> probes = Probes({"bridge": (500120.0, 4999880.0)}, {"fan": [(500200.0, 4999800.0), (500200.0, 4999950.0)]})
    >>> [point.name for point in probes.points]
    ['bridge']
    """

    points: tuple[Probe, ...] = ()
    cross_sections: tuple[CrossSection, ...] = ()
    interval: float | None = None
    changes: tuple[str, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", tuple(_points(self.points)))
        object.__setattr__(self, "cross_sections", tuple(_sections(self.cross_sections)))
        problems = list(self._problems())
        if problems:
            raise ConfigError(problems)

    @classmethod
    def from_vector(
        cls,
        terrain: Terrain,
        points: str | PathLike[str] | None = None,
        cross_sections: str | PathLike[str] | None = None,
        *,
        points_layer: str | None = None,
        cross_sections_layer: str | None = None,
        interval: float | None = None,
    ) -> "Probes":
        """Probes of vector files in the map coordinates of the terrain.

        Names come from the attribute ``name``; without one, points are p1, p2, ... and lines x1, x2, ...

        Raises
        ------
        ConfigError
            With all problems: geometries of another type, places outside of the terrain or without elevation, names twice.
        """
        read: Probes = reader("Probes.from_vector")(
            terrain, points, cross_sections, points_layer=points_layer, cross_sections_layer=cross_sections_layer, interval=interval
        )
        return read

    def _problems(self) -> Iterator[Problem]:
        if not self.points and not self.cross_sections:
            yield Problem("probes", None, "", "there is neither a point nor a cross-section", "add one")
        if self.interval is not None and not (np.isfinite(self.interval) and self.interval > 0):
            yield Problem("probes", None, "interval", f"{self.interval:g} s; it must be above 0", "leave it out for the default")
        for several in (self.points, self.cross_sections):
            yield from name_problems(several)
        for line in self.cross_sections:
            yield from vertex_problems(line)

    def on(self, terrain: Terrain) -> "Probes":
        """The probes in local coordinates [m] of a terrain, each line with the downhill side on its left.

        Raises
        ------
        ConfigError
            With every point and line that lies outside of the terrain or on cells without elevation.
        """
        both: tuple[Probe | CrossSection, ...] = (*self.points, *self.cross_sections)
        problems = [problem for one in both for problem in place_problems(one, terrain)]
        if problems:
            raise ConfigError(problems)
        west, south = terrain.west, terrain.south
        return replace(
            self,
            points=tuple(replace(p, easting=p.easting - west, northing=p.northing - south) for p in self.points),
            cross_sections=tuple(
                replace(line, vertices=tuple((x - west, y - south) for x, y in downhill_on_the_left(line, terrain)))
                for line in self.cross_sections
            ),
        )

    def at(self, terrain: Terrain) -> "Probes":
        """Probes of local coordinates (see :meth:`on`) in map coordinates."""
        west, south = terrain.west, terrain.south
        return replace(
            self,
            points=tuple(replace(p, easting=p.easting + west, northing=p.northing + south) for p in self.points),
            cross_sections=tuple(
                replace(line, vertices=tuple((x + west, y + south) for x, y in line.vertices)) for line in self.cross_sections
            ),
        )

    def statement(self) -> str:
        """Number of points and cross-sections."""
        counts = ((len(self.points), "point"), (len(self.cross_sections), "cross-section"))
        return "probes: " + ", ".join(f"{count} {what}{'s' * (count != 1)}" for count, what in counts)

    def times(self, end_time: float) -> np.ndarray:
        """Times (n,) [s] of the series of a run until ``end_time`` [s]."""
        interval = self.interval or end_time / 200.0
        count = int(np.ceil(end_time / interval - 1e-9))
        return np.minimum(np.arange(count + 1) * interval, end_time)


def _points(value: Any) -> Sequence[Probe]:
    return [Probe(name, float(x), float(y)) for name, (x, y) in value.items()] if isinstance(value, Mapping) else value


def _sections(value: Any) -> Sequence[CrossSection]:
    if not isinstance(value, Mapping):
        return value  # type: ignore[no-any-return]
    return [CrossSection(name, tuple((float(x), float(y)) for x, y in line)) for name, line in value.items()]


def name_problems(several: Sequence[Probe | CrossSection]) -> Iterator[Problem]:
    """Names that are empty, too long or used twice."""
    seen: dict[str, str] = {}
    for one in several:
        if not one.name.strip() or len(one.name) > LONGEST_NAME or not one.name.isprintable():
            fix = f"write 1 to {LONGEST_NAME} letters, digits or signs"
            yield Problem(one.source, None, "name", f"{one.name[:LONGEST_NAME]!r} cannot be a name", fix)
        elif one.name in seen:
            yield Problem(one.source, None, "name", f"{one.name!r} is the name of {seen[one.name]} too", "give each its own name")
        seen.setdefault(one.name, one.source)


def vertex_problems(line: CrossSection) -> Iterator[Problem]:
    """A line that is a point, or has coordinates that are not finite."""
    if not np.isfinite(np.array(line.vertices, float)).all():
        yield Problem(line.source, None, line.name, "a coordinate is not finite", "draw the line again")
    elif len(set(line.vertices)) < 2:
        yield Problem(line.source, None, line.name, f"the line has {len(set(line.vertices))} different vertex", "draw two or more")


def place_problems(one: Probe | CrossSection, terrain: Terrain) -> Iterator[Problem]:
    """A point or line that lies outside of the terrain, or on cells without elevation."""
    inside, known = _standing(one, terrain)
    is_point = isinstance(one, Probe)
    what = f"{'point' if is_point else 'line'} {one.name!r}"
    part = "" if is_point else "{:.0%} of the length of "
    remedy = "move it" if is_point else "shorten it"
    if not inside.all():
        west, south, east, north = terrain.extent
        x, y = one.vertices[0]
        at = f"at easting {x:.10g}, northing {y:.10g}" if is_point else ""
        extent = f"{terrain.source} (easting {west:.10g} to {east:.10g}, northing {south:.10g} to {north:.10g})"
        fault = f"{part.format(1.0 - inside.mean())}{what} {at} lies outside of {extent}".replace("  ", " ")
        yield Problem(one.source, None, "", fault, f"{remedy}, or check its coordinate system")
    elif not known.all():
        fault = f"{part.format(1.0 - known.mean())}{what} lies on cells without elevation"
        yield Problem(one.source, None, "", fault, f"{remedy}, or fill the elevation raster")


def _standing(one: Probe | CrossSection, terrain: Terrain) -> tuple[np.ndarray, np.ndarray]:
    """Which places along a point or line lie on the raster, and which on cells with an elevation."""
    places = np.array(one.vertices)
    if isinstance(one, CrossSection):
        places = np.concatenate([places, one.samples(0.5 * min(terrain.cell_size))[0]])
    row, column = cell_of(terrain, places)
    inside = (row >= 0) & (row < terrain.shape[0]) & (column >= 0) & (column < terrain.shape[1])
    rows, columns = (np.clip(k, 0, n - 1) for k, n in zip((row, column), terrain.shape, strict=True))
    return inside, np.isfinite(terrain.elevation[rows, columns])


def cell_of(terrain: Terrain, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Row and column (n,) of the cells of the raster that hold places (n, 2) in map coordinates [m]; beyond it for others."""
    places = np.asarray(places, np.float64)
    column = np.floor((places[..., 0] - terrain.west) / terrain.cell_size[0])
    row = terrain.shape[0] - 1 - np.floor((places[..., 1] - terrain.south) / terrain.cell_size[1])
    limit = np.iinfo(np.int32).max  # of places that are far off
    return tuple(np.nan_to_num(k, nan=-1.0).clip(-1, limit).astype(np.int64) for k in (row, column))  # type: ignore[return-value]


def ground_at(terrain: Terrain, places: np.ndarray) -> np.ndarray:
    """Elevation (n,) [m] at places (n, 2), bilinear between the cell centres; NaN beside cells without elevation."""
    return terrain.elevation_at(places - (terrain.west, terrain.south))


def downhill_on_the_left(line: CrossSection, terrain: Terrain) -> Vertices:
    """Vertices of a line, turned if its right side is lower, near it or, on level ground, up to 64 cells away.

    Where all that is level, in the order in which it was drawn.
    """
    cell = max(terrain.cell_size)
    places, normals, lengths = line.samples(0.5 * cell)
    for reach in REACHES * cell:
        rise = ground_at(terrain, places + reach * normals) - ground_at(terrain, places - reach * normals)
        slope = float(np.nansum(rise * lengths)) / (2.0 * reach * line.length)
        if abs(slope) > LEVEL:
            return line.vertices[::-1] if slope > 0.0 else line.vertices
    return line.vertices


@dataclass(frozen=True)
class ProbeSeries:
    """Time series at the probes of one run.

    Attributes
    ----------
    probes : Probes
        Points and lines in map coordinates; positive discharge crosses a line to its left, which is its lower side.
    terrain : Terrain
        The ground under them.
    time : ndarray (times,)
        [s] since the release. After the end of the run thickness and volumes stay, speeds and discharge are 0.
    points : mapping of str to ndarray (points, times)
        ``flow_thickness`` [m], ``speed`` [m s-1], ``pressure`` [Pa], ``momentum_flux`` [m3 s-2].
    cross_sections : mapping of str to ndarray (cross-sections, times)
        ``discharge`` [m3 s-1], the mean of the interval that ends then; ``passed_volume`` [m3]; ``flow_width`` [m] that the
        flow covers with at least the arrival threshold; ``largest_thickness`` [m] along the line.
    peaks : mapping of str to ndarray (points,)
        Values of the maps of the run at the points: ``max_flow_thickness`` and so on, ``arrival_time`` [s] (NaN: never),
        ``deposit_thickness``.
    section_peaks : mapping of str to ndarray (cross-sections,)
        ``max_discharge`` [m3 s-1] of an interval, ``max_flow_thickness`` [m] and first ``arrival_time`` [s] along the line.
    """

    probes: Probes
    terrain: Terrain
    time: np.ndarray
    points: Mapping[str, np.ndarray]
    cross_sections: Mapping[str, np.ndarray]
    peaks: Mapping[str, np.ndarray]
    section_peaks: Mapping[str, np.ndarray]
