"""Small scenes that every backend must treat alike."""

import os
from dataclasses import replace

import numpy as np

from runout import DruckerPrager, Elastic
from runout.backends.protocol import get_backend
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface

GRAVITY = 9.81
STATE = ("velocity", "affine", "strain", "history")
ROW_TOLERANCE = 10  # sums lose some digits more than their parts
HASH_DEVICE = os.environ.get("RUNOUT_TEST_DEVICE", "cpu")  # "cuda:0" runs the tests of the hash backend on a GPU
IN_ORDER = HASH_DEVICE != "cpu"  # where bits repeat only with sums in fixed order
UNORDERED = 1e-9 if IN_ORDER else 0.0  # of a scale: difference of two runs of ``simulate`` there, whose sums have no fixed order
ROCK = Elastic(density=2000.0, youngs_modulus=1e6, poisson_ratio=0.3)
HARD = DruckerPrager(  # as ROCK below its strength, by the compiled code of SAND
    density=2000.0, youngs_modulus=1e6, poisson_ratio=0.3, friction_angle=50.0, cohesion=1e6
)
SAND = DruckerPrager(density=1800.0, youngs_modulus=2e6, poisson_ratio=0.25, friction_angle=30.0)


def engine_of(name, **choices):
    """A backend on one thread of the CPU, or hash on the device that the environment names, in fixed order: tests compare bits."""
    if name == "hash":
        choices = {"deterministic": IN_ORDER, **choices}
    return get_backend(name, HASH_DEVICE if name == "hash" else "cpu", threads=1, **choices)


def scene(surface=None, spacing=(1.0, 1.0, 1.0), materials=(ROCK,), friction=(0.5,), gravity=(0.0, 0.0, -GRAVITY), **choices):
    """A scene in float64 on a raster of 40 x 30 cells of 2 m x 2.5 m."""
    choices = {"precision": "float64", **choices}
    return Scene(spacing, surface, Raster(30, 40, (2.0, 2.5)), materials, friction, gravity, **choices)


def plane(slope_x=0.0, slope_y=0.0, height=0.0):
    """Surface height + slope_x x + slope_y y."""
    x, y = np.meshgrid(2.0 * np.arange(41), 2.5 * np.arange(31), indexing="ij")
    return Surface.through(height + slope_x * x + slope_y * y, (2.0, 2.5))


