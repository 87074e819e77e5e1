"""Outline or points of a vector file that a product is scored against."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runout.errors import ObservationError
from runout.io.polygons import read_frame
from runout.model.terrain import Terrain
from runout.scores.gauges import POINT_UNITS, Gauges
from runout.scores.read import observation_errors, read_gauges, read_outline


@dataclass(frozen=True)
class VectorContent:
    """An outline (shapely, map coordinates) or gauges, and what was changed on the way in."""

    outline: Any = None
    gauges: Gauges | None = None
    changes: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """ "outline" or "points"."""
        return "outline" if self.gauges is None else "points"


def read_vector(path: Path, terrain: Terrain, layer: str | None = None) -> VectorContent:
    """Outline of the polygons of a file, or its points with the attributes that are named as quantities.

    Raises
    ------
    ObservationError
        If it holds lines, several kinds of geometries, or points without such attributes.
    """
    with observation_errors():
        frame, _ = read_frame(path, layer, "observation")
    kinds = {str(geometry.geom_type).removeprefix("Multi") for geometry in frame.geometry if geometry is not None}
    if kinds == {"Polygon"}:
        outline, changes = read_outline(path, terrain, layer)
        return VectorContent(outline, None, changes)
    if kinds != {"Point"}:
        held = " and ".join(sorted(kinds)) or "no geometries"
        remedy = "a thalweg goes to --thalweg" if kinds == {"LineString"} else "write one kind into a file"
        raise ObservationError(f"{path}: holds {held}; an outline is polygons, gauges are points, {remedy}")
    named = {name: name for name in POINT_UNITS if name in frame.columns}
    if not named:
        have = ", ".join(map(str, frame.columns.drop(frame.geometry.name))) or "none"
        raise ObservationError(f"{path}: its points have none of the attributes {', '.join(POINT_UNITS)}; they have: {have}")
    gauges, changes = read_gauges(path, terrain, named, layer)
    return VectorContent(None, gauges, changes)
