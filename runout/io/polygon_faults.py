"""What is wrong with a polygon that is not valid, and the remedy for its case."""

from pathlib import Path
from typing import Any

import numpy as np

FLAT = 1e-12  # area over the square of the length, of points on one line within round-off
MENDED = "`ogr2ogr -makevalid mended.gpkg {path}` makes {parts} of {area:.6g} m2 of it; look at them in the GIS before you use them"
CASES = {  # what is wrong and the remedy, by the reason of GEOS
    "hole lies outside shell": (
        "a hole lies outside its outline",
        "delete the hole, or draw it as a polygon of its own if it belongs to the {what}",
    ),
    "holes are nested": (
        "one hole lies in another",
        "delete the inner hole, or draw it as a polygon of its own if it is an island that belongs to the {what}",
    ),
    "nested shells": (
        "one of its parts lies in another",
        "delete the inner part, which would count twice, or make it a hole",
    ),
    "interior is disconnected": (
        "its holes cut it into separate parts",
        "draw each part as a polygon of its own, or move the hole off the outline; {mended}",
    ),
    "duplicate rings": ("it has the same ring twice", "delete one of the two"),
    "too few points in geometry component": (
        "one of its rings has fewer than three corners",
        "draw the ring with three corners or more, or delete it",
    ),
    "invalid coordinate": ("one of its coordinates is not a number", "draw it anew, or delete that point"),
}
NO_AREA = (
    "it has no area, since its points lie on one line or at one place",
    "draw it with three corners or more that enclose an area, or delete it",
)
NO_AREA_IN_HOLE = ("one of its holes has no area, since its points lie on one line or at one place", "delete the hole")
SPIKE = ("its outline runs out and back along one line", "delete the corner at the end of that line")
TOUCHES = ("its outline touches itself", "split it there into two polygons, or move one of its corners; {mended}")
CROSSES = ("its outline crosses itself", "move or reorder its corners so that its sides do not cross; {mended}")
PARTS_OVERLAP = (
    "two of its parts overlap",
    "unite them (QGIS: Multipart to singleparts, then Dissolve), so that their common area counts once",
)
NOTHING_LEFT = ("its holes cover all of it", "delete the hole that is as large as the outline")
HOLE_CROSSES = (
    "a hole crosses the outline or another hole",
    "draw the hole within the outline and apart from other holes, or subtract it (QGIS: Difference)",
)
OTHER = ("it is not valid", "mend it in the GIS (QGIS: Fix geometries); {mended}")


def fault_message(path: Path, number: int, polygon: Any, what: str) -> str:
    """Message on polygon ``number`` (from 1) of a file that is not valid: what is wrong, where, and the remedy.

    Parameters
    ----------
    polygon : shapely Polygon or MultiPolygon
        In the map coordinates of the terrain [m].
    what : str
        What the polygon stands for, such as "release".
    """
    import shapely

    reason, _, place = shapely.is_valid_reason(polygon).rstrip("]").partition("[")
    at = f" at easting {place.split()[0]}, northing {place.split()[1]}" if len(place.split()) >= 2 else ""
    fault, remedy = _case(polygon, reason.strip().lower())
    remedy = remedy.format(what=what, mended=_mended(path, polygon))
    return f"{path}: polygon {number} is not valid, {fault} ({reason.strip().lower()}){at}; {remedy}"


def _case(polygon: Any, reason: str) -> tuple[str, str]:
    """What is wrong with a polygon, and the remedy."""
    import shapely

    parts = shapely.get_parts(polygon)
    if not np.isfinite(shapely.get_coordinates(polygon)).all():
        return CASES["invalid coordinate"]
    if any(_is_flat(part.exterior) for part in parts):
        return NO_AREA
    if any(_is_flat(hole) for part in parts for hole in part.interiors):
        return NO_AREA_IN_HOLE
    if reason in CASES:
        return CASES[reason]
    if reason == "ring self-intersection":
        return SPIKE if any(_has_lines(part.exterior) for part in parts) else TOUCHES
    return _crossing(parts) if reason == "self-intersection" else OTHER


def _crossing(parts: np.ndarray) -> tuple[str, str]:
    """Which rings of the parts of a polygon cross each other."""
    import shapely

    if not all(part.exterior.is_simple for part in parts):
        return SPIKE if any(_has_lines(part.exterior) for part in parts) else CROSSES
    if all(shapely.is_valid(parts)):
        return PARTS_OVERLAP
    left = [shapely.difference(shapely.Polygon(p.exterior), shapely.union_all(_filled(p.interiors))) for p in parts]
    return NOTHING_LEFT if any(one.area == 0 for one in left) else HOLE_CROSSES


def _filled(rings: Any) -> np.ndarray:
    """The areas in rings."""
    import shapely

    return np.array([shapely.make_valid(shapely.Polygon(ring)) for ring in rings])


def _is_flat(ring: Any) -> bool:
    """Whether the points of a ring lie on one line."""
    return bool(ring.convex_hull.area <= FLAT * ring.length**2)


def _has_lines(ring: Any) -> bool:
    """Whether a ring has sides that enclose nothing."""
    import shapely

    return any("Line" in part.geom_type for part in shapely.get_parts(_filled([ring])[0]))


def _mended(path: Path, polygon: Any) -> str:
    """What the command that mends polygons makes of one."""
    import shapely

    if not np.isfinite(shapely.get_coordinates(polygon)).all():
        return "draw it anew"
    flat = [part for part in shapely.get_parts(shapely.make_valid(polygon)) if part.area > 0]
    count = sum(int(shapely.get_num_geometries(part)) for part in flat)
    area = sum(part.area for part in flat)
    return MENDED.format(path=path, parts="one polygon" if count == 1 else f"{count} polygons", area=area)
