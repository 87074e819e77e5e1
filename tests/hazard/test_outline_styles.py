"""Styles of the outlines and the colours of classes as QGIS reads them."""

from xml.etree import ElementTree

import numpy as np
import pytest

from runout.hazard.outline_style import arrival_style, outline_styles, screen_styles, slope_styles
from runout.hazard.style import MapClasses, below, class_edges
from runout.hazard.writers.qgis_project import OUTLINES
from runout.palettes import PROBABILITY_LEVELS, Palette, palette_of

INFLOWS = ("inflow_lines", "inflow_areas")


def test_each_layer_with_a_style_has_its_place_in_the_project_of_qgis():
    assert set(OUTLINES) == {*outline_styles(), *arrival_style([0.0, 1.0]), "danger_level", "intensity_class"}


def read(text):
    return ElementTree.fromstring(text.split("\n", 1)[1])


def options(element):
    return {o.get("name"): o.get("value") for o in element.iter("Option") if o.get("name")}


def rgb(colour):
    return ",".join(str(int(colour[k : k + 2], 16)) for k in (1, 3, 5)) + ",255"


def test_lines_of_probability_are_wider_and_darker_the_higher_they_are():
    style = read(outline_styles()["inundation"])
    categories, symbols = list(style.iter("category")), list(style.iter("symbol"))
    assert [float(c.get("value")) for c in categories] == sorted(PROBABILITY_LEVELS)
    assert [c.get("label") for c in categories] == [
        f"probability {100 * level:g} % or more" for level in sorted(PROBABILITY_LEVELS)
    ]
    assert [c.get("symbol") for c in categories] == [s.get("name") for s in symbols]
    widths = [float(options(s)["outline_width"]) for s in symbols]
    assert widths == pytest.approx([0.4 + 0.1 * k for k in range(len(widths))])
    assert [options(s)["outline_color"] for s in symbols] == [
        rgb(c) for c in palette_of("probability").hexadecimal(len(symbols) + 1)[1:]
    ]


def test_each_layer_has_a_colour_of_its_own_and_labels():
    styles = {name: read(text) for name, text in outline_styles().items()}
    areas = ("release", "obstacles", "friction_zones", "observed_outline", "return_periods")
    assert set(styles) == {*areas, "inundation", "structures", "facades", "gauges", "thalweg", "probes", "cross_sections", *INFLOWS}
    first = {name: options(styles[name])["outline_color"] for name in areas}
    assert first == {
        "release": "215,38,61,255",
        "obstacles": "107,63,22,255",
        "friction_zones": "34,40,47,255",
        "observed_outline": "11,79,174,255",
        "return_periods": "140,26,75,255",
    }
    for name, colour in first.items():
        text = next(styles[name].iter("text-style"))
        assert text.get("textColor") == colour
        assert next(styles[name].iter("settings")).find("placement") is not None
        assert next(text.iter("text-buffer")).get("bufferDraw") == "1"
        assert next(styles[name].iter("rendering")).get("drawLabels") == "1"
    assert next(styles["release"].iter("text-style")).get("fieldName") == '"name"'


def test_the_release_shows_on_red_for_it_has_a_white_line_below():
    below, above = read(outline_styles()["release"]).iter("layer")
    assert (options(below)["outline_color"], options(above)["outline_color"]) == ("255,255,255,255", "215,38,61,255")
    assert float(options(below)["outline_width"]) > float(options(above)["outline_width"])


def test_points_lines_and_areas_have_symbols_of_their_kind():
    styles = outline_styles() | slope_styles()
    kinds = {name: "".join({s.get("type") for s in read(text).iter("symbol")}) for name, text in styles.items()}
    outlined = ("inundation", "obstacles", "friction_zones", "observed_outline", "return_periods", "structures", "sinks")
    areas = ("release", *outlined, "inflow_areas")
    assert kinds == {
        **dict.fromkeys(areas, "fill"),
        **dict.fromkeys(("facades", "thalweg", "cross_sections", "flow_paths", "inflow_lines"), "line"),
        **dict.fromkeys(("probes", "gauges"), "marker"),
    }
    assert next(read(slope_styles()["release"]).iter("text-style")).get("fieldName").startswith('"rank"')


