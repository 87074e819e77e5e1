"""Releases that thin out to their rim, and mass that is trapped in a scar."""

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import shapely

from runout import DruckerPrager, simulate
from runout.errors import ReleaseError
from runout.model.numerics import Numerics
from runout.model.release import Edge, Release
from runout.model.terrain import Terrain
from runout.release import taper
from runout.release.read import _on_cells
from runout.release.statements import record, separate_parts, start_sentences, statement
from runout.release.taper import tapered, trapped_share
from runout.simulation.scenario import build_scene

CELL, SLOPE, WEST = 5.0, math.tan(math.radians(25.0)), 200.0
EGG = shapely.transform(shapely.Point(0, 0).buffer(1.0), lambda c: np.array([150.0, 150.0]) + c * [75.0, 55.0])


def plane(slope: float = SLOPE, cell: float = CELL, columns: int = 140) -> Terrain:
    """A plane of 60 rows that falls to the east, and from 300 m on a level floor."""
    x = (np.arange(columns) + 0.5) * cell
    return Terrain.from_array(np.tile(np.maximum(slope * (300.0 - x), 0.0) + WEST, (60, 1)), cell)


def mass(terrain: Terrain, thickness: float, *, edge: str = "tapered", placement: str = "excavated") -> Release:
    """The egg on a terrain, without a file."""
    if edge == "vertical":
        return Release(_on_cells(np.array([EGG]), np.array([thickness]), terrain), terrain, EGG, placement)
    body = tapered(np.array([EGG]), np.array([thickness]), EGG, terrain, excavated=placement == "excavated")
    return Release(body.thickness(), terrain, EGG, placement, edge=Edge.TAPERED, body=body)


@pytest.fixture(scope="module")
def slope():
    return plane()


@pytest.mark.parametrize("stated", [{"thickness": 6.0}, {"thickness": "depth"}, {"volume": 15_000.0}], ids=str)
def test_an_excavated_polygon_thins_out_and_keeps_its_volume(write_polygons, terrain, stated):
    release = Release.from_vector(write_polygons([shapely.box(50, 50, 100, 100)], depth=[6.0]), terrain, **stated)
    assert release.edge is Edge.TAPERED
    assert release.volume == pytest.approx(15_000.0, rel=1e-9)
    inside = release.thickness[20:30, 10:20]
    assert inside.min() > 0
    assert release.thickness.sum() == pytest.approx(inside.sum(), rel=1e-12)
    assert inside[[0, -1]].mean() < 0.4 * inside[4:6, 4:6].mean()
    for factor in (0.7, 1.0, 1.5):
        assert release.scaled(factor).volume == pytest.approx(factor * release.volume, rel=1e-13)


def test_the_stated_thickness_is_the_mean_that_is_printed_and_the_tapered_edge_explains_the_middle(write_polygons, terrain):
    parts = [shapely.Point(100, 100).buffer(41.3), shapely.box(203, 53, 257, 149)]
    release = Release.from_vector(write_polygons(parts), terrain, 15.0, name="scar")
    assert release.mean_thickness == pytest.approx(15.0, rel=1e-9)
    assert "thickness: 15 m on average" in repr(release)
    said = statement(release)
    assert f"15 m thick on average, {release.thickness.max():.3g} m at most, excavated, tapered edge: it thins out" in said
    assert separate_parts(release) == 2
    (together,) = start_sentences([release])
    assert "its 2 separate polygons start together at time zero" in together
    vertical = Release.from_vector(write_polygons(parts[:1]), terrain, 15.0, edge="vertical")
    assert "thins out" not in statement(vertical) + repr(vertical)
    assert not list(start_sentences([vertical]))


def test_edges_are_chosen_by_placement_and_by_name(write_polygons, terrain):
    path = write_polygons([shapely.box(50, 50, 100, 100)])
    on_surface = Release.from_vector(path, terrain, thickness=6.0, placement="on_surface")
    vertical = Release.from_vector(path, terrain, thickness=6.0, edge="vertical")
    mound = Release.from_vector(path, terrain, thickness=6.0, placement="on_surface", edge="tapered")
    assert on_surface.thickness.max() == vertical.thickness.max() == pytest.approx(6.0)
    assert mound.thickness.max() > 10.0
    assert mound.volume == pytest.approx(vertical.volume, rel=1e-9)
    with pytest.raises(ReleaseError, match="edge is 'round'; choose one of tapered, vertical"):
        Release.from_vector(path, terrain, thickness=6.0, edge="round")


