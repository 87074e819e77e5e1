"""Isotropic Hencky elasticity without eigenvectors.

The state is B = b_e - I: in float32 it keeps small strains to 4e-6 over 1e5 steps where b_e itself loses half of them.
Stress is Kirchhoff stress tau = lambda tr(h) I + 2 mu h of the log strain h = 1/2 log(b_e)
(Xiao & Chen 2002, Acta Mech. 157:51, eq. 3.5), so that V0 tau = V sigma.
"""

import math
from typing import Any

from runout.physics.tensors import (
    added,
    contracted,
    deviator,
    horner,
    interlaced,
    invariants,
    inverse,
    isotropic,
    norm,
    polynomial,
    product,
    real,
    scaled,
    shifted,
    squared_invariants,
    sym,
    trace,
    vec,
)


def lame_lambda(youngs_modulus: Any, nu: Any):
    """First Lame parameter [Pa]."""
    return youngs_modulus * nu / ((real(1.0) + nu) * (real(1.0) - real(2.0) * nu))


def shear_modulus(youngs_modulus: Any, nu: Any):
    """Shear modulus [Pa]."""
    return youngs_modulus / (real(2.0) * (real(1.0) + nu))


def wave_speed(lam: Any, mu: Any, density: Any):
    """Speed of pressure waves [m/s]."""
    return math.sqrt((lam + real(2.0) * mu) / density)


def youngs_modulus(c: Any, density: Any, nu: Any):
    """Young's modulus [Pa] with which pressure waves have the speed ``c`` [m/s]: inverse of :func:`wave_speed`."""
    return density * c * c * (real(1.0) + nu) * (real(1.0) - real(2.0) * nu) / (real(1.0) - nu)


def trial_strain(B: Any, L: Any):
    """B after a step with velocity gradient times dt ``L``: B + G + G^T + G L^T with G = L (I + B).

    Nothing is added to the identity: (I + L) B (I + L)^T in float32 loses the small step in I + L, 0.2 % of the strain
    in 1e5 steps where this form loses 1e-5 to 1e-4.
    """
    g0 = L[0] + L[0] * B[0] + L[1] * B[3] + L[2] * B[5]
    g1 = L[1] + L[0] * B[3] + L[1] * B[1] + L[2] * B[4]
    g2 = L[2] + L[0] * B[5] + L[1] * B[4] + L[2] * B[2]
    g3 = L[3] + L[3] * B[0] + L[4] * B[3] + L[5] * B[5]
    g4 = L[4] + L[3] * B[3] + L[4] * B[1] + L[5] * B[4]
    g5 = L[5] + L[3] * B[5] + L[4] * B[4] + L[5] * B[2]
    g6 = L[6] + L[6] * B[0] + L[7] * B[3] + L[8] * B[5]
    g7 = L[7] + L[6] * B[3] + L[7] * B[1] + L[8] * B[4]
    g8 = L[8] + L[6] * B[5] + L[7] * B[4] + L[8] * B[2]
    return sym(
        B[0] + (real(2.0) * g0 + (g0 * L[0] + g1 * L[1] + g2 * L[2])),
        B[1] + (real(2.0) * g4 + (g3 * L[3] + g4 * L[4] + g5 * L[5])),
        B[2] + (real(2.0) * g8 + (g6 * L[6] + g7 * L[7] + g8 * L[8])),
        B[3] + (g1 + g3 + (g0 * L[3] + g1 * L[4] + g2 * L[5])),
        B[4] + (g5 + g7 + (g3 * L[6] + g4 * L[7] + g5 * L[8])),
        B[5] + (g2 + g6 + (g0 * L[6] + g1 * L[7] + g2 * L[8])),
    )


def vanishes(small: Any):
    """Whether a number added to one is lost: 1e-9 in single precision, not in double. Known when a kernel is compiled."""
    return real(1.0) + small == real(1.0)


def log_strain_series(B: Any):
    """1/2 log(I + B) for |B| up to 0.28: the power series, whose last terms are fitted in double precision.

    There orders 5 to 18 have the coefficients of the least largest error over eigenvalues of -0.28 to 0.28 (Remez exchange),
    1.1e-16 of the result; the power series would need 26 orders. Even and odd orders are two sums. In single precision the
    series ends at order 12 with a rest below 2e-8 of the result, less than half a unit in the last place.
    """
    K = invariants(B)
    if vanishes(real(1.0e-9)):
        P = vec(real(-1.0) / real(24.0), real(1.0) / real(22.0), real(-1.0) / real(20.0))
        P = horner(P, K, real(1.0) / real(18.0))
        P = horner(P, K, real(-1.0) / real(16.0))
        P = horner(P, K, real(1.0) / real(14.0))
        P = horner(P, K, real(-1.0) / real(12.0))
        P = horner(P, K, real(1.0) / real(10.0))
        P = horner(P, K, real(-1.0) / real(8.0))
        P = horner(P, K, real(1.0) / real(6.0))
        P = horner(P, K, real(-1.0) / real(4.0))
        P = horner(P, K, real(1.0) / real(2.0))
    else:
        S = squared_invariants(K)
        odd = vec(real(0.040305174126857), real(0.031705502372727), real(0.038586543561183))
        odd = horner(odd, S, real(0.045449171874865))
        odd = horner(odd, S, real(0.055555683903746))
        odd = horner(odd, S, real(0.071428569877296))
        odd = horner(odd, S, real(0.10000000000712))
        odd = horner(odd, S, real(1.0) / real(6.0))
        odd = horner(odd, S, real(1.0) / real(2.0))
        even = vec(real(-0.03751892929692), real(-0.029875899137814), real(-0.035813666296672))
        even = horner(even, S, real(-0.041662657426257))
        even = horner(even, S, real(-0.0500000894801))
        even = horner(even, S, real(-0.062499998994589))
        even = horner(even, S, real(-0.083333333337598))
        even = horner(even, S, real(-1.0) / real(8.0))
        even = horner(even, S, real(-1.0) / real(4.0))
        P = interlaced(even, odd, K)
    return polynomial(B, horner(P, K, real(0.0)))


