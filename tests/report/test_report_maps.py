from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from matplotlib.image import imread
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from shapely.geometry import LineString, Point, box

from runout.palettes import PROBABILITY_LEVELS, palette_of
from runout.report.maps import Basemap, draw_map, png
from runout.report.marks import Mark
from runout.report.values import STYLES, colour_scale

N = 60


@pytest.fixture
def basemap():
    easting, northing = 5000.0 + 10.0 * np.arange(N), 9000.0 - 10.0 * np.arange(N)
    return Basemap(easting, northing, np.add.outer(northing, 0.1 * easting), [box(5200, 8700, 5250, 8750)])


def rgb_at(figure, easting, northing):
    """Colour of the pixel of a map position."""

    picture = imread(BytesIO(png(figure, dpi=100)))
    axes = figure.axes[0]
    x, y = axes.transData.transform((easting, northing))
    return picture[round(picture.shape[0] - y), round(x), :3]


def is_grey(colour):
    return np.ptp(colour) < 0.03


def test_a_marked_cell_is_painted_where_it_lies_and_its_neighbours_stay_hillshade(basemap):
    values = np.zeros((N, N))
    values[10, 40] = 5.0  # easting 5400 m, northing 8900 m
    flat = replace(basemap, elevation=np.zeros((N, N)), outlines=[])
    figure = draw_map(flat, values, STYLES["thickness"])
    assert not is_grey(rgb_at(figure, 5400.0, 8900.0))
    for east, north in ((5415.0, 8900.0), (5385.0, 8900.0), (5400.0, 8915.0), (5400.0, 8885.0)):
        assert is_grey(rgb_at(figure, east, north))


def test_slopes_towards_the_light_in_the_north_west_are_brighter(basemap):
    facing_west = np.broadcast_to(np.arange(N) * 8.0, (N, N))
    bright = draw_map(replace(basemap, elevation=facing_west, outlines=[]), np.zeros((N, N)), STYLES["thickness"])
    ridge = np.minimum(np.arange(N), N - 1 - np.arange(N)) * 8.0
    both = draw_map(replace(basemap, elevation=np.broadcast_to(ridge, (N, N)), outlines=[]), np.zeros((N, N)), STYLES["thickness"])
    assert rgb_at(both, 5103.0, 8703.0).mean() > rgb_at(both, 5503.0, 8703.0).mean() + 0.1
    assert np.isfinite(rgb_at(bright, 5103.0, 8703.0)).all()


def test_a_map_without_any_value_and_with_unknown_terrain_is_still_drawn(basemap):
    holes = basemap.elevation.copy()
    holes[:5] = np.nan
    assert png(draw_map(replace(basemap, elevation=holes), np.full((N, N), np.nan), STYLES["pressure"])).startswith(b"\x89PNG")


def test_unknown_ground_is_grey_and_hatched_with_a_key_and_known_ground_has_none(basemap):
    holes = np.zeros((N, N))
    holes[:20, :20] = np.nan
    flat = replace(basemap, elevation=holes, outlines=[])
    nothing = np.zeros((N, N))
    figure = draw_map(flat, nothing, STYLES["thickness"])
    (key,) = figure.axes[0].get_legend().get_texts()
    assert key.get_text() == "no elevation"
    patch = [rgb_at(figure, 5100.0 + 3.0 * k, 8880.0).mean() for k in range(12)]
    assert np.ptp(patch) > 0.05  # hatched
    known = [rgb_at(figure, 5400.0 + 3.0 * k, 8500.0).mean() for k in range(12)]
    assert np.ptp(known) < 0.02
    whole = draw_map(replace(flat, elevation=np.zeros((N, N))), nothing, STYLES["thickness"])
    assert whole.axes[0].get_legend() is None


def test_the_window_holds_the_release_and_every_reached_cell(basemap):
    reached = np.zeros((N, N), bool)
    reached[40, 50] = True
    west, east, south, north = basemap.extent(basemap.window(reached))
    assert west <= 5200 < 5505 <= east
    assert south <= 8595 < 8750 <= north


