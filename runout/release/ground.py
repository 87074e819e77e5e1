"""Checks that a release lies inside the terrain and on known elevations."""

from typing import Any

import numpy as np

from runout.errors import ReleaseError
from runout.model.terrain import Terrain

SHOWN = 3  # cells named in a message
DEGREES = 360.0  # largest coordinate that can be an angle


def require_inside(outline: Any, terrain: Terrain, source: str) -> None:
    """Raise ReleaseError unless a polygon in map coordinates lies inside the terrain; states where and how far it leaves it."""
    import shapely

    west, south, east, north = terrain.extent
    window = shapely.box(west, south, east, north)
    if window.covers(outline):
        return
    inside = shapely.intersection(outline, window).area / outline.area
    w, s, e, n = outline.bounds
    beyond = {"west": west - w, "south": south - s, "east": e - east, "north": n - north}
    sides = ", ".join(f"{by:.6g} m beyond the {side} edge" for side, by in beyond.items() if by > 0)
    extents = f"release {_extent(w, s, e, n)}, terrain {_extent(west, south, east, north)}"
    if inside == 0:
        raise ReleaseError(f"{source} lies outside the terrain {terrain.source} ({extents}); {_way_back(outline, window)}")
    raise ReleaseError(
        f"{source} reaches {sides} of the terrain {terrain.source} ({1 - inside:.1%} of its area; {extents}); "
        "use a larger DEM or cut the polygon"
    )


def _way_back(outline: Any, window: Any) -> str:
    """Remedy for a polygon that lies wholly outside the window of the terrain."""
    import shapely

    west, south, east, north = window.bounds
    if window.intersects(shapely.transform(outline, lambda points: points[:, ::-1])):
        return "with easting and northing exchanged it lies inside; exchange the two in its file"
    if window.distance(outline) <= float(np.hypot(east - west, north - south)):
        return "use a DEM that covers it, or move the polygon"
    if np.abs(shapely.get_coordinates(outline)).max() <= DEGREES < max(map(abs, window.bounds)):
        return "its coordinates look like degrees; state their system: `ogr2ogr -a_srs EPSG:4326 placed.gpkg FILE`"
    return "check the coordinate system of both, or use a DEM that covers it"


def _extent(west: float, south: float, east: float, north: float) -> str:
    return f"easting {west:.2f} to {east:.2f}, northing {south:.2f} to {north:.2f}"


def require_elevation(thickness: np.ndarray, terrain: Terrain, source: str) -> None:
    """Raise ReleaseError if cells with thickness (rows, columns) have no elevation; names the first ones."""
    unknown = (thickness > 0) & np.isnan(terrain.elevation)
    if not unknown.any():
        return
    rows, columns = np.nonzero(unknown)
    cells = "; ".join(
        f"row {r}, column {c} (easting {terrain.easting[c]:.2f}, northing {terrain.northing[r]:.2f})"
        for r, c in zip(rows[:SHOWN], columns[:SHOWN], strict=True)
    )
    more = f" and {len(rows) - SHOWN} more" if len(rows) > SHOWN else ""
    raise ReleaseError(
        f"{terrain.source}: {len(rows)} of {int((thickness > 0).sum())} cells under the release {source} have no elevation: "
        f"{cells}{more}; fill them (gdal_fillnodata.py) or move the release"
    )
