"""Initial stress of a release: that of its own weight, or none."""

from collections.abc import Callable
from enum import StrEnum
from functools import cache

import numpy as np

from runout.backends import resting_loops
from runout.backends.resting_particles import Press, loops
from runout.errors import ConfigError, member_of
from runout.model.materials import Material
from runout.model.particles import Particles
from runout.model.release import Release
from runout.model.scene import STANDARD_GRAVITY, Scene
from runout.terrain.free_surface import FreeSurface, free_surface


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
    def slopes_of(number: int) -> Callable[[Particles], tuple[np.ndarray, np.ndarray]]:
        return _surface_slopes(free_surface(releases[number], scene.spacing[:2]), scene.spacing)

    def press(particles: Particles, depth: np.ndarray, number: int) -> None:
        friction = _friction_below(particles, scene, number)
        particles.strain = strain_at_rest(scene.materials[number], depth, slopes_of(number)(particles), friction)

    return press


def _surface_slopes(
    surface: FreeSurface, spacing: tuple[float, float, float]
) -> Callable[[Particles], tuple[np.ndarray, np.ndarray]]:
    """Function that returns the slopes east and north (n,) [1] of a free surface at particles (:meth:`FreeSurface.slopes`)."""
    ground, thickness = surface.ground, surface.thickness_slopes
    lattice = np.ascontiguousarray(ground.coefficients), ground.origin, ground.spacing
    cells = surface.origin, surface.cell_size, np.zeros((2, 0, 0)) if thickness is None else np.ascontiguousarray(thickness)

    def slopes(particles: Particles) -> tuple[np.ndarray, np.ndarray]:
        n = len(particles)
        begins, room, found = np.empty(n, np.int64), np.empty((resting_loops.ROWS, n)), np.empty((2, n))
        loops().meet_free_surface(particles.node, particles.offset, spacing, *lattice, *cells, begins, room, found[0], found[1])
        return found[0], found[1]

    return slopes


def _friction_below(particles: Particles, scene: Scene, number: int) -> np.ndarray:
    """Friction coefficients at rest (n,) [1] below particles of release ``number`` (:meth:`Scene.friction_at`)."""
    basal, n = scene.basal, len(particles)
    own = basal.at_rest()[number * basal.kinds : (number + 1) * basal.kinds]
    if basal.kind is None:
        return np.full(n, own[0])
    friction, size = np.empty(n), (float(basal.size[0]), float(basal.size[1]))
    loops().meet_friction(particles.node, particles.offset, scene.spacing, size, basal.kind, own, friction)
    return friction


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
    strain, room = np.empty((len(depth), 6)), np.empty((resting_loops.ROWS, len(depth)))
    weight, (slope, intercept) = material.density * STANDARD_GRAVITY, material.yield_cone
    numbers = float(weight), float(slope), float(intercept), float(material.rest_ratio)
    elasticity = resting_loops.Elasticity(float(material.lame_lambda), float(material.shear_modulus))
    loops().press_at_rest(depth, *slopes, friction, *numbers, elasticity, room, strain)
    return strain