def test_the_window_stays_on_the_raster_when_the_flow_is_at_its_corner(basemap):
    reached = np.zeros((N, N), bool)
    reached[0, 0] = True
    rows, columns = replace(basemap, outlines=[]).window(reached)
    assert (rows.start, columns.start) == (0, 0)
    assert rows.stop - rows.start == columns.stop - columns.start == 24


def test_probability_has_the_classes_of_the_outlines_and_speed_a_scale_from_zero():
    shown = np.ma.masked_less_equal(np.linspace(0, 30, 500), 0)
    assert colour_scale(shown, STYLES["probability"])["norm"].boundaries == pytest.approx([0.0, *PROBABILITY_LEVELS, 1.0])
    speed = colour_scale(shown, STYLES["speed"])["norm"]
    assert (speed.vmin, speed.vmax) == (0.0, pytest.approx(29.7, abs=0.1))


def test_a_probability_on_a_bound_is_in_the_class_above_as_files_hold_it():
    scale = colour_scale(np.ma.array([0.5]), STYLES["probability"])
    colours = [scale["norm"](float(np.float32(level))) for level in PROBABILITY_LEVELS]
    inside = [scale["norm"](level + 0.01) for level in PROBABILITY_LEVELS]
    assert colours == inside


def test_window_holds_what_was_observed_where_no_member_came(basemap):
    reached = np.zeros((N, N), dtype=bool)
    away, beyond = box(5400, 8800, 5450, 8850), Point(99_000.0, 8700.0)
    line = LineString([(5000.0, 8500.0), (5590.0, 8500.0)])
    window = replace(basemap, observed=[Mark(away, ""), Mark(beyond, "gauge"), Mark(line, "")]).window(reached)
    west, east, south, north = basemap.extent(window)
    assert box(west, south, east, north).contains(away)
    assert east - west < 590
    before = basemap.extent(basemap.window(reached))
    assert before[1] < 5400


def test_obstacles_and_zones_are_drawn_with_their_labels_where_they_are_in_the_window(basemap):
    dam, zone, away = box(5300, 8600, 5360, 8620), box(5380, 8650, 5580, 8750), box(9000, 9000, 9100, 9100)
    marked = replace(basemap, obstacles=[Mark(dam, "+8 m")], zones=[Mark(zone, "friction 8°"), Mark(away, "elsewhere")])
    figure = draw_map(marked, np.zeros((N, N)), STYLES["thickness"])
    placed = {text.get_text(): text.xy for text in figure.axes[0].texts if text.get_text() in ("+8 m", "friction 8°", "elsewhere")}
    assert set(placed) == {"+8 m", "friction 8°"}
    assert not dam.contains(Point(placed["+8 m"]))  # too small for its label, which is beside it
    assert dam.distance(Point(placed["+8 m"])) < 40.0
    assert zone.contains(Point(placed["friction 8°"]))
    plain = draw_map(basemap, np.zeros((N, N)), STYLES["thickness"])
    assert np.abs(rgb_at(figure, 5380.0, 8700.0) - rgb_at(plain, 5380.0, 8700.0)).max() > 0.1


def test_labels_of_small_structures_cover_no_structure_and_no_other_label(basemap):
    places = [(5180, 8700), (5310, 8660), (5320, 8540)]
    houses = [Mark(box(x, y, x + 40, y + 40), f"house {x}") for x, y in places]
    marked = replace(basemap, obstacles=[*houses, Mark(box(5390, 8500, 5410, 8780), "dam")])
    figure = draw_map(marked, np.zeros((N, N)), STYLES["thickness"])
    figure.canvas.draw()
    axes, drawn = figure.axes[0], {mark.label for mark in marked.obstacles}
    labels = [text.get_window_extent() for text in axes.texts if text.get_text() in drawn]
    marks = [axes.transData.transform_bbox(Bbox.from_extents(*mark.geometry.bounds)) for mark in marked.obstacles]
    assert len(labels) == len(marks)
    assert not [1 for k, label in enumerate(labels) for other in (*labels[:k], *marks) if label.overlaps(other)]


