"""Reads releases from vector files, thickness rasters and arrays."""

import logging
import math
from enum import StrEnum
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import ReleaseError, member_of
from runout.io.boundary import as_path
from runout.io.elevation_raster import ElevationRaster, Header
from runout.io.layer_crs import ToTerrain, to_terrain
from runout.io.polygon_coverage import SAME_EDGE, covered_window, regrid
from runout.io.polygon_reproject import raster_on_terrain
from runout.io.polygons import PolygonLayer, read_polygons, without_overlap
from runout.io.window import LARGEST_WHOLE, Bounds
from runout.model.limits import LIMITS, checked
from runout.model.materials import Material
from runout.model.pore_pressure import PorePressure
from runout.model.release import Edge, Placement, Release
from runout.model.terrain import Terrain
from runout.release.ground import require_elevation, require_inside
from runout.terrain.source import THICKNESS, errors_as, north_up_in_unit_of, open_source, require_straight

log = logging.getLogger(__name__)

LEAST_COVER = 0.01  # share of a cell of the terrain that the polygons of a release cover at least
LOST_VOLUME = 1e-6  # share of a raster's volume that may fall outside the terrain by round-off of its header
TOLERANCE = 0.01  # largest relative difference of computed and stated volume
PRINTED = 1e-6  # smaller differences are rounding of a printed volume and not reported
MARGIN = 8  # cells of a huge raster that are read around the terrain, to detect a release that extends beyond it
EDGE_POINTS = 33  # points along each side of the terrain: straight edges become curves in another system


class Sign(StrEnum):
    """Sign of thickness in a raster."""

    POSITIVE = "positive"
    NEGATIVE = "negative"  # thickness is a loss of elevation


def read_vector(
    path: str | PathLike[str],
    terrain: Terrain,
    *,
    thickness: float | str | None = None,
    volume: float | None = None,
    placement: Placement | str = Placement.EXCAVATED,
    edge: Edge | str | None = None,
    layer: str | None = None,
    name: str | None = None,
    material: Material | None = None,
    basal_friction_angle_deg: float | str | None = None,
    pore_pressure: PorePressure | None = None,
) -> Release:
    """Release of the polygons of a vector file, united.

    Cells that the outline cuts have the covered share of the thickness. Overlapping polygons count once.

    Parameters
    ----------
    path : path
        GeoPackage, Shapefile, GeoJSON or FlatGeobuf, in any known coordinate system. GeoJSON without a stated
        system is in longitude and latitude (RFC 7946) and is reprojected.
    thickness : float or str or None
        Mean vertical thickness [m], or the name of the attribute that holds it. None: taken from the volume.
    volume : float or None
        Volume of all polygons together [m3].
    edge : Edge or None
        "tapered": thins out to the outline (:mod:`runout.release.taper`); "vertical": as thick there as inside. By default
        tapered where it is excavated, and vertical on the surface.
    layer : str or None
        Needed if the file has several.
    name : str or None
        The file's name by default.
    basal_friction_angle_deg : float or str or None
        Angle [deg] or attribute; replaces the friction of the run for this release.

    Raises
    ------
    ReleaseError
        With the place, the value and the remedy.
    """
    source = as_path(path, ReleaseError)
    polygons = read_polygons(source, terrain, layer)
    depths = _polygon_thickness(polygons, thickness, volume)
    parts, overlaps = without_overlap(polygons, depths)
    outline = _united(parts, f"release {source}", terrain)
    if depths is None:
        depths = np.full(len(parts), checked("volume", volume, place=str(source), error=ReleaseError) / outline.area)
    cells, scaled = matched(_on_cells(parts, depths, terrain), terrain.cell_area, volume, str(source))
    placement = Placement.of(placement)
    edge, body, sentences = _shaped(Edge.of(edge, placement), parts, depths, outline, cells, terrain, placement, str(source))
    cells = cells if body is None else body.thickness()
    friction = _polygon_friction(polygons, basal_friction_angle_deg)
    return _release(
        cells, terrain, source=str(source), outline=outline, placement=placement, edge=edge, body=body, name=name or source.stem,
        material=material, basal_friction_angle=friction, changes=polygons.changes + overlaps + scaled + sentences,
        pore_pressure=pore_pressure,
    )  # fmt: skip


