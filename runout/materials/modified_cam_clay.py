"""Modified Cam-clay on Hencky strain: soft soil that hardens when it is pressed and softens when it loosens.

Yield: q^2/M^2 + p (p - p_c) <= 0 with p = -tr(tau)/3 and q = sqrt(3/2) |dev tau| (Roscoe & Burland 1968). Flow is associated. The
preconsolidation pressure follows the plastic log volume, p_c = p_c0 exp(-gained/(lambda - kappa)), with the slopes of log volume
over log pressure of virgin compression and of swelling (Butterfield 1979, Geotechnique 29:469; Borja & Tamagnini 1998, CMAME
155:73). The elastic moduli are constant here, so that swelling at the pressure p has the slope p over the bulk modulus.

The return is implicit. Its unknown is the log volume x that a step loses plastically. With p = p_trial - K x,
p_c = p_c(x), D = 2 p - p_c and plastic multiplier x/D, the ellipse holds M^2 D^2 q_trial^2 = p (p_c - p) (M^2 D + 6 G x)^2. The
root lies between x = 0 and the critical state D = 0, where q = M p.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from runout.errors import MaterialError
from runout.model.laws import register_law
from runout.model.materials import Material
from runout.model.parameters import AUTO, parameter
from runout.physics.elastic import deviatoric_stress, pressure
from runout.physics.plastic import dissipated_energy
from runout.physics.tensors import deviator, real, scaled, shifted


@dataclass(frozen=True, kw_only=True)
class ModifiedCamClay(Material):
    """Soft clay and silt that drain: strength grows with consolidation, and shear ends at the critical state q = M p.

    The mass starts with the preconsolidation pressure that its stress at rest needs, times overconsolidation_ratio, and at
    least preconsolidation_pressure. With youngs_modulus auto the bulk modulus is at least preconsolidation_pressure over
    swelling_slope.
    """

    law: ClassVar[str] = "modified_cam_clay"
    history: ClassVar[str] = "plastic log volume gained [1], below 0 if lost; 0 until the first step sets the consolidation"
    critical_state_slope: float = parameter("slope M of q over p at the critical state", low=0.1, high=2, typical=1.0, sampled=True)
    compression_slope: float = parameter(
        "slope of log volume over log pressure in virgin compression, lambda/(1 + e)",
        low=1e-3, high=0.5, typical=0.1, sampled=True,
    )  # fmt: skip
    swelling_slope: float = parameter(
        "slope of log volume over log pressure in swelling, kappa/(1 + e)",
        low=0, high=0.2, open_low=True, typical=0.01, sampled=True,
    )  # fmt: skip
    preconsolidation_pressure: float = parameter(
        "mean pressure that the soil has carried before, at least", unit="Pa", low=100, high=1e8, typical=5e4, sampled=True,
        hint="50 kPa is 5.0e4",
    )  # fmt: skip
    overconsolidation_ratio: float = parameter(
        "preconsolidation pressure over that which the stress at rest needs", low=1, high=100, default=1.0, sampled=True
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.swelling_slope >= self.compression_slope:
            raise MaterialError(
                f"swelling_slope is {self.swelling_slope:g}, not below compression_slope {self.compression_slope:g}; "
                "soil swells less than it was compressed, take a smaller one"
            )

    def chosen(self, speed: float, thickness: float, gravity: float) -> Self:
        """This material with a number as Young's modulus: that of the run, or that of swelling if it is larger."""
        material = super().chosen(speed, thickness, gravity)
        swelling = 3 * (1 - 2 * self.poisson_ratio) * self.preconsolidation_pressure / self.swelling_slope
        stiff = self.youngs_modulus == AUTO and swelling > material.modulus
        return material.__class__(**{**vars(material), "youngs_modulus": swelling}) if stiff else material

    @property
    def yield_cone(self) -> tuple[float, float]:
        """Slope M [1] and no intercept: the critical state, in which slow shear ends."""
        return self.critical_state_slope, 0.0

    def record(self) -> dict[str, float]:
        """Lame parameters [Pa], M [1], plastic compressibility lambda - kappa [1], p_c0 [Pa] and overconsolidation ratio [1]."""
        return {
            "lame_lambda": self.lame_lambda,
            "shear_modulus": self.shear_modulus,
            "critical_state_slope": self.critical_state_slope,
            "plastic_slope": self.compression_slope - self.swelling_slope,
            "preconsolidation_pressure": self.preconsolidation_pressure,
            "overconsolidation_ratio": self.overconsolidation_ratio,
        }


def consolidation(gained: Any, mat: Any):
    """Preconsolidation pressure [Pa] after a plastic log volume gained; its logarithm is limited to what float32 holds."""
    return mat.preconsolidation_pressure * math.exp(min(max(-gained / mat.plastic_slope, real(-40.0)), real(40.0)))


def first_history(p: Any, q: Any, mat: Any):
    """History that belongs to the stress of the first step: an ellipse through it, times the overconsolidation ratio."""
    wanted = mat.preconsolidation_pressure
    if p > real(0.0):
        ratio = q / (mat.critical_state_slope * p)
        wanted = max(wanted, mat.overconsolidation_ratio * p * (real(1.0) + ratio * ratio))
    return min(-mat.plastic_slope * math.log(wanted / mat.preconsolidation_pressure), real(-1.0e-12))  # not 0: it is set


