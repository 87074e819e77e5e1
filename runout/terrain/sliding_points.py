"""Points that slide over the ground in place of a mass: how long, how fast, how far and how deep it flows, without a run.

Points that slide alone meet in the hollows of the ground, 2 to 10 times as thick as the flow. For its depth each point also feels
the slope of the surface of the mass, as in depth-averaged models: a particle-in-cell scheme on squares of an eighth of the length
of the releases. On 17 flows the depth was 0.78 to 1.25 of that of the run (docs/guide/choosing).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from runout.model.column_resistance import Columns, Resistance
from runout.model.depth_resolution import flow_depth
from runout.model.materials import Material
from runout.model.registered_law import calling
from runout.model.release import Release
from runout.model.scene import STANDARD_GRAVITY
from runout.model.surface import Surface
from runout.physics import contact
from runout.terrain.sdf import raster_surface

POINTS = 1500  # of all releases together: late stragglers of a flow are a part in a thousand of its mass
STEPS = 400  # least number until the end time
MOST_STEPS = 8 * STEPS
CROSSING = 0.5  # cells of the ground that the fastest point crosses in a step
SQUARES = 8  # on the length of the releases, on which points are counted: about 20 on each of a compact release
SEQUENCE = 0.8191725133961645, 0.6710436067037893  # of points that fill a square evenly (Roberts 2018)

_slip_after: Callable[..., np.ndarray] = calling(contact.slip_after, math=np)  # type: ignore[arg-type]
COURANT = 0.4  # squares that a point or a wave crosses in a step
MOST_SQUARE_STEPS = 1500
RESTING = 0.1  # root mean square speed over its largest, at which the flow has come to rest: 1 % of the energy


@dataclass(frozen=True)
class Slide:
    """Slides of some members, until all points rest or have gone."""

    time: np.ndarray  # (steps,): end of each step [s]
    # speed, fastest: (steps, members): root mean square and largest speed [m/s]
    speed: np.ndarray
    fastest: np.ndarray
    share: np.ndarray  # (steps, members): share of the mass that is on the terrain [1]


@dataclass(frozen=True)
class Ground:
    """The sliding surface below the masses, and which cells of the terrain (nx, ny) have an elevation, from the south-west."""

    surface: Surface
    known: np.ndarray
    size: tuple[float, float]

    @classmethod
    def under(cls, releases: Sequence[Release], spacing: tuple[float, float]) -> "Ground":
        """The ground of releases on a grid of ``spacing`` [m]."""
        terrain, dug = releases[0].terrain, np.sum([r.excavation for r in releases], axis=0)
        surface = raster_surface(terrain, dug if dug.any() else None, spacing)
        return cls(surface, np.isfinite(terrain.elevation)[::-1].T, terrain.cell_size)

    def holds(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Whether local positions (n,) [m] lie on cells with an elevation."""
        (nx, ny), (dx, dy) = self.known.shape, self.size
        i, j = (np.floor(place / size).astype(np.int64) for place, size in ((x, dx), (y, dy)))
        inside = (i >= 0) & (i < nx) & (j >= 0) & (j < ny)
        return inside & self.known[np.clip(i, 0, nx - 1), np.clip(j, 0, ny - 1)]


@dataclass
class Points:
    """Points that move."""

    # member, release: (n,): number of the member and of the release of each point
    member: np.ndarray
    release: np.ndarray
    # place, velocity: (2, n): local position [m] and velocity in plan [m/s]
    place: np.ndarray
    velocity: np.ndarray
    thinness: np.ndarray  # (n,): thickness of the columns above them, over that for which the resistance was made [1]

    @classmethod
    def of(cls, releases: Sequence[Release], members: int, points: int) -> "Points":
        """Points that stand for equal volumes of the releases, the same for every member."""
        number, place = _starts(releases, np.outer(SEQUENCE, np.arange(1.0, points + 1.0)) % 1.0)
        release, place = np.tile(number, members), np.tile(place, (1, members))
        return cls(np.repeat(np.arange(members), points), release, place, np.zeros_like(place), np.ones(len(release)))

    def advance(self, ground: Ground, resistance: Resistance, dt: float, pressed: np.ndarray | float = 0.0) -> np.ndarray:
        """Speed (n,) [m/s] after a step of ``dt`` [s]; ``pressed`` (2, n) [1] is what neighbours add to the slope."""
        _, *slopes = ground.surface.evaluate(*self.place)
        slope = np.array(slopes)
        cosine2 = 1.0 / (1.0 + (slope**2).sum(0))
        self.velocity -= dt * STANDARD_GRAVITY * cosine2 * (slope + pressed)
        speed = np.sqrt((self.velocity**2).sum(0) + (self.velocity * slope).sum(0) ** 2)
        (x, y), cosine = self.place, np.sqrt(cosine2)
        steady, drag = resistance(Columns(self.member, self.release, x, y, cosine, speed, self.thinness))
        left = _slip_after(np.maximum(0.0, speed - dt * steady), dt * drag)
        self.velocity *= left / np.maximum(speed, 1e-12)
        self.place += dt * self.velocity
        return left

    def keep(self, those: np.ndarray) -> None:
        """Drop the others."""
        self.member, self.release, self.thinness = self.member[those], self.release[those], self.thinness[those]
        self.place, self.velocity = self.place[:, those], self.velocity[:, those]


