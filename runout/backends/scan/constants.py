"""Constants of a run, and of its present time step, as the kernels take them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.backends import footprints
from runout.backends.scan.domain import domain_of
from runout.backends.scan.groups import Constants, Domain, TimeStep, Zones
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.physics import moments


@dataclass
class Tables:
    """What the scene and the time step say.

    Attributes
    ----------
    constants : Constants
    step : TimeStep
    packed_dt : float
        Time step [s] with whose stress the records are packed; 0 where they hold no stress.
    domain : Domain
    zones : Zones, optional
    particle_volume : float
        Mean volume of a particle [m3].
    """

    constants: Constants
    step: TimeStep
    packed_dt: float
    domain: Domain
    zones: Zones | None
    particle_volume: float

    @classmethod
    def of(cls, scene: Scene, particles: Particles, corner: np.ndarray) -> "Tables":
        """Tables of a scene whose blocks are counted from the node ``corner`` (3,); no time step is set yet."""
        real, spacing = scene.dtype, np.array(scene.spacing)
        friction = np.array(scene.acting_friction, real)
        zones = _zones(scene, real)
        if zones:  # contacts hold the number of their release until take_zones puts a friction in its place
            friction = np.arange(len(friction)).astype(real)
        constants = Constants(
            friction=friction, density=np.array([m.density for m in scene.materials], np.float64), h=spacing.astype(real),
            spacing=spacing, gravity=np.array(scene.gravity, np.float64), corner=corner, dv=np.zeros(16, real),
        )  # fmt: skip
        none = (real(0),) * 3
        step = TimeStep(scene.law.table(scene.materials, real), real(0), none, none)
        volume = footprints.mean_volume(scene, particles)
        return cls(constants, step, 0.0, domain_of(scene, corner), zones, volume)

    def set_step(self, scene: Scene, dt: float) -> Any:
        """Set the constants of steps of ``dt`` [s]; returns by how much longer [s] the step is with which records are packed."""
        real, dv, mats = scene.dtype, self.constants.dv, self.step.mats
        scene.law.set_step(mats, dt)
        longer = real(dt - self.packed_dt)
        if scene.packed:
            self.packed_dt = dt
        for k in range(16):
            dv[k] = dt * scene.gravity[k % 4 - 1] if k % 4 else 0.0
        slopes = tuple(real(moments.moment_slope(dt, h)) if scene.packed else real(0) for h in scene.spacing)
        self.step = TimeStep(mats, real(dt), slopes, tuple(real(dt / h) for h in scene.spacing))  # type: ignore[arg-type]
        return longer


def _zones(scene: Scene, real: Any) -> Zones | None:
    zones = scene.friction_zones
    if not zones:
        return None
    masses = np.column_stack([scene.friction, scene.strengths]).astype(real)
    factor, coefficient = (np.ascontiguousarray(values, real) for values in (zones.factor, zones.coefficient))
    return Zones(factor, coefficient, np.array(zones.cell_size), masses)
