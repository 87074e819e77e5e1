"""Outlines, points and labels of a map: those that get a label and where it lies, for all maps, and how matplotlib draws them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.palettes import OBSERVED, OBSTACLE, PROBE, RELEASE

INK = "#22282f"
MOST_LABELS = 14  # of a kind on one map
LETTER, LINE, LABEL_SIZE = 6.2, 12.0, 9.0  # width of a letter and height of a line of a label; size of its font [pt]
GAP = 6.0  # between a mark and the label beside it; of a point with its symbol
PLACES = ((0, 0), (0, -1), (0, 1), (1, 0), (-1, 0))  # of a label: in the middle of a mark, above, below, to the right, to the left
UNKNOWN_GROUND, UNKNOWN_HATCH, HATCH = "#d3d7db", "#8b939b", "\\\\\\"  # hatched unlike obstacles

Box = tuple[float, float, float, float]  # left, top, right, bottom, from the upper left corner of a map


@dataclass(frozen=True)
class Mark:
    """A shapely geometry in map coordinates, with its label."""

    geometry: Any
    label: str


def label_places(
    basemap: Any, extent: tuple[float, float, float, float], box_of: Callable[[Any], Box], size: tuple[float, float]
) -> Iterator[tuple[float, float, str, str]]:
    """Middle x and y, words and colour of the labels on a map of a ``size``; one without a free place is left out.

    Marks within the ``extent`` (west, east, south, north) [m] get one. ``box_of`` is the box on the map of a geometry.
    """
    from shapely import box

    west, east, south, north = extent
    window = box(west, south, east, north)
    kinds = ((basemap.probes, PROBE), (basemap.observed, OBSERVED), (basemap.obstacles, OBSTACLE), (basemap.zones, INK))
    labelled = [(mark, colour) for marks, colour in kinds for mark in [mark for mark in marks if mark.label][:MOST_LABELS]]
    shown = [(mark.label, colour, mark.geometry.intersection(window)) for mark, colour in labelled]
    boxes = [(label, colour, box_of(geometry)) for label, colour, geometry in shown if not geometry.is_empty]
    small = [mark for label, _, mark in boxes if not _holds(mark, label)]
    taken: list[Box] = []
    for label, colour, mark in boxes:
        place = _free_place(label, mark, size, [*taken, *small]) or _free_place(label, mark, size, taken)
        if place is not None:
            taken.append(_around(*place, label))
            yield *place, label, colour


def _free_place(label: str, mark: Box, size: tuple[float, float], taken: Sequence[Box]) -> tuple[float, float] | None:
    """Middle of a label in a ``mark`` that is larger, else beside it, where it covers none of the boxes ``taken``."""
    left, top, right, bottom = mark
    half = 0.5 * LETTER * len(label), 0.5 * LINE
    for across, down in PLACES if _holds(mark, label) else PLACES[1:]:
        x = 0.5 * (left + right) + across * (0.5 * (right - left) + half[0] + GAP)
        y = 0.5 * (top + bottom) + down * (0.5 * (bottom - top) + half[1] + GAP)
        area = _around(x, y, label)
        within = area[0] >= 0 and area[1] >= 0 and area[2] <= size[0] and area[3] <= size[1]
        if within and not any(_overlap(area, other) for other in taken):
            return x, y
    return None


def _around(x: float, y: float, label: str) -> Box:
    half = 0.5 * LETTER * len(label), 0.5 * LINE
    return x - half[0], y - half[1], x + half[0], y + half[1]


def _holds(mark: Box, label: str) -> bool:
    return mark[2] - mark[0] > LETTER * len(label) and mark[3] - mark[1] > LINE


def _overlap(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def draw_marks(axes: Any, basemap: Any) -> None:
    """Draw the marks of a basemap within the limits of axes, with their labels.

    Releases are red, obstacles hatched, friction zones dashed, what was observed blue with triangles, probes purple with dots.
    """
    for x, y in _rings([zone.geometry for zone in basemap.zones]):
        axes.plot(x, y, color="white", linewidth=1.8, alpha=0.6, zorder=3)
        axes.plot(x, y, color=INK, linewidth=0.9, linestyle=(0, (5, 3)), zorder=3)
    for obstacle in basemap.obstacles:
        axes.add_patch(_hatched(obstacle.geometry))
    for marks, colour, symbol in ((basemap.observed, OBSERVED, "^"), (basemap.probes, PROBE, "o")):
        points = [mark.geometry for mark in marks if mark.geometry.geom_type == "Point"]
        _draw_cased(axes, [mark.geometry for mark in marks if mark.geometry.geom_type != "Point"], colour)
        for point in points:
            axes.plot(point.x, point.y, symbol, color=colour, markeredgecolor="white", markersize=6, zorder=5)
    _draw_cased(axes, basemap.outlines, RELEASE)
    _draw_labels(axes, basemap)


def _draw_cased(axes: Any, shapes: Sequence[Any], colour: str) -> None:
    """Lines and rings over a white line."""
    for x, y in _rings(shapes):
        axes.plot(x, y, color="white", linewidth=2.6, alpha=0.8, zorder=3)
        axes.plot(x, y, color=colour, linewidth=1.3, zorder=4)


def _draw_labels(axes: Any, basemap: Any) -> None:
    """Write the labels of marks within the limits of axes; their boxes are in points."""
    from matplotlib.patheffects import withStroke

    pixels, (west, _, _, north), pixel = axes.transData, axes.bbox.extents, axes.figure.dpi / 72.0

    def box_of(geometry: Any) -> Box:
        (left, bottom), (right, top) = (pixels.transform(np.reshape(geometry.bounds, (2, 2))) - (west, north)) / (pixel, -pixel)
        return left, top, right, bottom

    size = axes.bbox.width / pixel, axes.bbox.height / pixel
    for x, y, label, colour in label_places(basemap, (*axes.get_xlim(), *axes.get_ylim()), box_of, size):
        axes.annotate(
            label, pixels.inverted().transform((west + x * pixel, north - y * pixel)), ha="center", va="center",
            fontsize=LABEL_SIZE, color=colour, zorder=6, path_effects=[withStroke(linewidth=2.5, foreground="white")],
        )  # fmt: skip


def draw_unknown(axes: Any, unknown: np.ndarray, extent: tuple[float, float, float, float]) -> None:
    """Hatch cells (rows, columns) of an extent (west, east, south, north) [m] in grey, with a key, if there are any."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.patches import Patch

    if not unknown.any():
        return
    west, east, south, north = extent
    dx, dy = (east - west) / unknown.shape[1], (north - south) / unknown.shape[0]
    x, y = west + (np.arange(-1, unknown.shape[1] + 1) + 0.5) * dx, north - (np.arange(-1, unknown.shape[0] + 1) + 0.5) * dy
    inside = np.pad(unknown.astype(float), 1, mode="edge")
    drawn = axes.contourf(x, y, inside, levels=[0.5, 1.5], colors=[UNKNOWN_GROUND], hatches=[HATCH], zorder=1)
    drawn.set(edgecolor=UNKNOWN_HATCH, linewidth=0.0)
    key = Patch(facecolor=UNKNOWN_GROUND, edgecolor=UNKNOWN_HATCH, hatch=HATCH, linewidth=0.5, label="no elevation")
    legend = axes.legend(
        handles=[key], loc="upper left", prop=FontProperties(size=LABEL_SIZE), handlelength=1.6, borderpad=0.3, framealpha=0.85,
        edgecolor="none", labelcolor=INK,
    )  # fmt: skip
    legend.set_zorder(6)


def _hatched(geometry: Any) -> Any:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    rings = [Path(list(zip(*ring, strict=True)), closed=True) for ring in _rings([geometry])]
    path = Path.make_compound_path(*rings)
    return PathPatch(path, facecolor=(1.0, 1.0, 1.0, 0.35), edgecolor=OBSTACLE, linewidth=1.2, hatch="////", zorder=3)


def _rings(shapes: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
    """Coordinates of all rings of polygons, and of lines."""
    for shape in shapes:
        for part in getattr(shape, "geoms", [shape]):
            for ring in [part.exterior, *part.interiors] if part.geom_type == "Polygon" else [part]:
                yield ring.xy