def volume_and_square(releases: Sequence[Release], points: int) -> tuple[float, float]:
    """Volume [m3] of one of the ``points`` that stand for releases, and side [m] of the squares on which they are counted."""
    return sum(r.volume for r in releases) / points, math.sqrt(sum(r.area for r in releases)) / SQUARES


@dataclass
class _Gathering:
    """Thickness of a mass by how many of its points lie together, on squares as wide as a part of the releases.

    A flow becomes thicker where points gather, in channels and at its front, and thinner as they part.
    """

    volume: float  # volume that one point stands for [m3]
    size: float  # side of a square [m]
    most: np.ndarray  # (releases,): thickness [m] for which the resistance was made: points that gather further count as this
    moved: float = math.inf  # way of the fastest point since the last count [m]

    @classmethod
    def of(cls, releases: Sequence[Release], points: int, most: Sequence[float]) -> "_Gathering":
        """Of releases that ``points`` stand for."""
        return cls(*volume_and_square(releases, points), np.asarray(most))

    def count(self, points: Points, way: float) -> None:
        """Set the thinness of points, of which the fastest has moved on by ``way`` [m]; seldom, where they hardly move."""
        self.moved += way
        if self.moved < CROSSING * self.size:
            return
        self.moved = 0.0
        x, y = np.floor(points.place / self.size).astype(np.int64)
        _, square, number = np.unique((points.member << 42) + (x << 21) + y, return_inverse=True, return_counts=True)
        thickness = number[square] * self.volume / self.size**2
        points.thinness = np.minimum(1.0, thickness / self.most[points.release])


def slide(
    releases: Sequence[Release],
    resistance: Resistance,
    members: int,
    spacing: tuple[float, float],
    end_time: float = math.inf,
    points: int = POINTS,
    most: Sequence[float] | None = None,
) -> Slide:
    """Points of equal mass that slide from where the releases lie, each alone, against the friction of the ground.

    Along the slope they gain g sin(slope), as in the energy line (Heim 1932), and lose what the ground resists. They keep their
    velocity in plan where the slope changes: at a kink this loses what a plastic impact takes. A point that rests stays at rest.
    Points that leave the terrain or reach cells without elevation are gone.

    Parameters
    ----------
    releases : sequence of Release
        On one terrain.
    resistance : callable
        Resistance of :mod:`runout.model.column_resistance`.
    members : int
    spacing : tuple of float
        Spacing of the grid [m], east and north: the surface follows the terrain as that of a run on this grid.
    end_time : float
        End of the slide [s]. By default points slide until they rest or leave the terrain, for :data:`MOST_STEPS` steps at most.
    points : int
        Number of points of each member.
    most : sequence of float, optional
        Vertical thickness [m] of each release for which ``resistance`` was made. With it the columns are as thick as the points
        gather, at most so; without it they keep the thickness of the resistance.
    """
    ground, moving = Ground.under(releases, spacing), Points.of(releases, members, points)
    gathering = None if most is None else _Gathering.of(releases, points, most)
    rows: list[tuple[float, np.ndarray, np.ndarray, np.ndarray]] = []
    cell, time, fastest = min(ground.surface.spacing), 0.0, np.zeros(1)
    longest = math.sqrt(cell / STANDARD_GRAVITY) if math.isinf(end_time) else end_time / STEPS
    shortest = 0.0 if math.isinf(end_time) else end_time / MOST_STEPS
    staying = np.full(members, points)
    while len(moving.member) and time < end_time * (1 - 1e-9) and len(rows) < MOST_STEPS:
        dt = min(max(min(CROSSING * cell / max(float(fastest.max()), 1e-9), longest), shortest), end_time - time)
        time += dt
        if gathering:
            gathering.count(moving, dt * float(fastest.max()))
        speed = moving.advance(ground, resistance, dt)
        there = ground.holds(*moving.place)
        staying = staying - np.bincount(moving.member[~there], minlength=members)
        goes_on = there & (speed > 0.0)
        speed = speed[goes_on]
        moving.keep(goes_on)
        energy, fastest = np.bincount(moving.member, speed**2, members), np.zeros(members)
        np.maximum.at(fastest, moving.member, speed)
        rows.append((time, np.sqrt(energy / np.maximum(staying, 1)), fastest, staying / points))
    return Slide(*map(np.array, zip(*rows, strict=True)))


