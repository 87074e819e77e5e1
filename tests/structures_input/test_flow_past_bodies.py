"""Flows under and over an overhang of the terrain, through a tunnel, and over and under a gallery: no mass is lost or in a body."""

from dataclasses import dataclass

import numpy as np
import trimesh
from structure_bodies import SOUTH, WEST, write_footprints

import runout
from runout.model.friction import FrictionZones
from runout.model.scene import Raster, Scene
from runout.structures.build import build_structures
from runout.structures.lattice_distance import points_inside
from runout.structures.read import overhang_bodies, read_bodies
from runout.structures.solid import Solid, as_arrays
from runout.structures.source import StructureSource
from runout.terrain.mesh import read_mesh_terrain

CELL = 1.0  # [m] of the grid; the lattice of distances has half of it
ROUNDED = 0.1  # [m] by which a centre may lie in a body: a fifth of a cell of the lattice, at edges
SLOPE = 0.4
SAND = runout.DruckerPrager(density=1800.0, youngs_modulus=2e6, poisson_ratio=0.3, friction_angle=34.0, cohesion=0.0)


@dataclass(frozen=True)
class Flow:
    """Particles (times, n, 3) [m] in the coordinates of the map, less its south-west corner, NaN where they have left."""

    place: np.ndarray
    solids: tuple[Solid, ...]
    result: runout.Result


def height(x):
    """Height above a plane ground that falls to the east."""
    return x[..., 2] + SLOPE * x[..., 0] - 100.0


def flow(terrain, releases, solids, end_time, friction=8.0):
    result = runout.simulate(
        terrain, releases, SAND, structures=build_structures(solids, terrain, (CELL,) * 3), basal_friction_angle=friction,
        cell_size=CELL, particles_per_cell=(2, 2, 2), end_time=end_time, precision="float64", stop=False,
        snapshot_times=np.linspace(0, end_time, 9)[1:], snapshot_particles=10**6,
    )  # fmt: skip
    frames = np.array(result.particle_frames, np.float64).reshape(8, -1, 4)[..., :3]
    return Flow(frames, tuple(solids), result)


def assert_whole_and_outside(found):
    """Every particle is accounted for in each ledger row, and none lies deeper in a body than its edges are rounded."""
    ledger = found.result.ledger
    np.testing.assert_allclose(ledger.mass + ledger.escaped_mass, float(ledger.mass[0]), rtol=1e-12)
    points = found.place.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    for solid in found.solids:
        arrays = as_arrays(solid)
        inside = points[points_inside(points, arrays)]
        shrunk = np.concatenate([inside + ROUNDED * d for d in np.vstack([np.eye(3), -np.eye(3)])])
        assert points_inside(shrunk, arrays).reshape(6, -1).all(axis=0).sum() == 0
    assert float(ledger.structure_dissipation[-1]) > 0.0


def slab(terrain, west, east, south, north, thickness):
    """A release between local coordinates [m]."""
    (rows, columns), (dx, dy) = terrain.shape, terrain.cell_size
    x, y = (np.arange(columns) + 0.5) * dx, (rows - np.arange(rows) - 0.5) * dy
    inside = ((x > west) & (x < east))[None, :] & ((y > south) & (y < north))[:, None]
    return runout.Release.from_array(np.where(inside, thickness, 0.0), terrain, placement="on_surface")


def lip(path):
    """A channel beside a plateau; between x = 30 and 44 a lip of rock, 6 m thick, reaches over a half of the channel."""
    x = np.array([0.0, 28.0, 30.0, 44.0, 46.0, 90.0])
    open_wall = [(0, 0), (20, 0), (20.01, 6), (20.02, 6), (20.03, 12), (20.04, 12), (50, 16)]
    with_lip = [(0, 0), (20, 0), (20.01, 6), (10, 6), (10, 12), (20.04, 12), (50, 16)]
    sections = [(a, with_lip if 29 < a < 45 else open_wall) for a in x]
    points = np.array([[(WEST + a, SOUTH + y, z + 100 - SLOPE * a) for y, z in section] for a, section in sections])
    n = points.shape[1]
    i, j = (g.ravel() for g in np.indices((len(x) - 1, n - 1)))
    a = i * n + j
    faces = np.concatenate([np.stack([a, a + n, a + n + 1], 1), np.stack([a, a + n + 1, a + 1], 1)])
    trimesh.Trimesh(points.reshape(-1, 3), faces, process=False).export(path)
    return path


def test_a_flow_runs_under_and_over_an_overhang_of_a_mesh(tmp_path):
    terrain, above = read_mesh_terrain(lip(tmp_path / "lip.ply"), CELL, "EPSG:32632")
    solids = overhang_bodies(above, terrain, np.nan)
    low = slab(terrain, 6, 22, 3, 17, 3.0)
    high = slab(terrain, 10, 28, 23, 33, 3.0)
    found = flow(terrain, [low, high], solids, 5.0)
    assert_whole_and_outside(found)
    x, h = found.place, height(found.place)
    under_plan = (x[..., 0] > 32) & (x[..., 0] < 42) & (x[..., 1] > 11.5) & (x[..., 1] < 19)
    under, over = under_plan & (h < 9), under_plan & (h >= 9)
    assert under.any(axis=1).any()
    assert over.any(axis=1).any()
    assert h[under].max() < 6.3
    assert h[over].min() > 11.7
    assert (x[-1, :, 0] > 46).sum() > 1000  # beyond it


