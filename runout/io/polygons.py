"""Reads and checks the polygons of a vector file and transforms them to the map coordinates of the terrain.

Overlaps are found in bounded time, and polygons are cut so that none overlap.
"""

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import ReleaseError
from runout.io.boundary import exists, names_in
from runout.io.opening import open_vector
from runout.io.polygon_reproject import polygons_on_terrain
from runout.model.limits import checked, checked_within
from runout.model.parameters import Parameter
from runout.model.terrain import Terrain

OVERLAP = 1e-6  # share of a polygon below which an overlap is round-off of shared borders
SLIVER = 1e-3  # cells of the terrain: smaller polygons and overlaps are what a GIS overlay leaves along shared borders
MOST_PAIRS = 30_000  # pairs with overlapping bounding boxes; with more pairs, polygons of equal value are united instead of cut
NAMED = 5  # pairs or polygons that a message names
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
    "nested shells": ("one of its parts lies in another", "delete the inner part, which would count twice, or make it a hole"),
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


@dataclass(frozen=True)
class Overlaps:
    """Overlaps of polygons."""

    # first, second: (m,): positions of the polygons of each pair with a common area, the first one smaller
    first: np.ndarray
    second: np.ndarray
    area: np.ndarray  # (m,): the common area [m2]
    counts: np.ndarray  # (m,) of bool: whether it is more than round-off and than a sliver
    complete: bool  # False if there are too many pairs to examine all of them
    slivers: np.ndarray  # (m,) of bool: whether it is more than round-off and less than a sliver

    def sliver_sentences(self, source: Path) -> tuple[str, ...]:
        """A sentence on the slivers, if there are such."""
        if not self.slivers.any():
            return ()
        few, area = int(self.slivers.sum()), float(self.area[self.slivers].sum())
        of = f"{source}: {few} overlaps of polygons below {SLIVER:g} cells of the terrain"
        return (f"{of}, {area:.3g} m2 in all, are left to the first polygon of each pair.",)


def overlaps_of(polygons: np.ndarray, values: np.ndarray | None, least: float = 0.0) -> Overlaps:
    """Overlaps of polygons (n,); those below a ``least`` area [m2] are slivers.

    If there are too many pairs, those of different ``values`` (n,) are examined first.
    """
    import shapely

    first, second = shapely.STRtree(polygons).query(polygons)
    pairs = first < second
    first, second = first[pairs], second[pairs]
    complete = len(first) <= MOST_PAIRS
    if not complete:
        differ = np.zeros(len(first), bool) if values is None else values[first] != values[second]
        chosen = np.argsort(~differ, kind="stable")[:MOST_PAIRS]
        first, second = first[chosen], second[chosen]
    common = shapely.area(shapely.intersection(polygons[first], polygons[second]))
    some = common > 0
    first, second, common = first[some], second[some], common[some]
    areas = shapely.area(polygons)
    beyond = common > OVERLAP * np.minimum(areas[first], areas[second])
    return Overlaps(first, second, common, beyond & (common >= least), complete, beyond & (common < least))


def cut(polygons: np.ndarray, values: np.ndarray | None, overlaps: Overlaps) -> np.ndarray:
    """Polygons (n,) without overlaps: a common area is left to the first of its polygons.

    With too many pairs, polygons of equal value are united: the first holds the union, the others are empty.
    """
    import shapely

    if not overlaps.complete:
        return _united(polygons, np.zeros(len(polygons)) if values is None else values)
    result = polygons.copy()
    if not len(overlaps.second):
        return result
    order = np.argsort(overlaps.second, kind="stable")
    first, second = overlaps.first[order], overlaps.second[order]
    starts = np.flatnonzero(np.diff(second, prepend=-1))
    for start, end in zip(starts, [*starts[1:], len(second)], strict=True):
        earlier = shapely.union_all(polygons[first[start:end]])
        result[second[start]] = polygonal(shapely.difference(polygons[second[start]], earlier))
    return result


def _united(polygons: np.ndarray, values: np.ndarray) -> np.ndarray:
    import shapely

    result = np.full(len(polygons), shapely.MultiPolygon(), dtype=object)
    taken = shapely.MultiPolygon()
    for value in dict.fromkeys(values.tolist()):  # in the order of the file
        same = np.flatnonzero(values == value)
        result[same[0]] = polygonal(shapely.difference(shapely.union_all(polygons[same]), taken))
        taken = shapely.union(taken, result[same[0]])
    return result


