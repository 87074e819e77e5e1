"""Scarps: thickness of a mass above an ellipsoid or a set of planes, which thins out to the rim.

``runout scarp`` writes the thickness as a raster that a site takes as a release.
"""

import logging
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runout import __version__, log
from runout.config.schema import NAME
from runout.errors import ConfigError, ExitCode, ReleaseError
from runout.hazard.style import MapClasses
from runout.io.atomic import write_json, write_text
from runout.io.geotiff import write_cog
from runout.io.netcdf import map_dataset
from runout.io.polygon_coverage import covered_part
from runout.model.limits import Range, checked, checked_within
from runout.release.ground import require_elevation, require_inside
from runout.release.read import release_from_array
from runout.slopes.choices import ScarpChoices, record
from runout.slopes.place import read_place
from runout.terrain.open_edge import filled

if TYPE_CHECKING:
    from runout.model.release import Release
    from runout.model.terrain import Terrain

POINTS_OF_AN_AXIS = 24  # along a semi-axis of an ellipsoid, at least
_DIP, _AZIMUTH = Range(0, 89, "deg"), Range(-360, 360, "deg")
POINTS = 8  # along each side of a cell, at which the thickness is averaged
Points = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # thickness [m] at easting, northing, ground [m]
LOGGER = logging.getLogger("runout.slopes")
FOLDER = "scarp"


@dataclass(frozen=True)
class ScarpPlane:
    """A plane of a scarp.

    Attributes
    ----------
    easting, northing : float
        Point that it passes below [m].
    depth : float
        Depth of the plane below the ground there [m]; negative above it.
    dip_deg, azimuth_deg : float
        Dip [deg], 0 to 89, and the direction that it dips to, clockwise from north [deg].

    Raises
    ------
    ReleaseError
        If a value is out of range.
    """

    easting: float
    northing: float
    depth: float
    dip_deg: float
    azimuth_deg: float

    def __post_init__(self) -> None:
        checked_within(Range(-1000, 1000, "m"), "plane: depth", self.depth, error=ReleaseError)
        checked_within(_DIP, "plane: dip", self.dip_deg, error=ReleaseError)
        checked_within(_AZIMUTH, "plane: azimuth", self.azimuth_deg, error=ReleaseError)


def scarp_ellipsoid(
    terrain: "Terrain",
    centre: tuple[float, float],
    semi_axes: tuple[float, float],
    depth: float,
    *,
    azimuth_deg: float | None = None,
    tilt_deg: float | None = None,
    volume: float | None = None,
    name: str = "scarp",
) -> "Release":
    """Release above the lower half of an ellipsoid.

    With the plane p fitted to the ground in a circle of the same area, s = sqrt(1 - (u / a)^2 - (v / b)^2) and the ground z, the
    thickness is s (depth + z - p), not below 0. On a plane slope this is half an ellipsoid with vertical depth: volume 2/3 pi a b
    depth. Elsewhere the sliding surface is smooth in the middle, and the thickness still ends at 0 at the rim.

    Parameters
    ----------
    terrain : Terrain
    centre : tuple of float
        Easting and northing [m].
    semi_axes : tuple of float
        Semi-axes a along the azimuth and b across [m], in plan; a cell or more.
    depth : float
        Vertical depth in the middle [m].
    azimuth_deg : float, optional
        Direction of the first axis, clockwise from north [deg]; default: down the fitted plane.
    tilt_deg : float, optional
        Inclination of the plane p down along the azimuth [deg]; p then passes through the ground at the centre.
    volume : float, optional
        Volume [m3] to which the thickness is scaled.
    name : str
        Name of the release.

    Raises
    ------
    ReleaseError
        If a value is out of range, or the ellipse leaves the terrain or its known cells.
    """
    east, north = _point(terrain, centre)
    axis = Range(max(terrain.cell_size), 1e5, "m", "the raster has no finer cells")
    a, b = (checked_within(axis, "semi-axis", value, error=ReleaseError) for value in semi_axes)
    checked("thickness", depth, key="depth", error=ReleaseError)
    slope, level = fitted_plane(terrain, (east, north), math.sqrt(a * b))
    azimuth = math.atan2(-slope[0], -slope[1]) if azimuth_deg is None else _azimuth(azimuth_deg)
    along = np.array([math.sin(azimuth), math.cos(azimuth)])
    if tilt_deg is not None:
        slope = -math.tan(math.radians(checked_within(_DIP, "tilt", tilt_deg, error=ReleaseError))) * along
        level = float(ground_at(terrain, np.array([east]), np.array([north]))[0])
    _require_ellipse(terrain, (east, north), (a, b), along, name)

    def thickness(x: np.ndarray, y: np.ndarray, ground: np.ndarray) -> np.ndarray:
        dx, dy = x - east, y - north
        u, v = along[0] * dx + along[1] * dy, along[1] * dx - along[0] * dy
        profile = np.sqrt(np.maximum(1.0 - (u / a) ** 2 - (v / b) ** 2, 0.0))
        return profile * np.maximum(depth + ground - level - slope[0] * dx - slope[1] * dy, 0.0)  # type: ignore[no-any-return]

    near = np.hypot(*(axis - value for axis, value in zip(_centres(terrain), (east, north), strict=True)))
    cells = near <= max(a, b) + max(terrain.cell_size)
    points = max(POINTS, math.ceil(POINTS_OF_AN_AXIS * max(terrain.cell_size) / min(a, b)))
    return _release(terrain, mean_thickness(terrain, thickness, cells, points), volume, name)


