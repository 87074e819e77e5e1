"""Particles of a cell where nobody states them: four above each other, or one where a thick mass stays thick.

A flow on a slope thins, and what is thinner than a cell needs several particles above each other. A mass that friction holds on
level ground keeps much of its thickness, and more particles in plan pay there (docs/decisions/11-particle-arrangement.md).
"""

import math
from collections.abc import Sequence

import numpy as np

from runout.accuracy import PARTICLES_PER_CELL
from runout.model.friction import FrictionZones
from runout.model.materials import Material
from runout.model.release import Release
from runout.terrain.fill import filled
from runout.terrain.prepare import reachable, steepness

LEVEL = (3, 3, 1)  # particles of a cell of a thick mass on level ground
THICK = 4.5  # cells through a thick mass; in a thinner one (2, 2, 4) is as accurate or more
HELD = 2.0  # times the slope of the ground above which friction holds a mass


def default_particles(
    releases: Sequence[Release], material: Material, angle: float, height: float, zones: FrictionZones | None = None
) -> tuple[int, int, int]:
    """Particles (px, py, pz) of a cell for a run that states none.

    Parameters
    ----------
    releases : sequence of Release
    material : Material
        Of the releases that bring none of their own.
    angle : float
        Basal friction angle of the releases that bring none of their own [rad].
    height : float
        Of a cell [m].
    zones : FrictionZones, optional
        Where the ground changes the friction.
    """
    cells = min((r.volume / r.area for r in releases), default=0.0) / height
    if cells < THICK:
        return PARTICLES_PER_CELL
    angles = [angle if r.basal_friction_angle is None else r.basal_friction_angle for r in releases]
    basal = zones.least_angle(min(angles)) if zones else min(angles)
    friction = min(math.tan(basal), *((r.material or material).internal_friction for r in releases))
    return particles_for(cells, _steepest(releases, friction), friction)


def particles_for(cells: float, slope: float, friction: float) -> tuple[int, int, int]:
    """Particles (px, py, pz) of a cell.

    Parameters
    ----------
    cells : float
        Through the mean thickness of the mass [1].
    slope : float
        Tangent of the steepest ground that the mass can reach [1].
    friction : float
        Least coefficient [1] of the ground and of the mass itself.
    """
    return LEVEL if cells >= THICK and friction > HELD * slope else PARTICLES_PER_CELL


def _steepest(releases: Sequence[Release], friction: float) -> float:
    """Tangent [1] of the steepest ground that releases can reach against ``friction`` [1], the hollow that they leave included.

    Once the ground below them is too steep for friction to hold them, no other is looked at.
    """
    terrain = releases[0].terrain
    thickness = np.sum([r.thickness for r in releases], axis=0)
    ground = filled(terrain.elevation, terrain.cell_size) - np.sum([r.excavation for r in releases], axis=0)
    slope = steepness(ground, terrain.cell_size)
    below = float(slope[thickness > 0].max())
    if HELD * below >= friction:
        return below
    return float(slope[reachable(terrain, thickness, math.atan(friction))].max())