def polygonal(geometry: Any) -> Any:
    """Polygons of a geometry, without the points and lines that cutting along a shared border can leave."""
    import shapely

    parts = [g for g in shapely.get_parts(geometry) if g.geom_type == "Polygon"]
    return shapely.MultiPolygon(parts)


def is_missing(value: Any) -> bool:
    """Whether an attribute of a feature is empty; a list, which GeoJSON allows, is a value."""
    import pandas

    return bool(pandas.api.types.is_scalar(value) and pandas.isna(value))


@dataclass(frozen=True)
class PolygonLayer:
    """Polygons of a layer."""

    source: Path  # the file
    polygons: np.ndarray  # (n,) of shapely Polygon or MultiPolygon: valid, two-dimensional, in the terrain's map coordinates
    attributes: Any  # pandas.DataFrame: one row a polygon
    changes: tuple[str, ...] = ()  # assumptions and changes, one sentence each
    least_area: float = 0.0  # area [m2] below which a common part of polygons is a sliver of an overlay

    def number(self, row: int) -> int:
        """Number of a polygon among the features of the file, from 1."""
        return int(self.attributes.index[row]) + 1

    def numbers(self, attribute: str, what: str) -> np.ndarray:
        """Values (n,) of a numeric attribute; ReleaseError if it is missing, not numeric, or has empty values."""
        import pandas

        if attribute not in self.attributes:
            raise ReleaseError(self.lacks(attribute, what))
        column = self.attributes[attribute]
        kinds = pandas.api.types
        other = kinds.is_datetime64_any_dtype(column) or kinds.is_timedelta64_dtype(column) or kinds.is_bool_dtype(column)
        converted = pandas.Series(np.nan, column.index) if other else column  # dates and truth values would become numbers
        values = pandas.to_numeric(converted, errors="coerce").to_numpy(np.float64)
        unusable = np.flatnonzero(~np.isfinite(values))
        if len(unusable):
            first = unusable[0]
            content = "empty" if is_missing(column.iloc[first]) else repr(column.iloc[first])
            raise ReleaseError(
                f"{self.source}: attribute {attribute!r} of polygon {self.number(first)} is {content}; "
                f"every polygon needs a number for its {what}"
            )
        return values

    def stated(self, entry: float | str, quantity: str, key: str = "") -> np.ndarray:
        """Values (n,) of a quantity of :data:`runout.model.limits.LIMITS`: one number for all polygons, or those of an attribute.

        ``key`` is what site.yaml calls it, for messages; the name of the quantity by default. Raises ReleaseError if an attribute
        is missing or no number, or a value lies outside the limits; names the polygon.
        """
        place = str(self.source)
        if not isinstance(entry, str):
            return np.full(len(self.polygons), checked(quantity, entry, place=place, key=key, error=ReleaseError))
        values = self.numbers(entry, key or quantity.replace("_", " "))
        for row, value in enumerate(values):
            key = f"attribute {entry!r} of polygon {self.number(row)}"
            checked(quantity, float(value), place=place, key=key, error=ReleaseError)
        return values

    def within(self, entry: float | str, parameter: Parameter) -> np.ndarray:
        """Values (n,) of a parameter of a law: one number for all polygons, or of an attribute; errors as of :meth:`stated`."""
        assert parameter.valid is not None  # a number
        if not isinstance(entry, str):
            what = f"{self.source}: {parameter.key}"
            return np.full(len(self.polygons), checked_within(parameter.valid, what, entry, error=ReleaseError))
        values = self.numbers(entry, parameter.key)
        for row, value in enumerate(values.tolist()):
            what = f"{self.source}: attribute {entry!r} of polygon {self.number(row)}"
            checked_within(parameter.valid, what, value, error=ReleaseError)
        return values

    def numeric_attributes(self) -> str:
        """Names of the numeric attributes, for messages."""
        return ", ".join(self.attributes.select_dtypes("number").columns) or "none"

    def lacks(self, attribute: str, what: str) -> str:
        """Message on an attribute that the layer does not have, with the nearest that it has."""
        number = re.match(r"\s*[-+]?\d+([.,]\d+)?", attribute)
        meant = f"; for a number write {number[0].strip().replace(',', '.')}, without a unit" if number else ""
        return f"{self.source}: no attribute {attribute!r} for the {what}{meant or self._nearest(attribute)}"

    def _nearest(self, attribute: str) -> str:
        near = difflib.get_close_matches(attribute, map(str, self.attributes.columns), n=1, cutoff=0.4)
        asked = f"; did you mean {near[0]!r}?" if near else ";"
        return f"{asked} numeric attributes: {self.numeric_attributes()}"


