"""Compares coordinate systems of release files with that of the terrain, by definition and not by name."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import ReleaseError
from runout.io.crs import horizontal, names_datum, same, same_ellipsoid
from runout.model.terrain import Terrain

SAME_PLACE = 1e-3  # largest difference of coordinates that are taken to be equal [m]

Points = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class ToTerrain:
    """Transformation from the coordinates of a file to those of the terrain."""

    # forward, inverse: map coordinates (n, 2) of the file to those of the terrain [m], and back; None if both are the same
    forward: Points | None
    inverse: Points | None
    sentences: tuple[str, ...]  # assumptions and changes, one sentence each


def stated_crs(crs: Any) -> Any:
    """Horizontal :class:`pyproj.CRS` that a file states; None if it states none or an explicitly undefined one.

    The definition decides: a system without a name is used, a local or "undefined" one is not.
    """
    import pyproj
    from pyproj.exceptions import CRSError

    if not crs:
        return None
    try:
        crs = pyproj.CRS.from_user_input(crs)
    except CRSError as error:
        remedy = "write the right one into the file, for example with `gdal_edit.py -a_srs EPSG:CODE`"
        raise ReleaseError(f"the coordinate system {str(crs)[:60]!r} is not understood ({error}); {remedy}") from error
    if crs.is_engineering or (crs.is_geographic and crs.name.lower().startswith("undefined")):
        return None
    return horizontal(crs)


def crs_name(crs: Any) -> str:
    """Code and name, ``EPSG:32616 (WGS 84 / UTM zone 16N)``; for a system with neither, its parameters."""
    import warnings

    code = crs.to_epsg(min_confidence=70) if names_datum(crs) else None
    if code:
        return f"EPSG:{code} ({crs.name})"
    if crs.name.lower() not in ("unknown", "unnamed", ""):
        return str(crs.name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # warning of pyproj that PROJ text is not a complete definition
        return crs.to_proj4() or "a system without a name"


def to_terrain(path: Path, crs: Any, terrain: Terrain, bounds: Any, command: str) -> ToTerrain:
    """Transformation from the coordinates of a file to those of the terrain.

    A file without a system is taken to be in that of the terrain. If only the system of the elevation file, before projection,
    places it on the terrain, that system is taken.

    Parameters
    ----------
    path : Path
        The file, for messages.
    crs : anything pyproj reads, or None
        System that the file states.
    terrain : Terrain
        Terrain of the target system.
    bounds : sequence of float
        West, south, east and north edge of the content, in the coordinates of the file.
    command : str
        GDAL command that reprojects such a file: ``ogr2ogr`` or ``gdalwarp``.

    Raises
    ------
    ReleaseError
        If no transformation is known, or the file is in degrees and the terrain states no system.
    """
    source, target = stated_crs(crs), stated_crs(terrain.crs)
    if source is None:
        return _unstated(path, target, terrain, np.asarray(bounds, float), command)
    if target is not None:
        return _between(path, source, target, terrain, command)
    if source.is_geographic:
        raise ReleaseError(
            f"{path} is in degrees ({crs_name(source)}), and the terrain {terrain.source} states no coordinate system; "
            "state the terrain's (terrain.crs in site.yaml)"
        )
    assumed = f"{path} is in {crs_name(source)}, the terrain {terrain.source} states no coordinate system; taken to be the same."
    return ToTerrain(None, None, (assumed,))


def _unstated(path: Path, target: Any, terrain: Terrain, bounds: np.ndarray, command: str) -> ToTerrain:
    if target is None:
        return ToTerrain(None, None, ())
    own = stated_crs(terrain.own_crs)
    if own is not None and not _meets(bounds, terrain.extent):
        change = _between(path, own, target, terrain, command)
        if change.forward is not None and _meets(_moved_bounds(change.forward, bounds), terrain.extent):
            note = f"{path} states no coordinate system; taken to be in that of the elevation raster's file, {crs_name(own)}."
            return ToTerrain(change.forward, change.inverse, (note, *change.sentences))
    return ToTerrain(None, None, (f"{path} states no coordinate system; taken to be in the terrain's, {crs_name(target)}.",))


def _between(path: Path, source: Any, target: Any, terrain: Terrain, command: str) -> ToTerrain:
    """Transformation between two known systems; none if both are the same."""
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    named = names_datum(source) and names_datum(target)
    if same(source, target) and (named or source == target):
        return ToTerrain(None, None, ())
    if terrain.own_crs and _is_own(source, stated_crs(terrain.own_crs), target, terrain):
        return _as_elevations(path, source, target, terrain)
    if {axis.direction for axis in source.axis_info} == {"west", "south"}:
        raise ReleaseError(
            f"{path} is in {crs_name(source)}, whose axes point west and south: files in it disagree on what they mean; "
            f"write it in a system with eastings and northings, for example {command} -t_srs EPSG:5514 for EPSG:5513"
        )
    both = f"{path} is in {crs_name(source)}, the terrain {terrain.source} in {crs_name(target)}"
    if not named and not same_ellipsoid(source, target):
        raise ReleaseError(
            f"{both}; one of them names no datum, and the ellipsoids differ, so positions are uncertain by about 100 m; "
            f"write the right system into the file, for example {command} -a_srs EPSG:CODE"
        )
    try:
        transformer = Transformer.from_crs(
            source, target, always_xy=True, allow_ballpark=not named, area_of_interest=_area(target, terrain.extent)
        )
        change = _tried(transformer, terrain)
    except ProjError as error:
        raise ReleaseError(f"{both}; no transformation between them is known here ({error}); {_remedy(path, command)}") from error
    if change.forward is None:
        return ToTerrain(
            None, None, (f"{both}; their coordinates agree to {1e3 * SAME_PLACE:g} mm here and are taken as they are.",)
        )
    datum = "" if named else "; one of them names no datum, which is taken to be that of the other"
    note = f"{path}: transformed from {crs_name(source)} to the terrain's {crs_name(target)} ({_operation(transformer)}){datum}."
    return ToTerrain(change.forward, change.inverse, (note,))


def _is_own(source: Any, own: Any, target: Any, terrain: Terrain) -> bool:
    """Whether a system equals that of the elevation file. Without a datum, ellipsoid and coordinates are compared."""
    from pyproj import Transformer

    if own is None or same(source, own):
        return own is not None
    if names_datum(source) or names_datum(own) or not same_ellipsoid(source, own):
        return False
    corners = _corners(terrain.extent)
    x, y = Transformer.from_crs(own, target, always_xy=True).transform(corners[:, 0], corners[:, 1], direction="INVERSE")
    there = Transformer.from_crs(own, source, always_xy=True).transform(x, y)
    return bool(np.allclose(there, (x, y), rtol=1e-10, atol=0.0))


def _as_elevations(path: Path, source: Any, target: Any, terrain: Terrain) -> ToTerrain:
    """The transformation that the elevations had from the system of their file to that of the terrain."""
    from pyproj import Transformer

    transformer = Transformer.from_crs(source, target, always_xy=True)
    change = _tried(transformer, terrain)
    note = f"{path}: transformed as the elevations were, from {crs_name(source)} to {crs_name(target)} ({_operation(transformer)})."
    return ToTerrain(change.forward, change.inverse, (note,))


def _tried(transformer: Any, terrain: Terrain) -> ToTerrain:
    """Both directions of a transformer; none if it does not move the corners of the terrain."""
    from pyproj.exceptions import ProjError

    def inverse(points: np.ndarray) -> np.ndarray:
        return np.column_stack(transformer.transform(points[:, 0], points[:, 1], direction="INVERSE"))

    def forward(points: np.ndarray) -> np.ndarray:
        return np.column_stack(transformer.transform(points[:, 0], points[:, 1]))

    corners = _corners(terrain.extent)
    there = inverse(corners)
    back = forward(there)
    if not np.isfinite(back).all():
        raise ProjError("the terrain lies outside the area of one of them")
    stays = np.abs(there - corners).max() < SAME_PLACE
    return ToTerrain(None, None, ()) if stays else ToTerrain(forward, inverse, ())


def _operation(transformer: Any) -> str:
    """Steps of a transformer that has been used, and its accuracy as PROJ states it."""
    used = transformer.get_last_used_operation()
    accuracy = f"accuracy {used.accuracy:g} m" if used.accuracy is not None and used.accuracy >= 0 else "accuracy not stated"
    parts = [part for part in used.description.split(" + ") if not part.startswith("axis order change")]
    return f"{' + '.join(parts)}; {accuracy}"


def _area(crs: Any, extent: tuple[float, float, float, float]) -> Any:
    from pyproj import Transformer
    from pyproj.aoi import AreaOfInterest

    edges = Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform_bounds(*extent)
    return AreaOfInterest(*edges) if np.isfinite(edges).all() else None


def _corners(bounds: Any) -> np.ndarray:
    west, south, east, north = bounds
    return np.array([(west, south), (west, north), (east, south), (east, north), ((west + east) / 2, (south + north) / 2)])


def _moved_bounds(forward: Points, bounds: np.ndarray) -> np.ndarray:
    moved = forward(_corners(bounds))
    return np.concatenate([moved.min(axis=0), moved.max(axis=0)]) if np.isfinite(moved).all() else np.full(4, np.nan)


def _meets(bounds: np.ndarray, extent: tuple[float, float, float, float]) -> bool:
    """Whether two boxes intersect."""
    west, south, east, north = extent
    return bool(bounds[0] <= east and bounds[2] >= west and bounds[1] <= north and bounds[3] >= south)


def _remedy(path: Path, command: str) -> str:
    order = f"reprojected{path.suffix} {path}" if command == "ogr2ogr" else f"{path} reprojected{path.suffix}"
    return f"reproject it where the grids of both are there: {command} -t_srs EPSG:CODE {order}"
