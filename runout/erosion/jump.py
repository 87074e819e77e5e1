"""Erosion by the jump of shear stress between the base of the flow and the bed, with a ceiling.

E = (tau - tau_b) / (rho_b beta u), at most `most`; tau is the friction of the flow on the ground, and the bed resists with
tau_b = tan(phi_b) (1 - lambda_b) sigma + c (Iverson 2012, J. Geophys. Res. 117:F03006; Iverson & Ouyang 2015, Rev. Geophys. 53:27).
With a wet bed the rate feeds itself without end, so that the ceiling must be stated.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from runout.model.erosion_laws import Erosion, register_erosion
from runout.model.parameters import parameter
from runout.physics.tensors import real

STILL = 1e-3  # [m/s]: least speed that divides the jump


@dataclass(frozen=True, kw_only=True)
class JumpErosion(Erosion):
    """Jump of shear stress between flow and bed, with a stated ceiling: studies of wet beds."""

    law: ClassVar[str] = "jump"
    of_friction: ClassVar[bool] = True
    most: float = parameter("largest erosion rate", unit="m/s", low=0, high=10, typical=0.05, sampled=True)
    friction_angle: float = parameter(
        "friction angle of the bed", unit="deg", low=0, high=60, default=35.0, degrees=True, sampled=True
    )
    cohesion: float = parameter("cohesion of the bed", unit="Pa", low=0, high=1e6, default=0.0, sampled=True)
    speed_ratio: float = parameter(
        "speed at the base of the flow over its mean speed", low=0, high=1, open_low=True, default=1.0, sampled=True
    )


def erosion_rate(H: Any, u: Any, sigma: Any, tau: Any, pore_ratio: Any, eroded: Any, bed: Any):
    """Erosion rate E [m/s]."""
    strength = math.tan(bed.friction_angle) * (real(1.0) - bed.pore_ratio) * sigma + bed.cohesion
    jump = max(real(0.0), tau - strength)
    return min(bed.most, jump / (bed.density * bed.speed_ratio * max(u, real(STILL))))


register_erosion(JumpErosion, erosion_rate)
