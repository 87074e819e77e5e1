"""Marks of the explorer: outlines, structures, probes and observations, with what a click on them shows."""

from collections.abc import Iterator, Sequence
from typing import Any

from runout.report.marks import INK, OBSERVED, OBSTACLE, PROBE, RELEASE, Mark
from runout.report.study import Study, features
from runout.report.wording import percent

OUTLINE = "#8c1a4b"


def marks(study: Study, cell: float) -> list[dict[str, Any]]:
    """Groups of marks: ``name``, ``colour``, ``shown`` at first, and ``items`` with ``label``, ``kind`` and ``parts`` of coordinates."""
    basemap = study.basemap
    groups = [
        ("Releases", RELEASE, True, [Mark(outline, "") for outline in basemap.outlines]),
        ("Outlines of the ensemble", OUTLINE, False, list(_inundation(study, cell))),
        ("Obstacles and structures", OBSTACLE, True, basemap.obstacles),
        ("Friction zones", INK, False, basemap.zones),
        ("Observed", OBSERVED, True, basemap.observed),
        ("Probes", PROBE, True, basemap.probes),
    ]
    return [
        {"name": name, "colour": colour, "shown": shown, "items": [_item(mark) for mark in items if not mark.geometry.is_empty]}
        for name, colour, shown, items in groups
        if items
    ]


def _inundation(study: Study, cell: float) -> Iterator[Mark]:
    """Outlines within which the flow arrives with a probability, without corners that cells alone make."""
    for feature in features(study.results / "outlines.gpkg", "inundation"):
        yield Mark(feature["geometry"].simplify(0.1 * cell), f"probability {percent(float(feature['probability']))}")


def _item(mark: Mark) -> dict[str, Any]:
    kind = mark.geometry.geom_type.removeprefix("Multi").lower()
    return {"label": mark.label, "kind": kind, "parts": [_rounded(part) for part in _parts(mark.geometry)]}


def _parts(geometry: Any) -> Iterator[Any]:
    """Lines of coordinates: rings, lines and points."""
    for part in getattr(geometry, "geoms", [geometry]):
        if part.geom_type == "Polygon":
            yield from (ring.coords for ring in (part.exterior, *part.interiors))
        else:
            yield part.coords


def _rounded(coordinates: Sequence[Any]) -> list[list[float]]:
    return [[round(float(place[axis]), 2) for place in coordinates] for axis in (0, 1)]
