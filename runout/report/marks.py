"""What is drawn over a map: outlines of releases, obstacles and friction zones with their labels."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

INK = "#22282f"
RELEASE = "#d7263d"
OBSTACLE = "#6b3f16"
MOST_LABELS = 12  # on one map
LABEL_SIZE = 9.0  # [pt]


@dataclass(frozen=True)
class Mark:
    """A shapely polygon or multipolygon in map coordinates, and what is written beside it."""

    geometry: Any
    label: str


def draw_marks(axes: Any, releases: Sequence[Any], obstacles: Sequence[Mark], zones: Sequence[Mark], labels: bool = True) -> None:
    """Draw releases red, obstacles hatched and friction zones dashed, the last two with ``labels``, on axes with their limits."""
    for x, y in _rings([zone.geometry for zone in zones]):
        axes.plot(x, y, color="white", linewidth=1.8, alpha=0.6, zorder=3)
        axes.plot(x, y, color=INK, linewidth=0.9, linestyle=(0, (5, 3)), zorder=3)
    for obstacle in obstacles:
        axes.add_patch(_hatched(obstacle.geometry))
    for x, y in _rings(releases):
        axes.plot(x, y, color="white", linewidth=2.6, alpha=0.8, zorder=3)
        axes.plot(x, y, color=RELEASE, linewidth=1.3, zorder=4)
    marks = [*((obstacle, OBSTACLE) for obstacle in obstacles), *((zone, INK) for zone in zones)]
    for mark, colour in _largest(marks) if labels else ():
        _label(axes, mark, colour)


def _largest(marks: list[tuple[Mark, str]]) -> list[tuple[Mark, str]]:
    return sorted(marks, key=lambda pair: -pair[0].geometry.area)[:MOST_LABELS]


def _hatched(geometry: Any) -> Any:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    rings = [Path(list(zip(*ring, strict=True)), closed=True) for ring in _rings([geometry])]
    path = Path.make_compound_path(*rings)
    return PathPatch(path, facecolor=(1.0, 1.0, 1.0, 0.35), edgecolor=OBSTACLE, linewidth=1.2, hatch="////", zorder=3)


def _label(axes: Any, mark: Mark, colour: str) -> None:
    """Words inside the part of a mark that the axes show."""
    from matplotlib.patheffects import withStroke
    from shapely import box

    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    shown = mark.geometry.intersection(box(west, south, east, north))
    if shown.is_empty:
        return
    place = shown.representative_point()
    halo = [withStroke(linewidth=2.5, foreground="white")]
    axes.annotate(
        mark.label, (place.x, place.y), ha="center", va="center", fontsize=LABEL_SIZE, color=colour,
        path_effects=halo, zorder=6,
    )  # fmt: skip


def _rings(polygons: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
    """Coordinates of all rings."""
    for polygon in polygons:
        for part in getattr(polygon, "geoms", [polygon]):
            for ring in [part.exterior, *part.interiors]:
                yield ring.xy