def scarp_planes(
    terrain: "Terrain",
    planes: Sequence[ScarpPlane | tuple[float, float, float, float, float]],
    *,
    outline: str | PathLike[str] | None = None,
    volume: float | None = None,
    name: str = "scarp",
) -> "Release":
    """Release between the ground and the highest of some planes.

    Without an outline, the masses below which a point of a plane lies are kept; planes must close them: a steep one behind, a
    gentle one below, others at the sides.

    Parameters
    ----------
    terrain : Terrain
    planes : sequence of ScarpPlane or tuple
        Planes; a tuple is easting [m], northing [m], depth [m], dip [deg] and azimuth [deg], see :class:`ScarpPlane`.
    outline : path, optional
        Polygons that limit the mass; cells that they cut have the covered share.
    volume : float, optional
        Volume [m3] to which the thickness is scaled.
    name : str
        Name of the release.

    Raises
    ------
    ReleaseError
        If a value is out of range, the planes enclose no mass, or one that reaches the edge of the terrain.
    """
    surfaces = [plane if isinstance(plane, ScarpPlane) else ScarpPlane(*plane) for plane in planes]
    if not surfaces:
        raise ReleaseError("no plane is stated; a scarp of planes needs one at least")
    bases = [_base(terrain, plane) for plane in surfaces]

    def thickness(x: np.ndarray, y: np.ndarray, ground: np.ndarray) -> np.ndarray:
        surface = np.max([z + gx * (x - e) + gy * (y - n) for e, n, z, gx, gy in bases], axis=0)
        return np.maximum(ground - surface, 0.0)  # type: ignore[no-any-return]

    east, north = _centres(terrain)
    ground = filled(terrain.elevation, terrain.cell_size)
    above = thickness(np.broadcast_to(east, terrain.shape), np.broadcast_to(north, terrain.shape), ground) > 0
    share = None if outline is None else _covered_share(terrain, Path(outline))
    cells = above if share is None else above & (share > 0)
    if share is None:
        cells = _around(terrain, cells, bases)
    values = mean_thickness(terrain, thickness, _wider(cells))
    return _release(terrain, values if share is None else values * share, volume, name)


def _point(terrain: "Terrain", place: Sequence[float]) -> tuple[float, float]:
    """A point on known ground."""
    west, south, east, north = terrain.extent
    x, y = float(place[0]), float(place[1])
    if not (west < x < east and south < y < north):
        extent = f"easting {west:.2f} to {east:.2f}, northing {south:.2f} to {north:.2f}"
        raise ReleaseError(f"point {x:.2f}, {y:.2f} lies outside the terrain {terrain.source} ({extent}); check its coordinates")
    row, column = int((north - y) / terrain.cell_size[1]), int((x - west) / terrain.cell_size[0])
    if np.isnan(terrain.elevation[row, column]):
        raise ReleaseError(f"point {x:.2f}, {y:.2f}: {terrain.source} has no elevation there (row {row}, column {column}); move it")
    return x, y


