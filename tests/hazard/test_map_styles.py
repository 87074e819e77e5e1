from xml.etree import ElementTree

import pytest

from runout.hazard.style import class_edges, qml


def items(name: str, edges: list[float], unit: str = "m") -> list[dict[str, str]]:
    """Attributes of the classes of a style."""
    return [item.attrib for item in ElementTree.fromstring(qml(edges, unit, name).split("\n", 1)[1]).iter("item")]


def test_classes_lie_at_the_thresholds_and_nothing_is_transparent() -> None:
    classes = items("peak_flow_thickness", class_edges("peak_flow_thickness", [2.0, 0.5], 9.0))
    assert [c["value"] for c in classes] == ["0", "0.5", "2", "inf"]
    assert [c["label"] for c in classes] == ["up to 0 m", "0 to 0.5 m", "0.5 to 2 m", "above 2 m"]
    assert [c["alpha"] for c in classes] == ["0", "255", "255", "255"]
    assert len({c["color"] for c in classes}) == 4


def test_an_arrival_at_once_is_shown() -> None:
    classes = items("first_arrival_time", class_edges("first_arrival_time", [], 60.0), "s")
    assert classes[0]["label"] == "0 to 10 s"
    assert all(c["alpha"] == "255" for c in classes)


def test_counts_of_members_have_whole_classes() -> None:
    assert class_edges("members_reached", [], 3.0) == [0.0, 1.0, 2.0]
    assert all(float(edge).is_integer() for edge in class_edges("members_reached", [], 1000.0))


def test_probabilities_share_the_levels_of_the_outlines() -> None:
    classes = items("inundation_probability", class_edges("inundation_probability", [0.1], 1.0), "1")
    assert [c["value"] for c in classes] == ["0", "0.05", "0.25", "0.5", "0.75", "0.95", "inf"]
    assert classes[-1]["label"] == "above 0.95"


@pytest.mark.parametrize("largest", [1e-3, 1.0, 123.4, 9e5])
def test_edges_ascend_from_zero_whatever_the_largest_value(largest: float) -> None:
    edges = class_edges("first_arrival_time", [], largest)
    assert edges[0] == 0.0
    assert edges == sorted(set(edges))
    assert edges[-1] < largest
