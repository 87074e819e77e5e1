"""Probes as layers of ``outlines.gpkg``."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from runout.model.probes import Probes


def probe_layers(probes: "Probes | None") -> dict[str, tuple[str, list[dict[str, Any]]]]:
    """Layers ``probes`` and ``cross_sections``: type of geometry, and rows with ``name`` and ``geometry``; none without probes."""
    from shapely import LineString, Point

    if probes is None:
        return {}
    points = [{"name": p.name, "geometry": Point(p.easting, p.northing)} for p in probes.points]
    lines = [{"name": s.name, "length_m": s.length, "geometry": LineString(s.vertices)} for s in probes.cross_sections]
    found = {"probes": ("Point", points), "cross_sections": ("LineString", lines)}
    return {name: layer for name, layer in found.items() if layer[1]}
