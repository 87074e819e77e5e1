"""Drucker-Prager plasticity whose cohesion falls to a residual with the slip, on Hencky strain.

Yield: q <= M p + q_c, where q_c falls in a line from its peak to its residual while the plastic shear grows to slip/h:
softening_slip is the slip across a cell of size h. A shear band is some cells wide; the scaling by h keeps its slip and its energy
by area (Pietruszczak & Mroz 1981, IJNME 17:327). The return is implicit: with the plastic shear x of a step,
q_trial - sqrt(3) G x = M p + q_c(x). What comes apart at the apex has its residual cohesion from then on.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from runout.errors import MaterialError
from runout.materials.drucker_prager import DruckerPrager, apex
from runout.model.laws import register_law
from runout.model.parameters import parameter
from runout.physics import geostatic
from runout.physics.elastic import deviatoric_stress, pressure
from runout.physics.plastic import dissipated_energy, gained_volume
from runout.physics.tensors import deviator, real, scaled, shifted, trace


@dataclass(frozen=True, kw_only=True)
class CohesionSoftening(DruckerPrager):
    """Cemented or overconsolidated soil, sensitive clay: cohesion is lost with the slip, friction stays.

    Shear localises in a few cells, whatever their size. A cell softens after the plastic shear softening_slip over cell, so that
    the slip of a band does not depend on the cell. Bands were four to seven cells wide and their slip five to seven times
    softening_slip: calibrate it. With a friction angle of 0, material carries any tension.
    """

    law: ClassVar[str] = "cohesion_softening"
    history: ClassVar[str] = "softened part, below 0, down to -1; then the log volume gained and not yet lost again, above 0 [1]"
    cohesion: float = parameter(
        "cohesion of Mohr-Coulomb at the peak", unit="Pa", low=0, high=1e9, open_low=True, typical=1e4, sampled=True,
        hint="1 kPa is 1.0e3",
    )  # fmt: skip
    residual_cohesion: float = parameter(
        "cohesion of Mohr-Coulomb after the softening", unit="Pa", low=0, high=1e9, default=0.0, sampled=True, hint="1 kPa is 1.0e3"
    )
    softening_slip: float = parameter(
        "slip across one cell that takes its cohesion from peak to residual", unit="m", low=1e-4, high=100,
        typical=0.2, sampled=True,
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.residual_cohesion > self.cohesion:
            raise MaterialError(
                f"residual_cohesion is {self.residual_cohesion:g} Pa, above the cohesion of {self.cohesion:g} Pa at the peak; "
                "cohesion falls with the slip, take a smaller one"
            )
        if self.friction_angle == 0 and self.residual_cohesion == 0:
            raise MaterialError("friction_angle and residual_cohesion are both 0; nothing of such a material is left, set one")

    @property
    def residual_intercept(self) -> float:
        """Intercept q_c [Pa] of the cone after the softening."""
        return self.yield_cone[1] * self.residual_cohesion / self.cohesion

    def shear_strength(self, pressure: float) -> float:
        """That of the residual cohesion, see :meth:`runout.Material.shear_strength`."""
        return geostatic.shear_strength(self.yield_cone[0], self.residual_intercept / pressure)  # type: ignore[no-any-return]

    def record(self) -> dict[str, float]:
        """That of Drucker-Prager, residual intercept [Pa], slip of the softening [m] and cell [m], which the backend sets."""
        own = {"residual_intercept": self.residual_intercept, "softening_slip": self.softening_slip, "cell_size": 1.0}
        return super().record() | own


def softened_part(excess: Any, softened: Any, mat: Any):
    """Softened part [1] after a step whose trial q lies ``excess`` [Pa] above its limit with the part at its start."""
    strain = mat.softening_slip / mat.cell_size
    stiffness = math.sqrt(real(3.0)) * mat.shear_modulus * strain - (mat.cone_intercept - mat.residual_intercept)
    if excess < stiffness * (real(1.0) - softened):
        return softened + excess / stiffness
    return real(1.0)


def return_to_softened_cone(h: Any, softened: Any, slope: Any, mat: Any):
    """Hencky strain [1] on or in the cone with a ``slope`` [1], or at its apex, and the softened part [1] then."""
    loss = mat.cone_intercept - mat.residual_intercept
    friction = slope * pressure(h, mat)
    q = deviatoric_stress(h, mat)
    limit = friction + mat.cone_intercept - loss * softened
    if q <= limit:
        return h, softened
    part = real(1.0)
    if limit > real(0.0):
        part = softened_part(q - limit, softened, mat)
    limit = friction + mat.cone_intercept - loss * part
    if limit <= real(0.0):
        return apex(mat.residual_intercept, slope, mat), real(1.0)
    return shifted(scaled(deviator(h), limit / q), trace(h) * (real(1.0) / real(3.0))), part


def update(h: Any, history: Any, mat: Any, effective: Any):
    """Hencky strain, history and energy dissipated per stress-free volume [J/m3] after the return of a trial strain.

    ``history`` is the softened part, below 0, or, once that is all, the log volume gained at the apex, above 0 [1]. Where grains
    carry the share ``effective`` [1] of the mean stress, the cone is flatter by that share.
    """
    softened = -history
    gained = real(0.0)
    if history > real(0.0):
        softened = real(1.0)
        gained = history * mat.volume_correction
    pressed = shifted(h, gained * (real(1.0) / real(3.0)))
    new, softened = return_to_softened_cone(pressed, softened, effective * mat.cone_slope, mat)
    left = -softened
    if softened >= real(1.0):
        left = max(gained_volume(pressed, new), real(1.0e-12))  # not 0, which is that of intact material
    return new, left, dissipated_energy(h, new, mat)


register_law(CohesionSoftening, update)
