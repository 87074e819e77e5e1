"""Finds overlapping polygons in bounded time, and cuts polygons so that none overlap."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

OVERLAP = 1e-6  # share of a polygon below which an overlap is round-off of shared borders
SLIVER = 1e-3  # cells of the terrain: smaller polygons and overlaps are what a GIS overlay leaves along shared borders
MOST_PAIRS = 30_000  # pairs with overlapping bounding boxes; with more pairs, polygons of equal value are united instead of cut


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
