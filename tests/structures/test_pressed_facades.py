"""Impulses are booked on the facade that is pressed, also where a convex edge is the nearest point."""

import numpy as np
import pytest
import trimesh
from boxes import Box
from scenes import HARD, at, loaded, plane, scene

from runout.model.terrain import Terrain
from runout.structures.build import build_structures
from runout.structures.facades import mesh_facades
from runout.structures.solid import Solid

CUBES = (1.0, 1.0, 1.0)
SPEED, DURATION = 4.0, 0.8  # [m/s], [s]


def house(turn_deg):
    """A square house of 8 m, turned on level ground, and its structures."""
    box = Box((40.0, 36.0, 2.0), (4.0, 4.0, 6.0), np.radians(turn_deg))
    mesh = trimesh.creation.box(2.0 * np.array(box.half))
    vertices, faces = mesh.vertices @ box.axes + np.array(box.centre), np.asarray(mesh.faces)
    solid = Solid("house", vertices, faces, *mesh_facades(vertices, faces), 0.0, "house")
    return box, build_structures([solid], Terrain(np.zeros((30, 40)), (2.5, 2.5)), CUBES)


def grains(box, low, high):
    """Particles two along each edge of a cell in the axes of a box, from its centre at ground level [m]."""
    axes = [np.arange(a + 0.25, b, 0.5) for a, b in zip(low, high, strict=True)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    particles = at(x @ box.axes + np.array([*box.centre[:2], 0.0]), CUBES)
    particles.radius[:] = 0.25
    return particles


def pressed(backend, structures, particles):
    """Impulse [N s] on each facade (facades, 3) after :data:`DURATION`, and its outward normal (facades, 3)."""
    loaded(backend, scene(plane(), structures=structures.field, friction=(0.0,), materials=(HARD,)), particles)
    time = 0.0
    while time < DURATION:
        dt = backend.stable_step()
        backend.step(dt)
        time += dt
    patches, facades = structures.field.patches, len(structures.facades)
    sums, normals = np.zeros((facades, 3)), np.zeros((facades, 3))
    np.add.at(sums, patches.facade, backend.structure_impulses())
    np.add.at(normals, patches.facade, patches.area[:, None] * patches.normal)
    return sums, normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, 45.0])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_block_that_presses_beside_a_corner_presses_on_the_facade_before_it(turn_deg, side, backend):
    box, structures = house(turn_deg)
    ends = sorted((side * 1.0, side * 4.0))
    particles = grains(box, (-7.0, ends[0], 0.0), (-4.0, ends[1], 2.0))
    particles.velocity[:] = SPEED * box.axes[0]
    sums, normals = pressed(backend, structures, particles)
    handed = SPEED * particles.mass.sum() - backend.ledger().momentum @ box.axes[0]
    west = np.argmin(normals @ box.axes[0])
    assert sums.sum(axis=0) @ box.axes[0] == pytest.approx(handed, rel=1e-9)
    assert not np.delete(sums, west, axis=0).any()


@pytest.mark.parametrize(("turn_deg", "tolerance"), [(0.0, 0.01), (30.0, 0.15), (45.0, 0.01)])
def test_a_block_that_meets_an_edge_presses_on_both_facades_alike(turn_deg, tolerance, backend):
    """Its direction halves the angle between them. The lattice is symmetric about it without a turn and at 45 degrees."""
    box, structures = house(turn_deg)
    diagonal = Box(box.centre, box.half, box.angle + np.pi / 4)
    edge = -4.0 * np.sqrt(2.0)
    particles = grains(diagonal, (edge - 3.0, -2.0, 0.0), (edge, 2.0, 2.0))
    particles.velocity[:] = SPEED * diagonal.axes[0]
    sums, normals = pressed(backend, structures, particles)
    handed = SPEED * particles.mass.sum() - backend.ledger().momentum @ diagonal.axes[0]
    toward = -normals @ diagonal.axes[0] > 0.5
    assert toward.sum() == 2
    assert sums.sum(axis=0) @ diagonal.axes[0] == pytest.approx(handed, rel=1e-9)
    np.testing.assert_allclose(sums[toward] @ diagonal.axes[0], handed / 2.0, rtol=tolerance)
