"""Default particles per cell: (2, 2, 4), more levels in masses thinner than half a cell, (3, 3, 1) in thick ones on level ground.

A flow on a slope becomes thin, and layers thinner than a cell need several particles above each other: a layer of one level carries
too little pressure at its rim. A mass that friction holds on level ground stays thick, and more particles in plan are more accurate
there (docs/decisions/11-particle-arrangement.md).

The heights of particles are staggered from column to column by ordered dither.
"""

import math
from collections.abc import Sequence

import numpy as np

from runout.model.basal_friction import BasalFriction
from runout.model.basal_strength import least_angle
from runout.model.friction import FrictionZones
from runout.model.limits import PARTICLES_PER_CELL
from runout.model.materials import Material
from runout.model.release import Release
from runout.terrain.open_edge import filled
from runout.terrain.prepare import reachable, steepness

LEVEL = (3, 3, 1)  # particles per cell for a thick mass on level ground
THICK = 4.5  # least cells through a thick mass; for thinner ones (2, 2, 4) is at least as accurate
THIN = 0.5  # cells through a mass; thinner ones get as many levels through their thickness as others through a cell
MOST_LEVELS = 32
HELD = 2.0  # ratio of friction to slope above which friction holds a mass
ORDER = np.array([[0, 2], [3, 1]])  # levels of neighbours differ as much as possible
LEVELS = ORDER.size
CLOSE = 1e-9  # round-off as a share of a layer
PLASTIC = 0.7548776662466927, 0.5698402909980532  # steps of a sequence of low discrepancy in the plane (Roberts 2018)


def default_particles(
    releases: Sequence[Release], material: Material, basal: BasalFriction | float, height: float, zones: FrictionZones | None = None
) -> tuple[int, int, int]:
    """Default particles per cell (px, py, pz) of a run in cells of a ``height`` [m].

    ``material`` and ``basal``, a law or its angle [rad], are those of the releases without one of their own. ``zones`` have
    another basal friction.
    """
    cells = min((r.volume / r.area for r in releases), default=height) / height
    if cells < THICK:
        return particles_for(cells, 0.0, 0.0)
    frictions = [r.friction_on(basal) for r in releases]
    least = least_angle(frictions, [math.inf] * len(frictions), zones)
    friction = min(math.tan(least), *((r.material or material).internal_friction for r in releases))
    return particles_for(cells, _steepest(releases, friction), friction)


def particles_for(cells: float, slope: float, friction: float) -> tuple[int, int, int]:
    """Particles per cell (px, py, pz) of a mass of so many ``cells`` [1] through its mean thickness.

    ``slope`` is the tangent [1] of the steepest ground that the mass can reach, ``friction`` the least coefficient [1] of the
    ground and of the mass itself.
    """
    along, across, levels = PARTICLES_PER_CELL
    if cells < THIN:
        return along, across, min(MOST_LEVELS, math.ceil(levels / max(cells, 1.0 / MOST_LEVELS)))
    return LEVEL if cells >= THICK and friction > HELD * slope else PARTICLES_PER_CELL


def _steepest(releases: Sequence[Release], friction: float) -> float:
    """Tangent [1] of the steepest ground within reach of the releases against ``friction`` [1], including their scars.

    If friction cannot hold them on the ground below, no further ground is examined.
    """
    terrain = releases[0].terrain
    thickness = np.sum([r.thickness for r in releases], axis=0)
    ground = filled(terrain.elevation, terrain.cell_size) - np.sum([r.excavation for r in releases], axis=0)
    slope = steepness(ground, terrain.cell_size)
    below = float(slope[thickness > 0].max())
    if HELD * below >= friction:
        return below
    return float(slope[reachable(terrain, thickness, math.atan(friction))].max())


def shares(index: np.ndarray) -> np.ndarray:
    """Position of the particles of a column within their layer, from 0 at the bottom to 1 [1].

    There are four levels, each once in every two by two columns. Together these have four times as many heights of particles as
    one column. The lowest level lies half a level above the bottom. The order is that of Bayer (1973, An optimum method for
    two-level rendition of continuous-tone pictures).

    ``index`` (n, 2): of the columns, east and north.
    """
    return (ORDER[index[:, 0] % 2, index[:, 1] % 2] + 0.5) / LEVELS


def rows(thickness: np.ndarray, layer: float) -> np.ndarray:
    """Layers (m,) of about ``layer`` [m] into which columns of a thickness (m,) [m] are divided, at least one."""
    return np.maximum(1, np.floor(thickness / layer + 0.5 + CLOSE)).astype(np.int64)  # a half is rounded up in spite of round-off


def layered(index: np.ndarray, thickness: np.ndarray, layer: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Column (n,), height above its bottom (n,) [m] and layer height (n,) [m] of particles that fill columns.

    Parameters
    ----------
    index : ndarray (m, 2)
        Of the columns, east and north.
    thickness : ndarray (m,)
        Of the columns [m]; each is divided into equal layers, one at least.
    layer : float
        Nominal height of a layer [m]; the number of layers is rounded to the nearest.
    """
    count = rows(thickness, layer)
    column = np.repeat(np.arange(len(count)), count)
    row = np.arange(len(column)) - np.repeat(np.cumsum(count) - count, count)
    height = (thickness / count)[column]
    return column, (row + shares(index)[column]) * height, height


def half_size(height: np.ndarray) -> np.ndarray:
    """Half the distance [m] of levels for layers of ``height`` (n,) [m]; with this radius the lowest particles touch the ground."""
    return 0.5 * height / LEVELS