def _azimuth(azimuth_deg: float) -> float:
    return math.radians(checked_within(_AZIMUTH, "azimuth", azimuth_deg, error=ReleaseError))


def _base(terrain: "Terrain", plane: ScarpPlane) -> tuple[float, float, float, float, float]:
    """Point, elevation [m] and gradient to the east and north of a plane."""
    east, north = _point(terrain, (plane.easting, plane.northing))
    ground = float(ground_at(terrain, np.array([east]), np.array([north]))[0])
    fall, azimuth = math.tan(math.radians(plane.dip_deg)), math.radians(plane.azimuth_deg)
    return east, north, ground - plane.depth, -fall * math.sin(azimuth), -fall * math.cos(azimuth)


def _centres(terrain: "Terrain") -> tuple[np.ndarray, np.ndarray]:
    """Easting (1, columns) and northing (rows, 1) of the cell centres [m]."""
    return terrain.easting[None, :], terrain.northing[:, None]


def _require_ellipse(
    terrain: "Terrain", centre: tuple[float, float], axes: tuple[float, float], along: np.ndarray, name: str
) -> None:
    from shapely import Polygon

    turn = np.linspace(0.0, 2.0 * math.pi, 181)[:-1]
    u, v = axes[0] * np.cos(turn), axes[1] * np.sin(turn)
    points = np.column_stack([centre[0] + u * along[0] + v * along[1], centre[1] + u * along[1] - v * along[0]])
    require_inside(Polygon(points), terrain, f"ellipsoid {name}")


def _wider(cells: np.ndarray) -> np.ndarray:
    from scipy import ndimage

    return ndimage.binary_dilation(cells, np.ones((3, 3), bool))  # type: ignore[no-any-return]


def _around(terrain: "Terrain", above: np.ndarray, bases: Sequence[tuple[float, ...]]) -> np.ndarray:
    """Parts of the mass that hold a point of a plane; ReleaseError if they reach the edge."""
    from scipy import ndimage

    label, _ = ndimage.label(above, np.ones((3, 3)))
    north = terrain.extent[3]
    rows = [int((north - n) / terrain.cell_size[1]) for _, n, *_ in bases]
    columns = [int((e - terrain.west) / terrain.cell_size[0]) for e, *_ in bases]
    wanted = np.isin(label, [k for k in label[rows, columns] if k])
    if not wanted.any():
        raise ReleaseError("the planes hold no mass at their points: at each, another plane lies above the ground; lower it")
    if wanted[[0, -1]].any() or wanted[:, [0, -1]].any():
        raise ReleaseError(
            f"the planes do not close the mass: it reaches the edge of {terrain.source}; add a steeper plane behind or at the "
            "sides, or limit it with an outline"
        )
    return wanted


def _covered_share(terrain: "Terrain", path: Path) -> np.ndarray:
    """Share (rows, columns) of each cell that the polygons of a file cover [1]."""
    import shapely

    from runout.io.polygons import read_polygons

    layer = read_polygons(path, terrain, what="outline")
    shape = shapely.union_all(layer.polygons)
    require_inside(shape, terrain, f"outline {path}")
    share = np.zeros(terrain.shape)
    place, area = covered_part(shape, terrain)
    share[place] = area / terrain.cell_area
    return share


def _release(terrain: "Terrain", thickness: np.ndarray, volume: float | None, name: str) -> "Release":
    present_volume = float(thickness.sum() * terrain.cell_area)
    if present_volume == 0.0:
        raise ReleaseError(f"{name}: the scarp holds no mass: its surface lies above the ground everywhere; lower it")
    require_elevation(thickness, terrain, name)
    if volume is not None:
        thickness = thickness * (checked("volume", volume, error=ReleaseError) / present_volume)
    checked("thickness", float(thickness.max()), place=name, key="largest thickness", error=ReleaseError)
    return release_from_array(thickness, terrain, name=name, source=name)


