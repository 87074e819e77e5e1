"""Areas of patches are those from which contacts are booked: a uniform pressure is nearly the same on all patches of a facade."""

import numpy as np
import pytest
import trimesh
from boxes import Box
from scenes import HARD, at, engine_of, loaded, plane, scene

from runout.model.terrain import Terrain
from runout.simulation.structure_forces import StructureForces
from runout.structures.build import build_structures
from runout.structures.facades import mesh_facades
from runout.structures.solid import Solid

CUBES = (1.0, 1.0, 1.0)
PER_CELL = 4  # contacts along each edge of a cell
HIGHEST = 6.13  # of the house [m]


def house(turn_deg):
    """A house whose sides are no multiples of a cell, on level ground, and its structures."""
    box = Box((40.21, 36.34, HIGHEST - 6.0), (3.87, 4.56, 6.0), np.radians(turn_deg))
    mesh = trimesh.creation.box(2.0 * np.array(box.half))
    vertices, faces = mesh.vertices @ box.axes + np.array(box.centre), np.asarray(mesh.faces)
    solid = Solid("house", vertices, faces, *mesh_facades(vertices, faces), 0.0, "house")
    return box, build_structures([solid], Terrain(np.zeros((30, 40)), (2.5, 2.5)), CUBES)


def forces_of_a_sheet(box, structures):
    """Forces of grains that press alike on the whole western facade, by the patches of their contacts."""
    d = 1.0 / PER_CELL
    y, z = np.arange(-box.half[1] + d / 2, box.half[1], d), np.arange(d / 2, HIGHEST, d)
    x = np.stack(np.meshgrid(-box.half[0] - 0.25, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    particles = at(x @ box.axes + np.array([*box.centre[:2], 0.0]), CUBES)
    particles.radius[:], particles.velocity[:] = 0.4, 2.0 * box.axes[0]
    engine = loaded(
        engine_of("scan"),
        scene(plane(height=-5.0), structures=structures.field, gravity=(0.0, 0.0, 0.0), materials=(HARD,)),
        particles,
    )
    engine.step(1e-3)
    touching, impulses = engine.structures.touching, np.zeros((1, len(structures.field.patches.area), 3))
    for first, number in zip(touching.place, touching.number, strict=False):
        np.add.at(impulses[0], touching.patch[first : first + number], d * d * box.axes[0])
    assert touching.number.sum() == len(x)
    return StructureForces(structures, np.array([0.0, 1.0]), impulses)


@pytest.mark.parametrize("turn_deg", [0.0, 20.0, 45.0])
def test_uniform_pressure_on_a_facade_of_any_length_has_a_percentile_near_its_mean(turn_deg):
    """Some 16 contacts press on each patch; one more or less at each of its sides is a fifth of them."""
    box, structures = house(turn_deg)
    found, patches = forces_of_a_sheet(box, structures), structures.field.patches
    west = int(found.pressure[0].argmax())
    area = patches.area[patches.facade == west]
    assert area.sum() == pytest.approx(2.0 * box.half[1] * HIGHEST)
    assert area.min() > 0.3
    assert found.pressure[0, west] == pytest.approx(1.0, rel=0.01)
    assert found.high_pressure[0, west] == pytest.approx(1.0, rel=0.2)
