"""Initial stress of a release: that of its own weight, or none."""

from collections.abc import Callable
from enum import StrEnum
from functools import cache

import numpy as np

from runout.backends.compile import array_binding
from runout.errors import ConfigError, member_of
from runout.model.materials import Material
from runout.model.particles import Particles
from runout.model.release import Release
from runout.model.scene import STANDARD_GRAVITY, Scene
from runout.terrain.free_surface import FreeSurface, free_surface

AT_ONCE = 2**15  # particles per chunk; its arrays fit into the cache

Press = Callable[[Particles, np.ndarray, int], None]


class InitialStress(StrEnum):
    """Stress of a release at the start."""

    AT_REST = "at_rest"  # of its own weight on an infinite slope (runout.physics.geostatic)
    NONE = "none"  # it settles elastically under its weight within the first moments

    @classmethod
    def of(cls, value: "InitialStress | str") -> "InitialStress":
        """Initial stress with this name; ConfigError if there is none."""
        return member_of(cls, value, "initial_stress", ConfigError)


def pressed_by(scene: Scene, releases: list[Release]) -> Press | None:
    """Function that sets the initial stress of particles of a release from their depths (n,) [m] below its surface.

    None if particles start without stress.
    """
    if InitialStress.of(scene.initial_stress) is InitialStress.NONE:
        return None

    @cache
    def surface_of(number: int) -> FreeSurface:
        return free_surface(releases[number], scene.spacing[:2])

    def press(particles: Particles, depth: np.ndarray, number: int) -> None:
        surface = surface_of(number)
        x, y, _ = particles.position(np.array(scene.spacing)).T
        for first in range(0, len(particles), AT_ONCE):
            part = slice(first, first + AT_ONCE)
            friction = scene.friction_at(np.full(len(x[part]), number), x[part], y[part])
            slopes = surface.slopes(x[part], y[part])
            particles.strain[part] = strain_at_rest(scene.materials[number], depth[part], slopes, friction)

    return press


def strain_at_rest(
    material: Material, depth: np.ndarray, slopes: tuple[np.ndarray, np.ndarray], friction: np.ndarray
) -> np.ndarray:
    """Elastic strain B (n, 6) [1] of a mass under its own weight (:mod:`runout.physics.geostatic`).

    Parameters
    ----------
    material : Material
    depth : ndarray (n,)
        Vertical depth below the free surface [m].
    slopes : tuple of ndarray (n,)
        Of the free surface, east and north [1].
    friction : ndarray (n,)
        Friction coefficient that acts at the base [1].
    """
    law = array_binding()
    geostatic, elastic = law.geostatic, law.elastic
    east, north = slopes
    weight = material.density * STANDARD_GRAVITY * np.maximum(depth, 0.0)
    slope, intercept = material.yield_cone
    tangent = np.hypot(east, north)
    normal = np.maximum(weight / (1.0 + tangent**2), 1e-12)
    cohesion = intercept / normal
    limit = np.minimum(friction, geostatic.shear_strength(slope, cohesion))
    share = geostatic.mobilised_share(tangent, limit)
    ratio = geostatic.lateral_ratio(material.rest_ratio, share * tangent, slope, cohesion)
    h = elastic.strain_of_stress(geostatic.slope_stress(weight, east, north, share, ratio), material)
    small = elastic.is_small(4.0 * law.tensors.contracted(h, h))
    strain = np.empty((len(depth), 6))
    for chosen, exponential in ((small, _series), (~small, elastic.strain_scaled)):
        if chosen.any():
            strain[chosen] = np.stack(exponential(tuple(c[chosen] for c in h)), axis=-1)
    return strain


def _series(h: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    elastic = array_binding().elastic
    return elastic.strain_series(tuple(2.0 * c for c in h))  # type: ignore[no-any-return]
