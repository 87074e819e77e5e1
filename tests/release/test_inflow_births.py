"""Hydrographs, and the births of inflows: exact volumes, even places, and what cannot be used."""

import math

import geopandas
import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from runout import Hydrograph, Inflow, Terrain
from runout.errors import ConfigError
from runout.model.inflow import Cumulative
from runout.release import inlet
from runout.release.inlet import read_inflow

X = (np.arange(40) + 0.5) * 2.0
TERRAIN = Terrain.from_array(np.tile(100.0 - 0.5 * X, (30, 1)), 2.0, origin=(1000.0, 2000.0))  # falls to the east
ACROSS = [(1020.0, 2040.0), (1020.0, 2020.0)]
GRID, PER_AXIS = (1.0, 1.0, 1.0), (2, 2, 4)
numbers = st.floats(0.0, 50.0)


def inflow(hydrograph=None, line=ACROSS, **choices):
    if "polygon" in choices:
        line = None
    elif hydrograph is None or hydrograph.velocity is None:
        choices = {"thickness": 1.0, **choices}
    return Inflow(TERRAIN, hydrograph or Hydrograph([0.0, 10.0], [30.0, 30.0]), line=line, **choices)


def births(one):
    how = inlet.Spacing.of(one, GRID, PER_AXIS)
    return inlet.births_over_polygon(one, how) if one.line is None else inlet.births_at_line(one, how, inlet.slope_at(one))


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(st.floats(0.01, 5.0), numbers), min_size=2, max_size=8), st.floats(0.0, 1.0))
def test_the_time_of_a_volume_is_the_inverse_of_the_volume_at_a_time(rows, share):
    steps, rate = np.array(rows).T
    series = Cumulative(np.cumsum(steps), rate)
    amount = share * series.sums[-1]
    assert series.at(series.when(amount)) == pytest.approx(amount, rel=1e-9, abs=1e-9 * max(1.0, series.sums[-1]))
    assert series.at(series.time[-1] + 1.0) == pytest.approx(series.sums[-1], rel=1e-12)
    assert series.at(series.time[0] - 1.0) == 0.0


def test_a_hydrograph_is_linear_between_its_rows():
    h = Hydrograph([1.0, 3.0, 7.0, 9.0], [0.0, 10.0, 0.0, 0.0])
    assert (h.volume, h.peak, h.begin, h.end, h.duration) == (30.0, 10.0, 1.0, 7.0, 6.0)
    np.testing.assert_allclose(h.entered.at([0.0, 2.0, 3.0, 5.0, 20.0]), [0.0, 2.5, 10.0, 25.0, 30.0])
    later = h.changed(2.0, 5.0)
    assert (later.volume, later.begin, later.end) == (60.0, 6.0, 12.0)
    begun = Hydrograph([0.0, 0.0 + 2.0, 4.0], [3.0, 3.0, 0.0])
    assert (begun.begin, begun.end) == (0.0, 4.0)


@pytest.mark.parametrize(
    ("series", "said"),
    [
        (([0, 1], [1, 2, 3]), r"the columns have shapes time \(2,\), discharge \(3,\)"),
        (([0], [1]), "1 row of numbers; give two times at least"),
        (([0, 0], [1, 1]), "row 2: time is 0 s after 0 s; times must ascend"),
        (([0, 1], [1, -1]), "row 2: discharge is -1 m3/s; it must be at least 0"),
        (([0, np.nan], [1, 1]), "row 2: time is nan; it must be a finite number"),
        (([0, 1], [1, 2e7]), "row 2: discharge is 2e"),
        (([0, 1], [1, 1], [0, 1]), "row 1: velocity is 0 m/s; it must be above 0 where there is a discharge"),
        (([0, 1], [0, 0]), "discharge is 0 at all times"),
        ((["a", 1], [0, 0]), "hydrograph: time is"),
    ],
)
def test_a_series_that_cannot_be_used_is_refused(series, said):
    with pytest.raises(ConfigError, match=said):
        Hydrograph(*series)


