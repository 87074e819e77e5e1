"""Pore pressure of a particle: the share lambda of the total normal stress that water carries, and how it drains.

With lambda_eq, which stays, the ratio is

    lambda = lambda_eq + (lambda_0 - lambda_eq) min(1, closure E),  dE/dt = -(decay_rate + diffusion / H^2) E,  E = 1 at the start.

E is the part that remains. Pressure that decays in a time t_d has decay_rate = 1/t_d, diffusion = 0 and closure = 1. Pressure at
the base of a layer of thickness H that drains at its top with a diffusivity D has decay_rate = 0, diffusion = pi^2 D/4 and closure
= 4/pi: the first term of the series of Terzaghi (1943, Theoretical Soil Mechanics, ch. 13), bounded by the start. Its error is
4.8 % of the excess at D t/H^2 = 0.1, and below 1 % beyond 0.2. A layer whose thickness changes goes on from what remains.

Grains carry the rest of the normal stress, 1 - lambda, and friction acts on that (Terzaghi's effective stress): at the ground
(:func:`runout.physics.contact.effective_impulse`) and in the mass (:func:`runout.physics.plastic.effective_return`).
"""

import math
from typing import Any

from runout.physics.tensors import real

LARGEST_RATIO = 0.97  # a mass that stands on less than 3 % of its weight is a fluid, whose strength no ratio describes
WATER_DENSITY = 1000.0  # [kg/m3]
THINNEST = 1e-6  # [m] of a layer that drains; thinner ones have drained in any step


def equilibrium_ratio(saturation: Any, density: Any):
    """Hydrostatic ratio lambda_eq [1] of a mass with a ``density`` [kg/m3]; its lower part, ``saturation`` [1], stands in water."""
    return saturation * real(WATER_DENSITY) / density


def diffusion_rate(diffusivity: Any):
    """Rate [m2/s] over the square of the thickness at which excess pressure fades, pi^2 D/4; ``diffusivity`` D [m2/s]."""
    return real(0.25) * real(math.pi) * real(math.pi) * diffusivity


def layer_thickness(mass: Any, area: Any, density: Any, upward: Any):
    """Thickness H [m] of a column with a ``mass`` [kg] over an ``area`` [m2] in plan, normal to the ground.

    ``upward`` [1] is the vertical part of the unit normal of the ground (:func:`runout.physics.heightfield.normal_z`).
    """
    return mass / (area * density) * upward


def drainage_rate(thickness: Any, pore: Any):
    """Rate [1/s] at which E falls in a layer of a ``thickness`` [m]; ``pore`` is the record of the mass."""
    h = max(thickness, real(THINNEST))
    return pore.decay_rate + pore.diffusion / (h * h)


def share_left(rate: Any, dt: Any):
    """Share [1] of E that is left after ``dt`` [s], in which it falls at a ``rate`` [1/s]."""
    return math.exp(-rate * dt)


def remaining_share(thickness: Any, dt: Any, pore: Any):
    """Share [1] of E that is left after ``dt`` [s] in a layer of a ``thickness`` [m]; ``pore`` is the record of the mass."""
    return share_left(drainage_rate(thickness, pore), dt)


def pore_ratio(excess: Any, left: Any, pore: Any):
    """Ratio lambda [1] from the ``excess`` lambda_0 - lambda_eq at the start and the part E that is ``left``."""
    return pore.equilibrium + excess * min(real(1.0), pore.closure * left)


def effective_share(excess: Any, left: Any, pore: Any):
    """Share 1 - lambda [1] of the normal stress that grains carry."""
    return real(1.0) - pore_ratio(excess, left, pore)


def effective_friction(friction: Any, effective: Any):
    """Friction coefficient [1] by total stress where grains carry the share ``effective`` [1] of it."""
    return friction * effective


def total_lateral_ratio(rest: Any, effective: Any):
    """Ratio [1] of the total stresses along and across a plane at rest, from that of effective stresses: water presses alike."""
    return real(1.0) - effective * (real(1.0) - rest)
