"""Speed of a flow with drag: the law's own resistance by column, terminal speed on planes, and the energy line without drag."""

import math

import numpy as np
import pytest

from runout import Coulomb, DruckerPrager, FrictionZones, Release, Terrain, VelocityWeakening, Voellmy
from runout.forecast.stiffness import stiffness
from runout.model.column_resistance import ColumnResistance, Columns, ground_below
from runout.terrain import energy_line
from runout.terrain.energy_line import largest_speed

G, CELL, SLOPE, COLUMNS, DENSITY = 9.81, 10.0, 0.6, 200, 300.0
SNOW = DruckerPrager(density=DENSITY, friction_angle=45.0)


def slab(thickness=2.0, columns=slice(5, 11), **choices):
    """A slab high on a plane that falls to the east."""
    z = np.broadcast_to(SLOPE * CELL * (COLUMNS - np.arange(float(COLUMNS))), (21, COLUMNS)).copy()
    values = np.zeros(z.shape)
    values[8:13, columns] = thickness
    return Release(values, Terrain(z, (CELL, CELL)), placement="on_surface", **choices)


def speed(friction, *releases, zones=None):
    """Speed [m/s] by which a run chooses its stiffness."""
    count = len(releases)
    return stiffness([SNOW] * count, releases, [friction] * count, [math.inf] * count, zones).flow_speed


def line(mu, release):
    return largest_speed([release], [math.atan(mu)])


def columns_of(speeds, cosine=1.0, thinness=1.0):
    n = len(speeds)
    one, none = np.ones(n), np.zeros(n, int)
    return Columns(none, none, one, one, cosine * one, np.array(speeds, float), thinness * one)


@pytest.mark.parametrize("cosine", [1.0, 0.8])
@pytest.mark.parametrize("thinness", [1.0, 0.3])
def test_a_column_is_held_back_by_the_stress_of_the_law_over_its_mass(cosine, thinness):
    """Voellmy: tau = mu sigma + tau_0 + rho u^2 (g / xi + c), over rho H cos of a column of vertical thickness H."""
    law = Voellmy(mu=0.25, xi=1200.0, minimum_shear_stress=70.0, forest_drag=0.01)
    ground = ground_below([SNOW], [law], [math.inf], None)
    steady, drag = ColumnResistance([ground], [3.0], 50.0)(columns_of([0.0, 7.0, 49.0, 80.0], cosine, thinness))
    mass = DENSITY * 3.0 * thinness * cosine
    np.testing.assert_allclose(steady, 0.25 * G * cosine + 70.0 / mass)
    np.testing.assert_allclose(drag, DENSITY * (G / 1200.0 + 0.01) / mass)


def test_a_column_meets_the_friction_of_its_speed():
    law = VelocityWeakening(static_friction=0.8, dynamic_friction=0.1, weakening_speed=4.0)
    ground = ground_below([SNOW], [law], [math.inf], None)
    speeds = np.linspace(0.0, 60.0, 25)
    steady, drag = ColumnResistance([ground], [3.0], 60.0)(columns_of(speeds))
    np.testing.assert_allclose(steady / G, 0.1 + 0.7 / (1.0 + speeds / 4.0), atol=0.02)
    assert not drag.any()


@pytest.mark.parametrize(("xi", "thickness"), [(500.0, 2.0), (1500.0, 2.0), (1500.0, 1.0)])
def test_a_flow_on_a_plane_may_reach_the_terminal_speed_of_a_column_as_thick_as_flows_gather(xi, thickness):
    """v^2 = xi H (sin - mu cos), H normal to the slope (Voellmy 1955)."""
    release, cosine = slab(thickness), 1.0 / math.hypot(1.0, SLOPE)
    terminal = math.sqrt(xi * thickness * cosine * cosine * (SLOPE - 0.2))
    found = speed(Voellmy(mu=0.2, xi=xi), release)
    assert found == pytest.approx(math.sqrt(energy_line.GATHERED) * terminal, rel=0.01)
    assert found < 0.7 * line(0.2, release)


def test_without_drag_or_with_hardly_any_the_energy_line_counts():
    release = slab()
    for law in (Coulomb(friction_angle=math.degrees(math.atan(0.2))), VelocityWeakening(dynamic_friction=0.2)):
        assert speed(law, release) == line(0.2, release)
    almost = speed(Voellmy(mu=0.2, xi=1e6), release)
    assert 0.97 * line(0.2, release) < almost <= line(0.2, release)
    assert speed(Voellmy(mu=0.61, xi=1000.0), release) == line(0.61, release)  # held: it only collapses


def test_speed_falls_with_drag_and_the_thickest_release_counts():
    slow, fast = speed(Voellmy(mu=0.2, xi=300.0), slab()), speed(Voellmy(mu=0.2, xi=600.0), slab())
    assert fast == pytest.approx(math.sqrt(2.0) * slow, rel=0.01)
    thick = slab(4.0, slice(14, 20))
    law = Voellmy(mu=0.2, xi=300.0)
    assert speed(law, slab(), thick) == pytest.approx(speed(law, thick), rel=0.01)


def test_forest_on_the_way_slows_the_flow_only_where_it_stands():
    clear, law = np.zeros((COLUMNS, 21)), Voellmy(mu=0.2, xi=1500.0)

    def zones(first):
        forest = clear.copy()
        forest[first:] = 0.1
        changed = {"forest_drag": (np.ones(clear.shape), forest)}
        return FrictionZones(np.ones(clear.shape), clear, (CELL, CELL), replaced=changed)

    release = slab()
    assert speed(law, release, zones=zones(0)) < 0.5 * speed(law, release)
    assert speed(law, release, zones=zones(150)) == pytest.approx(speed(law, release), rel=0.01)
