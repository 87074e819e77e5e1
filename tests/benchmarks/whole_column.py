"""Voellmy friction whose Coulomb part slows the whole column too, for runs of masses with hardly any internal friction.

Depth-averaged models have no internal friction. A mass of low internal friction does not pass Coulomb friction on from its base;
here no shear has to pass. Both parts of tau = mu sigma + rho g u^2 / xi act as drag: mu sigma = (mu sigma / u^2) u^2.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from runout.friction.voellmy import Voellmy
from runout.model.friction_laws import register_friction
from runout.physics.tensors import real

SLOW = 0.05  # speed [m/s] below which the Coulomb part fades out, so this mass creeps and never rests


@dataclass(frozen=True, kw_only=True)
class WholeColumn(Voellmy):
    """Voellmy friction that acts on the column as a whole."""

    law: ClassVar[str] = "voellmy_whole_column"


def resistance(normal: Any, slip: Any, area: Any, dt: Any, basal: Any):
    """Steady impulse [N s], here none, and drag [kg/m]."""
    speed = max(slip, real(SLOW))
    return real(0.0), area * basal.drag + basal.mu * normal / (dt * speed * speed)


register_friction(WholeColumn, resistance)
