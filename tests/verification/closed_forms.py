"""Closed forms that the scheme is verified against; SI units, angles in degrees at this edge."""

import numpy as np

GRAVITY = 9.81


def sliding_block(time: float, slope_deg: float, friction: float) -> tuple[float, float]:
    """Displacement [m] and speed [m/s] along the slope of a rigid block from rest, Coulomb friction; exact."""
    slope = np.radians(slope_deg)
    acceleration = max(GRAVITY * (np.sin(slope) - friction * np.cos(slope)), 0.0)
    return 0.5 * acceleration * time**2, acceleration * time


def symplectic_excess(time: float, slope_deg: float, friction: float, dt: float) -> float:
    """What symplectic Euler adds to the displacement of a block [m]: a T dt/2, exact."""
    return sliding_block(time, slope_deg, friction)[1] * dt / 2


def symplectic_free_fall(steps: int, dt: float) -> tuple[float, float]:
    """Height [m] and velocity [m/s] after ``steps`` of symplectic Euler from rest at 0; exact."""
    return -GRAVITY * dt**2 * steps * (steps + 1) / 2, -steps * GRAVITY * dt


def rotated(position: np.ndarray, angle: float) -> np.ndarray:
    """Positions (n, 3) after a rotation about z by ``angle`` [rad]; exact."""
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    return position @ turn.T


def axisymmetric_runout(aspect: float) -> float:
    """Run-out (R_f - R_0)/R_0 of a granular column of H_0/R_0 = ``aspect``, fit of experiments, scatter 15 to 25 %.

    Lube, Huppert, Sparks & Hallworth 2004, J. Fluid Mech. 508:175.
    """
    return 1.24 * aspect if aspect < 1.7 else 1.6 * np.sqrt(aspect)


def axisymmetric_height(aspect: float) -> float:
    """Final height H_f/R_0 of a granular column, fit of experiments.

    Lajeunesse, Mangeney-Castelnau & Vilotte 2004, Phys. Fluids 16:2371.
    """
    return min(aspect, 0.74)