@pytest.mark.parametrize("width", [0.3, 1.0, 3.0])
def test_every_letter_of_a_map_is_ten_pixels_high_on_a_phone(basemap, width):
    marked = replace(basemap, obstacles=[Mark(box(5300, 8600, 5360, 8620), "+8 m")])
    window = slice(0, N), slice(0, max(3, round(N * width)))
    figure = draw_map(marked, np.ones((N, N)), STYLES["speed"], window, "Speed")
    figure.canvas.draw()
    shown = [text for text in figure.findobj(Text) if text.get_text().strip() and text.get_visible()]
    assert len(shown) >= 8
    pixels_per_inch = 350 / figure.get_figwidth()
    assert min(text.get_fontsize() for text in shown) / 72 * pixels_per_inch >= 10.0


def test_logarithmic_colours_span_at_most_three_decades():
    flux = colour_scale(np.ma.masked_less_equal(np.geomspace(1e-6, 400.0, 500), 0), STYLES["momentum_flux"])["norm"]
    assert flux.vmax / flux.vmin <= 1001


def test_pressure_is_shown_in_kilopascal_in_classes_with_meanings():
    style = STYLES["pressure"]
    assert style.scale == 1e-3
    assert style.steps == (0.0, 1.0, 3.0, 10.0, 30.0, 100.0)
    assert style.meanings == ("", *palette_of("pressure").meanings)
    scale = colour_scale(np.ma.array([200.0]), style)
    assert scale["cmap"](scale["norm"](99.0)) != scale["cmap"](scale["norm"](101.0)) == scale["cmap"](scale["norm"](1e6))


@pytest.mark.parametrize("style", [name for name, style in STYLES.items() if not style.diverging])
def test_colours_darken_or_brighten_steadily(style):
    from matplotlib.colors import to_rgba_array

    colours = to_rgba_array(colour_scale(np.ma.array([1.0, 2.0]), STYLES[style])["cmap"].colors)
    lightness = colours[:, :3] @ [0.2126, 0.7152, 0.0722]
    steps = np.diff(lightness)
    assert (steps <= 1e-3).all() or (steps >= -1e-3).all()


def test_colours_of_a_difference_are_light_at_zero_and_symmetric_about_it():
    scale = colour_scale(np.ma.array([-1.0, 4.0]), STYLES["difference"])
    norm, colours = scale["norm"], scale["cmap"]
    assert norm.vmin == -norm.vmax
    lightness = [sum(colours(norm(value))[:3]) for value in (norm.vmin, 0.5 * norm.vmin, 0.0, 0.5 * norm.vmax, norm.vmax)]
    assert max(lightness) == lightness[2]
    assert lightness[0] < lightness[1]
    assert lightness[4] < lightness[3]


def test_labels_of_a_probe_and_a_gauge_at_one_point_do_not_cover_each_other(basemap):
    place = Point(5300.0, 8700.0)
    observed, probes = ([Mark(place, label) for label in labels] for labels in (("12 s, 3.5 m/s", "14 s"), ("bridge", "road")))
    one = replace(basemap, observed=observed, probes=probes)
    figure = draw_map(one, np.zeros((N, N)), STYLES["thickness"])
    png(figure, dpi=100)
    axes = figure.axes[0]
    written = {"12 s, 3.5 m/s", "14 s", "bridge", "road"}
    boxes = {text.get_text(): text.get_window_extent() for text in axes.findobj(Text) if text.get_text() in written}
    assert boxes.keys() == written
    middle = axes.transData.transform(place.coords[0])
    symbol = Bbox([middle - 2.0, middle + 2.0])
    for name, box_ in boxes.items():
        assert not Bbox.intersection(box_, symbol), name
        assert not any(Bbox.intersection(box_, other) for key, other in boxes.items() if key != name), name
