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


def sunk(height: Any, fall: Any, layer: Any, touching: Any):
    """Way [m] by which a particle at a ``height`` [m] above its ground sinks when that falls by ``fall`` [m].

    One that lies no higher than ``touching`` [m] sinks with the ground, one at the top of the ``layer`` [m] stays where it is, and
    those between by a share of the fall. So the layer is stretched by the fall, which makes room for what is eroded there.
    """
    share = (layer - height) / max(layer - touching, real(1.0e-9))
    return fall * min(max(share, real(0.0)), real(1.0))
