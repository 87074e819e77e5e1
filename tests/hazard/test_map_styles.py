from xml.etree import ElementTree

import numpy as np
import pytest
from shapely import contains_xy

from runout.hazard.style import MapClasses, class_edges
from runout.io.vector import PROBABILITY_LEVELS, outline, reaches
from runout.model.terrain import Terrain


def items(name: str, edges: list[float], unit: str = "m") -> list[dict[str, str]]:
    """Attributes of the classes of a style."""
    return [item.attrib for item in ElementTree.fromstring(MapClasses.of(edges, unit, name).qml().split("\n", 1)[1]).iter("item")]


def classes_of(values: np.ndarray, classes: list[dict[str, str]]) -> np.ndarray:
    """Number of the class that QGIS gives to each value: the first whose bound it does not pass."""
    return np.searchsorted([float(c["value"]) for c in classes], values.astype(np.float64), side="left")


def test_classes_lie_at_the_thresholds_and_nothing_is_transparent() -> None:
    classes = items("peak_flow_thickness", class_edges("peak_flow_thickness", [2.0, 0.5], 0.0, 2.1))
    assert [c["label"] for c in classes] == ["0 m", "above 0 to 0.5 m", "0.5 to 2 m", "2 m or more"]
    assert [c["alpha"] for c in classes] == ["0", "255", "255", "255"]
    assert len({c["color"] for c in classes}) == 4


@pytest.mark.parametrize("last", [0.3, 2.0, 30.0])
@pytest.mark.parametrize("ratio", [1.3, 2.0, 3.9, 4.1, 10.0, 180.0, 1e5])
def test_classes_go_on_above_the_last_threshold(last: float, ratio: float) -> None:
    edges = class_edges("peak_speed", [0.1, last], 0.0, ratio * last)
    assert edges == sorted(set(edges))
    assert ratio * last / 11 < edges[-1] <= ratio * last, "the last class is no wider than a decade, and not empty"
    assert len(edges) <= 12
    if ratio >= 2:
        assert edges[-1] > last


def test_thresholds_that_no_value_reaches_take_no_colour() -> None:
    assert class_edges("peak_speed", [1.0, 5.0, 10.0], 0.0, 5.5) == [0.0, 1.0, 5.0]
    low = class_edges("peak_speed", [1.0, 5.0], 0.0, 0.3)
    assert len(low) >= 4
    assert low[-1] < 0.3


def test_an_arrival_at_once_is_shown() -> None:
    classes = items("first_arrival_time", class_edges("first_arrival_time", [], 0.0, 60.0), "s")
    assert classes[0]["label"] == "0 to 10 s"
    assert all(c["alpha"] == "255" for c in classes)


def test_elevations_are_coloured_from_the_lowest_to_the_highest() -> None:
    edges = class_edges("elevation", [], 1210.0, 1790.0)
    assert 1110 <= edges[0] <= 1210
    assert 1690 <= edges[-1] < 1790
    assert [c["value"] for c in items("elevation", edges)] == [f"{edge:g}" for edge in edges]
    assert all(c["alpha"] == "255" for c in items("elevation", edges))
    assert items("ground_slope", [0.0, 5.0], "degree")[-1]["label"] == "5°"


def test_counts_of_members_have_whole_classes() -> None:
    assert class_edges("members_reached", [], 0.0, 3.0) == [1.0, 2.0, 3.0]
    assert classes_of(np.arange(4), items("members_reached", [1.0, 2.0, 3.0], "1")).tolist() == [0, 1, 2, 3]
    assert all(float(edge).is_integer() for edge in class_edges("members_reached", [], 0.0, 1000.0))


def test_a_cell_exactly_at_a_level_is_inside_the_colour_and_inside_the_outline() -> None:
    levels = np.array([0.0, *PROBABILITY_LEVELS], np.float32)
    values = np.concatenate([np.nextafter(levels, np.float32(-1)), levels, np.nextafter(levels, np.float32(2)), [0.4, 1.0]])
    values = np.clip(values, 0.0, 1.0).astype(np.float32)[None].repeat(3, axis=0)
    terrain = Terrain(np.zeros(values.shape), (1.0, 1.0))
    classes = items("inundation_probability", class_edges("inundation_probability", [0.1], 0.0, 1.0), "1")
    for k, level in enumerate(PROBABILITY_LEVELS):
        coloured = classes_of(values, classes) >= k + 2
        np.testing.assert_array_equal(coloured, values >= np.float32(level))
        np.testing.assert_array_equal(coloured, reaches(values, level))
        inside = contains_xy(outline(reaches(values, level), terrain), *np.meshgrid(terrain.easting, terrain.northing))
        np.testing.assert_array_equal(coloured, inside)


@pytest.mark.parametrize("share", [0.05, 0.25, 0.5, 0.75, 0.95])
def test_a_probability_that_is_a_sum_of_weights_reaches_its_level(share: float) -> None:
    weights = np.full(200, 1 / 200)
    assert reaches(np.array([weights[: round(200 * share)].sum()]), share)
    assert not reaches(np.array([weights[: round(200 * share) - 1].sum()]), share)


@pytest.mark.parametrize("largest", [1e-3, 1.0, 123.4, 9e5])
def test_edges_ascend_from_zero_whatever_the_largest_value(largest: float) -> None:
    for name in ("first_arrival_time", "speed_exceedance_standard_error", "mean_deposit_thickness"):
        edges = class_edges(name, [], 0.0, largest)
        assert edges[0] == 0.0
        assert edges == sorted(set(edges))
        assert largest / 2 <= edges[-1] < largest
