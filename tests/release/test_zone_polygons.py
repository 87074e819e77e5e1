"""Friction zones of vector files: shares of cells, values and attributes, and what is refused."""

import numpy as np
import pytest
import shapely

from runout import FrictionZones, ZoneError
from runout.terrain.zones import together

SLOPE = shapely.box(12.0, 10.0, 40.0, 30.0)  # local metres: columns 2 to 7, a share of 0.6 in the first; rows from the south 2 to 5


def test_a_cell_that_the_border_cuts_has_the_mean_by_area(terrain, write_polygons):
    zones = FrictionZones.from_vector(write_polygons([SLOPE]), terrain, factor=1.5)
    assert zones.factor.shape == (60, 40)
    np.testing.assert_allclose(zones.factor[2, 2:6], 1.3, rtol=1e-12)
    np.testing.assert_allclose(zones.factor[3:8, 2:6], 1.5, rtol=1e-12)
    assert (zones.factor == 1.0).sum() == 60 * 40 - 24
    assert not zones.coefficient.any()


def test_an_angle_replaces_the_friction_of_the_mass(terrain, write_polygons):
    zones = FrictionZones.from_vector(write_polygons([SLOPE]), terrain, basal_friction_angle_deg=30.0)
    x, y = np.array([13.0, 25.0, 50.0]), np.array([20.0, 20.0, 20.0])
    own = np.tan(np.radians(30.0))
    np.testing.assert_allclose(zones.at(np.full(3, 0.4), x, y), [0.4 * 0.4 + 0.6 * own, own, 0.4], rtol=1e-12)
    assert zones.least_angle(np.radians(40.0)) == pytest.approx(np.radians(30.0))
    assert zones.least_angle(np.radians(20.0)) == pytest.approx(np.radians(20.0))


def test_an_attribute_gives_each_polygon_its_own(terrain, write_polygons):
    path = write_polygons([SLOPE, shapely.box(100.0, 100.0, 120.0, 150.0)], friction=[0.5, 2.0])
    zones = FrictionZones.from_vector(path, terrain, factor="friction")
    assert (zones.factor[5, 4], zones.factor[21, 25]) == pytest.approx((0.5, 2.0))
    assert "2 on 1560 m2; friction times 0.5 to 2" in zones.statement()


def test_what_lies_beyond_the_terrain_is_left_out(terrain, write_polygons):
    zones = FrictionZones.from_vector(write_polygons([shapely.box(-50.0, -50.0, 10.0, 10.0)]), terrain, factor=0.5)
    assert (zones.factor != 1.0).sum() == 4
    assert zones.zones[0]["geometry"].area == pytest.approx(100.0)
    with pytest.raises(ZoneError, match="no friction zone lies on the terrain"):
        FrictionZones.from_vector(write_polygons([shapely.box(-50.0, -50.0, -10.0, -10.0)]), terrain, factor=0.5)


def test_zones_of_two_files_hold_side_by_side_and_not_over_each_other(terrain, write_polygons):
    forest = FrictionZones.from_vector(write_polygons([SLOPE], "forest.gpkg"), terrain, factor=1.5)
    rock = write_polygons([shapely.box(40.0, 10.0, 62.5, 30.0)], "rock.gpkg")
    both = together([forest, FrictionZones.from_vector(rock, terrain, basal_friction_angle_deg=25.0)])
    found = both.at(np.full(3, 0.4), np.array([39.0, 41.0, 62.0]), np.full(3, 20.0))
    own = np.tan(np.radians(25.0))
    np.testing.assert_allclose(found, [0.6, own, 0.5 * own + 0.2], rtol=1e-12)
    with pytest.raises(ZoneError, match=r"forest.gpkg and .*rock.gpkg overlap by 100 m2"):
        together(
            [forest, FrictionZones.from_vector(write_polygons([shapely.box(35, 10, 60, 30)], "rock.gpkg"), terrain, factor=2.0)]
        )


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({}, "give factor, which multiplies friction, or basal_friction_angle_deg, which replaces it"),
        ({"factor": 1.0, "basal_friction_angle_deg": 20.0}, "give factor"),
        ({"factor": -0.5}, "factor is -0.5; it must be at least 0 and at most 10"),
        ({"basal_friction_angle_deg": 80.0}, "basal_friction_angle_deg is 80 deg; it must be at least 0 and at most 60 deg"),
        ({"basal_friction_angle_deg": 0.5}, "angles are in degrees here; write 28.6 if it is 0.5 radians"),
        ({"factor": "fricton"}, "no attribute 'fricton' for the factor; did you mean 'friction'"),
        ({"factor": 1.2, "layer": "wood"}, "no layer 'wood'"),
    ],
)
def test_values_that_cannot_be_are_refused_with_the_place(terrain, write_polygons, given, says):
    with pytest.raises(ZoneError, match=says):
        FrictionZones.from_vector(write_polygons([SLOPE], friction=[1.2]), terrain, **given)