def read_polygons(
    path: Path,
    terrain: Terrain,
    layer: str | None = None,
    what: str = "release",
    faults: list[str] | None = None,
    key: str = "layer",
) -> PolygonLayer:
    """Polygons of a GeoPackage, Shapefile, GeoJSON or FlatGeobuf; ``what`` names them in messages, ``key`` what chooses the layer.

    A list of ``faults`` takes the messages on polygons that are not valid, which are then left out. Slivers below a thousandth of a
    cell of the terrain are left out with a sentence. Raises ReleaseError for a missing or unreadable file, unknown layer, a
    coordinate system without known transformation, no features, points or lines, features without a geometry, or polygons that are
    not valid: each with its place and its own remedy.
    """
    drawn = read_drawn(path, terrain, layer, what, key)
    geometry, invalid = drawn.polygons, _invalid(drawn, what)
    if invalid and faults is None:
        raise ReleaseError(_joined(list(invalid.values())))
    if faults is not None:
        faults += invalid.values()
    sound = np.array([row not in invalid for row in range(len(geometry))])
    return replace(drawn, polygons=geometry[sound], attributes=drawn.attributes[sound])


def read_drawn(path: Path, terrain: Terrain, layer: str | None, what: str, key: str = "layer") -> PolygonLayer:
    """:func:`read_polygons` without the check, slow for many points, that no polygon crosses itself."""
    frame, driver = read_frame(path, layer, what, key)
    if len(frame) == 0:
        raise ReleaseError(f"{path}: the layer is empty; draw at least one {what} polygon")
    frame, changes = polygons_on_terrain(path, frame, driver, terrain)
    geometry = frame.geometry.force_2d().to_numpy()
    _require_polygons(path, geometry, what)
    least = SLIVER * terrain.cell_area
    geometry, notes = _without_slivers(path, geometry, least)
    remaining = np.array([one is not None for one in geometry])
    attributes = frame.drop(columns=frame.geometry.name).reset_index(drop=True)
    return PolygonLayer(path, geometry[remaining], attributes[remaining], (*changes, *notes), least)


def read_frame(path: Path, layer: str | None, what: str, key: str = "layer") -> tuple[Any, str]:
    """Frame of the layer and the name of the GDAL driver; ``key`` is what messages call the choice of a layer."""
    if not exists(path):
        near = difflib.get_close_matches(path.name, names_in(path.parent), n=1)
        raise ReleaseError(f"{path}: no such file" + (f"; did you mean {path.with_name(near[0])}?" if near else "; check the path"))
    file = open_vector(path, ReleaseError)
    return file.read(_layer(path, file.layers(), layer, what, key))


def _layer(path: Path, layers: list[str], layer: str | None, what: str, key: str) -> str:
    if not layers:
        raise ReleaseError(f"{path}: holds a table but no geometries; write the {what} into it")
    if layer is None and len(layers) > 1:
        names = f"holds {len(layers)} layers ({', '.join(layers)})"
        raise ReleaseError(
            f"{path}: {names}; name the one with the {what}, for example {key}{' ' if key.startswith('--') else ': '}{layers[0]}"
        )
    if layer is not None and layer not in layers:
        near = difflib.get_close_matches(layer, layers, n=1, cutoff=0.4)
        question = f"did you mean {near[0]!r}? " if near else ""
        raise ReleaseError(f"{path}: no layer {layer!r}; {question}layers: {', '.join(layers)}")
    return layer or layers[0]


