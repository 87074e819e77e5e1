"""How fast a mass may become: its height below the energy line."""

import math
from collections.abc import Sequence

import numpy as np

from runout.model.release import Release
from runout.model.scene import STANDARD_GRAVITY
from runout.terrain.fill import filled
from runout.terrain.prepare import reachable


def largest_speed(releases: Sequence[Release], angle: float) -> float:
    """Estimate of the largest speed [m/s] of masses against friction of ``angle`` [rad].

    v^2 = 2 g (line - ground) below the energy line (Heim 1932) from the centre of each mass, with distances in plan from
    there, on the cells that the masses can reach. On two sites flows reached 0.61 to 0.95 of it (docs/theory).

    Parameters
    ----------
    releases : sequence of Release
        On one terrain.
    angle : float
        Friction angle [rad] that acts at the base.
    """
    terrain = releases[0].terrain
    reach = reachable(terrain, np.sum([r.thickness for r in releases], axis=0), angle)
    ground = filled(terrain.elevation, terrain.cell_size) - np.sum([r.excavation for r in releases], axis=0)
    fall = max(_fall(ground, r, reach, math.tan(angle)) for r in releases)
    return math.sqrt(2.0 * STANDARD_GRAVITY * fall)


def _fall(ground: np.ndarray, release: Release, reach: np.ndarray, friction: float) -> float:
    """Largest height [m] of reached cells below the energy line of one mass."""
    (dx, dy), share = release.terrain.cell_size, release.thickness / release.thickness.sum()
    rows, columns = np.arange(ground.shape[0]), np.arange(ground.shape[1])
    north, east = (rows - share.sum(axis=1) @ rows) * dy, (columns - share.sum(axis=0) @ columns) * dx
    centre = float((share * (ground + 0.5 * release.thickness)).sum())
    below = centre - friction * np.hypot(east[None, :], north[:, None]) - ground
    return float(below[reach].max(initial=0.0))