def slope(width=30.0, length=60.0):
    """A plane of :data:`SLOPE` that falls to the east, in cells of 1 m."""
    x = np.tile(np.arange(length) + 0.5, (int(width), 1))
    return runout.Terrain.from_array(100.0 - SLOPE * x, 1.0, "EPSG:32632", (WEST, SOUTH))


def along_slope(x, y, h):
    return WEST + np.asarray(x), SOUTH + np.asarray(y), 100.0 - SLOPE * np.asarray(x) + np.asarray(h)


def tube_between(outer, inner, length):
    """Closed mesh of a tube along z between two rectangles (left, low, right, high)."""
    corners = [[(left, low), (right, low), (right, high), (left, high)] for left, low, right, high in (outer, inner)]
    ring = np.array(corners, float).reshape(8, 2)  # four corners outside, four inside
    vertices = np.vstack([np.column_stack([ring, np.full(8, z)]) for z in (0.0, length)])
    quads = []
    for i in range(4):
        j = (i + 1) % 4
        quads += [(i, i + 4, j + 4, j), (i + 8, j + 8, j + 12, i + 12), (i, j, j + 8, i + 8), (i + 4, i + 12, j + 12, j + 4)]
    faces = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    return trimesh.Trimesh(vertices, faces)


def test_a_flow_runs_through_a_tunnel(tmp_path):
    """A mesh with a hole from front to back: the flow is wider than the opening, and some of it stays before the portal."""
    tube = tube_between((0, -6, 30, 6), (11, 0, 19, 3), 12.0)
    y, h, x = tube.vertices.T
    x = 24.0 + x
    tube.vertices = np.column_stack([WEST + x, SOUTH + y, 100.0 - SLOPE * x + h])
    tube.export(tmp_path / "tunnel.obj")
    terrain = slope()
    solids = read_bodies([StructureSource(tmp_path / "tunnel.obj", units="m", friction_angle_deg=10.0)], terrain).solids
    found = flow(terrain, slab(terrain, 4, 18, 7, 23, 4.0), solids, 5.0, friction=5.0)
    assert_whole_and_outside(found)
    x, h = found.place, height(found.place)
    within = (x[..., 0] > 24.2) & (x[..., 0] < 35.8)
    assert within.sum(axis=1).max() > 500
    assert h[within].max() < 3.0
    assert 11.0 - ROUNDED < x[..., 1][within].min() < x[..., 1][within].max() < 19.0 + ROUNDED
    assert (x[-1, :, 0] < 24).sum() > 500
    assert (x[-1, :, 0] > 36).sum() > 500


def test_flows_run_over_the_roof_of_a_gallery_and_along_the_road_below(tmp_path):
    """The roof goes on from the slope above; a second mass collapses on the level road."""
    import shapely

    x = np.tile(np.arange(60) + 0.5, (40, 1))
    road = 100.0 - SLOPE * 28.0 - 6.0
    terrain = runout.Terrain.from_array(np.where(x < 28, 100.0 - SLOPE * x, road), 1.0, "EPSG:32632", (WEST, SOUTH))
    piers = [shapely.box(35, y, 38, y + 3) for y in (2, 18, 35)]
    path = write_footprints(
        tmp_path / "gallery.gpkg", [shapely.box(27, 1, 38, 39), *piers], height=[6.0] * 4, base=[road] * 4,
        clearance=[4.0, None, None, None], name=["roof", "west", "middle", "east"],
    )  # fmt: skip
    solids = read_bodies([StructureSource(path, friction_angle_deg=8.0)], terrain).solids
    above, below = slab(terrain, 6, 24, 20, 34, 3.0), slab(terrain, 29, 34, 6, 14, 3.0)
    found = flow(terrain, [above, below], solids, 5.0)
    assert_whole_and_outside(found)
    at, h = found.place, found.place[..., 2] - road
    under_roof = (at[..., 0] > 29) & (at[..., 0] < 35) & (at[..., 1] > 2) & (at[..., 1] < 38)
    low, high = under_roof & (h < 5), under_roof & (h >= 5)
    assert h[low].max() < 4.0 + ROUNDED
    assert h[high].min() > 6.0 - ROUNDED
    assert high.sum(axis=1).max() > 1000
    assert at[..., 1][low].min() < 5.0  # along the road, between the piers
    assert at[..., 1][low].max() > 16.0
    assert (at[-1, :, 0] > 39).sum() > 1000


def test_friction_of_an_overhang_is_that_of_the_ground_unless_stated(tmp_path):
    terrain, above = read_mesh_terrain(lip(tmp_path / "lip.ply"), CELL, "EPSG:32632")
    factor = np.ones((terrain.shape[1], terrain.shape[0]))
    factor[:38] = 2.0  # the western half of the lip
    zones = FrictionZones(factor, np.zeros_like(factor), terrain.cell_size)
    found = {}
    for stated in (np.nan, 0.5):
        field = build_structures(overhang_bodies(above, terrain, stated), terrain, (CELL,) * 3).field
        a_scene = Scene(
            (CELL,) * 3, None, Raster(*terrain.shape, terrain.cell_size), (SAND, SAND), (0.1, 0.2), structures=field,
            friction_zones=zones,
        )  # fmt: skip
        found[stated] = a_scene.structure_friction()
    east = field.patches.centre[:, 0]
    np.testing.assert_allclose(found[np.nan], np.outer([0.1, 0.2], np.where(east < 38, 2.0, 1.0)))
    np.testing.assert_array_equal(found[0.5], 0.5)