def square_root(b: Any):
    """Square root of a positive definite tensor (Denman & Beavers 1976; ten steps serve eigenvalues of 1e-3 to 1e3)."""
    Y = b
    Z = isotropic(real(1.0))
    for _step in range(10):
        X = scaled(added(Y, inverse(Z)), real(0.5))
        Z = scaled(added(Z, inverse(Y)), real(0.5))
        Y = X
    return Y


def is_small(square: Any):
    """Whether the series serve a strain from the square of its norm: |B| or 2 |h| up to 0.28."""
    return square <= real(0.0784)


def log_strain_scaled(B: Any):
    """1/2 log(I + B) for large strain: log b = 2^k log(b^(1/2^k)) by as many square roots as the series needs, 6 at most.

    Higham 2008, alg. 11.9.
    """
    b = B
    scale = real(1.0)
    for _root in range(6):
        if is_small(contracted(b, b)):
            break
        b = shifted(square_root(shifted(b, real(1.0))), real(-1.0))
        scale = real(2.0) * scale
    return scaled(log_strain_series(b), scale)


def log_strain(B: Any):
    """Hencky strain h = 1/2 log(I + B) [1]."""
    if is_small(contracted(B, B)):
        return log_strain_series(B)
    return log_strain_scaled(B)


def strain_series(X: Any):
    """exp(X) - I for |X| up to 0.28: the power series, whose last terms are fitted in double precision.

    There orders 5 to 11 have the coefficients of the least largest error, 5e-17 of the result; single precision ends at order 7
    with a rest of 4e-9.
    """
    K = invariants(X)
    if vanishes(real(1.0e-9)):
        P = vec(real(1.0) / real(5040.0), real(1.0) / real(720.0), real(1.0) / real(120.0))
    else:
        P = vec(real(2.089062655413e-8), real(2.759254502682e-7), real(2.756436659758e-6))
        P = horner(P, K, real(2.480156850102e-5))
        P = horner(P, K, real(0.0001984126607622))
        P = horner(P, K, real(0.0013888888892))
        P = horner(P, K, real(0.008333333333957))
    P = horner(P, K, real(1.0) / real(24.0))
    P = horner(P, K, real(1.0) / real(6.0))
    P = horner(P, K, real(1.0) / real(2.0))
    P = horner(P, K, real(1.0))
    return polynomial(X, horner(P, K, real(0.0)))


def strain_scaled(h: Any):
    """B = exp(2h) - I of a Hencky strain by scaling and squaring, |h| up to 3."""
    Y = strain_series(scaled(h, real(2.0) / real(64.0)))
    for _doubling in range(6):
        Y = added(scaled(Y, real(2.0)), product(Y, Y))
    return Y


def strain_of_log(h: Any):
    """B = exp(2h) - I of a Hencky strain, |h| up to 3."""
    if is_small(real(4.0) * contracted(h, h)):
        return strain_series(scaled(h, real(2.0)))
    return strain_scaled(h)


def kirchhoff_stress(h: Any, mat: Any):
    """Kirchhoff stress tau [Pa], tension positive."""
    return added(isotropic(mat.lame_lambda * trace(h)), scaled(h, real(2.0) * mat.shear_modulus))


def strain_of_stress(tau: Any, mat: Any):
    """Hencky strain h whose Kirchhoff stress is tau: the inverse of :func:`kirchhoff_stress`."""
    t = trace(tau) / (real(3.0) * mat.lame_lambda + real(2.0) * mat.shear_modulus)
    return scaled(shifted(tau, -mat.lame_lambda * t), real(0.5) / mat.shear_modulus)


def energy_density(h: Any, mat: Any):
    """Stored energy per stress-free volume [J/m3]."""
    t = trace(h)
    n = norm(h)
    return real(0.5) * mat.lame_lambda * t * t + mat.shear_modulus * n * n


def pressure(h: Any, mat: Any):
    """Mean Kirchhoff pressure [Pa], compression positive."""
    return -(mat.lame_lambda + real(2.0) * mat.shear_modulus / real(3.0)) * trace(h)


def deviatoric_stress(h: Any, mat: Any):
    """Equivalent Kirchhoff stress q = sqrt(3/2) |dev tau| [Pa]."""
    return math.sqrt(real(6.0)) * mat.shear_modulus * norm(deviator(h))


def step(B: Any, L: Any, history: Any, mat: Any):
    """One step of a material that never yields.

    Returns the new B, the Hencky strain that gives its stress, the history variable and the energy
    dissipated per stress-free volume [J/m3].
    """
    trial = trial_strain(B, L)
    return trial, log_strain(trial), history, real(0.0)


def step_small(B: Any, L: Any, history: Any, mat: Any):
    """:func:`step` without branches for small strain, and the square that :func:`is_small` must accept."""
    trial = trial_strain(B, L)
    return trial, log_strain_series(trial), history, real(0.0), contracted(trial, trial)
