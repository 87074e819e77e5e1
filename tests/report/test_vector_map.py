"""Maps and charts of a page as SVG: cells lie where they belong, in their colours, under marks and labels that users wrote."""

import base64
import re
from io import BytesIO
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image
from shapely.geometry import LineString, Point, Polygon, box

from runout.report.chart import Chart
from runout.report.maps import Basemap
from runout.report.marks import Mark
from runout.report.values import STYLES, colour_scale
from runout.report.vector_map import EDGE, LEFT, VectorMaps

N = 40
EAST, NORTH = 5000.0 + 10.0 * np.arange(N), 9000.0 - 10.0 * np.arange(N)


def maps(window=None, elevation=None, **marks):
    ground = np.add.outer(NORTH, 0.1 * EAST) if elevation is None else elevation
    basemap = Basemap(EAST, NORTH, ground, **marks)
    return VectorMaps(basemap, window or basemap.whole)


def elements(svg):
    return list(ElementTree.fromstring(str(svg)).iter())


def image(drawn):
    """Colours and opacity (rows, columns, 4) of the cells of a map."""
    (source,) = re.findall(r'href="data:image/png;base64,([^"]+)"', drawn.svg)
    with Image.open(BytesIO(base64.b64decode(source))) as read:
        return np.asarray(read.convert("RGBA"))


def test_each_cell_has_its_pixel_in_the_colour_of_its_value():
    values = np.full((N, N), np.nan)
    values[10, 30], values[20, 5], values[0, 0] = 2.0, 4.0, 0.0
    style = STYLES["thickness"]
    pixels = image(maps().drawn(values, style, "Map: thickness"))
    assert pixels.shape == (N, N, 4)
    assert (pixels[..., 3] > 0).sum() == 2  # neither unknown cells nor those of 0
    scale = colour_scale(np.ma.array([2.0, 4.0]), style)
    for place, value in (((10, 30), 2.0), ((20, 5), 4.0)):
        expected = np.array(scale["cmap"](scale["norm"](value))[:3]) * 255
        assert np.abs(pixels[place][:3] - expected).max() <= 3


def test_values_beyond_the_last_class_have_a_colour_and_a_part_of_the_bar_of_their_own():
    style, values = STYLES["pressure"], np.full((N, N), np.nan)
    values[1, 1], values[2, 2] = 1e3 * 99.0, 1e3 * 1e6  # Pa
    drawn = maps().drawn(values, style, "pressure")
    pixels = image(drawn)
    assert pixels[1, 1].tolist() != pixels[2, 2].tolist()
    parts = re.findall(r'height="9" fill="#([0-9a-f]{6})"', drawn.legend)
    assert len(parts) == len(style.steps)
    assert pixels[2, 2, :3].tolist() == list(bytes.fromhex(parts[-1]))
    assert all(f"from {step:g}: " in drawn.legend for step, words in zip(style.steps, style.meanings, strict=False) if words)


def test_classes_have_the_colours_of_the_scheme_and_the_strongest_is_first_in_the_legend():
    values = np.zeros((N, N))
    values[3, 4], values[5, 6] = 1, 2
    entries = [{"name": f"<{k}>", "text": "houses & roads", "colour": colour, "checked": "primary"} for k, colour in
               (("weak", "#ffe080"), ("strong", "#c00000"))]  # fmt: skip
    drawn = maps().classes(values, entries, "classes")
    pixels = image(drawn)
    assert pixels[3, 4].tolist() == [0xFF, 0xE0, 0x80, 255]
    assert pixels[5, 6].tolist() == [0xC0, 0, 0, 255]
    assert (pixels[..., 3] > 0).sum() == 2
    assert drawn.legend.index("&lt;strong&gt;") < drawn.legend.index("&lt;weak&gt;")
    assert "houses &amp; roads" in drawn.legend


def test_a_window_shows_its_cells_alone_and_marks_lie_where_they_are():
    window = (slice(10, 30), slice(5, 25))
    square = maps(window, outlines=[box(5100, 8800, 5150, 8850)])
    assert image(square.drawn(np.ones((N, N)), STYLES["thickness"], "x")).shape[:2] == (20, 20)
    west, east, south, north = square.extent
    path = re.findall(r'd="(M[^"]+Z)" class="v-line" stroke="#d7263d"', square.definitions())[0]
    corners = np.array(re.findall(r"([\d.]+) ([\d.]+)", path), float)
    x, y = west + corners[:, 0] / square.width * (east - west), north - corners[:, 1] / square.height * (north - south)
    assert [x.min(), x.max(), y.min(), y.max()] == pytest.approx([5100, 5150, 8800, 8850], abs=0.5)