def read_raster(
    path: str | PathLike[str],
    terrain: Terrain,
    *,
    volume: float | None = None,
    placement: Placement | str = Placement.EXCAVATED,
    sign: Sign | str = Sign.POSITIVE,
    name: str | None = None,
    material: Material | None = None,
    basal_friction_angle_deg: float | None = None,
    pore_pressure: PorePressure | None = None,
) -> Release:
    """Release of a raster of vertical thickness [m]; parameters as in :meth:`runout.Release.from_raster`.

    Cells without data are not released. A raster on another grid than the terrain is resampled by area; its volume is kept. Raises
    ReleaseError with the place, the value and the remedy.
    """

    source = as_path(path, ReleaseError)
    values, edges, changes = read_thickness(source, terrain)
    values = _positive(values, str(source), sign)
    on_terrain = _same_cells(edges, _terrain_edges(terrain))
    cells = _from_south_west(values if on_terrain else regrid(values, edges, _terrain_edges(terrain)))
    whole, cell_volume = _volume(values, edges), float(cells.sum() * terrain.cell_area)
    if not on_terrain and cell_volume < whole * (1 - LOST_VOLUME):
        raise ReleaseError(
            f"{source}: {1 - cell_volume / whole:.1%} of its {whole:.6g} m3 lies outside the terrain {terrain.source}; "
            "use a larger DEM or cut the release"
        )
    if not on_terrain:
        changes += (f"{source}: resampled by area to the cells of the terrain; its {cell_volume:.6g} m3 are kept.",)
    cells, scaled = matched(cells, terrain.cell_area, volume, str(source))
    return _release(
        cells, terrain, source=str(source), placement=placement, name=name or source.stem, material=material,
        basal_friction_angle=_friction(basal_friction_angle_deg, str(source)), changes=changes + scaled,
        pore_pressure=pore_pressure,
    )  # fmt: skip


def release_from_array(
    thickness: np.ndarray,
    terrain: Terrain,
    *,
    volume: float | None = None,
    placement: Placement | str = Placement.EXCAVATED,
    name: str = "release",
    material: Material | None = None,
    basal_friction_angle_deg: float | None = None,
    pore_pressure: PorePressure | None = None,
    source: str = "array",
) -> Release:
    """Release of vertical thickness (rows, columns) [m] on the cells of the terrain, north-west corner first."""
    friction = _friction(basal_friction_angle_deg, source)
    release = Release(thickness, terrain, None, Placement.of(placement), friction, material, name, source)
    cells, scaled = matched(release.thickness, terrain.cell_area, volume, source)
    return _release(
        cells,
        terrain,
        source=source,
        placement=placement,
        name=name,
        material=material,
        basal_friction_angle=friction,
        pore_pressure=pore_pressure,
        changes=scaled,
    )


def _release(
    cells: np.ndarray, terrain: Terrain, *, source: str, placement: Placement | str, changes: tuple[str, ...], **rest: Any
) -> Release:
    """The release after the final checks; logs its changes."""
    release = Release(cells, terrain, source=source, placement=Placement.of(placement), changes=changes, **rest)
    require_elevation(release.thickness, terrain, source)
    for change in changes:
        log.warning(change)
    return release


def _polygon_thickness(layer: PolygonLayer, thickness: float | str | None, volume: float | None) -> np.ndarray | None:
    """Thickness (n,) [m] of the polygons; None if it derives from the volume."""
    source = str(layer.source)
    if thickness is None:
        if volume is None:
            raise ReleaseError(
                f"{source}: neither thickness nor volume is stated; give a thickness [m], the attribute that holds it "
                f"(numeric attributes: {layer.numeric_attributes()}), or a volume [m3]"
            )
        return None
    return layer.stated(thickness, "thickness")


def _shaped(
    edge: Edge,
    parts: np.ndarray,
    depths: np.ndarray,
    outline: Any,
    cells: np.ndarray,
    terrain: Terrain,
    placement: Placement,
    source: str,
) -> tuple[Edge, Any, tuple[str, ...]]:
    """Edge of a release, the body of a tapered one, and a sentence if it has too many parts to be tapered.

    ``cells`` (rows, columns) hold the mean thickness [m] with a vertical edge, whose volume is kept.
    """
    import shapely

    from runout.release.taper import MOST_PARTS, tapered

    if edge is Edge.VERTICAL:
        return edge, None, ()
    count = int(shapely.get_num_geometries(outline))
    if count > MOST_PARTS:
        sentence = f"{source}: {count} separate parts are too many to be tapered ({MOST_PARTS} are not); they keep a vertical edge."
        return Edge.VERTICAL, None, (sentence,)
    exact = depths * (cells.sum() * terrain.cell_area / float(np.sum(depths * shapely.area(parts))))
    return edge, tapered(parts, exact, outline, terrain, excavated=placement is Placement.EXCAVATED), ()