def test_a_round_mass_on_level_ground_is_a_paraboloid():
    level = plane(0.0, 4.0)
    disc = shapely.Point(140.0, 120.0).buffer(80.0, 64)
    body = tapered(np.array([disc]), np.array([5.0]), disc, level, excavated=True)
    r2 = np.add.outer((level.northing - 120.0) ** 2, (level.easting - 140.0) ** 2)
    exact = 10.0 * np.maximum(1.0 - r2 / 80.0**2, 0.0)
    np.testing.assert_allclose(body.thickness(), exact, atol=0.3)


def test_polygons_that_touch_have_one_bowl_and_others_have_their_own(write_polygons, terrain):
    shapes = [shapely.box(50, 50, 100, 100), shapely.box(100, 50, 150, 100), shapely.box(200, 100, 230, 130)]
    release = Release.from_vector(write_polygons(shapes, depth=[4.0, 8.0, 2.0]), terrain, thickness="depth")
    assert release.volume == pytest.approx(2500 * 12.0 + 900 * 2.0, rel=1e-9)
    assert release.thickness[:, 40:].sum() * terrain.cell_area == pytest.approx(1800.0, rel=0.01)
    across = release.thickness[25, 10:30]
    assert across[8:12].min() > 0.5 * across[:8].max()  # no ridge where the polygons touch
    assert across[10:].sum() > across[:10].sum()


def test_trapped_share_of_a_box_in_a_plane_is_the_wedge_behind_its_lower_wall():
    ground = plane(0.5)
    thickness = np.zeros(ground.shape)
    thickness[20:40, 20:40] = 10.0  # 100 m along the slope
    box = Release(thickness, ground)
    for angle in (0.0, 10.0):
        exact = 10.0 / (2.0 * (0.5 - math.tan(math.radians(angle))) * 100.0)
        assert trapped_share(box, math.radians(angle)) == pytest.approx(exact, rel=0.3)
    assert trapped_share(Release(thickness, ground, placement="on_surface"), 0.0) == 0.0
    hole = Release(thickness, plane(0.0))
    assert trapped_share(hole, 0.0) == pytest.approx(1.0)


def test_trapped_share_of_many_cells_is_that_of_blocks(slope, monkeypatch):
    from runout.release import taper

    release = mass(slope, 15.0, edge="vertical")
    whole = trapped_share(release, 0.2)
    monkeypatch.setattr(taper, "LARGEST", 200)
    assert trapped_share(release, 0.2) == pytest.approx(whole, abs=0.06)


@pytest.mark.parametrize("factor", [0.7, 1.0, 1.5])
def test_a_tapered_scar_leads_out_whatever_the_volume(slope, factor):
    angle = math.radians(15.0)
    vertical, thin = mass(slope, 7.0, edge="vertical").scaled(factor), mass(slope, 7.0).scaled(factor)
    assert thin.volume == pytest.approx(vertical.volume, rel=1e-12)
    assert trapped_share(thin, 0.0) < 0.002
    assert trapped_share(thin, angle) < 0.02
    assert trapped_share(vertical, angle) > 0.03