def test_coordinates_stand_at_their_places():
    drawn = maps()
    west, east, _, _ = drawn.extent
    frame = str(drawn.definitions())
    labels = [
        (float(x), float(label))
        for x, label in re.findall(r'<text x="([\d.]+)" y="[\d.]+" class="v-text v-coordinate">([\d.]+)<', frame)
    ]
    assert len(labels) >= 3
    for x, kilometres in labels:
        assert west + (x - LEFT) / drawn.width * (east - west) == pytest.approx(1e3 * kilometres, abs=1.0)


def test_labels_of_users_are_escaped_and_do_not_cover_each_other():
    houses = [Mark(box(x, 8800, x + 20, 8820), f"house <{x}>") for x in (5100, 5120, 5140)]
    probes = [Mark(Point(5110, 8810), "probe & gauge"), Mark(Point(99_000, 0), "away")]
    text = str(maps(obstacles=houses, probes=probes, zones=[Mark(LineString([(5000, 8700), (5300, 8700)]), "")]).definitions())
    ElementTree.fromstring(text)
    places = [
        (float(x), float(y), label)
        for x, y, label in re.findall(r'<text x="([\d.-]+)" y="([\d.-]+)" class="v-text v-label"[^>]*>([^<]+)<', text)
    ]
    assert {"probe &amp; gauge", "house &lt;5100&gt;"} <= {label for _, _, label in places}
    assert all("away" not in label for _, _, label in places)
    for k, (x, y, label) in enumerate(places):
        for a, b, other in places[:k]:
            assert abs(y - b) >= 11 or abs(x - a) >= 3.0 * (len(label) + len(other)) / 2


def test_terrain_with_holes_flat_terrain_and_large_windows_are_drawn():
    holes = np.add.outer(NORTH, EAST)
    holes[:5] = np.nan
    rings = Polygon([(5000, 8700), (5200, 8700), (5200, 8900)], [[(5150, 8750), (5180, 8750), (5180, 8780)]])
    for elevation in (holes, np.zeros((N, N)), np.full((N, N), np.nan)):
        drawn = maps(elevation=elevation, outlines=[rings])
        assert ElementTree.fromstring(str(drawn.definitions())) is not None
        assert elements(drawn.drawn(np.full((N, N), np.nan), STYLES["pressure"], "nothing").svg)
    side = 3000
    large = Basemap(np.arange(side, dtype=float), np.arange(side, 0, -1.0), np.zeros((side, side), np.float32))
    assert max(image(VectorMaps(large, large.whole).drawn(np.ones((side, side)), STYLES["speed"], "x")).shape) <= 1400


@pytest.mark.parametrize("style", STYLES)
def test_every_style_has_a_colour_bar_with_numbers_inside_it(style):
    values = np.linspace(0.01, 0.99, N * N).reshape(N, N)
    legend = str(maps().drawn(values, STYLES[style], "x").legend)
    numbers = [float(x) for x in re.findall(r'<text x="([\d.]+)"', legend)]
    assert len(numbers) >= 2
    assert min(numbers) >= LEFT - 0.1
    assert max(numbers) <= LEFT + maps().width + EDGE
    assert STYLES[style].label.split(" [")[0] in legend


def test_a_chart_places_its_points_and_escapes_its_labels():
    chart = Chart("x <a>", "y", (0.0, 10.0), (0.0, 5.0))
    chart.points([0.0, 10.0, np.nan], [0.0, 5.0, 1.0], "#000", "points & lines")
    chart.line(np.arange(1000) / 100, np.zeros(1000), "#123")
    svg = str(chart.svg('"alt"'))
    root = ElementTree.fromstring(svg[: svg.index("<ul")])
    circles = [element for element in root.iter() if element.tag.endswith("circle")]
    assert [(float(c.get("cx")), float(c.get("cy"))) for c in circles] == [(46.0, 212.0), (428.0, 10.0)]
    assert "x &lt;a&gt;" in svg
    assert "points &amp; lines" in svg
    assert svg.count("L") < 150
