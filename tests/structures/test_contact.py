"""Contact with structures: momentum is handed over, walls do not leak, roofs carry, and the balance of momentum closes."""

from dataclasses import replace

import numpy as np
import pytest
from boxes import FACES, Box, between, field_of_boxes
from scenes import HARD, SAND, at, box, engine_of, loaded, plane, scene

CUBES = (1.0, 1.0, 1.0)
LATTICE, BAND = 0.5, 2.5  # [m]
WEST, NORTH, BOTTOM, TOP = 0, 3, 4, 5  # faces
WALL = between((40, 24, -4), (42, 36, 8))
ROUNDED = 0.1  # [m] at a convex edge: a fifth of a cell of the lattice
GRAVITY = np.array([0.0, 0.0, -9.81])


def field(*boxes):
    return field_of_boxes(boxes, LATTICE, BAND)


def advance(engine, duration):
    """Step for so many seconds; returns the time [s]."""
    time = 0.0
    while time < duration:
        dt = engine.stable_step()
        engine.step(dt)
        time += dt
    return time


def on_facades(engine, structures):
    """Impulse [N s] on each facade (facades, 3)."""
    facade = structures.patches.facade
    sums = np.zeros((facade.max() + 1, 3))
    np.add.at(sums, facade, engine.structure_impulses())
    return sums


def test_a_block_without_friction_hands_its_momentum_to_the_wall(backend):
    structures = field(WALL)
    particles = box((35, 29, 0), (3, 3, 2), CUBES)
    particles.velocity[:, 0] = 4.0
    loaded(backend, scene(plane(), structures=structures, friction=(0.0,), materials=(HARD,)), particles)
    time = advance(backend, 1.2)
    row, of_facade = backend.ledger(), on_facades(backend, structures)
    assert row.momentum[0] < 0.0  # an elastic block bounces
    assert of_facade[WEST, 0] == pytest.approx(4.0 * row.mass - row.momentum[0], rel=1e-9)
    np.testing.assert_allclose(of_facade.sum(axis=0) - of_facade[WEST], 0.0, atol=1e-6 * row.mass)
    np.testing.assert_allclose(row.basal_impulse, [0.0, 0.0, 9.81 * row.mass * time], atol=0.02 * 4.0 * row.mass)


def test_momentum_balance_closes_to_rounding(backend):
    """Sand slides down a slope with friction into an oblique wall with friction."""
    structures = field(Box((40.0, 30.0, -8.0), (1.5, 6.0, 12.0), 0.4, 0.3))
    slope = plane(slope_x=-0.3)
    particles = box((32, 27, 0), (5, 5, 3), CUBES, density=SAND.density, surface=slope)
    particles.velocity[:] = (8.0, 0.0, -2.4)
    start = particles.mass @ particles.velocity
    loaded(backend, scene(slope, structures=structures, friction=(0.2,), materials=(SAND,)), particles)
    time = advance(backend, 0.8)
    row, pushed = backend.ledger(), backend.structure_impulses().sum(axis=0)
    defect = row.momentum - start - row.mass * GRAVITY * time - row.basal_impulse + pushed
    assert np.abs(pushed[:2]).min() > 0.01 * np.abs(start).max()
    np.testing.assert_allclose(defect, 0.0, atol=1e-12 * np.abs(start).max())
    lost = row.structure_dissipation + row.basal_dissipation + row.plastic_dissipation
    assert 0.0 < row.structure_dissipation < lost


WAYS = ("float64", 0.0), ("float64", 30.0), ("float32", 45.0), ("float32", 17.0)


