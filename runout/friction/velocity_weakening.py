"""Basal friction that falls with the speed, for large and fast rock avalanches.

mu(s) = mu_w + (mu_0 - mu_w) / (1 + s / U_w) of the slip speed s (Lucas, Mangeney & Ampuero 2014, Nat. Commun. 5:3417, eq. 1).
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from runout.model.basal_friction import BasalFriction
from runout.model.friction_laws import register_friction
from runout.model.parameters import parameter
from runout.physics.tensors import real


@dataclass(frozen=True, kw_only=True)
class VelocityWeakening(BasalFriction):
    """Friction that falls with the speed: large rock avalanches."""

    law: ClassVar[str] = "velocity_weakening"
    coefficients: ClassVar[tuple[str, ...]] = ("static_friction", "dynamic_friction")
    static_friction: float = parameter("friction coefficient at rest", low=0, high=2, default=0.84, sampled=True)
    dynamic_friction: float = parameter("friction coefficient at high speed", low=0, high=2, default=0.11, sampled=True)
    weakening_speed: float = parameter(
        "speed at which half of the difference is lost", unit="m/s", low=0, high=1000, open_low=True, default=4.0, sampled=True
    )


def resistance(normal: Any, slip: Any, area: Any, dt: Any, basal: Any):
    """Steady impulse [N s] and drag [kg/m]: mu at the slip speed times the normal impulse, and none."""
    lost = basal.static_friction - basal.dynamic_friction
    friction = basal.dynamic_friction + lost / (real(1.0) + slip / basal.weakening_speed)
    return friction * normal, real(0.0)


register_friction(VelocityWeakening, resistance)
