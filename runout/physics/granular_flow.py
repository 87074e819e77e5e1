"""Rate-dependent friction mu(I) of dense granular flow on Hencky strain, without dilation.

Shear stress s = sqrt(J_2) = mu(I) p with mu(I) = mu_s + (mu_2 - mu_s)/(1 + I_0/I) and I = rate d sqrt(rho/p) (Jop, Forterre &
Pouliquen 2006, Nature 441:727, eq. 1 to 3; rho is the bulk density here and that of the grains there, so that I_0 differs by the
root of the volume fraction, about 0.77). The return is implicit in the rate and solved exactly (Dunatunga & Kamrin 2015,
J. Fluid Mech. 779:483, sec. 3.4). What comes apart carries no stress until it has closed up again.
"""

import math
from typing import Any

from runout.physics.drucker_prager import pressure
from runout.physics.elastic import log_strain, log_strain_series, trial_strain
from runout.physics.plastic import dissipated_energy, end_of_small_step, end_of_step, gained_volume
from runout.physics.tensors import deviator, isotropic, norm, real, scaled, shifted, trace


def friction(I: Any, mat: Any):
    """mu(I) [1] at an inertial number."""
    return mat.static_friction + mat.friction_rise * I / (mat.inertial_constant + I)


def plastic_shear(excess: Any, p: Any, mat: Any):
    """Plastic shear [1] of a step whose trial stress lies ``excess`` [Pa] above mu_s p: root of a quadratic equation.

    excess - G x = p (mu_2 - mu_s) k x / (I_0 + k x), k = d sqrt(rho/p)/dt.
    """
    k = mat.grain_inertia / (math.sqrt(p) * mat.time_step)
    b = k * (excess - p * mat.friction_rise) - mat.shear_modulus * mat.inertial_constant
    root = math.sqrt(b * b + real(4.0) * mat.shear_modulus * k * excess * mat.inertial_constant)
    if b > real(0.0):
        return (b + root) / (real(2.0) * mat.shear_modulus * k)
    return real(2.0) * excess * mat.inertial_constant / (root - b)


def return_to_flow(h: Any, mat: Any):
    """Hencky strain whose stress flows at the rate of its plastic shear, or of no stress at all."""
    p = pressure(h, mat)
    if p <= real(0.0):
        return isotropic(real(0.0))
    s = math.sqrt(real(2.0)) * mat.shear_modulus * norm(deviator(h))
    excess = s - mat.static_friction * p
    if excess <= real(0.0):
        return h
    left = real(1.0) - mat.shear_modulus * plastic_shear(excess, p, mat) / s
    return shifted(scaled(deviator(h), left), trace(h) * (real(1.0) / real(3.0)))


def flow_return(elastic: Any, history: Any, mat: Any):
    """Hencky strain, history and energy dissipated per stress-free volume [J/m3] after the return of a trial strain.

    ``history`` is the log volume gained without stress and not yet lost again [1].
    """
    h = shifted(elastic, history * (real(1.0) / real(3.0)))
    new = return_to_flow(h, mat)
    return new, gained_volume(h, new), dissipated_energy(elastic, new, mat)


def update(B: Any, L: Any, history: Any, mat: Any):
    """One step of the law.

    Returns the new B, the Hencky strain that gives its stress, the history variable (:func:`flow_return`) and the energy
    dissipated per stress-free volume [J/m3].
    """
    trial = trial_strain(B, L)
    elastic = log_strain(trial)
    new, left, lost = flow_return(elastic, history, mat)
    return end_of_step(trial, elastic, new, left, lost)


def update_small(B: Any, L: Any, history: Any, mat: Any):
    """:func:`update` without loops for small strain, and the square that ``elastic.is_small`` must accept."""
    trial = trial_strain(B, L)
    elastic = log_strain_series(trial)
    new, left, lost = flow_return(elastic, history, mat)
    return end_of_small_step(trial, elastic, new, left, lost)
