"""Palettes: one for each quantity wherever it is drawn, readable without red and green."""

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgba_array

from runout.hazard.outline_style import outline_styles
from runout.hazard.style import MapClasses, class_edges
from runout.palettes import PALETTES, Palette, palette_of
from runout.quantities import ALL_QUANTITIES
from runout.report.values import STYLES, colour_scale

DEUTERANOPIA = [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]  # Machado 2009
PROTANOPIA = [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
MAPS = {
    "time": "first_arrival_time",
    "probability": "inundation_probability",
    "annual_rate": "thickness_annual_exceedance",
    "share": "mean_bed_share",
    "distance": "boundary_distance_deviation",
    "difference": "flow_thickness_difference",
    **{name: quantity.peak for name, quantity in ALL_QUANTITIES.items()},
}


def linear(rgb):
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(rgb, sight=None):
    """CIE L*a*b* of sRGB colours (n, 3) as a sight sees them."""
    light = np.clip(linear(np.asarray(rgb)) @ np.transpose(np.eye(3) if sight is None else sight), 0, 1)
    xyz = light @ np.transpose([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    f = xyz / [0.9505, 1.0, 1.089]
    f = np.where(f > 216 / 24389, np.cbrt(f), (24389 / 27 * f + 16) / 116)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)


def each():
    return PALETTES | {name: palette_of(name) for name in ALL_QUANTITIES}


@pytest.mark.parametrize("sight", [None, DEUTERANOPIA, PROTANOPIA], ids=["all", "deuteranopia", "protanopia"])
@pytest.mark.parametrize("name", each())
def test_neighbouring_classes_differ_for_every_sight(name, sight):
    palette = each()[name]
    seen = lab(palette.rgba(5 if palette.signed else 6)[:, :3], sight)
    assert np.linalg.norm(np.diff(seen, axis=0), axis=1).min() > 7.0
    lightness = seen[:, 0]
    if palette.signed:
        assert lightness.argmax() == 2
        assert np.linalg.norm(seen[0] - seen[-1]) > 30.0, "the ends are not mistaken for one another"
    else:
        assert (np.diff(lightness) < 0).all() or (np.diff(lightness) > 0).all()


def test_red_and_green_would_fail():
    seen = lab(Palette("RdYlGn", signed=True).rgba(5)[:, :3], DEUTERANOPIA)
    assert np.linalg.norm(seen[0] - seen[-1]) < 30.0


@pytest.mark.parametrize("style", MAPS)
def test_report_and_qgis_have_the_same_colours_in_the_same_direction(style):
    colours = colour_scale(np.ma.array(np.linspace(1.0, 30.0, 6)), STYLES[style])["cmap"]
    count = min(colours.N, 12)
    of_report = colours(np.linspace(0, 1, count))
    of_qgis = to_rgba_array(MapClasses.of(list(range(count)), "m", MAPS[style]).colours)
    np.testing.assert_allclose(of_report, of_qgis, atol=0.02)


@pytest.mark.parametrize("style", ["probability", "annual_rate", "share", "pressure"])
def test_fixed_classes_have_the_same_bounds_and_colours_in_report_and_qgis(style):
    edges = class_edges(MAPS[style], [], 0.0, 0.4)
    classes = MapClasses.of(edges, "1", MAPS[style])
    scale = colour_scale(np.ma.array([1.0]), STYLES[style])
    assert STYLES[style].steps[: len(edges)] == pytest.approx(edges)
    assert [to_hex(scale["cmap"](scale["norm"](edge * (1 + 1e-6) + 1e-9))) for edge in edges] == list(classes.colours)


def test_dark_is_worse():
    for name, worse_is_large in (("speed", True), ("arrival", False), ("probability", True), ("safety", False), ("pressure", True)):
        lightness = lab(palette_of(name).rgba(2)[:, :3])[:, 0]
        assert (lightness[1] < lightness[0]) == worse_is_large, name


def test_classes_of_pressure_say_what_they_do_and_keep_thresholds_of_the_site():
    edges = class_edges("peak_pressure", [3.0, 5.0], 0.0, 2.0)
    assert edges == [0.0, 1.0, 3.0, 5.0, 10.0, 30.0, 100.0]
    labels = MapClasses.of(edges, "kPa", "peak_pressure").labels
    assert labels[0] == "above 0 to 1 kPa"
    assert labels[2] == "3 to 5 kPa: doors and light walls give way"
    assert labels[3] == "5 to 10 kPa: doors and light walls give way"
    assert labels[-1] == "100 kPa or more: only strong concrete stands"
    assert "10 to 30 kPa: masonry is damaged" in outline_styles()["facades"]


def test_a_picture_has_the_colours_of_the_classes_and_nothing_where_nothing_happens():
    classes = MapClasses.of([0.0, 1.0, 3.0], "m", "peak_flow_thickness")
    picture = classes.painted(np.array([[0.0, 0.5, 1.0], [2.9, 3.0, np.nan]]))
    expected = (255 * to_rgba_array(classes.colours)).round()[:, :3]
    assert picture[..., 3].tolist() == [[0, 204, 204], [204, 204, 0]]
    np.testing.assert_array_equal(picture[[0, 0, 1, 1], [1, 2, 0, 1], :3], expected[[0, 1, 1, 2]])
    arrival = MapClasses.of([0.0, 10.0], "s", "first_arrival_time").painted(np.array([[0.0, np.nan]]))
    assert arrival[0, :, 3].tolist() == [204, 0]
