"""Coulomb friction: the same share of the normal stress at any speed."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import radians, tan
from typing import Any, ClassVar

from runout.model.basal_friction import BasalFriction, MassAbove
from runout.model.friction_laws import register_friction
from runout.model.limits import LIMITS
from runout.model.parameters import parameter
from runout.physics.tensors import real


@dataclass(frozen=True, kw_only=True)
class Coulomb(BasalFriction):
    """One friction angle, whatever the speed: rock and debris avalanches, and the default."""

    law: ClassVar[str] = "coulomb"
    coefficients: ClassVar[tuple[str, ...]] = ("friction",)
    friction_angle: float = parameter(
        "friction angle of the mass on the ground",
        unit="deg",
        low=LIMITS["basal_friction_angle"].low,
        high=LIMITS["basal_friction_angle"].high,
        typical=20.0,
        degrees=True,
        sampled=True,
    )

    def numbers(self) -> dict[str, float]:
        """The coefficient tan(angle) [1]."""
        return {"friction": tan(radians(self.friction_angle))}

    @classmethod
    def acting(cls, numbers: Mapping[str, Any], mass: MassAbove) -> dict[str, Any]:
        """The coefficient [1], at most the strength of the mass, so that contact does not compare them in every step."""
        import numpy as np  # the command line starts without NumPy

        return {"friction": np.minimum(numbers["friction"], mass.strength)}


def resistance(normal: Any, slip: Any, area: Any, dt: Any, basal: Any):
    """Steady impulse [N s] and drag [kg/m]: mu times the normal impulse, and none."""
    return basal.friction * normal, real(0.0)


register_friction(Coulomb, resistance)