def _require_polygons(path: Path, geometry: np.ndarray, what: str) -> None:
    import shapely

    empty = np.flatnonzero(shapely.is_missing(geometry) | shapely.is_empty(geometry))
    if len(empty):
        raise ReleaseError(f"{path}: feature {empty[0] + 1} has no geometry; delete it or draw its polygon")
    other = sorted({g.geom_type for g in geometry} - {"Polygon", "MultiPolygon"})
    if other:
        raise ReleaseError(f"{path}: holds {' and '.join(other)}; draw polygons around the {what}")


def _without_slivers(path: Path, geometry: np.ndarray, least: float) -> tuple[np.ndarray, tuple[str, ...]]:
    """Polygons (n,) without parts below a ``least`` area [m2], None for those that are nothing else; a sentence if there are such.

    If all parts are as small, the layer was drawn so, and stays.
    """
    import shapely

    parts, row = shapely.get_parts(geometry, return_index=True)
    small = shapely.area(parts) < least
    hull = shapely.area(shapely.convex_hull(parts[small]))  # the lobes of a ring that crosses itself take off from each other
    small[small] = shapely.is_valid(parts[small]) | ((hull > 0) & (hull < least))
    if not small.any() or small.all():
        return geometry, ()
    cleaned = geometry.copy()
    for number in np.unique(row[small]):
        own = parts[(row == number) & ~small]
        cleaned[number] = shapely.MultiPolygon(list(own)) if len(own) else None
    area = float(shapely.area(parts[small]).sum())
    note = f"{path}: {int(small.sum())} slivers below {SLIVER:g} cells of the terrain are left out, {area:.3g} m2 in all."
    return cleaned, (note,)


def _invalid(layer: PolygonLayer, what: str) -> dict[int, str]:
    """Messages on the polygons that are not valid, by their rows."""
    import shapely

    rows = np.flatnonzero(~shapely.is_valid(layer.polygons)).tolist()
    return {row: fault_message(layer.source, layer.number(row), layer.polygons[row], what) for row in rows}


def _joined(messages: Sequence[str]) -> str:
    """The first messages in lines, and how many more there are."""
    more = len(messages) - NAMED
    return "\n".join([*messages[:NAMED], *([f"and {more} polygons more are not valid"] if more > 0 else [])])


def without_overlap(
    layer: PolygonLayer, values: np.ndarray | None, what: str = "thickness", unit: str = " m", told: Sequence[str] | None = None
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Polygons (n,) without overlaps, and the sentences that report them; a common area is left to the first of its polygons.

    ``values`` (n,): thickness [m], or the quantity ``what`` in ``unit``; None if all polygons have one value. ``told``: what
    messages say of the value of each polygon, in place of the number. Raises ReleaseError if polygons of different values overlap,
    since the value of the common area is ambiguous.
    """
    import shapely

    overlaps = overlaps_of(layer.polygons, values, layer.least_area)
    first, second, common, counts = overlaps.first, overlaps.second, overlaps.area, overlaps.counts
    for i, j, area in zip(first[counts], second[counts], common[counts], strict=True):
        if values is not None and values[i] != values[j]:
            one, other = (told[k] if told else f"{values[k]:g}{unit}" for k in (i, j))
            raise ReleaseError(
                f"{layer.source}: polygons {layer.number(i)} ({one}) and {layer.number(j)} ({other}) overlap by "
                f"{area:.6g} m2; cut one of them back so that every place has one {what}"
            )
    polygons = cut(layer.polygons, values, overlaps)
    sentences = overlaps.sliver_sentences(layer.source)
    if not counts.any():
        return polygons, sentences
    total = shapely.area(layer.polygons).sum() - shapely.area(polygons).sum()
    pairs = sorted(zip(first[counts].tolist(), second[counts].tolist(), strict=True))
    named = ", ".join(f"{layer.number(i)} and {layer.number(j)}" for i, j in pairs[:NAMED])
    if len(pairs) > NAMED or not overlaps.complete:
        named += f" and {'more than ' * (not overlaps.complete)}{len(pairs) - NAMED} pairs more"
    return polygons, (
        *sentences,
        f"{layer.source}: polygons {named} overlap and have one {what}; the common {total:.6g} m2 count once.",
    )


def fault_message(path: Path, number: int, polygon: Any, what: str) -> str:
    """Message on polygon ``number`` (from 1) of a file that is not valid: what is wrong, where, and the remedy.

    ``polygon``: in the map coordinates of the terrain [m]. ``what``: what the polygon stands for, such as "release".
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
