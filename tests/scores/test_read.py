"""Lines and points of vector files: what is read, and what is refused."""

import geopandas
import numpy as np
import pytest
import shapely

from runout import Terrain
from runout.errors import ObservationError
from runout.scores.read import read_gauges, read_thalweg

CORNER = 5e5, 5.2e6


@pytest.fixture
def slope():
    """A slope that falls from 159 to 0 m to the east."""
    elevation = np.broadcast_to(np.arange(159.0, -1.0, -1.0), (60, 160))
    return Terrain.from_array(elevation, 1.0, crs="EPSG:32632", origin=CORNER)


@pytest.fixture
def line_file(tmp_path, slope):
    """Function that writes lines to a file and reads them as a thalweg."""

    def read(*lines):
        geometry = [shapely.LineString(np.add(line, CORNER)) for line in lines]
        geopandas.GeoDataFrame(geometry=geometry, crs="EPSG:32632").to_file(tmp_path / "line.gpkg")
        found, changes = read_thalweg(tmp_path / "line.gpkg", slope)
        return np.subtract(found.points, CORNER), changes

    return read


@pytest.fixture
def gauge_file(tmp_path, slope):
    """Function that writes points with attributes to a file and reads them as gauges with a speed."""

    def read(**attributes):
        geometry = [shapely.Point(CORNER[0] + x, CORNER[1] + 30.0) for x in (20.0, 90.0)]
        geopandas.GeoDataFrame(attributes, geometry=geometry, crs="EPSG:32632").to_file(tmp_path / "gauges.gpkg")
        return read_gauges(tmp_path / "gauges.gpkg", slope, {"speed": "v"})[0]

    return read


def test_a_thalweg_of_a_file_runs_downhill_and_its_parts_are_joined(line_file):
    points, changes = line_file([(10.5, 30), (60, 30)], [(60, 30), (120.5, 20)])
    np.testing.assert_allclose(points, [(10.5, 30), (60, 30), (120.5, 20)])
    assert not changes
    points, changes = line_file([(120.5, 20), (60, 30), (10.5, 30)])
    np.testing.assert_allclose(points, [(10.5, 30), (60, 30), (120.5, 20)])
    assert "runs uphill, from 39 to 149 m" in changes[0]


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([[(10, 30), (60, 30)], [(80, 30), (120, 20)]], r"holds 2 features \(LineString\); a thalweg is one line"),
        ([[(10, 30), (60, 30)], [(60, 30), (90, 20)], [(60, 30), (90, 40)]], "holds 3 features"),
        ([[(10, 300), (60, 300)]], "does not meet"),
    ],
)
def test_a_thalweg_of_a_file_is_one_line_on_the_terrain(line_file, lines, said):
    with pytest.raises(ObservationError, match=said):
        line_file(*lines)


def test_gauges_of_a_file_have_their_places_and_values_and_empty_ones_are_unknown(gauge_file):
    gauges = gauge_file(v=[12.5, None])
    np.testing.assert_allclose(gauges.easting - CORNER[0], [20.0, 90.0])
    np.testing.assert_array_equal(gauges.values["speed"], [12.5, np.nan])


def test_gauges_on_the_edges_of_the_terrain_lie_on_it_and_those_beyond_are_counted(tmp_path, slope):
    west, south, east, north = slope.extent
    edges = [(west, south + 5), (east, south + 5), (west + 5, south), (west + 5, north)]
    beyond = [(west - 0.1, south + 5), (east + 0.1, south + 5), (west + 5, south - 0.1), (west + 5, north + 0.1)]
    for name, places in (("edges", edges), ("all", edges + beyond)):
        frame = geopandas.GeoDataFrame({"v": np.ones(len(places))}, geometry=list(map(shapely.Point, places)), crs="EPSG:32632")
        frame.to_file(tmp_path / f"{name}.gpkg")
    assert read_gauges(tmp_path / "edges.gpkg", slope, {"speed": "v"})[1] == ()
    (change,) = read_gauges(tmp_path / "all.gpkg", slope, {"speed": "v"})[1]
    assert "4 of 8 gauges lie outside" in change


@pytest.mark.parametrize(("attributes", "said"), [({"v": [1.0, -2.0]}, "must be 0 or more"), ({"w": [1.0, 2.0]}, "'v'.*w")])
def test_gauges_without_a_speed_or_with_a_negative_one_are_refused(gauge_file, attributes, said):
    with pytest.raises(ObservationError, match=said):
        gauge_file(**attributes)
