"""Draws outlines and labels of releases, obstacles and friction zones on a map."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.palettes import OBSERVED, OBSTACLE, PROBE, RELEASE

INK = "#22282f"
MOST_LABELS = 12  # on one map
LABEL_SIZE = 9.0  # [pt]
WIDE = 0.33  # half the mean width of a letter over its size, with a reserve: the axes may still shrink
SYMBOL = 4.0  # from the middle of a point to the edge of its symbol [pt]
GAP = 2.0  # between a mark and the label beside it [pt]
BESIDE = (  # places of labels: corner or middle of a side of a mark, and direction from there to the label, east and north
    *(((0, 1), (0, 1)), ((0, -1), (0, -1)), ((1, 0), (1, 0)), ((-1, 0), (-1, 0))),
    *(((1, 1), (-1, 1)), ((1, -1), (-1, -1)), ((-1, 1), (1, 1)), ((-1, -1), (1, -1))),
)
UNKNOWN_GROUND, UNKNOWN_HATCH, HATCH = "#d3d7db", "#8b939b", "\\\\\\"  # hatched unlike obstacles


@dataclass(frozen=True)
class Mark:
    """A shapely geometry in map coordinates, with its label."""

    geometry: Any
    label: str


def draw_marks(
    axes: Any, releases: Sequence[Any], obstacles: Sequence[Mark], zones: Sequence[Mark], taken: list[np.ndarray]
) -> None:
    """Draw releases red, obstacles hatched and friction zones dashed within the limits of the axes.

    The last two are labelled clear of the boxes of labels ``taken``, which get theirs.
    """
    for x, y in _rings([zone.geometry for zone in zones]):
        axes.plot(x, y, color="white", linewidth=1.8, alpha=0.6, zorder=3)
        axes.plot(x, y, color=INK, linewidth=0.9, linestyle=(0, (5, 3)), zorder=3)
    for obstacle in obstacles:
        axes.add_patch(_hatched(obstacle.geometry))
    for x, y in _rings(releases):
        axes.plot(x, y, color="white", linewidth=2.6, alpha=0.8, zorder=3)
        axes.plot(x, y, color=RELEASE, linewidth=1.3, zorder=4)
    marks = [*((obstacle, OBSTACLE) for obstacle in obstacles), *((zone, INK) for zone in zones)]
    clear = [_box_of(axes, o.geometry) for o in obstacles if not _visible(axes, o.geometry).is_empty]
    for mark, colour in _in_order(axes, marks):
        _label(axes, mark, colour, taken=taken, kept_clear=clear if colour == OBSTACLE else None)


def draw_observed(axes: Any, observed: Sequence[Mark], taken: list[np.ndarray]) -> None:
    """Draw observed outlines blue, a thalweg dotted and points as triangles with their labels; ``taken`` as for marks."""
    kinds: dict[str, list[Mark]] = {}
    for mark in observed:
        kinds.setdefault(mark.geometry.geom_type.removeprefix("Multi"), []).append(mark)
    for x, y in _rings([mark.geometry for mark in kinds.get("Polygon", [])]):
        axes.plot(x, y, color="white", linewidth=2.6, alpha=0.8, zorder=3)
        axes.plot(x, y, color=OBSERVED, linewidth=1.3, zorder=4)
    for mark in kinds.get("LineString", []):
        axes.plot(*mark.geometry.xy, color=OBSERVED, linewidth=1.0, linestyle=(0, (1, 2)), zorder=4)
    points = kinds.get("Point", [])
    for mark in points:
        axes.plot(mark.geometry.x, mark.geometry.y, "^", color=OBSERVED, markeredgecolor="white", markersize=6, zorder=5)
    for mark in points[:MOST_LABELS]:
        _label(axes, mark, OBSERVED, taken=taken, kept_clear=())


def draw_probes(axes: Any, probes: Sequence[Mark], taken: list[np.ndarray]) -> None:
    """Draw points of recorded series as purple dots, cross-sections as lines, with their names; ``taken`` as for marks."""
    for mark in probes:
        if mark.geometry.geom_type == "Point":
            axes.plot(mark.geometry.x, mark.geometry.y, "o", color=PROBE, markeredgecolor="white", markersize=5, zorder=5)
        else:
            axes.plot(*mark.geometry.xy, color="white", linewidth=2.6, alpha=0.8, zorder=3)
            axes.plot(*mark.geometry.xy, color=PROBE, linewidth=1.3, zorder=4)
    for mark in probes[:MOST_LABELS]:
        is_point = mark.geometry.geom_type == "Point"
        place = mark.geometry if is_point else mark.geometry.interpolate(0.12, normalized=True)  # inside the map
        _label(axes, Mark(place, mark.label), PROBE, taken=taken, kept_clear=())


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


def _in_order(axes: Any, marks: list[tuple[Mark, str]]) -> list[tuple[Mark, str]]:
    """The largest marks by the order of their labels: zones and those that hold theirs, then the others, the smallest first."""
    largest = sorted(marks, key=lambda pair: -pair[0].geometry.area)[:MOST_LABELS]
    seen = [(mark, colour) for mark, colour in largest if not _visible(axes, mark.geometry).is_empty]
    beside = [colour == OBSTACLE and not _fits(axes, mark.label, mark.geometry) for mark, colour in seen]
    return [pair for pair, small in zip(seen, beside, strict=True) if not small] + [
        pair for pair, small in zip(seen[::-1], beside[::-1], strict=True) if small
    ]


def _hatched(geometry: Any) -> Any:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    rings = [Path(list(zip(*ring, strict=True)), closed=True) for ring in _rings([geometry])]
    path = Path.make_compound_path(*rings)
    return PathPatch(path, facecolor=(1.0, 1.0, 1.0, 0.35), edgecolor=OBSTACLE, linewidth=1.2, hatch="////", zorder=3)


def _label(axes: Any, mark: Mark, colour: str, *, taken: list[np.ndarray], kept_clear: Sequence[np.ndarray] | None = None) -> None:
    """Write a label inside the visible part of a mark where it covers none of ``taken``, boxes (4,) of the labels before.

    With ``kept_clear`` it is written beside a mark that is too small for it, clear of these boxes too if there is such a place.
    """
    from matplotlib.patheffects import withStroke

    shown = _visible(axes, mark.geometry)
    if shown.is_empty:
        return
    free = _free_place(axes, mark.label, shown, taken, kept_clear)
    if free is None:
        return
    place, side = free
    offset = side[0] * _gap(shown), side[1] * _gap(shown)
    axes.annotate(
        mark.label, place, offset, textcoords="offset points", ha=("center", "left", "right")[side[0]],
        va=("center", "bottom", "top")[side[1]], fontsize=LABEL_SIZE, color=colour, zorder=6,
        path_effects=[withStroke(linewidth=2.5, foreground="white")],
    )  # fmt: skip


def _visible(axes: Any, geometry: Any) -> Any:
    """The part of a geometry within the limits of the axes."""
    from shapely import box

    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    return geometry.intersection(box(west, south, east, north))


def _free_place(
    axes: Any, label: str, shown: Any, taken: list[np.ndarray], kept_clear: Sequence[np.ndarray] | None
) -> tuple[tuple[float, float], tuple[int, int]] | None:
    """Place of a label in map coordinates and the side of it on which the label lies; None where all would cover another label.

    Boxes (left, bottom, right, top) [pixel] are those of :func:`_box_of`; that of the label is added to ``taken``.
    """
    half, gap, whole = _half(axes, label), _gap(shown) * axes.figure.dpi / 72.0, axes.bbox.extents
    west, south, east, north = shown.bounds
    inside = (shown.representative_point().coords[0], (0, 0))
    for corner, near in () if kept_clear is None or _fits(axes, label, shown) else BESIDE:
        place = ((west + east) / 2 + corner[0] * (east - west) / 2, (south + north) / 2 + corner[1] * (north - south) / 2)
        box = _around(axes.transData.transform(place) + np.array(near) * (half + gap), half)
        within = (box[:2] >= whole[:2]).all() and (box[2:] <= whole[2:]).all()
        if within and not any(_overlap(box, other) for other in (*taken, *(kept_clear or ()))):
            taken.append(box)
            return place, near
    box = _around(axes.transData.transform(inside[0]), half)
    if any(_overlap(box, other) for other in taken):
        return None
    taken.append(box)
    return inside


def _gap(geometry: Any) -> float:
    """Distance [pt] of a label from the border of a geometry; a point has a symbol."""
    return GAP + (SYMBOL if geometry.geom_type == "Point" else 0.0)


def _box_of(axes: Any, geometry: Any) -> np.ndarray:
    """Box around the visible part of a geometry: left, bottom, right, top [pixel]."""
    bounds = np.array(_visible(axes, geometry).bounds)
    return axes.transData.transform(bounds.reshape(2, 2)).ravel()  # type: ignore[no-any-return]


def _half(axes: Any, label: str) -> np.ndarray:
    """Half the width and height of a label [pixel]."""
    letters = max(len(line) for line in label.splitlines() or [""])
    return LABEL_SIZE * axes.figure.dpi / 72.0 * np.array([WIDE * letters, 0.6])  # type: ignore[no-any-return]


def _fits(axes: Any, label: str, geometry: Any) -> bool:
    """Whether a label is smaller than the box around the visible part of a geometry."""
    box = _box_of(axes, geometry)
    return bool((box[2:] - box[:2] >= 2.0 * _half(axes, label)).all())


def _around(middle: np.ndarray, half: np.ndarray) -> np.ndarray:
    return np.concatenate([middle - half, middle + half])


def _overlap(box: np.ndarray, other: np.ndarray) -> bool:
    return bool((box[:2] < other[2:]).all() and (other[:2] < box[2:]).all())


def _rings(shapes: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
    """Coordinates of all rings of polygons, and of lines."""
    for shape in shapes:
        for part in getattr(shape, "geoms", [shape]):
            for ring in [part.exterior, *part.interiors] if part.geom_type == "Polygon" else [part]:
                yield ring.xy