@pytest.mark.parametrize(
    ("name", "precision", "angle"),
    [*(("reference", *way) for way in WAYS[:2]), *((name, *way) for name in ("scan", "hash") for way in WAYS)],
)  # the reference has no other precision
def test_a_wall_of_two_cells_does_not_leak(name, precision, angle):
    backend = engine_of(name)
    wall = Box((40.0, 30.0, 4.0), (1.0, 7.0, 8.0), np.radians(angle), 0.1)
    x = np.random.default_rng(1).uniform((31, 27, 0.1), (41, 33, 4), (2500, 3))
    x = x[wall.beyond(x)[0][:, 0] < -1.2]
    particles = at(x, CUBES, SAND.density, 0.1)
    particles.mass[:] *= np.random.default_rng(2).uniform(0.2, 2.0, len(x))
    particles.radius[:] = 0.125
    particles.velocity[:] = 30.0 * wall.axes[0]
    loaded(backend, scene(plane(), structures=field(wall), friction=(0.1,), materials=(SAND,), precision=precision), particles)
    for _ in range(6):
        advance(backend, 0.1)
        place, beyond = wall.beyond(backend.particles().position(np.ones(3)))
        assert not ((place[:, 0] > 0) & (beyond[:, 1:] < 0).all(axis=1)).any()
        assert (beyond.max(axis=1) > -ROUNDED).all()
    assert on_facades(backend, field(wall))[WEST] @ wall.axes[0] > 10.0 * particles.mass.sum()


def test_the_roof_of_a_gallery_carries_what_lies_on_it(backend):
    roof = (between((30, 26, 3), (40, 36, 5), 0.5), between((30, 26, -2), (32, 36, 3)), between((38, 26, -2), (40, 36, 3)))
    structures = field(*roof)
    particles = box((33, 29, 5), (4, 4, 2), CUBES, density=SAND.density)
    loaded(backend, scene(plane(), structures=structures, materials=(SAND,)), particles)
    advance(backend, 1.0)
    before = on_facades(backend, structures)
    time = advance(backend, 0.5)
    force = (on_facades(backend, structures) - before) / time
    assert force[TOP, 2] == pytest.approx(-9.81 * particles.mass.sum(), rel=0.03)
    assert np.abs(np.delete(force, TOP, axis=0)).max() == 0.0
    assert not backend.ledger().basal_impulse.any()


def test_a_flow_below_an_overhang_meets_it_from_below(backend):
    structures = field(between((30, 26, 3), (40, 36, 5)))
    particles = box((33, 27, 0), (4, 3, 2), CUBES, density=SAND.density)
    particles.velocity[:] = (0.0, 3.0, 9.0)
    loaded(backend, scene(plane(), structures=structures, materials=(SAND,)), particles)
    advance(backend, 0.5)
    of_facade = on_facades(backend, structures)
    assert of_facade[BOTTOM, 2] > 4.0 * particles.mass.sum()
    assert np.abs(np.delete(of_facade, BOTTOM, axis=0)).max() == 0.0
    x = backend.particles().position(np.ones(3))
    assert x[:, 2].max() < 3.0
    assert x[:, 1].mean() > 29.0  # and goes on below it


def test_a_column_of_a_fluid_presses_on_its_walls_with_rho_g_h_squared_by_two(backend):
    """Nearly incompressible, between walls without friction; the pressure of an elastic material is nu / (1 - nu) of its weight."""
    height, width, low, high = 4.0, 3.0, 20.0, 23.0
    walls = (
        between((low - 2, low - 2, -2), (low, high + 2, 9)), between((high, low - 2, -2), (high + 2, high + 2, 9)),
        between((low, low - 2, -2), (high, low, 9)), between((low, high, -2), (high, high + 2, 9)),
    )  # fmt: skip
    structures, fluid = field(*walls), replace(HARD, density=1000.0, youngs_modulus=3e6, poisson_ratio=0.49)
    particles = box((low, low, 0), (width, width, height), CUBES, fluid.density)
    depth = height - particles.position(np.ones(3))[:, 2]
    particles.strain[:, 2] = np.expm1(-2.0 * fluid.density * 9.81 * depth / (fluid.lame_lambda + 2.0 * fluid.shear_modulus))
    loaded(backend, scene(plane(), structures=structures, friction=(0.0,), materials=(fluid,)), particles)
    advance(backend, 0.3)
    before = on_facades(backend, structures)
    time = advance(backend, 0.3)
    force = (on_facades(backend, structures) - before) / time
    expected = 0.49 / 0.51 * fluid.density * 9.81 * height**2 / 2.0 * width
    found = [-force[1, 0], force[FACES, 0], -force[2 * FACES + NORTH, 1], force[3 * FACES + 2, 1]]
    np.testing.assert_allclose(found, expected, rtol=0.04)