def _polygon_friction(layer: PolygonLayer, angle_deg: float | str | None) -> float | None:
    """Basal friction angle [rad] of all polygons."""
    if not isinstance(angle_deg, str):
        return _friction(angle_deg, str(layer.source))
    values = np.unique(layer.stated(angle_deg, "basal_friction_angle"))
    if len(values) > 1:
        raise ReleaseError(
            f"{layer.source}: attribute {angle_deg!r} differs among the polygons ({values[0]:g} to {values[-1]:g} deg); "
            "a release has one basal friction angle, so write the polygons to one file or layer each"
        )
    return _friction(float(values[0]), str(layer.source))


def _friction(angle_deg: float | None, source: str) -> float | None:
    """Basal friction angle [rad]."""
    if angle_deg is None:
        return None
    angle = checked("basal_friction_angle", angle_deg, place=source, key="basal_friction_angle_deg", error=ReleaseError)
    return math.radians(angle)


def _united(parts: np.ndarray, what: str, terrain: Terrain) -> Any:
    import shapely

    outline = shapely.union_all(parts)
    require_inside(outline, terrain, what)
    if outline.area < LEAST_COVER * terrain.cell_area:
        share = f"{outline.area / terrain.cell_area:.2g} of one cell of the terrain {terrain.source}"
        remedy = "draw it larger, or check its unit and coordinate system"
        raise ReleaseError(f"{what}: covers {outline.area:.3g} m2, {share}; {remedy}")
    return outline


def _on_cells(parts: np.ndarray, depths: np.ndarray, terrain: Terrain) -> np.ndarray:
    """Mean thickness (rows, columns) [m] of polygons without overlaps; one pass per distinct thickness."""
    import shapely

    edges = _terrain_edges(terrain)
    volume = np.zeros((len(edges[0]) - 1, len(edges[1]) - 1))
    for depth in np.unique(depths):
        united = shapely.union_all(parts[depths == depth])
        if united.is_empty:
            continue
        local = shapely.transform(united, terrain.frame.to_local)
        window, area = covered_window(local, edges)
        volume[window] += depth * area * (united.area / area.sum())
    return _from_south_west(volume / terrain.cell_area)


def _positive(values: np.ndarray, source: str, sign: Sign | str) -> np.ndarray:
    """Positive thickness [m] of a raster with either sign."""
    values = values * (-1.0 if member_of(Sign, sign, f"{source}: sign", ReleaseError) is Sign.NEGATIVE else 1.0) + 0.0
    if not values.any():
        raise ReleaseError(f"{source}: the release is empty; the raster is 0 or nodata everywhere")
    wrong, right = int((values < 0).sum()), int((values > 0).sum())
    if wrong and right:
        raise ReleaseError(
            f"{source}: {right} cells are a thickness and {wrong} have the other sign; "
            "a raster of both erosion and deposition is no release, so cut it to the source area"
        )
    if wrong:
        other = Sign.NEGATIVE if Sign(sign) is Sign.POSITIVE else Sign.POSITIVE
        sign_word = "negative" if other is Sign.NEGATIVE else "positive"
        raise ReleaseError(
            f"{source}: all {wrong} cells with thickness are {sign_word}; "
            f"if the raster states what fails that way, say so: sign={str(other)!r}"
        )
    return values


def _terrain_edges(terrain: Terrain) -> tuple[np.ndarray, np.ndarray]:
    """Local edges of the terrain's columns from the west and of its rows from the south [m]."""
    (rows, columns), (dx, dy) = terrain.shape, terrain.cell_size
    return np.arange(columns + 1) * dx, np.arange(rows + 1) * dy


def _same_cells(edges: tuple[np.ndarray, np.ndarray], others: tuple[np.ndarray, np.ndarray]) -> bool:
    """Whether two lattices are equal within the digits of a file header."""
    return all(len(a) == len(b) and np.abs(a - b).max() < SAME_EDGE * (b[1] - b[0]) for a, b in zip(edges, others, strict=True))


def _from_south_west(cells: np.ndarray) -> np.ndarray:
    """(rows, columns) from the north-west of (nx, ny) from the south-west."""
    return np.ascontiguousarray(cells.T[::-1])


def _volume(values: np.ndarray, edges: tuple[np.ndarray, np.ndarray]) -> float:
    return float(np.diff(edges[0]) @ values @ np.diff(edges[1]))


