"""Particles that compiled loops make have the bits of the formulas for arrays."""

import numpy as np
import pytest

from runout import DruckerPrager, Release, Terrain
from runout.backends import resting_particles
from runout.backends.compile import array_binding
from runout.model.friction import FrictionZones
from runout.model.numerics import Numerics
from runout.model.particle_source import slices
from runout.model.particles import ARRAYS, Particles
from runout.model.scene import STANDARD_GRAVITY
from runout.release import arrangement
from runout.release.sample import onto_known_ground
from runout.simulation.scenario import build_scene
from runout.terrain.free_surface import free_surface

FIRM = DruckerPrager(density=2000.0, friction_angle=30.0, cohesion=3e3)
SOFT = DruckerPrager(density=1500.0, friction_angle=31.0, cohesion=1e4, youngs_modulus=5e5)  # strains beyond the power series
SPACING, PER_AXIS = (6.0, 5.0, 4.0), (2, 2, 4)


def heaps(placement="on_surface"):
    """Two masses on waves beside cells without elevation, with friction zones; the second one is soft."""
    rng = np.random.default_rng(1)
    ground = 5.0 * np.arange(41)[:, None] + 30.0 * np.sin(np.arange(61) / 7.0)
    ground[:, :4] = np.nan
    terrain = Terrain(ground, (10.0, 8.0))
    first, second = np.zeros((2, *ground.shape))
    first[5:20, 4:25], second[25:38, 30:57] = rng.uniform(0.01, 22.0, (15, 21)), 12.0
    zones = FrictionZones(rng.choice([1.0, 0.6, 1.4], (61, 41)), np.zeros((61, 41)), (10.0, 8.0))
    releases = [Release(first, terrain, placement=placement), Release(second, terrain, placement="on_surface", material=SOFT)]
    numerics = Numerics(cell_size=SPACING, particles_per_cell=PER_AXIS, seed=2)
    return releases, build_scene(terrain, releases, FIRM, 20.0, numerics, friction_zones=zones, in_chunks=True)


def by_arrays(scene, source, releases):
    """The same particles, chunk by chunk, by formulas for arrays."""
    for number, filled in enumerate(source.filled):
        rng, columns = np.random.default_rng([2, number]), filled.columns
        surface = free_surface(releases[number], SPACING[:2])
        for part in columns.parts():
            column, above, height = arrangement.layered(columns.index[part], columns.thickness[part], columns.layer)
            plan = columns.centres(part)[column]
            plan = plan + rng.uniform(-0.25, 0.25, plan.shape) * np.array(columns.size)
            ground, east, north = scene.surface.evaluate(*plan.T)
            p = Particles.at(np.column_stack((plan, ground + above)), np.array(SPACING))
            p.volume[:] = filled.volumes[part][column]
            p.radius[:] = arrangement.half_size(height) / np.sqrt(1.0 + east * east + north * north)
            p.mass[:], p.release[:] = p.volume * scene.materials[number].density, number
            x, y, _ = p.position(np.array(SPACING)).T
            friction = scene.friction_at(np.full(len(x), number), x, y)
            p.strain[:] = strain(scene.materials[number], columns.thickness[part][column] - above, surface.slopes(x, y), friction)
            yield onto_known_ground(p, scene)


def strain(material, depth, slopes, friction):
    """Strain B (n, 6) of the own weight."""
    law, weight = array_binding(), material.density * STANDARD_GRAVITY * np.maximum(depth, 0.0)
    of_material = *material.yield_cone, material.rest_ratio, material
    h = law.geostatic.strain_at_rest(weight, *slopes, np.hypot(*slopes), friction, *of_material)
    small = law.elastic.is_small(4.0 * law.tensors.contracted(h, h))
    series = law.elastic.strain_series(tuple(2.0 * c for c in h))
    with np.errstate(over="ignore", invalid="ignore"):
        return np.where(small, series, law.elastic.strain_scaled(h)).T


@pytest.mark.parametrize("placement", ["on_surface", "excavated"])
def test_compiled_loops_give_the_bits_of_formulas_for_arrays(placement):
    releases, (scene, source) = heaps(placement)
    first, largest = 0, 0.0
    for (part, chunk), expected in zip(slices(source), by_arrays(scene, source, releases), strict=True):
        expected.identity += first
        for name, (dtype, _) in ARRAYS.items():
            found, wanted = getattr(chunk, name), getattr(expected, name)
            assert found.dtype == dtype
            assert np.ascontiguousarray(found).tobytes() == wanted.tobytes(), f"{name} of the particles from {part.start} on"
        first, largest = part.stop, max(largest, float(np.abs(chunk.strain).max()))
    assert first == len(source) > 80_000
    assert largest > 0.28


def test_particles_over_unknown_ground_are_moved_by_loops_that_find_them(monkeypatch):
    _, (scene, source) = heaps()
    moved, known = [], resting_particles.onto_known_ground
    monkeypatch.setattr(resting_particles, "onto_known_ground", lambda p, s: moved.append(len(p)) or known(p, s))
    shifted = next(source.chunks())
    moved.clear()
    shifted.node[:, 0] -= 3
    place = shifted.position(np.array(SPACING))
    outside = int((~scene.holds(place[:, 0], place[:, 1])).sum())
    assert 0 < outside < len(shifted)
    settled = resting_particles.settled_in(scene)(shifted).position(np.array(SPACING))
    assert moved == [len(shifted)]
    assert scene.holds(settled[:, 0], settled[:, 1]).all()
    again = resting_particles.settled_in(scene)
    again(shifted)
    assert len(moved) == 1


def test_nobody_writes_to_the_zeros_that_particles_share():
    _, (_, source) = heaps()
    chunk = next(source.chunks())
    for name in ("velocity", "affine", "history", "ground_force"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(chunk, name)[0] = 1.0
    chunk.strain[0] = 1.0


def test_loops_release_the_lock_of_python_and_fuse_nothing():
    made = vars(resting_particles.loops())
    assert made
    assert all(loop.targetoptions["nogil"] for loop in made.values())
    assert not any("fastmath" in loop.targetoptions for loop in made.values())