def test_polygons_of_different_friction_must_not_overlap_and_lines_are_no_zones(terrain, write_polygons):
    over = [SLOPE, shapely.box(30.0, 10.0, 50.0, 30.0)]
    with pytest.raises(ZoneError, match=r"polygons 1 \(1.5\) and 2 \(2\) overlap by 200 m2.* one friction"):
        FrictionZones.from_vector(write_polygons(over, friction=[1.5, 2.0]), terrain, factor="friction")
    same = FrictionZones.from_vector(write_polygons(over), terrain, factor=1.5)
    assert same.factor.max() == pytest.approx(1.5)
    assert "count once" in same.changes[0]
    with pytest.raises(ZoneError, match="draw polygons around the friction zone"):
        FrictionZones.from_vector(write_polygons([shapely.LineString([(0, 0), (20, 20)])]), terrain, factor=1.5)


def test_zones_below_one_lessen_friction_in_one_file_and_beside_those_of_another(terrain, write_polygons):
    ice = FrictionZones.from_vector(write_polygons([SLOPE], "ice.gpkg"), terrain, factor=0.5)
    np.testing.assert_allclose(ice.factor[2:4, 4], (0.7, 0.5), rtol=1e-12)
    assert ice.least_angle(np.arctan(0.4)) == pytest.approx(np.arctan(0.2))
    rough = FrictionZones.from_vector(write_polygons([shapely.box(40.0, 10.0, 60.0, 30.0)], "rough.gpkg"), terrain, factor=1.5)
    both = together([ice, rough])
    found = both.at(np.full(3, 0.4), np.array([38.0, 42.0, 70.0]), np.full(3, 20.0))
    np.testing.assert_allclose(found, (0.2, 0.6, 0.4), rtol=1e-12)
    assert both.factor.min() == 0.5
    assert both.source == f"{ice.source}, {rough.source}"
    assert [zone["factor"] for zone in both.zones] == [0.5, 1.5]


def test_positions_beyond_the_rim_have_the_friction_of_the_rim(terrain, write_polygons):
    rim = FrictionZones.from_vector(write_polygons([shapely.box(0.0, 0.0, 5.0, 5.0)]), terrain, factor=0.5)
    far = rim.at(np.full(4, 0.4), np.array([-9.0, 4.9, 5.1, 900.0]), np.array([-9.0, 4.9, 4.9, 900.0]))
    np.testing.assert_allclose(far, (0.2, 0.2, 0.4, 0.4), rtol=1e-12)


def test_slivers_between_zones_and_files_are_no_overlap(terrain, write_polygons):
    beside = shapely.box(40.0 - 5e-4, 10.0, 60.0, 30.0)
    zones = FrictionZones.from_vector(write_polygons([SLOPE, beside], own=[0.5, 1.5]), terrain, factor="own")
    assert any("overlaps of polygons below 0.001 cells" in change for change in zones.changes)
    one = FrictionZones.from_vector(write_polygons([SLOPE], "one.gpkg"), terrain, factor=0.5)
    other = FrictionZones.from_vector(write_polygons([beside], "other.gpkg"), terrain, factor=1.5)
    np.testing.assert_allclose(together([one, other]).factor, zones.factor, atol=2e-4)


def test_an_attribute_of_zero_friction_is_asked_about_and_a_stated_zero_is_not(terrain, write_polygons):
    path = write_polygons([SLOPE, shapely.box(50.0, 10.0, 60.0, 30.0)], own=[0.0, 1.5])
    (asked,) = FrictionZones.from_vector(path, terrain, factor="own").warnings
    assert "attribute 'own' is 0 in 1 of 2 polygons (1), which are ground without friction" in asked
    assert FrictionZones.from_vector(path, terrain, factor=0.0).warnings == ()
    (asked,) = FrictionZones.from_vector(path, terrain, basal_friction={"mu": "own"}, law="voellmy").warnings
    assert "attribute 'own'" in asked
    assert FrictionZones.from_vector(path, terrain, basal_friction={"cohesion": "own"}, law="voellmy").warnings == ()