@pytest.mark.parametrize("edge", ["tapered", "vertical"])
def test_a_larger_volume_digs_no_deeper_and_a_smaller_one_less_deep(slope, edge):
    stated = mass(slope, 7.0, edge=edge)
    larger, smaller = stated.scaled(1.8), stated.scaled(0.6)
    np.testing.assert_array_equal(larger.excavation, stated.excavation)
    np.testing.assert_allclose(larger.heap, 0.8 * stated.thickness, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(smaller.excavation, smaller.thickness)
    np.testing.assert_allclose(smaller.scaled(3.0).excavation, stated.excavation, rtol=1e-12)
    assert (smaller.excavation <= stated.excavation + 1e-9).all()
    assert trapped_share(larger, 0.2) < trapped_share(stated, 0.2) + 1e-9
    on_ground = mass(slope, 7.0, edge=edge, placement="on_surface").scaled(1.8)
    assert not on_ground.excavation.any()


def test_a_larger_volume_slides_on_the_surface_of_the_stated_one_and_stands_above_the_ground(slope):
    sand = DruckerPrager(density=2000.0, youngs_modulus=2e7, friction_angle=34.0)
    middle, floors, tops = (np.array([150.0]), np.array([150.0])), [], []
    for factor in (1.0, 1.6):
        scene, particles = build_scene(slope, mass(slope, 7.0).scaled(factor), sand, 15.0, Numerics(cell_size=10.0))
        floors.append(float(scene.surface.evaluate(*middle)[0][0]))
        place = particles.position(scene.spacing)
        column = np.hypot(place[:, 0] - 150.0, place[:, 1] - 150.0) < 10.0
        tops.append(float(place[column, 2].max()))
    assert floors[1] == pytest.approx(floors[0], abs=1e-9)
    assert tops[1] - tops[0] > 0.5 * 0.6 * mass(slope, 7.0).thickness.max()


def test_volume_factors_in_turn_give_what_their_product_gives(slope):
    release = mass(slope, 12.0)
    np.testing.assert_allclose(release.scaled(0.5).scaled(3.0).thickness, release.scaled(1.5).thickness, rtol=1e-12)


def test_more_than_the_ground_can_hold_above_its_outlet_is_dug_all_the_same(slope):
    release = mass(slope, 60.0)
    assert release.volume == pytest.approx(60.0 * EGG.area, rel=1e-12)
    assert trapped_share(release, 0.0) > 0.1


@cache
def left(edge: str, factor: float) -> float:
    """Share of the mass that is still in its scar after 40 s."""
    release = mass(plane(), 7.0, edge=edge).scaled(factor)
    sand = DruckerPrager(density=2000.0, youngs_modulus=2e7, friction_angle=34.0)
    result = simulate(release.terrain, release, sand, basal_friction_angle=15.0, cell_size=10.0, end_time=40.0, threads=1)
    deposit = result.maps["deposit_thickness"].values
    return float(deposit[release.thickness > 0].sum() / deposit.sum())


def test_a_tapered_mass_leaves_its_scar_and_one_in_a_pit_does_not():
    """Measured 1.1 % of 1.0 times the volume in a pit with vertical walls, and a hundredth of that where it is tapered."""
    assert 10.0 * left("tapered", 1.0) < 0.008 < left("vertical", 1.0)
    assert left("vertical", 1.5) < 0.04
    assert left("tapered", 1.5) < 0.01


def test_what_is_too_narrow_to_be_tapered_keeps_its_thickness():
    needle = shapely.box(20.0, 100.0, 250.0, 101.0)
    body = tapered(np.array([needle]), np.array([3.0]), needle, plane(), excavated=True)
    assert body.thickness().max() == pytest.approx(0.6)
    assert body.thickness().sum() * CELL**2 == pytest.approx(3.0 * 230.0)


def test_many_polygons_are_tapered_and_too_many_keep_a_vertical_edge(write_polygons, terrain, monkeypatch):
    apart = [shapely.box(x, y, x + 10.0, y + 10.0) for x in range(5, 285, 14) for y in range(5, 185, 14)]
    few = Release.from_vector(write_polygons(apart[:60], "few.gpkg"), terrain, thickness=2.0)
    assert (few.edge, len(few.body.parts)) == (Edge.TAPERED, 60)
    assert few.volume == pytest.approx(2.0 * 100.0 * 60, rel=1e-9)
    specks = [shapely.box(x, y, x + 1.0, y + 1.0) for x in range(5, 45, 2) for y in range(5, 37, 2)]
    assert Release.from_vector(write_polygons(specks, "many.gpkg"), terrain, thickness=2.0).edge is Edge.TAPERED
    monkeypatch.setattr(taper, "MOST_PARTS", 300)
    many = Release.from_vector(write_polygons(specks, "many.gpkg"), terrain, thickness=2.0)
    assert (many.edge, many.body) == (Edge.VERTICAL, None)
    assert "separate parts are too many to be tapered" in many.changes[0]


@pytest.mark.parametrize("factor", [0.4, 1.0])
def test_a_bowl_that_is_cut_keeps_its_volume_and_ends_between_two_of_the_surfaces_that_fall_to_the_rim(slope, factor):
    for part in mass(slope, 7.0).body.parts:
        thickness = part._thickness(factor)
        above = np.minimum(taper.DEEPEST * factor * part.bowl, part.planes)
        between = [(b - 1e-9 <= thickness).all() and (thickness <= a + 1e-9).all() for a, b in pairwise(above)]
        assert any(between)
        assert float((part.cells @ thickness).sum()) == pytest.approx(factor * float((part.cells @ part.bowl).sum()), rel=1e-6)
        assert (thickness >= 0.0).all()


def test_the_record_of_a_release_has_its_largest_and_its_mean_thickness(slope):
    release = mass(slope, 7.0)
    sizes = record(release)
    assert sizes["largest_thickness"] == release.thickness.max()
    assert sizes["volume"] / sizes["area"] == pytest.approx(sizes["mean_thickness"])
    assert 1.3 * sizes["mean_thickness"] < sizes["largest_thickness"] < 3.0 * sizes["mean_thickness"]


def test_parts_that_are_shaped_together_have_the_shape_that_each_has_alone():
    ground, rng = plane(), np.random.default_rng(2)
    shapes = np.array([shapely.Point(30 + 40 * i, 30 + 40 * j).buffer(5 + 12 * rng.random()) for i in range(9) for j in range(6)])
    depths = rng.uniform(1.0, 6.0, len(shapes))
    together = tapered(shapes, depths, shapely.union_all(shapes), ground, excavated=True)
    alone = np.zeros(ground.shape)
    finest = int(np.sqrt(taper.NODES / len(shapes)))
    for k in range(len(shapes)):
        outlined = taper._outlined(shapes[k], shapely.STRtree(shapes), shapes, depths, ground, finest)
        (part,) = taper._shaped([outlined], ground, taper.filled(ground.elevation, ground.cell_size), taper.FEW_SLOPES)
        alone[part.window] += part.volumes(0.8) / ground.cell_area
    np.testing.assert_allclose(together.scaled(0.8).thickness(), alone, atol=1e-9)


def test_linear_weights_over_cells_sum_to_the_spacing_and_balance_at_their_centre():
    """Nodes of 3 m spacing over six cells of 2 m; the tent of a node on an edge of a cell covers two cells alike."""
    centre = np.array([4.0, 6.5])
    found = taper._integrals(centre, 3.0, 2.0, 6)
    np.testing.assert_allclose(found.sum(axis=0), 3.0)
    np.testing.assert_allclose(found[:, 0], [1 / 6, 4 / 3, 4 / 3, 1 / 6, 0.0, 0.0], atol=1e-12)
    cut = taper._integrals(np.array([0.0]), 3.0, 2.0, 6)[:, 0]
    np.testing.assert_allclose(cut, [4 / 3, 1 / 6, 0.0, 0.0, 0.0, 0.0], atol=1e-12)


def test_values_between_cells_are_bilinear_and_those_of_the_rim_beyond():
    terrain = Terrain(np.zeros((4, 5)), (2.0, 3.0), 100.0, 200.0)
    values = terrain.easting[None, :] + 10.0 * terrain.northing[:, None]
    x, y = np.array([101.0, 104.4, 107.2]), np.array([201.5, 204.0, 209.1])
    np.testing.assert_allclose(taper._at(values, terrain, x, y), x + 10.0 * y)
    np.testing.assert_allclose(taper._at(values, terrain, np.array([90.0]), np.array([300.0])), 101.0 + 10.0 * 210.5)


def test_bowl_solves_the_poisson_equation_inside_and_is_zero_outside():
    inside = np.zeros((6, 7), bool)
    inside[1:5, 1:6] = True
    inside[1, 1] = False
    source = np.random.default_rng(0).uniform(0.5, 2.0, inside.shape)
    u = np.zeros(inside.shape)
    u[inside] = taper._bowl(inside, source)
    beside = u[:-2, 1:-1] + u[2:, 1:-1] + u[1:-1, :-2] + u[1:-1, 2:]
    np.testing.assert_allclose((4.0 * u[1:-1, 1:-1] - beside)[inside[1:-1, 1:-1]], source[inside])


def test_a_tapered_mass_is_nowhere_thinner_than_a_thousandth_of_its_mean():
    spike = shapely.union(shapely.box(50.0, 50.0, 150.0, 150.0), shapely.box(150.0, 100.1, 250.0, 100.9))  # an arm without a node
    (part,) = tapered(np.array([spike]), np.array([4.0]), spike, plane(), excavated=False).parts
    for factor in (1.0, 0.5):
        inside = part.covered > 0
        thickness = part.volumes(factor)[inside] / part.covered[inside]
        assert thickness.min() == pytest.approx(1e-3 * factor * part.volume / part.covered.sum(), rel=0.01)
        assert part.volumes(factor).sum() == pytest.approx(factor * 4.0 * spike.area)


@pytest.mark.parametrize(("cell", "size"), [(5.0, 2.5), (0.5, 2.0), (400.0, 20.0)])
def test_a_lattice_has_two_nodes_in_a_cell_but_at_least_ten_and_at_most_the_finest_across(cell, size):
    lattice = taper._Lattice.over(shapely.box(0.0, 0.0, 200.0, 100.0), plane(cell=cell), finest=100)
    assert lattice.size == size
    assert lattice.inside.shape == (100 / size + 2, 200 / size + 2)
    assert lattice.inside.sum() * size**2 == pytest.approx(200.0 * 100.0)