def bowl(radius=60.0, centre=(40.0, 37.0)):
    """A parabolic bowl: its spline is exact on any lattice."""
    x, y = np.meshgrid(2.0 * np.arange(-5, 46), 2.5 * np.arange(-5, 36), indexing="ij")
    return Surface.through(((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / (2 * radius), (2.0, 2.5), (-10.0, -12.5))


def at(position, spacing, density=2000.0, volume=0.125):
    """Particles of one volume [m3] at positions (n, 3) [m]."""
    p = Particles.at(np.asarray(position, float).reshape(-1, 3), np.asarray(spacing))
    p.volume[:] = volume
    p.mass[:] = density * volume
    return p


def box(corner, size, spacing, density=2000.0, per_cell=2, surface=None):
    """A box of regular particles, ``per_cell`` an axis; on a surface its bottom follows it."""
    d = np.asarray(spacing) / per_cell
    axes = [np.arange(round(s / a)) * a + a / 2 for s, a in zip(size, d, strict=True)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + np.asarray(corner)
    if surface is not None:
        x[:, 2] += surface.elevation(x[:, 0], x[:, 1])
    p = at(x, spacing, density, float(np.prod(d)))
    p.radius[:] = d[2] / 2
    return p


def cloud(n=500, spacing=(1.0, 0.7, 0.5), seed=0):
    """Particles of random mass, velocity and affine matrix around local (30, 30, -3) m."""
    rng = np.random.default_rng(seed)
    p = at(rng.uniform(-3, 3, (n, 3)) + np.array([30.0, 30.0, -3.0]), spacing)
    p.mass[:] = rng.uniform(0.1, 10.0, n)
    p.velocity[:] = rng.normal(size=(n, 3))
    p.affine[:] = rng.normal(size=(n, 3, 3))
    return p


def loaded(backend, a_scene, particles):
    """The backend after it has taken over the scene."""
    backend.load(a_scene, particles)
    return backend


def on_cpu(**choices):
    """The hash backend on the device that the environment names."""
    return get_backend("hash", HASH_DEVICE, **choices)


def single_precision(a_scene):
    """The same scene in float32."""
    return replace(a_scene, precision="float32")


def angular_momentum(p, spacing):
    """Angular momentum (3,) about the local origin, with the affine part."""
    own = p.affine * (np.asarray(spacing) ** 2 / 4)  # (n, velocity, arm)
    spin = np.stack([own[:, 2, 1] - own[:, 1, 2], own[:, 0, 2] - own[:, 2, 0], own[:, 1, 0] - own[:, 0, 1]], axis=1)
    return (p.mass[:, None] * (np.cross(p.position(spacing), p.velocity) + spin)).sum(axis=0)


def total_energy(row):
    """Energy and what has been booked as dissipated or gone [J]."""
    stored = row.kinetic_energy + row.potential_energy + row.elastic_energy
    return stored + row.basal_dissipation + row.structure_dissipation + row.plastic_dissipation + row.escaped_energy


def assert_same_arrays(expected, found):
    """Arrays by name are equal; on a GPU within :data:`UNORDERED` of their scale, and float32 within its rounding."""
    for name, values in expected.items():
        scale = np.nanmax(np.abs(values), initial=0.0)
        share = max(UNORDERED, IN_ORDER * np.finfo(values.dtype).eps if values.dtype.kind == "f" else 0.0)
        np.testing.assert_allclose(found[name], values, rtol=0, atol=share * scale, err_msg=name)


def assert_same_numbers(expected, found, of=""):
    """Two states, or two rows of a ledger, hold equal numbers under the same names."""
    for name, values in vars(expected).items():
        np.testing.assert_array_equal(getattr(found, name), values, err_msg=f"{name} {of}")


def assert_close_states(expected, found, tolerance, spacing=None):
    """Velocity, affine matrix, strain and history within ``tolerance`` of their scale; places too where ``spacing`` is given."""
    for name in STATE:
        x, y = getattr(expected, name), getattr(found, name)
        np.testing.assert_allclose(y, x, rtol=0, atol=tolerance * max(np.abs(x).max(), 1e-3), err_msg=name)
    if spacing is not None:
        h = np.array(spacing)
        np.testing.assert_allclose(found.position(h), expected.position(h), rtol=0, atol=50 * tolerance)


def assert_same(expected, found, tolerance, spacing, other_index=False):
    """State, ledger and columns within ``tolerance`` of their scale; backends with ``other_index`` count other blocks."""
    (a, row_a, columns_a), (b, row_b, columns_b) = expected, found
    np.testing.assert_array_equal(a.identity, b.identity)
    np.testing.assert_array_equal(a.release, b.release)
    assert_close_states(a, b, tolerance, spacing)
    for name in set(vars(row_a)) - ({"active_blocks", "box_blocks"} if other_index else set()):
        x, y = getattr(row_a, name), getattr(row_b, name)
        scale = np.abs(x).max() if np.ndim(x) else max(abs(x), row_a.kinetic_energy * (name != "max_speed"))
        np.testing.assert_allclose(y, x, rtol=0, atol=ROW_TOLERANCE * tolerance * scale, err_msg=name)
    for name in ("volume", "mass", "momentum"):
        x, y = getattr(columns_a, name), getattr(columns_b, name)
        np.testing.assert_allclose(y, x, rtol=0, atol=ROW_TOLERANCE * tolerance * np.abs(x).max(), err_msg=name)


def assert_close_bulk(expected, found, spacing):
    """Centre of mass within 1e-4 of a cell, energy within 1e-4, kinetic energy within 1e-3."""
    (a, row_a, _), (b, row_b, _) = expected, found
    shift = np.average(b.position(np.array(spacing)) - a.position(np.array(spacing)), axis=0, weights=a.mass)
    assert np.abs(shift).max() < 1e-4
    np.testing.assert_allclose(total_energy(row_b), total_energy(row_a), rtol=1e-4)
    np.testing.assert_allclose(row_b.kinetic_energy, row_a.kinetic_energy, rtol=1e-3)
