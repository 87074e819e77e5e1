"""Loop over nodes of the plan that applies a law of erosion to each; the binding compiles it.

``rate`` and ``friction_stress`` stand for the laws of the scene: the binding puts them there.
"""

from typing import Any

from runout.physics.bed import driving_stress, friction_stress, normal_stress
from runout.physics.heightfield import upward_normal
from runout.physics.tensors import vec


def rate(H: Any, u: Any, sigma: Any, tau: Any, pore_ratio: Any, eroded: Any, bed: Any):
    """Erosion rate [m/s]; that of a law stands in its place."""
    return 0.0


def take_rates(columns: Any, slopes: Any, eroded: Any, gravity: Any, basal: Any, bed: Any, of_friction: Any, rates: Any):
    """Erosion ``rates`` (n,) [m/s], vertical, under columns.

    ``columns`` (n, 4) are the vertical thickness [m], mean speed [m/s], density [kg/m3] and pore ratio [1]; ``slopes`` (n, 2) [1]
    those of the ground, ``eroded`` (n,) [m] the vertical depth so far, ``basal`` (n,) and ``bed`` (1,) the records of the laws;
    ``of_friction`` (0 or 1): tau is the friction of the flow, not the driving stress.
    """
    g = vec(gravity[0], gravity[1], gravity[2])
    for n in range(len(rates)):
        normal = upward_normal(slopes[n, 0], slopes[n, 1])
        u, density, pore_ratio = columns[n, 1], columns[n, 2], columns[n, 3]
        H = columns[n, 0] * normal[2]
        sigma = normal_stress(density, H, g, normal)
        tau = driving_stress(density, H, g, normal)
        if of_friction:
            tau = friction_stress(sigma, pore_ratio, u, basal[n])
        rates[n] = rate(H, u, sigma, tau, pore_ratio, eroded[n] * normal[2], bed[0]) / normal[2]