def ellipse_defect(x: Any, p_trial: Any, q: Any, unit: Any, history: Any, mat: Any):
    """M^2 D^2 q^2 - p (p_c - p) (M^2 D + 6 G x)^2 with stresses in a ``unit`` [Pa]; below 0 beyond the critical state."""
    bulk = mat.lame_lambda + real(2.0) * mat.shear_modulus / real(3.0)
    p = (p_trial - bulk * x) / unit
    p_c = consolidation(history - x, mat) / unit
    d = real(2.0) * p - p_c
    sheared = real(6.0) * mat.shear_modulus * x / unit
    if d * x < real(0.0):
        return real(-0.25) * p_c * p_c * sheared * sheared
    left = mat.critical_state_slope * d * q / unit
    factor = mat.critical_state_slope * mat.critical_state_slope * d + sheared
    return left * left - p * (p_c - p) * factor * factor


def critical_volume(p: Any, p_c: Any, bulk: Any, mat: Any):
    """Log volume [1] whose plastic loss leads to the critical state, or a little beyond."""
    x = (p - real(0.5) * p_c) / bulk
    if p > real(0.0):  # no farther than where p_c alone would change to 2 p
        by_hardening = mat.plastic_slope * math.log(real(2.0) * p / p_c)
        if abs(by_hardening) < abs(x):
            x = by_hardening
    return x


def lost_volume(p: Any, q: Any, history: Any, mat: Any):
    """Log volume x [1] that the return of a trial stress outside the ellipse loses plastically, below 0 where it gains.

    Ridders' method (1979, IEEE Trans. Circuits Syst. 26:979): the root stays between two ends, whose distance at least halves.
    """
    bulk = mat.lame_lambda + real(2.0) * mat.shear_modulus / real(3.0)
    p_c = consolidation(history, mat)
    unit = abs(p) + q + p_c
    a = min(p, real(0.0)) / bulk  # the ellipse carries no tension
    b = critical_volume(p, p_c, bulk, mat)
    at_a = ellipse_defect(a, p, q, unit, history, mat)
    at_b = ellipse_defect(b, p, q, unit, history, mat)
    x = b
    if at_a <= real(0.0):  # on the ellipse, but for rounding
        x = a
    for _step in range(40):
        if at_a <= real(0.0) or at_b >= real(0.0):
            break
        middle = real(0.5) * (a + b)
        at_middle = ellipse_defect(middle, p, q, unit, history, mat)
        if at_middle == real(0.0):
            x = middle
            break
        move = (middle - a) / math.sqrt(real(1.0) - (at_a / at_middle) * (at_b / at_middle))
        if at_middle < real(0.0):
            move = -move
        before = x
        x = middle + move
        at_x = ellipse_defect(x, p, q, unit, history, mat)
        if abs(x - before) <= real(1.0e-8) * abs(x):  # it converges with order two
            break
        if at_x > real(0.0):
            a = x
            at_a = at_x
            if at_middle < real(0.0):
                b = middle
                at_b = at_middle
        else:
            b = x
            at_b = at_x
            if at_middle > real(0.0):
                a = middle
                at_a = at_middle
    return x


def return_to_ellipse(h: Any, history: Any, mat: Any, effective: Any):
    """Hencky strain [1] whose stress of grains lies on or inside the ellipse, and the log volume [1] lost plastically."""
    p = effective * pressure(h, mat)
    q = deviatoric_stress(h, mat)
    ratio = q / mat.critical_state_slope
    if ratio * ratio + p * (p - consolidation(history, mat)) <= real(0.0):
        return h, real(0.0)
    x = lost_volume(p, q, history, mat)
    bulk = mat.lame_lambda + real(2.0) * mat.shear_modulus / real(3.0)
    p_c = consolidation(history - x, mat)
    left = min(max(p - bulk * x, real(0.0)), p_c)
    square = mat.critical_state_slope * mat.critical_state_slope
    d = real(2.0) * left - p_c
    if abs(d) < real(0.5) * p_c:  # near the critical state the flow rule is 0/0, and elsewhere the ellipse is steep
        share = mat.critical_state_slope * math.sqrt(left * (p_c - left)) / q
    else:
        share = square * d / (square * d + real(6.0) * mat.shear_modulus * x)
    return shifted(scaled(deviator(h), min(share, real(1.0))), -left / (effective * (real(3.0) * bulk))), x


def update(h: Any, history: Any, mat: Any, effective: Any):
    """Hencky strain, history and energy dissipated per stress-free volume [J/m3] after the return of a trial strain.

    ``history`` is the plastic log volume gained [1]. The ellipse is that of the share ``effective`` [1] of the mean stress, which
    grains carry.
    """
    known = history
    if history == real(0.0):
        known = first_history(effective * pressure(h, mat), deviatoric_stress(h, mat), mat)
        if pressure(h, mat) > real(0.0):
            return h, known, real(0.0)
    new, x = return_to_ellipse(h, known, mat, effective)
    return new, known - x, dissipated_energy(h, new, mat)


register_law(ModifiedCamClay, update)
