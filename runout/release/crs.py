"""Coordinate systems of release files compared with the terrain's."""

from pathlib import Path
from typing import Any

from runout.errors import ReleaseError
from runout.model.terrain import Terrain


def stated_crs(crs: Any) -> Any:
    """Horizontal :class:`pyproj.CRS` that a file states, or None if it states none (or an undefined one)."""
    import pyproj

    if not crs:
        return None
    crs = pyproj.CRS.from_user_input(crs)
    if crs.is_compound:
        crs = crs.sub_crs_list[0]
    return None if crs.is_engineering or crs.name.lower().startswith(("undefined", "unknown")) else crs


def same_crs(a: Any, b: Any) -> bool:
    """Whether two :class:`pyproj.CRS` are the same up to axis order and the way they are written."""
    if a.equals(b, ignore_axis_order=True):
        return True
    code = a.to_epsg(min_confidence=70)
    return code is not None and code == b.to_epsg(min_confidence=70)


def crs_name(crs: Any) -> str:
    """``EPSG:32616 (WGS 84 / UTM zone 16N)``."""
    code = crs.to_epsg(min_confidence=70)
    return f"EPSG:{code} ({crs.name})" if code else crs.name


def require_terrain_crs(path: Path, crs: Any, terrain: Terrain, command: str) -> tuple[str, ...]:
    """Sentences on what was assumed about the coordinate system of a file.

    Parameters
    ----------
    path : Path
        The file, for messages.
    crs : anything pyproj reads, or None
        What the file states.
    terrain : Terrain
        Whose system it must be in.
    command : str
        GDAL command that reprojects such a file: ``ogr2ogr`` or ``gdalwarp``.

    Raises
    ------
    ReleaseError
        If both state one and they differ, or the file is in degrees and the terrain states none.
    """
    stated, wanted = stated_crs(crs), stated_crs(terrain.crs)
    if stated is None:
        return () if wanted is None else (f"{path} states no coordinate system; taken to be in the terrain's, {crs_name(wanted)}.",)
    if wanted is None:
        if stated.is_geographic:
            raise ReleaseError(
                f"{path} is in degrees ({crs_name(stated)}), and the terrain {terrain.source} states no coordinate system; "
                "state the terrain's (terrain.crs in site.yaml) and reproject the release to it"
            )
        return (
            f"{path} is in {crs_name(stated)}, the terrain {terrain.source} states no coordinate system; taken to be the same.",
        )
    if not same_crs(stated, wanted):
        code = wanted.to_epsg(min_confidence=70)
        target = f"EPSG:{code}" if code else f'"{wanted.to_string()}"'
        order = f"reprojected{path.suffix} {path}" if command == "ogr2ogr" else f"{path} reprojected{path.suffix}"
        raise ReleaseError(
            f"{path} is in {crs_name(stated)}, the terrain {terrain.source} in {crs_name(wanted)}; "
            f"reproject it: {command} -t_srs {target} {order}"
        )
    return ()
