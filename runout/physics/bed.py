"""A column of the flow on an erodible bed: what it exerts on its base, per unit of ground area."""

import math
from typing import Any

from runout.physics.contact import law_resistance
from runout.physics.tensors import dot, real


def normal_stress(density: Any, thickness: Any, gravity: Any, normal: Any):
    """Total normal stress sigma [Pa] under a ``thickness`` [m], normal to the ground, at rest; ``gravity`` [m/s2] is a vector."""
    return density * thickness * max(real(0.0), -dot(gravity, normal))


def driving_stress(density: Any, thickness: Any, gravity: Any, normal: Any):
    """Stress [Pa] of gravity along the ground, rho g H sin(slope)."""
    across = dot(gravity, normal)
    x = gravity[0] - across * normal[0]
    y = gravity[1] - across * normal[1]
    z = gravity[2] - across * normal[2]
    return density * thickness * math.sqrt(x * x + y * y + z * z)


def friction_stress(normal_stress: Any, pore_ratio: Any, speed: Any, basal: Any):
    """Shear stress [Pa] of the law of basal friction of a column with a mean ``speed`` [m/s].

    Friction acts on the effective normal stress (1 - lambda) sigma, drag on the column as a whole.
    """
    steady, drag = law_resistance((real(1.0) - pore_ratio) * normal_stress, speed, real(1.0), real(1.0), basal)
    return steady + drag * speed * speed


def time_to_travel(distance: Any, speed: Any, gravity: Any):
    """Least time [s] in which a mass with a ``speed`` [m/s] covers a ``distance`` [m], sped up by all of ``gravity`` [m/s2]."""
    return real(2.0) * distance / (speed + math.sqrt(speed * speed + real(2.0) * gravity * distance))


def chance_at(x: Any, y: Any, turn: Any):
    """Number from 0 to 1 that looks like chance, of a place (x, y) [cells] and a ``turn``."""
    number = real(12.9898) * x + real(78.233) * y + turn
    return number - math.floor(number)


def sunk(height: Any, fall: Any, touching: Any, chance: Any):
    """Way [m] by which a particle at a ``height`` [m] above its ground sinks when that falls by ``fall`` [m].

    A particle touches the ground at the height ``touching`` [m] and stands for a layer of twice that. Where the ground falls,
    eroded mass takes the place of a part fall / (2 touching) of the layer, by ``chance`` from 0 to 1, and all above stays where it
    is. The rest of the layer sinks with the ground and keeps its contact.
    """
    layer = real(2.0) * touching
    if height >= layer or chance * layer < fall:
        return real(0.0)
    return fall * min((layer - height) / touching, real(1.0))
