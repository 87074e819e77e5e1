"""Points that slide over the ground in place of a mass: how long, how fast and how far it flows, without a run."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from runout.model.release import Release
from runout.model.scene import STANDARD_GRAVITY

POINTS = 200  # of all releases together
STEPS = 800  # least number until the end time
CROSSING = 0.5  # cells of the terrain that a point crosses in a step

Friction = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Slide:
    """Slides of some members, until all points rest or have gone.

    Attributes
    ----------
    time : ndarray (steps,)
        [s]
    speed, fastest : ndarray (steps, members)
        Root mean square and largest speed [m/s].
    share : ndarray (steps, members)
        Of the mass that is on the terrain [1].
    """

    time: np.ndarray
    speed: np.ndarray
    fastest: np.ndarray
    share: np.ndarray


@dataclass(frozen=True)
class _Ground:
    """Slopes (2, nx ny) [1] east and north below the masses, at the cells from the south-west corner; NaN at the rim."""

    slopes: np.ndarray
    shape: tuple[int, int]
    size: tuple[float, float]

    @classmethod
    def under(cls, releases: Sequence[Release], spacing: tuple[float, float]) -> "_Ground":
        """The ground of releases, with slopes over a grid cell of ``spacing`` [m] or a cell of the terrain to either side."""
        terrain = releases[0].terrain
        z = (terrain.elevation - np.sum([r.excavation for r in releases], axis=0))[::-1].T
        slopes = np.full((2, *z.shape), np.nan, np.float32)
        for axis, (size, h) in enumerate(zip(terrain.cell_size, spacing, strict=True)):
            cells = min(max(1, round(h / size)), (z.shape[axis] - 1) // 2)
            line, inner = np.moveaxis(z, axis, 0), np.moveaxis(slopes[axis], axis, 0)
            if cells:
                inner[cells:-cells] = (line[2 * cells :] - line[: -2 * cells]) / (2 * cells * size)
        return cls(slopes.reshape(2, -1), z.shape, terrain.cell_size)

    def at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Slopes (2, ...) at local positions [m], bilinear; NaN where the points have left the terrain or what is known of it."""
        (nx, ny), (dx, dy) = self.shape, self.size
        p, q = x / dx - 0.5, y / dy - 0.5
        i, j = (np.clip(r, 0, max(n - 2, 0)).astype(np.int64) for r, n in ((p, nx), (q, ny)))
        a, b, k, last = p - i, q - j, i * ny + j, nx * ny - 1
        west, east = (
            self.slopes[:, np.minimum(start, last)] * (1 - b) + self.slopes[:, np.minimum(start + 1, last)] * b
            for start in (k, k + ny)
        )
        return west * (1 - a) + east * a  # type: ignore[no-any-return]


def slide(
    releases: Sequence[Release], friction: Friction, members: int, spacing: tuple[float, float], times: tuple[float, float]
) -> Slide:
    """Points of equal mass that slide from where the releases lie, each alone, against Coulomb friction.

    Along the slope they gain g sin(slope) and lose mu g cos(slope), as in the energy line (Heim 1932). They keep their velocity in
    plan where the slope changes: at a kink this loses what a plastic impact takes. Points that leave the terrain or reach cells
    without elevation are gone.

    Parameters
    ----------
    releases : sequence of Release
        On one terrain.
    friction : callable
        Coefficients (members, n) [1] of masses of releases (n,) at local positions (members, n), (members, n) [m].
    members : int
    spacing : tuple of float
        Length over which slopes count [m], east and north; a cell of the terrain if that is longer.
    times : tuple of float
        End time, and that in which the fastest point crosses a cell of the terrain [s].
    """
    ground, (number, start) = _Ground.under(releases, spacing), _starts(releases)
    place = np.repeat(start[:, None], members, axis=1)
    velocity, there = np.zeros_like(place), np.ones(place.shape[1:], bool)
    count = int(max(STEPS, min(4 * STEPS, times[0] / (CROSSING * times[1]))))
    dt, rows = times[0] / count, []
    for _ in range(count):
        slope = ground.at(*place)
        there &= ~np.isnan(slope.sum(0))
        slope = np.where(there, slope, 0.0)
        cosine2 = 1.0 / (1.0 + (slope**2).sum(0))
        velocity -= dt * STANDARD_GRAVITY * cosine2 * slope
        lost = dt * STANDARD_GRAVITY * friction(number, *place) * np.sqrt(cosine2)
        velocity *= np.maximum(0.0, 1.0 - lost / np.maximum(_speed(velocity, slope), 1e-12)) * there
        place += dt * velocity
        speed, left = _speed(velocity, slope), there.sum(1)
        rows.append((np.sqrt((speed**2).sum(1) / np.maximum(left, 1)), speed.max(1), left / POINTS))
        if not speed.any():
            break
    return Slide(dt * np.arange(1, len(rows) + 1), *map(np.array, zip(*rows, strict=True)))


def _speed(velocity: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Speed [m/s] along the ground of velocities in plan (2, ...)."""
    return np.sqrt((velocity**2).sum(0) + (velocity * slope).sum(0) ** 2)  # type: ignore[no-any-return]


def _starts(releases: Sequence[Release]) -> tuple[np.ndarray, np.ndarray]:
    """Releases (n,) and local positions (2, n) [m] of points that stand for equal volumes."""
    cells = [r.thickness[::-1].T.ravel() for r in releases]
    volume = np.cumsum(np.concatenate(cells))
    found = np.searchsorted(volume, (np.arange(POINTS) + 0.5) / POINTS * volume[-1])
    number, cell = np.divmod(found, len(cells[0]))
    place = np.stack(np.divmod(cell, releases[0].terrain.shape[0])) + 0.5
    return number, place * np.array(releases[0].terrain.cell_size)[:, None]
