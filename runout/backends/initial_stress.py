"""Initial state of a release: the stress of its own weight, or none, pore pressure, and velocity."""

from collections.abc import Callable
from enum import StrEnum
from functools import cache

import numpy as np

from runout.backends import resting_loops
from runout.backends.compile import array_binding
from runout.backends.resting_particles import Launch, Press, Wet, loops
from runout.errors import ConfigError, member_of
from runout.model.materials import Material
from runout.model.particles import Particles
from runout.model.release import Release
from runout.model.release_start import StartVelocity
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
        effective = effective_shares(scene, particles, number)
        particles.strain = strain_at_rest(scene.materials[number], depth, slopes_of(number)(particles), friction, effective)

    return press


def wetted_by(scene: Scene, releases: list[Release], seed: int) -> Wet | None:
    """Function that sets the pore pressure of particles of a release at rest; ``seed`` is that of the run. None if all are dry."""
    if not scene.is_wet:
        return None

    def wet(particles: Particles, number: int) -> None:
        pore, density = scene.pore_pressure[number], scene.materials[number].density
        if pore is not None:
            x, y, _ = particles.position(np.array(scene.spacing)).T
            ratio = pore.at(x, y, scene.raster.cell_size, (seed, number))
            particles.pore_excess, particles.pore_left = ratio - pore.equilibrium(density), np.ones(len(particles))

    return wet


def launched_by(scene: Scene, releases: list[Release]) -> Launch | None:
    """Function that sets the velocity of particles of a release. None if all start at rest."""
    if not any(r.velocity for r in releases):
        return None
    for release in releases:
        if isinstance(release.velocity, StartVelocity):
            release.velocity.direction(release)  # refuses level ground
    ground = scene.ground
    assert ground is not None

    def launch(particles: Particles, number: int) -> None:
        velocity = releases[number].velocity
        if isinstance(velocity, StartVelocity):
            x, y, _ = particles.position(np.array(scene.spacing)).T
            particles.velocity = velocity.at(releases[number], ground, x, y)
        elif velocity is not None:
            particles.velocity = np.tile(np.array(velocity), (len(particles), 1))

    return launch


def energy_at_start(particles: Particles, scene: Scene) -> float:
    """Kinetic, potential and elastic energy [J] of particles without an affine motion."""
    stored, moduli = np.zeros(len(particles)), np.array([(m.lame_lambda, m.shear_modulus) for m in scene.materials], np.float64)
    loops().store_energy(np.ascontiguousarray(particles.strain, np.float64), particles.release, moduli, stored)
    height = particles.position(np.array(scene.spacing)) @ np.array(scene.gravity)
    kinetic = 0.5 * particles.mass @ (particles.velocity**2).sum(axis=1)
    return float(kinetic - particles.mass @ height + particles.volume @ stored)


def effective_shares(scene: Scene, particles: Particles, number: int) -> np.ndarray | None:
    """Shares (n,) [1] of the normal stress that the grains of particles of release ``number`` carry; None if it is dry."""
    if not scene.is_wet or scene.pore_pressure[number] is None:
        return None
    record = scene.pore_table().view(np.recarray)[number]
    return np.asarray(array_binding().pore_pressure.effective_share(particles.pore_excess, particles.pore_left, record))


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
    material: Material, depth: np.ndarray, slopes: tuple[np.ndarray, np.ndarray], friction: np.ndarray,
    effective: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
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
    effective : ndarray (n,), optional
        Share of the normal stress that grains carry [1]; all of it by default.
    """
    strain, room = np.empty((len(depth), 6)), np.empty((resting_loops.ROWS, len(depth)))
    weight, (slope, intercept) = material.density * STANDARD_GRAVITY, material.yield_cone
    numbers = float(weight), float(slope), float(intercept), float(material.rest_ratio)
    elasticity = resting_loops.Elasticity(float(material.lame_lambda), float(material.shear_modulus))
    if effective is None:
        loops().press_at_rest(depth, *slopes, friction, *numbers, elasticity, room, strain)
    else:
        loops().press_wet_mass(depth, *slopes, friction, effective, *numbers, elasticity, strain)
    return strain
