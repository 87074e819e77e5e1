"""Writes outlines of releases, inundation, obstacles and friction zones to a GeoPackage, with styles."""

import json
import math
import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.io.atomic import storage_error, whole_file
from runout.io.grid import horizontal_crs
from runout.model.friction import FrictionZones
from runout.model.release import Release
from runout.model.terrain import Terrain
from runout.palettes import PROBABILITY_LEVELS

if TYPE_CHECKING:
    import geopandas as gpd
    from shapely import MultiPolygon

_GEOPACKAGE: dict[str, Any] = {"driver": "GPKG", "dataset_options": {"VERSION": "1.2"}}  # older programs open it without a warning

RELEASE_COLUMNS = (*("name", "source", "placement", "volume_m3", "area_m2", "mean_thickness_m", "max_thickness_m"), "geometry")


def write_outlines(
    path: str | os.PathLike[str],
    terrain: Terrain,
    releases: Sequence[Release],
    probability: np.ndarray,
    *,
    levels: Iterable[float] = PROBABILITY_LEVELS,
    attributes: dict[str, Any] | None = None,
    zones: FrictionZones | None = None,
    obstacles: Sequence[tuple[Any, float]] = (),
    styles: Mapping[str, str] | None = None,
    further: Mapping[str, tuple[str, list[dict[str, Any]]]] | None = None,
) -> Path:
    """Write a GeoPackage with the layers ``release`` and ``inundation`` in the system of the terrain; returns the path.

    Without releases, where all mass flows in, there is no layer ``release``.
    Where there are friction ``zones``, the layer ``friction_zones`` has their outlines, each with its ``factor`` [1] or
    ``basal_friction_angle_deg``; where there are ``obstacles``, the layer ``obstacles`` has theirs, with ``height_m``.

    Parameters
    ----------
    probability : ndarray (rows, columns)
        Probability of inundation [1].
    levels : iterable of float
        Probabilities [1]; each becomes one multipolygon of the cells with at least that probability. Levels that no
        cell reaches are left out.
    attributes : dict, optional
        Further columns of the layer ``inundation``, the same for every level.
    obstacles : sequence of (shapely geometry, float)
        Outlines in map coordinates, each with its height [m].
    styles : mapping of str to str, optional
        QGIS styles (QML) of layers by their names. They go to the table ``layer_styles``, where QGIS finds them.
    further : mapping of str to (str, list of dict), optional
        Further layers: type of geometry, and rows of columns with ``geometry`` (shapely, map coordinates).

    Raises
    ------
    StorageError
        If the disk is full or the folder cannot be written; an older file stays as it is.
    """
    layers = {"release": _release_frame(terrain, releases)} if releases else {}
    layers["inundation"] = _inundation_frame(terrain, np.asarray(probability), levels, attributes or {})
    if obstacles:
        layers["obstacles"] = _frame([{"height_m": height, "geometry": _multi(part)} for part, height in obstacles], terrain)
    if zones and zones.zones:
        layers["friction_zones"] = _zone_frame(terrain, zones)
    kinds = dict.fromkeys(layers, "MultiPolygon")
    for name, (kind, rows) in (further or {}).items():
        layers[name], kinds[name] = _frame(_of_kind(rows, kind), terrain), kind
    return _write(path, layers, kinds, styles or {})


def write_layers(
    path: str | os.PathLike[str],
    terrain: Terrain,
    layers: Mapping[str, tuple[str, list[dict[str, Any]]]],
    styles: Mapping[str, str] | None = None,
) -> Path:
    """Write a GeoPackage with layers in the system of the terrain; returns the path.

    ``layers``: type of geometry, and rows of columns with ``geometry`` (shapely, map coordinates). A layer without rows is left
    out. ``styles``: QGIS styles (QML) of layers by their names. Raises StorageError if the disk is full or the folder cannot be
    written; an older file stays as it is.
    """
    filled_layers = {name: (kind, rows) for name, (kind, rows) in layers.items() if rows}
    frames = {name: _frame(_of_kind(rows, kind), terrain) for name, (kind, rows) in filled_layers.items()}
    return _write(path, frames, {name: kind for name, (kind, _) in filled_layers.items()}, styles or {})


def _write(
    path: str | os.PathLike[str], layers: "Mapping[str, gpd.GeoDataFrame]", kinds: Mapping[str, str], styles: Mapping[str, str]
) -> Path:
    with whole_file(path) as temporary, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="'crs' was not provided")  # a local system has none
        try:
            for name, frame in layers.items():
                frame.to_file(temporary, layer=name, engine="pyogrio", geometry_type=kinds[name], **_GEOPACKAGE)
            _write_styles(temporary, {name: text for name, text in styles.items() if name in layers})
        except RuntimeError as cause:  # errors of pyogrio for data source, layer and feature
            raise storage_error(path, cause) from cause
    return Path(path)