def _starts(releases: Sequence[Release], within: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Releases (n,) and local positions (2, n) [m] of points for equal volumes, at places ``within`` (2, n) their cells."""
    points, cells = within.shape[1], [r.thickness[::-1].T.ravel() for r in releases]
    volume = np.cumsum(np.concatenate(cells))
    place_in_releases = np.searchsorted(volume, (np.arange(points) + 0.5) / points * volume[-1])
    number, cell = np.divmod(place_in_releases, len(cells[0]))
    place = np.stack(np.divmod(cell, releases[0].terrain.shape[0])) + within
    return number, place * np.array(releases[0].terrain.cell_size)[:, None]


def lateral_pressure(materials: Sequence[Material]) -> np.ndarray:
    """Stress along the ground over that normal to it (materials,) [1]: the mean of a liquid, 1, and of the mass at rest.

    In a flow it lies between both ends (Savage and Hutter 1989, J. Fluid Mech. 199:177).
    """
    return np.array([0.5 * (1.0 + min(1.0, m.rest_ratio)) for m in materials])


@dataclass
class _Squares:
    """Thickness of the mass at the corners of squares; each point spreads its volume over the nearest four."""

    volume: float  # volume that one point stands for [m3]
    size: float  # side of a square [m]
    peak: np.ndarray = field(repr=False)  # (east, north): largest thickness so far [m]

    @classmethod
    def under(cls, releases: Sequence[Release], points: int) -> "_Squares":
        terrain, (volume, size) = releases[0].terrain, volume_and_square(releases, points)
        (rows, columns), (dx, dy) = terrain.shape, terrain.cell_size
        shape = math.ceil(columns * dx / size) + 2, math.ceil(rows * dy / size) + 2
        return cls(volume, size, np.zeros(shape))

    def lay(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Thickness (n,) [m] and its slope (2, n) [1] at the places (2, n) [m] of all points."""
        corner = np.floor(place / self.size)
        east, north = place / self.size - corner
        first = (corner[0] * self.peak.shape[1] + corner[1]).astype(np.int64)
        four = first + np.array([[[0], [1]], [[self.peak.shape[1]], [self.peak.shape[1] + 1]]])
        along, across = np.array([1.0 - east, east]), np.array([1.0 - north, north])
        weight = along[:, None] * across
        nodes, which = np.unique(four, return_inverse=True)
        thickness = np.bincount(which.ravel(), weight.ravel()) * (self.volume / self.size**2)
        highest = self.peak.ravel()
        highest[nodes] = np.maximum(highest[nodes], thickness)
        around = thickness[which.reshape(four.shape)]
        slope = np.array([((around[1] - around[0]) * across).sum(0), ((around[:, 1] - around[:, 0]) * along).sum(0)])
        return (weight * around).sum((0, 1)), slope / self.size


def forecast_depth(
    releases: Sequence[Release],
    resistance: Resistance,
    pressure: np.ndarray,
    spacing: tuple[float, float],
    end_time: float,
    thickness: Sequence[float],
    points: int = POINTS,
) -> float:
    """Depth [m] of the flow of releases, as :func:`runout.model.depth_resolution.flow_depth` has it of a run.

    Parameters
    ----------
    releases : sequence of Release
        On one terrain.
    resistance : callable
        Resistance of :mod:`runout.model.column_resistance`, for columns of a vertical ``thickness`` [m] of each release.
    pressure : ndarray (releases,)
        Result of :func:`lateral_pressure`.
    spacing : tuple of float
        Spacing of the grid [m], east and north.
    end_time : float
        End of the forecast [s].
    points : int
        Number of points of all releases together.
    """
    ground, moving, squares = Ground.under(releases, spacing), Points.of(releases, 1, points), _Squares.under(releases, points)
    time, steps, fastest, most = 0.0, 0, 0.0, np.asarray(thickness)
    while len(moving.member) and time < end_time * (1 - 1e-9) and steps < MOST_SQUARE_STEPS:
        depth, slope = squares.lay(moving.place)
        moving.thinness = np.minimum(1.0, depth / most[moving.release])
        speed = float(np.hypot(*moving.velocity).max()) + math.sqrt(STANDARD_GRAVITY * float(depth.max()))
        dt = min(COURANT * squares.size / speed, end_time - time)
        left = moving.advance(ground, resistance, dt, pressure[moving.release] * slope)
        moving.keep(ground.holds(*moving.place))
        usual = math.sqrt(float((left**2).mean()))
        time, steps, fastest = time + dt, steps + 1, max(fastest, usual)
        if usual <= RESTING * fastest:
            break
    return flow_depth(squares.peak[squares.peak > 0])