@pytest.mark.parametrize(
    "hydrograph",
    [
        Hydrograph([0.0, 10.0], [30.0, 30.0]),
        Hydrograph([0.0, 3.0, 8.0, 20.0], [0.0, 90.0, 20.0, 0.0]),
        Hydrograph([0.0, 3.0, 8.0, 20.0], [0.0, 90.0, 20.0, 0.0], [0.0, 5.0, 2.0, 0.0]),
        Hydrograph([0.0, 4.0, 5.0, 30.0], [60.0, 60.0, 0.3, 0.3], [3.0, 3.0, 2.0, 2.0]),  # as thin as a part of a particle
        Hydrograph([0.0, 1.0], [1e-3, 1e-3]),  # less than one particle in all
        Hydrograph([-5.0, 10.0], [30.0, 30.0]),
    ],
)
def test_births_have_the_volume_of_the_hydrograph(hydrograph):
    """To rounding, whatever the discharge; the part before the start of the run is left out, and a sentence says so."""
    one = inflow(hydrograph)
    found = births(one)
    early = float(hydrograph.entered.at(0.0))
    assert found.total == pytest.approx(hydrograph.volume - early, rel=1e-12)
    assert (np.diff(found.time) >= 0.0).all()
    assert found.time[-1] <= hydrograph.end
    left_out = [sentence for sentence in one.sentences(100.0, (0.1, 0.1, 0.1)) if "before the start of the run" in sentence]
    assert len(left_out) == (early > 0.0)
    # what entered up to any birth is the hydrograph, less than a plane of particles late
    late = hydrograph.entered.at(found.time) - early - np.cumsum(found.count * found.volume)
    plane = max(float((found.count * found.volume).max()), 20.0 / 0.5 * 0.125 * 2)
    assert np.abs(late).max() <= plane * (1.0 + 1e-9)


def test_planes_follow_each_other_at_the_distance_of_particles():
    """Speed and thickness of a plane are those of the discharge; between two births the flow goes half a cell."""
    steady = births(inflow())
    speed = 30.0 / 20.0
    np.testing.assert_allclose(steady.speed, speed, rtol=1e-9)
    np.testing.assert_allclose(np.diff(steady.time), 0.5 / speed, rtol=1e-9)
    np.testing.assert_allclose(steady.thickness, 1.0, rtol=1e-9)
    assert (steady.count == 40 * 4).all()
    np.testing.assert_allclose(steady.volume, 0.5 * 0.5 * 0.25, rtol=1e-9)
    stated = births(inflow(Hydrograph([0.0, 10.0], [30.0, 30.0], [3.0, 3.0])))
    along = 3.0 / math.sqrt(1.25)  # of a speed along ground that falls by 0.5
    np.testing.assert_allclose(stated.speed, along, rtol=1e-9)
    np.testing.assert_allclose(stated.thickness, 30.0 / (20.0 * along), rtol=1e-9)


def test_a_thin_flow_gives_whole_particles_spread_evenly():
    """They are as large as those of a thick flow, and no gap on the line is much wider than others."""
    thin = Hydrograph([0.0, 60.0], [0.4, 0.4], [2.0, 2.0])  # 1 cm thick
    found = births(inflow(thin))
    np.testing.assert_allclose(found.volume[:-1], 0.5 * 0.5 * 0.25, rtol=1e-9)
    assert (found.thickness == 0.0).all()
    share = np.sort(inlet.shares_along(0, int(found.count.sum())))
    gaps = np.diff(np.concatenate([share, [share[0] + 1.0]]))
    assert gaps.max() < 3.0 * gaps.mean()


def test_mass_leaves_downslope_however_the_line_is_drawn():
    for line in (ACROSS, ACROSS[::-1]):
        np.testing.assert_allclose(inflow(line=line).direction, [1.0, 0.0], atol=1e-12)
    bent = inflow(line=[(1020.0, 2020.0), (1023.0, 2030.0), (1020.0, 2040.0)])
    assert bent.width == 20.0
    places = bent.places(4)
    np.testing.assert_allclose(places[:, 1], [2037.5, 2032.5, 2027.5, 2022.5])
    np.testing.assert_allclose(places[:, 0], [1020.75, 1022.25, 1022.25, 1020.75])
    flat = Terrain.from_array(np.zeros((30, 40)), 2.0)
    level = Inflow(flat, Hydrograph([0, 1], [1, 1]), line=[(20, 40), (20, 20)], thickness=1.0)
    np.testing.assert_allclose(level.direction, [1.0, 0.0], atol=1e-12)  # on the left of the line as it is drawn


def test_places_in_a_polygon_are_spread_evenly():
    polygon = shapely.Polygon([(0, 0), (10, 0), (10, 10), (5, 4), (0, 10)])
    places = inlet.places_in(polygon, 400)
    assert shapely.contains_xy(polygon, *places.T).all()
    west = places[:, 0] < 5.0
    assert west.mean() == pytest.approx(0.5, abs=0.02)
    assert (places[:, 1] < 4.0).mean() == pytest.approx(40.0 / polygon.area, abs=0.03)


def test_births_over_a_polygon_raise_it_little_by_little():
    polygon = shapely.box(1010.0, 2010.0, 1020.0, 2020.0)
    found = births(inflow(polygon=polygon))
    assert found.total == pytest.approx(300.0, rel=1e-12)
    assert float((found.count * found.volume).max()) <= 0.26 * 0.25 * 100.0
    np.testing.assert_allclose(np.diff(found.time), found.time[0], rtol=1e-6)