def test_places_of_the_baseline_have_a_marker_for_each_kind_and_their_names():
    styles = {name: read(text) for name, text in screen_styles().items()}
    assert set(styles) == {"extent", "flow_path", "places"}
    places = styles["places"]
    shown = {c.get("value"): c.get("symbol") for c in places.iter("category")}
    assert {c.get("type") for c in places.iter("category")} == {"string"}
    assert set(shown) == {"steep step", "leaves a channel", "structure", "obstacle"}
    forms = {s.get("name"): (options(s)["name"], options(s)["color"]) for s in places.iter("symbol")}
    assert len({forms[symbol] for symbol in shown.values()}) == 4
    assert next(places.iter("text-style")).get("fieldName") == 'coalesce(nullif("name", \'\'), "kind")'


def test_labels_are_bold_and_only_where_there_are_some():
    for name, text in (outline_styles() | slope_styles() | screen_styles()).items():
        style = read(text)
        assert style.get("labelsEnabled") == str(int(style.find("labeling") is not None)), name
        assert {label.get("fontWeight") for label in style.iter("text-style")} <= {"75"}


def test_classes_of_pressure_on_facades_join_without_gaps_and_get_wider():
    style = read(outline_styles()["facades"])
    assert next(style.iter("renderer-v2")).get("attr") == "max_pressure_pa"
    ranges, symbols = list(style.iter("range")), list(style.iter("symbol"))
    assert [r.get("symbol") for r in ranges] == [s.get("name") for s in symbols]
    assert [float(r.get("upper")) for r in ranges[:-1]] == [float(r.get("lower")) for r in ranges[1:]]
    assert (float(ranges[0].get("lower")), float(ranges[-1].get("upper"))) == (0.0, 1e12)
    assert ranges[-1].get("label") == "more than 100 kPa: only strong concrete stands"
    widths = [float(options(s)["line_width"]) for s in symbols]
    assert widths == sorted(set(widths))


@pytest.mark.parametrize(("largest", "edges"), [(0.0, [1.0]), (1.0, [1.0]), (3.0, [1.0, 2.0, 3.0]), (8.0, list(range(1, 9)))])
def test_few_members_have_a_class_each_and_many_share_round_ones(largest, edges):
    assert class_edges("members_reached", [], 0.0, largest) == edges
    many = class_edges("members_reached", [], 0.0, 40.0)
    assert many[:2] == [1.0, 5.0]
    assert len(many) < 10


def test_an_edge_in_single_precision_belongs_to_the_class_above():
    for edge in (0.1, 0.5, 2.0, 30.0):
        assert float(np.nextafter(np.float32(edge), np.float32(0))) < below(edge) < float(np.float32(edge))


@pytest.mark.parametrize(
    ("name", "ramp", "kind"),
    [
        ("inundation_probability", "YlOrRd", "DISCRETE"),
        ("speed_exceedance_standard_error", "Purples", "DISCRETE"),
        ("first_arrival_time", "YlGnBu_r", "DISCRETE"),
        ("peak_speed", "plasma_r", "DISCRETE"),
        ("release_thickness", "viridis_r", "DISCRETE"),
        ("elevation", "cividis", "INTERPOLATED"),
    ],
)
def test_each_kind_of_map_has_its_colours_and_range(name, ramp, kind):
    style = read(MapClasses.of([0.0, 1.0, 5.0], "m", name).qml())
    shader, renderer = next(style.iter("colorrampshader")), next(style.iter("rasterrenderer"))
    assert shader.get("colorRampType") == kind
    shown = [item.get("color") for item in shader.iter("item") if item.get("alpha") == "255"]
    assert shown == Palette(ramp).hexadecimal(3)
    assert (renderer.get("classificationMin"), renderer.get("classificationMax"), shader.get("minimumValue")) == ("0", "5", "0")