def matched(thickness: np.ndarray, cell_area: float, volume: float | None, source: str) -> tuple[np.ndarray, tuple[str, ...]]:
    """Thickness [m] over cells of one area [m2], scaled to the stated volume [m3], and a sentence if the scaling is noticeable.

    Without a volume the thickness stays as it is. Raises ReleaseError if both volumes differ by more than 1 %.
    """
    if volume is None:
        return thickness, ()
    target, computed = checked("volume", volume, place=source, error=ReleaseError), float(thickness.sum() * cell_area)
    if computed == 0:
        raise ReleaseError(f"{source}: the volume is stated as {target:.6g} m3, but the thickness is 0 everywhere")
    difference = computed / target - 1.0
    if abs(difference) > TOLERANCE:
        raise ReleaseError(
            f"{source}: area and thickness give {computed:.6g} m3, the stated volume is {target:.6g} m3 ({difference:+.1%}); "
            f"correct one of them, or leave one out ({TOLERANCE:.0%} is allowed)"
        )
    if abs(difference) < PRINTED:
        return thickness * (target / computed), ()
    factor = target / computed
    return thickness * factor, (f"{source}: thickness scaled by {factor:.7g} to the stated {target:.6g} m3.",)


def read_thickness(path: Path, terrain: Terrain) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], tuple[str, ...]]:
    """Values (nx, ny) from the south-west, 0 for nodata; local edges ``(x, y)`` [m]; sentences on assumptions.

    Raises ReleaseError if the file cannot be read as one of elevations could be, or its system has no known transformation.
    """
    with errors_as(ReleaseError), open_source(path, THICKNESS) as source:
        header = source.header
        require_straight(header.transform, header.source, THICKNESS.name)
        placed = to_terrain(path, header.crs, terrain, header.bounds, "gdalwarp")
        extent, sentences = _needed(path, header, placed, terrain)
        raster = north_up_in_unit_of(source.read(extent), THICKNESS)
    values = _values(path, raster)[::-1]
    changes = (*(f"{path}: {change}." for change in raster.changes), *sentences)
    a, _, c, _, e, f = raster.transform
    x, y = c + np.arange(values.shape[1] + 1) * a, f + np.arange(values.shape[0], -1, -1) * e
    if placed.forward is not None:
        values, edges, resampling = raster_on_terrain(np.ascontiguousarray(values.T), (x, y), placed, terrain, path)
        return values, edges, (*changes, *resampling)
    return np.ascontiguousarray(values.T), (x - terrain.west, y - terrain.south), (*changes, *placed.sentences)


def _needed(path: Path, header: Header, placed: ToTerrain, terrain: Terrain) -> tuple[Bounds | None, tuple[str, ...]]:
    """Extent of a raster that is read, and a sentence unless it is all: of huge rasters only the cells on and near the terrain."""
    if header.cells <= LARGEST_WHOLE:
        return None, ()
    sentence = f"{path}: the cells on and near the terrain are read; releases elsewhere are left out."
    return _around(terrain, placed, header.transform), (sentence,)


def _around(terrain: Terrain, placed: ToTerrain, transform: tuple[float, ...]) -> Bounds:
    """Extent of a terrain and :data:`MARGIN` cells around it, in the coordinates of a raster."""
    west, south, east, north = terrain.extent
    along = np.linspace(0.0, 1.0, EDGE_POINTS)
    x, y = west + along * (east - west), south + along * (north - south)
    rim = np.concatenate([np.column_stack((x, np.full_like(x, edge))) for edge in (south, north)])
    rim = np.concatenate([rim, *(np.column_stack((np.full_like(y, edge), y)) for edge in (west, east))])
    there = rim if placed.inverse is None else placed.inverse(rim)
    more = MARGIN * np.abs([transform[0], transform[4]])
    low, high = there.min(axis=0) - more, there.max(axis=0) + more
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _values(path: Path, raster: ElevationRaster) -> np.ndarray:
    """Thickness (rows, columns) [m], north up, 0 where the raster holds none.

    Raises ReleaseError if a cell is infinite, or its absolute value exceeds the largest thickness: often it marks missing values.
    """
    values = np.where(np.isnan(raster.values), 0.0, raster.values)
    if np.isinf(values).any():
        raise ReleaseError(f"{path}: {int(np.isinf(values).sum())} cells are infinite; mark them as nodata")
    valid = LIMITS["thickness"]
    beyond = np.argwhere(np.abs(values) > valid.high)
    if not len(beyond):
        return values
    row, column = beyond[0]
    value, number = float(values[row, column]), raster.stored(float(values[row, column]))
    a, _, c, _, e, f = raster.transform
    east, north = c + (column + 0.5) * a, f + (row + 0.5) * e
    raise ReleaseError(
        f"{path}: thickness is {value:g} m at easting {east:.2f}, northing {north:.2f}, {len(beyond)} cells in all; "
        f"{valid.allowed()}; if {number:g} marks cells without a release, declare it: gdal_edit.py -a_nodata {number:.9g} {path}"
    )
