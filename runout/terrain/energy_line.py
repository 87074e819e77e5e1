"""How fast a mass may become: its height below the energy line."""

import math
from collections.abc import Sequence

import numpy as np

from runout.model.scene import STANDARD_GRAVITY
from runout.model.terrain import Terrain
from runout.terrain.fill import filled
from runout.terrain.prepare import reachable


def largest_speed(terrain: Terrain, thicknesses: Sequence[np.ndarray], angle: float) -> float:
    """Largest speed [m/s] that released masses may reach against friction of ``angle`` [rad].

    v^2 = 2 g (line - ground) below the energy line (Heim 1932) from the highest point of each mass, with distances in plan from
    that point, on the cells that it can reach. Friction on a path that is not straight, and within the mass, makes a flow slower.

    Parameters
    ----------
    terrain : Terrain
    thicknesses : sequence of ndarray (rows, columns)
        Released thickness of each mass [m].
    angle : float
        Smallest friction angle [rad] that acts at the base.
    """
    ground = filled(terrain.elevation, terrain.cell_size)
    reach = reachable(terrain, np.sum(thicknesses, axis=0), angle)
    fall = max(_fall(ground, terrain.cell_size, np.asarray(t) > 0, reach, math.tan(angle)) for t in thicknesses)
    return math.sqrt(2.0 * STANDARD_GRAVITY * max(fall, 0.0))


def _fall(ground: np.ndarray, cell_size: tuple[float, float], mass: np.ndarray, reach: np.ndarray, friction: float) -> float:
    """Largest height [m] below the energy line of one mass on the cells that are reached."""
    rows, columns = np.nonzero(mass)
    if not len(rows):
        return 0.0
    highest = int(np.argmax(ground[rows, columns]))
    row, column = rows[highest], columns[highest]
    east = (np.arange(ground.shape[1]) - column) * cell_size[0]
    north = (np.arange(ground.shape[0]) - row) * cell_size[1]
    below = ground[row, column] - friction * np.hypot(east[None, :], north[:, None]) - ground
    return float(below[reach].max(initial=0.0))
