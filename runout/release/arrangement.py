"""Default particles per cell: (2, 2, 4), more levels in masses thinner than half a cell, (3, 3, 1) in thick ones on level ground.

A flow on a slope becomes thin, and layers thinner than a cell need several particles above each other: a layer of one level carries
too little pressure at its rim. A mass that friction holds on level ground stays thick, and more particles in plan are more accurate
there (docs/decisions/11-particle-arrangement.md).
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
from runout.terrain.fill import filled
from runout.terrain.prepare import reachable, steepness

LEVEL = (3, 3, 1)  # particles per cell for a thick mass on level ground
THICK = 4.5  # least cells through a thick mass; for thinner ones (2, 2, 4) is at least as accurate
THIN = 0.5  # cells through a mass; thinner ones get as many levels through their thickness as others through a cell
MOST_LEVELS = 32
HELD = 2.0  # ratio of friction to slope above which friction holds a mass


def default_particles(
    releases: Sequence[Release], material: Material, basal: BasalFriction | float, height: float, zones: FrictionZones | None = None
) -> tuple[int, int, int]:
    """Default particles per cell (px, py, pz) of a run.

    Parameters
    ----------
    releases : sequence of Release
    material : Material
        Material of the releases without one of their own.
    basal : BasalFriction or float
        Basal friction of the releases without one of their own, or its angle [rad].
    height : float
        Height of a cell [m].
    zones : FrictionZones, optional
        Zones with another basal friction.
    """
    cells = min((r.volume / r.area for r in releases), default=height) / height
    if cells < THICK:
        return particles_for(cells, 0.0, 0.0)
    frictions = [r.friction_on(basal) for r in releases]
    least = least_angle(frictions, [math.inf] * len(frictions), zones)
    friction = min(math.tan(least), *((r.material or material).internal_friction for r in releases))
    return particles_for(cells, _steepest(releases, friction), friction)


def particles_for(cells: float, slope: float, friction: float) -> tuple[int, int, int]:
    """Particles per cell (px, py, pz).

    Parameters
    ----------
    cells : float
        Cells through the mean thickness of the mass [1].
    slope : float
        Tangent of the steepest ground that the mass can reach [1].
    friction : float
        Least coefficient [1] of the ground and of the mass itself.
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