@pytest.mark.parametrize("angle_deg", [0.0, 30.0])
def test_a_steady_stream_pushes_a_plate_with_its_flux_of_momentum(angle_deg):
    """Without gravity, a square jet of sand on an inclined plate: rho Q v times the sine of the angle between them."""
    speed, plate = 20.0, Box((30.0, 30.0, 30.0), (1.0, 10.0, 10.0), np.radians(angle_deg), 0.0)
    particles = box((8, 28, 28), (21, 4, 4), CUBES, density=SAND.density)
    ahead = plate.beyond(particles.position(np.ones(3)))[1][:, 0] > 0.3
    particles = particles.take(np.flatnonzero(ahead & (particles.position(np.ones(3))[:, 0] < 30.0)))
    particles.velocity[:, 0] = speed
    structures = field(plate)
    engine = engine_of("scan")
    loaded(engine, scene(plane(), structures=structures, materials=(SAND,), gravity=(0.0, 0.0, 0.0)), particles)
    advance(engine, 0.25)
    before = engine.structure_impulses().sum(axis=0)
    time = advance(engine, 0.45)
    force = (engine.structure_impulses().sum(axis=0) - before) / time
    flux = SAND.density * 16.0 * speed**2
    assert force @ plate.axes[0] == pytest.approx(flux * np.cos(np.radians(angle_deg)), rel=0.05)
    np.testing.assert_allclose(force @ plate.axes[1:].T, 0.0, atol=1e-6 * flux)


@pytest.mark.parametrize("opening_deg", [30.0, 90.0])
def test_walls_of_a_corner_share_a_fast_flow(opening_deg):
    """A particle touches one wall at a time: centres stay out of both by a fifth of a cell, and mirrored walls are pushed alike."""
    half, apex, sides = np.radians(opening_deg / 2), np.array([40.0, 30.0]), (1.0, -1.0)
    walls = []
    for side in sides:
        along, out = np.array([-np.cos(half), side * np.sin(half)]), np.array([np.sin(half), side * np.cos(half)])
        walls.append(Box((*(apex + 11.0 * along + out), 4.0), (13.0, 1.0, 8.0), np.arctan2(along[1], along[0]), 0.1))
    x = np.random.default_rng(0).uniform((22, 20, 0.1), (38, 40, 3), (8000, 3))
    free = np.min([wall.distance(x) for wall in walls], axis=0) > 0.3
    particles = at(x[free & (np.abs(x[:, 1] - 30) < (40 - x[:, 0]) * np.tan(half) - 0.4)], CUBES, SAND.density, 0.1)
    particles.radius[:], particles.velocity[:, 0] = 0.125, 30.0
    start, structures = particles.mass @ particles.velocity, field(*walls)
    engine = loaded(engine_of("scan"), scene(plane(), structures=structures, friction=(0.1,), materials=(SAND,)), particles)
    deepest, time = 0.0, 0.0
    while time < 0.5:
        time += advance(engine, 0.02)
        x = engine.particles().position(np.ones(3))
        deepest = min(deepest, *(wall.distance(x).min() for wall in walls))
    one, other = on_facades(engine, structures).reshape(2, FACES, 3).sum(axis=1)
    assert deepest > -0.2
    assert one[0] > 0.2 * start[0] / len(sides)
    np.testing.assert_allclose(one[:2], other[:2] * (1, -1), rtol=0.05)
    row = engine.ledger()
    received = row.basal_impulse + row.mass * GRAVITY * time - one - other
    np.testing.assert_allclose(row.momentum, start + received, atol=1e-12 * start[0])