def test_the_last_particle_of_a_polygon_is_born_at_the_end_of_the_hydrograph():
    found = births(inflow(Hydrograph([1.0, 4.0, 9.0], [0.0, 30.0, 0.0]), polygon=shapely.box(1010.0, 2010.0, 1020.0, 2020.0)))
    assert found.time[-1] == pytest.approx(9.0, rel=1e-9)
    assert (np.diff(found.time) > 0.0).all()


def test_an_inflow_of_a_file_is_named_after_it_unless_it_has_a_name(tmp_path):
    frame = geopandas.GeoDataFrame(geometry=[shapely.LineString(ACROSS)], crs=None)
    frame.to_file(tmp_path / "torrent.geojson")
    series = Hydrograph([0.0, 10.0], [30.0, 30.0])
    names = [read_inflow(tmp_path / "torrent.geojson", TERRAIN, series, thickness=1.0, name=name).name for name in (None, "gauge")]
    assert names == ["torrent", "gauge"]


@pytest.mark.parametrize(
    ("choices", "said"),
    [
        ({"line": None}, "neither line nor polygon is given; give one of them"),
        ({"polygon": shapely.box(1010, 2010, 1020, 2020), "thickness": 1.0}, "thickness has no meaning with a polygon"),
        ({"thickness": None}, "neither thickness nor velocity is given; add thickness"),
        ({"thickness": -1.0}, "thickness is -1 m; it must be at least 1e-05"),
        ({"line": [(1020, 2020)]}, "the line has 1 different vertex"),
        ({"line": [(1020, 2020, 3), (1020, 2040, 3)]}, r"line has shape \(2, 3\)"),
        ({"line": [(1020, 2020), (1020, 2030), (1021, 2025), (1020, 2040)]}, "the line turns back between its ends"),
        ({"material": 3}, "inflow inflow: material is 3"),
        ({"basal_friction_angle": 25.0}, "basal_friction_angle is 25 rad"),
    ],
)
def test_an_inflow_that_cannot_be_used_is_refused(choices, said):
    with pytest.raises(ConfigError, match=said):
        inflow(**choices)


def test_line_and_polygon_or_thickness_and_velocity_are_not_both_given():
    with pytest.raises(ConfigError, match="line and polygon are both given"):
        Inflow(TERRAIN, Hydrograph([0, 1], [1, 1]), line=ACROSS, polygon=shapely.box(1010, 2010, 1020, 2020))
    with pytest.raises(ConfigError, match="thickness and the velocities of the hydrograph are both given"):
        Inflow(TERRAIN, Hydrograph([0, 1], [1, 1], [2, 2]), line=ACROSS, thickness=1.0)
    with pytest.raises(ConfigError, match=r"hydrograph is 3; give runout\.Hydrograph"):
        Inflow(TERRAIN, 3, line=ACROSS, thickness=1.0)


def test_a_line_lies_on_known_ground_and_is_a_cell_wide():
    with pytest.raises(ConfigError, match="does not lie inside the terrain"):
        inlet.mass_at(inflow(line=[(1020.0, 2050.0), (1020.0, 2070.0)]))
    with pytest.raises(
        ConfigError, match=r"is 0\.5 m wide, less than a cell of 1 m; draw it wider, or use cell_size: 0\.5 or less"
    ):
        inlet.require_wide(inflow(line=[(1020.0, 2020.0), (1020.0, 2020.5)]), GRID)
    holed = TERRAIN.elevation.copy()
    holed[15, 10] = np.nan
    terrain = Terrain.from_array(holed, 2.0, origin=(1000.0, 2000.0))
    with pytest.raises(ConfigError, match=r"1 cells of the terrain at it have no elevation, the first at row 15, column 10"):
        inlet.mass_at(Inflow(terrain, Hydrograph([0, 1], [1, 1]), line=ACROSS, thickness=1.0))


def test_forecasts_see_the_flow_at_its_peak():
    mass = inlet.mass_at(inflow(Hydrograph([0.0, 5.0, 9.0], [0.0, 60.0, 0.0], [4.0, 4.0, 4.0])))
    thickness = 60.0 / 20.0 / 4.0 * math.sqrt(1.25)
    assert float(mass.thickness.max()) == pytest.approx(thickness, rel=1e-9)
    assert mass.start_speed == pytest.approx(4.0, rel=1e-9)
    assert mass.area == pytest.approx(20.0 * 2 * 2.0)
    assert not mass.excavation.any()


def test_a_hydrograph_beyond_the_end_is_said():
    said = inflow().sentences(4.0, GRID)
    assert len(said) == 1
    assert "goes on until 10 s, the run ends at 4 s: 180 m3 of 300 m3 do not enter" in said[0]
    assert "is 0.5 cells thick at the line" in inflow().sentences(20.0, (2.0, 2.0, 2.0))[0]
    place = "line of 20 m (20 cells), 1 m thick at most (1 cells)"
    assert inflow().statement(GRID) == f"300 m3 from 0 to 10 s, at most 30 m3/s; {place}"
