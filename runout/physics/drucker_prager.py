"""Non-dilatant Drucker-Prager plasticity on Hencky strain.

Yield: q <= M p + q_c with p = -tr(tau)/3 (compression positive) and q = sqrt(3/2) |dev tau|. The return keeps the
volume on the cone and goes to the apex in tension (Klar et al. 2016, ACM TOG 35:103, sec. 7.3). The volume gained at
the apex is remembered and must be lost again before the material carries load (Tampubolon et al. 2017, ACM TOG 36:105,
sec. 4.3.4).
"""

import math
from typing import Any

from runout.physics.elastic import log_strain, log_strain_series, trial_strain
from runout.physics.plastic import dissipated_energy, end_of_small_step, end_of_step, gained_volume
from runout.physics.tensors import deviator, isotropic, norm, real, scaled, shifted, trace


def cone_triaxial_compression(phi: Any, c: Any):
    """Slope M [1] and intercept q_c [Pa] of the cone through the compression corners of Mohr-Coulomb."""
    s = math.sin(phi)
    d = real(3.0) - s
    return real(6.0) * s / d, real(6.0) * c * math.cos(phi) / d


def cone_triaxial_extension(phi: Any, c: Any):
    """Slope M [1] and intercept q_c [Pa] of the cone through the extension corners of Mohr-Coulomb."""
    s = math.sin(phi)
    d = real(3.0) + s
    return real(6.0) * s / d, real(6.0) * c * math.cos(phi) / d


def cone_plane_strain(phi: Any, c: Any):
    """Slope M [1] and intercept q_c [Pa] that match Mohr-Coulomb in plane strain for isochoric flow."""
    r = math.sqrt(real(3.0))
    return r * math.sin(phi), r * c * math.cos(phi)


def cone_plane_strain_associated(phi: Any, c: Any):
    """Slope M [1] and intercept q_c [Pa] of Drucker & Prager 1952 (associated flow, plane strain)."""
    t = math.tan(phi)
    d = math.sqrt(real(9.0) + real(12.0) * t * t)
    r = real(3.0) * math.sqrt(real(3.0))
    return r * t / d, r * c / d


def pressure(h: Any, mat: Any):
    """Mean Kirchhoff pressure [Pa], compression positive."""
    return -(mat.lame_lambda + real(2.0) * mat.shear_modulus / real(3.0)) * trace(h)


def deviatoric_stress(h: Any, mat: Any):
    """Equivalent Kirchhoff stress q = sqrt(3/2) |dev tau| [Pa]."""
    return math.sqrt(real(6.0)) * mat.shear_modulus * norm(deviator(h))


def return_to_cone(h: Any, mat: Any):
    """Hencky strain of the admissible stress nearest along the deviator, or of the apex."""
    p = pressure(h, mat)
    q = deviatoric_stress(h, mat)
    limit = mat.cone_slope * p + mat.cone_intercept
    if limit <= real(0.0):
        bulk = mat.lame_lambda + real(2.0) * mat.shear_modulus / real(3.0)
        return isotropic(mat.cone_intercept / (real(3.0) * bulk * mat.cone_slope))
    if q <= limit:
        return h
    return shifted(scaled(deviator(h), limit / q), trace(h) * (real(1.0) / real(3.0)))


def plastic_return(elastic: Any, history: Any, mat: Any):
    """Hencky strain, history and energy dissipated per stress-free volume [J/m3] after the return of a trial strain.

    ``history`` is the log volume gained at the apex and not yet lost again [1].
    """
    gained = history * mat.volume_correction
    h = shifted(elastic, gained * (real(1.0) / real(3.0)))
    new = return_to_cone(h, mat)
    return new, gained_volume(h, new), dissipated_energy(elastic, new, mat)


def update(B: Any, L: Any, history: Any, mat: Any):
    """One step of the law.

    Returns the new B, the Hencky strain that gives its stress, the history variable (:func:`plastic_return`) and the energy
    dissipated per stress-free volume [J/m3].
    """
    trial = trial_strain(B, L)
    elastic = log_strain(trial)
    new, left, lost = plastic_return(elastic, history, mat)
    return end_of_step(trial, elastic, new, left, lost)


def update_small(B: Any, L: Any, history: Any, mat: Any):
    """:func:`update` without loops for small strain, and the square that ``elastic.is_small`` must accept."""
    trial = trial_strain(B, L)
    elastic = log_strain_series(trial)
    new, left, lost = plastic_return(elastic, history, mat)
    return end_of_small_step(trial, elastic, new, left, lost)