def ground_at(terrain: "Terrain", x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Elevation [m] at points by bilinear interpolation between cell centres; constant beyond the outermost ones."""
    from scipy import ndimage

    column, row = (x - terrain.easting[0]) / terrain.cell_size[0], (terrain.northing[0] - y) / terrain.cell_size[1]
    z = filled(terrain.elevation, terrain.cell_size)
    return ndimage.map_coordinates(z, [row, column], order=1, mode="nearest")  # type: ignore[no-any-return]


def fitted_plane(terrain: "Terrain", centre: tuple[float, float], radius: float) -> tuple[np.ndarray, float]:
    """Gradient to the east and north, and elevation at the centre [m], of the least-squares plane of the ground in a circle."""
    around = np.linspace(-radius, radius, 41)
    dx, dy = (axis.ravel() for axis in np.meshgrid(around, around))
    inside = np.hypot(dx, dy) <= radius
    dx, dy = dx[inside], dy[inside]
    ground = ground_at(terrain, centre[0] + dx, centre[1] + dy)
    fitted, *_ = np.linalg.lstsq(np.column_stack([dx, dy, np.ones_like(dx)]), ground, rcond=None)
    return fitted[:2], float(fitted[2])


def mean_thickness(terrain: "Terrain", thickness: Points, cells: np.ndarray, points: int = POINTS) -> np.ndarray:
    """Mean thickness (rows, columns) [m] over the cells of a mask, from ``points`` x ``points`` within each."""
    from scipy import ndimage

    rows, columns = np.nonzero(cells)
    offsets = (np.arange(points) + 0.5) / points - 0.5
    total = np.zeros(len(rows))
    z, (dx, dy) = filled(terrain.elevation, terrain.cell_size), terrain.cell_size
    for v in offsets:
        for u in offsets:
            x, y = terrain.easting[columns] + u * dx, terrain.northing[rows] + v * dy
            total += thickness(x, y, ndimage.map_coordinates(z, [rows - v, columns + u], order=1, mode="nearest"))
    values = np.zeros(terrain.shape)
    values[rows, columns] = total / points**2
    return values


def command(path: Path, out: Path | None, choices: ScarpChoices) -> int:
    """Make the scarp that is stated and write ``scarp/NAME.tif`` of the results with a record of its choices."""
    if not re.fullmatch(NAME, choices.name):
        raise ConfigError(f"--name is {choices.name!r}; use letters, digits, - and _")
    place = read_place(path, out)
    terrain = place.terrain
    release = _scarp(terrain, choices)
    file = place.results / FOLDER / f"{choices.name}.tif"
    maps = map_dataset(terrain, {"release_thickness": release.thickness}, title=f"{place.name}: scarp {choices.name}")
    stored = maps["release_thickness"].values.astype(np.float64)
    volume = float(stored.sum() * terrain.cell_area)
    contents = {"runout": __version__, "elevation": terrain.source, **record(choices), "volume_m3": volume}
    contents |= {"area_m2": release.area, "largest_thickness_m": float(release.thickness.max())}
    write_cog(maps, "release_thickness", file)
    write_text(MapClasses.over("release_thickness", [stored]).qml(), file.with_suffix(".qml"))
    write_json(contents, file.with_suffix(".json"))
    console = log.output()
    console.print(f"volume: {volume:.9g} m3", markup=False)
    console.print(f"area: {release.area:.6g} m2; largest thickness {release.thickness.max():.4g} m", markup=False)
    LOGGER.info("wrote %s; a site takes it as `release: [{raster: %s}]`, and `runout new` as --release", file, file.name)
    return ExitCode.OK


def _scarp(terrain: "Terrain", choices: ScarpChoices) -> "Release":
    if choices.ellipsoid is not None:
        east, north, along, across, depth = choices.ellipsoid
        return scarp_ellipsoid(
            terrain, (east, north), (along, across), depth, azimuth_deg=choices.azimuth, tilt_deg=choices.tilt,
            volume=choices.volume, name=choices.name,
        )  # fmt: skip
    return scarp_planes(terrain, choices.plane, outline=choices.outline, volume=choices.volume, name=choices.name)
