"""How fast a mass may become: its height below the energy line, less where friction grows with the speed."""

import math
from collections.abc import Sequence

import numpy as np

from runout.model.column_resistance import ColumnResistance, resting_resistance
from runout.model.ground_friction import GroundFriction
from runout.model.release import Release
from runout.model.scene import STANDARD_GRAVITY
from runout.terrain.prepare import below_energy_line
from runout.terrain.sliding_points import slide

GATHERED = 2.5  # thickness of the fastest part of a flow over the mean of its release: channels and fronts gather mass
BRIDGED = 8  # bumps shorter than this part of a release do not change the speed of a mass
POINTS = 40  # of all releases together


def largest_speed(releases: Sequence[Release], angles: Sequence[float]) -> float:
    """Estimate of the largest speed [m/s] of masses, each against friction of its angle [rad].

    v^2 = 2 g (line - ground) below the energy line (Heim 1932) from the centre of each mass, with distances in plan from
    there, on the cells that the masses can reach. The line of a mass that starts with a speed v_0 begins v_0^2 / 2 g higher. On
    nine flows the fastest particle had 0.91 to 1.09 of it (docs/theory).

    ``releases``: on one terrain. ``angles``: smallest friction angle [rad] that acts at the base of each.
    """
    terrain = releases[0].terrain
    known = np.isfinite(terrain.elevation)  # all cells under the masses: a run refuses others
    ground = np.where(known, terrain.elevation, 0.0) - np.sum([r.excavation for r in releases], axis=0)
    mass = np.sum([r.thickness for r in releases], axis=0)
    heads = [r.start_speed**2 / (2.0 * STANDARD_GRAVITY) for r in releases]
    reach = _reach(np.where(known, ground, np.inf), mass, terrain.cell_size, min(angles), max(heads)) & known
    fall = max(_fall(ground, r, reach, math.tan(angle), head) for r, angle, head in zip(releases, angles, heads, strict=True))
    return math.sqrt(2.0 * STANDARD_GRAVITY * fall)


def _reach(ground: np.ndarray, thickness: np.ndarray, cell_size: tuple[float, float], angle: float, head: float) -> np.ndarray:
    """Cells that masses can reach by the energy line from a ``head`` [m] above their highest point.

    As :func:`runout.terrain.prepare.reachable`. Distances count from the box of the masses, which is simpler than from their
    outline, and reaches no less.
    """
    (dx, dy), mass = cell_size, thickness > 0
    north, east = _aside(thickness.sum(axis=1), dy), _aside(thickness.sum(axis=0), dx)
    heights = (ground + thickness)[mass]
    top = float(heights[np.isfinite(heights)].max(initial=-np.inf)) + head
    return below_energy_line(ground, mass, np.hypot(north[:, None], east), top, angle, cell_size)


def _aside(thickness: np.ndarray, size: float) -> np.ndarray:
    """Distance [m] of rows or columns of ``size`` [m] from those with some thickness."""
    cells, inside = np.arange(len(thickness)), np.flatnonzero(thickness)
    return size * np.maximum(np.maximum(inside[0] - cells, cells - inside[-1]), 0)


def _fall(ground: np.ndarray, release: Release, reach: np.ndarray, friction: float, head: float) -> float:
    """Largest height [m] of reached cells below the energy line of one mass, which begins a ``head`` [m] above its centre."""
    (dx, dy), share = release.terrain.cell_size, release.thickness / release.thickness.sum()
    rows, columns = np.arange(ground.shape[0]), np.arange(ground.shape[1])
    north, east = (rows - share.sum(axis=1) @ rows) * dy, (columns - share.sum(axis=0) @ columns) * dx
    centre = float((share * (ground + 0.5 * release.thickness)).sum()) + head
    below = centre - friction * np.hypot(east[None, :], north[:, None]) - ground
    return float(below[reach].max(initial=0.0))


def speeds_with_drag(
    releases: Sequence[Release], grounds: Sequence[GroundFriction], limits: np.ndarray, points: int = POINTS
) -> np.ndarray:
    """Estimates (members,) of the largest speed [m/s] of masses on one terrain, each at most its ``limits`` (members,) [m/s].

    The limits are the speeds without drag, of :func:`largest_speed`; ``grounds`` are those of the members. Points slide from where
    the releases lie against the law of friction, under the load of a column :data:`GATHERED` times as thick as the mean of its
    release, and once more against the coefficients at rest alone. Where the latter stay slower than the limit, since they lose
    speed at kinks of the path, the estimate grows by that ratio. Without drag it is the limit.
    """
    thickness = [GATHERED * float(r.thickness[r.thickness > 0].mean()) for r in releases]
    laws = ColumnResistance(grounds, thickness, float(limits.max())), resting_resistance(grounds)
    length = math.sqrt(sum(r.area for r in releases)) / BRIDGED
    slid, free = (slide(releases, r, len(grounds), (length, length), points=points).fastest.max(0) for r in laws)
    hindered = np.maximum(1.0, limits / np.maximum(free, 1e-9))
    return np.where(free > 0, np.minimum(limits, slid * hindered), limits)  # type: ignore[no-any-return]