def reaches(probability: np.ndarray, level: float) -> np.ndarray:
    """Cells of at least a level [1]. Both are compared as float32, as the files and the classes of the styles hold them."""
    return np.asarray(probability, np.float32) >= np.float32(level)


def outline(mask: np.ndarray, terrain: Terrain) -> "MultiPolygon":
    """Outline of the true cells (rows, columns) along the cell edges, in map coordinates [m]; holes are kept."""
    from rasterio.features import shapes
    from rasterio.transform import Affine
    from shapely import MultiPolygon, union_all
    from shapely.geometry import shape

    transform = Affine(terrain.cell_size[0], 0.0, terrain.extent[0], 0.0, -terrain.cell_size[1], terrain.extent[3])
    cells = np.ascontiguousarray(mask, dtype=np.uint8)
    merged = union_all([shape(polygon) for polygon, _ in shapes(cells, mask=cells > 0, transform=transform)])
    return merged if merged.geom_type == "MultiPolygon" else MultiPolygon([] if merged.is_empty else [merged])


def _write_styles(path: Path, styles: Mapping[str, str]) -> None:
    """Add the table ``layer_styles``, in which QGIS keeps the styles of a GeoPackage, if there are styles."""
    import pandas as pd
    import pyogrio

    if not styles:
        return
    rows = [
        {
            "f_table_catalog": "",
            "f_table_schema": "",
            "f_table_name": name,
            "f_geometry_column": "geom",
            "styleName": name,
            "styleQML": text,
            "styleSLD": "",
            "useAsDefault": True,
            "description": "",
            "owner": "",
            "ui": None,
        }
        for name, text in styles.items()
    ]
    frame = pd.DataFrame(rows).assign(update_time=pd.Timestamp(datetime.now(UTC)))
    pyogrio.write_dataframe(frame, path, layer="layer_styles", layer_options={"FID": "id"}, **_GEOPACKAGE)


def _release_frame(terrain: Terrain, releases: Sequence[Release]) -> "gpd.GeoDataFrame":
    rows = [
        {
            "name": release.name,
            "source": Path(release.source).name,
            "placement": str(release.placement),
            "volume_m3": release.volume,
            "area_m2": release.area,
            "mean_thickness_m": release.volume / release.area,
            "max_thickness_m": float(release.thickness.max()),
            "geometry": _multi(release.outline) if release.outline is not None else outline(release.thickness > 0, terrain),
        }
        for release in releases
    ]
    return _frame(rows, terrain, RELEASE_COLUMNS)


def _zone_frame(terrain: Terrain, zones: FrictionZones) -> "gpd.GeoDataFrame":
    rows = [
        {
            "factor": zone.get("factor"),
            "basal_friction_angle_deg": math.degrees(math.atan(zone["coefficient"])) if "coefficient" in zone else None,
            **({"parameters": json.dumps(zone["parameters"])} if "parameters" in zone else {}),
            "geometry": _multi(zone["geometry"]),
        }
        for zone in zones.zones
    ]
    frame = _frame(rows, terrain)
    return frame.astype({"factor": float, "basal_friction_angle_deg": float})


def _inundation_frame(
    terrain: Terrain, probability: np.ndarray, levels: Iterable[float], attributes: dict[str, Any]
) -> "gpd.GeoDataFrame":
    rows = []
    for level in sorted(levels):
        inundated = reaches(probability, level)
        if inundated.any():
            area = float(inundated.sum() * terrain.cell_area)
            rows.append({"probability": level, "area_m2": area, **attributes, "geometry": outline(inundated, terrain)})
    return _frame(rows, terrain, ["probability", "area_m2", *attributes, "geometry"])


def _frame(rows: list[dict[str, Any]], terrain: Terrain, columns: Sequence[str] | None = None) -> "gpd.GeoDataFrame":
    import geopandas as gpd

    return gpd.GeoDataFrame(
        rows, columns=columns, geometry="geometry", crs=None if terrain.crs is None else horizontal_crs(terrain.crs)
    )


def _of_kind(rows: list[dict[str, Any]], kind: str) -> list[dict[str, Any]]:
    """Rows whose polygons are multipolygons where the layer holds these."""
    return [row | {"geometry": _multi(row["geometry"])} for row in rows] if kind == "MultiPolygon" else rows


def _multi(geometry: Any) -> "MultiPolygon":
    """Polygons of a geometry, without the lines and points that remain where a border only touches the edge of the map."""
    from shapely import MultiPolygon, get_parts

    return MultiPolygon([part for part in get_parts(get_parts(geometry)) if part.geom_type == "Polygon"])
