"""A law of basal friction with drag, for tests: tau = sigma (mu + c s^2). A block on a plane comes to v_inf tanh(a t / v_inf)."""

from dataclasses import dataclass
from typing import Any, ClassVar

from runout import BasalFriction, parameter, register_friction


@dataclass(frozen=True, kw_only=True)
class DragByLoad(BasalFriction):
    """Coulomb friction, and drag that grows with the normal stress and the square of the speed."""

    law: ClassVar[str] = "drag_by_load"
    coefficients: ClassVar[tuple[str, ...]] = ("friction",)
    friction: float = parameter("friction coefficient", low=0, high=2, default=0.2, sampled=True)
    drag: float = parameter("drag over normal stress and squared speed", unit="s2/m2", low=0, high=10, default=0.05, sampled=True)


def resistance(normal: Any, slip: Any, area: Any, dt: Any, basal: Any):
    """Steady impulse [N s] and drag [kg/m]."""
    return basal.friction * normal, basal.drag * normal / dt


register_friction(DragByLoad, resistance)
