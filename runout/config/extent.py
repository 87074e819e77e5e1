"""The part of a huge elevation raster that a site needs: the area within reach of its masses, from the energy line.

The bounds of a release are read before the terrain.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.fetch import locate
from runout.config.friction import ANGLE, KEY, OF_RELEASE, PREFIX, SiteFriction, sampled_ranges
from runout.config.inflow import read_inflows
from runout.config.input_readers import read_elevations, read_releases, read_zones
from runout.config.member_arguments import grid_spacing, material, sampled_releases
from runout.config.pore_pressure import SAMPLED, sampled_pores
from runout.config.release_laws import OwnLaws
from runout.config.stated_at import stated_at
from runout.errors import DemError, ReleaseError
from runout.io import source_code
from runout.io.layer_crs import stated_crs
from runout.io.opening import BYTES_PER_CELL
from runout.io.polygons import read_frame
from runout.io.provenance import checksum
from runout.io.references import holds_geometries
from runout.io.window import LARGEST_WHOLE, Bounds, bounds_of, part_of
from runout.terrain.source import THICKNESS, errors_as, open_source

if TYPE_CHECKING:
    from runout.config.schema import SiteSettings
    from runout.config.site_files import SiteFiles
    from runout.io.elevation_raster import Header
    from runout.model.release import Release
    from runout.model.terrain import Terrain

LARGEST_DERIVED = 50_000_000  # cells; for a larger extent, state terrain.extent
FIRST = 64  # width [cells] around the releases of the first extent tried
BEYOND = 16  # width [cells] of the margin around the area within reach
SHARE_BEYOND = 0.05  # the same margin as a share of the width of that area
EDGE_POINTS = 21  # points per edge of an extent that is transformed


@dataclass(frozen=True)
class Place:
    """West, south, east and north edge, and their coordinate system; None if the file states none."""

    edges: Bounds
    crs: Any


def polygon_bounds(path: Path, layer: str | None, elevations: Any) -> Place:
    """Bounds of the polygons of a layer. GeoJSON outside the range of degrees is taken to be in the system of the ``elevations``.

    Raises ReleaseError if the file cannot be read or has no bounds.
    """
    frame, driver = read_frame(path, layer, "release")
    edges = np.asarray(frame.total_bounds, float)
    if not np.isfinite(edges).all():
        raise ReleaseError(f"{path}: the layer is empty; draw at least one release polygon")
    crs = stated_crs(frame.crs.to_wkt() if frame.crs else None)
    beyond = np.abs(edges[[0, 2]]).max() > 180 or np.abs(edges[[1, 3]]).max() > 90
    if driver == "GeoJSON" and crs is not None and crs.is_geographic and beyond:
        crs = elevations
    return Place((float(edges[0]), float(edges[1]), float(edges[2]), float(edges[3])), crs)


def thickness_bounds(path: Path, remedy: str) -> Place:
    """Bounds of the cells of a raster that hold a thickness.

    Raises ReleaseError if the file cannot be read, holds no thickness, or is so large that its extent must be stated: ``remedy``
    says how.
    """
    with errors_as(ReleaseError), open_source(path, THICKNESS) as source:
        rows, columns = source.header.shape
        if source.header.cells > LARGEST_WHOLE:
            raise ReleaseError(f"{path}: {columns} x {rows} cells are too many to look for the release in; {remedy}")
        raster = source.read(None)
    covered = np.nan_to_num(raster.values) != 0
    if not covered.any():
        raise ReleaseError(f"{path}: the release is empty; the raster is 0 or nodata everywhere")
    used = [np.flatnonzero(covered.any(axis=1 - axis)) for axis in (0, 1)]
    a, b, c, d, e, f = raster.transform
    corner = a, b, c + a * used[1][0], d, e, f + e * used[0][0]
    shape = int(used[0][-1] - used[0][0]) + 1, int(used[1][-1] - used[1][0]) + 1
    return Place(bounds_of(corner, shape), stated_crs(raster.crs))


@dataclass(frozen=True)
class DerivedExtent:
    """Extent that contains the area within reach of the masses of a site."""

    edges: Bounds  # west, south, east and north, in the coordinates of the elevation raster's file
    sentence: str  # how the extent was derived, for log and record


def known_extent(files: "SiteFiles") -> DerivedExtent | None:
    """:func:`needed_extent`, or what an earlier run found for the same settings with the same inputs."""
    settings, known = files.settings, files.known
    if known.path is None:
        return needed_extent(settings, files.file)
    inputs = settings.model_dump(mode="json", exclude={"hazard", "metadata", "budget", "observations", "report", "stability"})
    rows = files.checksums("design") if settings.ensemble.table else []
    key = checksum([source_code.checksums().members, inputs, files.checksums(), *rows])
    entry = known.value("extent", key)
    if entry is None:
        extent = needed_extent(settings, files.file)
        known.note("extent", key, asdict(extent) if extent else {})
        return extent
    return DerivedExtent(tuple(entry["edges"]), entry["sentence"]) if entry else None


def needed_extent(settings: "SiteSettings", file: Path, largest: int | None = None) -> DerivedExtent | None:
    """Extent of the elevation raster of a site.yaml that no mass leaves; None if the raster is read as a whole.

    ``largest``: cells of the largest raster that is read as a whole; by default :data:`LARGEST_WHOLE`. Raises DemError if the
    raster is huge and its extent cannot be derived, or the derived extent is too large. Raises InputError if an input cannot be
    used.
    """
    from runout.terrain.read import read_header

    with stated_at(file, "terrain", "dem"):
        header = read_header(locate(settings.terrain.dem, file.parent), settings.terrain.crs)
    if header.cells <= (LARGEST_WHOLE if largest is None else largest):
        return None
    places = [(release.polygons, release.raster, release.layer) for release in settings.release]
    places += [(one.line or one.polygon, None, one.layer) for one in settings.inflow or []]
    boxes = [release_bounds(*place, file.parent, header) for place in places]
    if not boxes or not {ANGLE, KEY} & settings.model_fields_set:
        unknown = "and site.yaml does not say yet where masses may get"
        raise DemError(f"{header.source}: {_too_many(header)}, {unknown}; {_state(header)}")
    low, high = np.min(boxes, axis=0)[:2], np.max(boxes, axis=0)[2:]
    edges = float(low[0]), float(low[1]), float(high[0]), float(high[1])
    west, south, east, north = header.bounds
    if edges[0] >= east or edges[2] <= west or edges[1] >= north or edges[3] <= south:
        place, extent = (", ".join(f"{edge:.10g}" for edge in box) for box in (edges, header.bounds))
        raise DemError(f"{header.source}: the releases [{place}] lie outside [{extent}]; check the coordinate systems of both")
    return _grown(settings, file, header, edges)


def extent_around(dem: Path | str, release: Path, crs: str | None = None) -> Bounds | None:
    """Extent of a huge elevation raster around a release; None for smaller rasters, which are read as a whole.

    ``crs`` is the system of a raster that states none.

    Raises InputError if a file cannot be used.
    """
    from runout.terrain.read import read_header

    header = read_header(dem, crs)
    if header.cells <= LARGEST_WHOLE:
        return None
    is_vector = holds_geometries(release)
    path = str(release.absolute())
    west, south, east, north = release_bounds(path if is_vector else None, path, None, Path(), header)
    dx, dy = FIRST * abs(header.transform[0]), FIRST * abs(header.transform[4])
    return west - dx, south - dy, east + dx, north + dy


def release_bounds(vector: str | None, raster: Any, layer: str | None, folder: Path, header: "Header") -> Bounds:
    """West, south, east and north of a release or an inflow in the coordinates of an elevation raster's file.

    ``vector`` names the file of its polygons or its line, else ``raster`` that of its thickness.
    """
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    from runout.io.layer_crs import stated_crs

    if vector is not None:
        place = polygon_bounds(Path(locate(vector, folder)), layer, header.crs)
    else:
        place = thickness_bounds(Path(locate(raster, folder)), _state(header))
    target = stated_crs(header.crs)
    if place.crs is None or target is None:
        return place.edges
    try:
        edges = Transformer.from_crs(place.crs, target, always_xy=True).transform_bounds(*place.edges, densify_pts=EDGE_POINTS)
    except ProjError:
        edges = (math.nan,) * 4
    if not np.isfinite(edges).all():
        raise DemError(f"{header.source}: a release has no place in the coordinate system of this raster; check those of both")
    return tuple(float(edge) for edge in edges)  # type: ignore[return-value]


def _grown(settings: "SiteSettings", file: Path, header: "Header", edges: Bounds) -> DerivedExtent:
    """Extent around the releases. Each edge within reach of a mass moves outwards until the known ground ends."""
    cell = abs(header.transform[0]), abs(header.transform[4])
    more = [max(FIRST * cell[k % 2], edges[2 + k % 2] - edges[k % 2]) for k in range(4)]
    whole, before = header.bounds, np.full(4, np.nan)
    growing: list[int] = []
    ended: set[int] = set()
    while True:
        tried = tuple(_limited(edge + (-d if k < 2 else d), k, whole) for k, (edge, d) in enumerate(zip(edges, more, strict=True)))
        part = part_of(header.transform, header.shape, tried, header.source, DemError)  # type: ignore[arg-type]
        if part.rows * part.columns > LARGEST_DERIVED:
            needed = f"{part.columns} x {part.rows} cells or more, about {part.rows * part.columns * BYTES_PER_CELL / 1e9:.3g} GB"
            raise DemError(f"{header.source}: the masses may reach {needed} (energy line, least friction); {_state(header)}")
        terrain = read_elevations(settings, file, tried)
        angle, reach = _reach(settings, file, terrain)
        touched = _touched(reach)
        ended |= {k for k in growing if abs(terrain.extent[k] - before[k]) < terrain.cell_size[k % 2]}
        growing = [k for k in range(4) if touched[k] and tried[k] != whole[k] and k not in ended]
        before = np.array(terrain.extent)
        if not growing:
            return _kept(header, terrain, reach, tried, angle)  # type: ignore[arg-type]
        more = [2.0 * d if k in growing else d for k, d in enumerate(more)]


def _limited(edge: float, side: int, whole: Bounds) -> float:
    return max(edge, whole[side]) if side < 2 else min(edge, whole[side])


def _touched(reach: np.ndarray) -> tuple[bool, bool, bool, bool]:
    """Whether any cell within reach lies in the two outermost columns or rows: west, south, east, north."""
    near = reach[:, :2], reach[-2:], reach[:, -2:], reach[:2]
    west, south, east, north = (bool(cells.any()) for cells in near)
    return west, south, east, north


def _reach(settings: "SiteSettings", file: Path, terrain: "Terrain") -> tuple[float, np.ndarray]:
    """Smallest friction angle [rad] and the cells (rows, columns) within reach of the largest masses of the ensemble."""
    from runout.release.inlet import mass_at
    from runout.terrain.prepare import reachable

    largest = max(1.0, _largest(settings, "release_volume_factor"))
    read = read_releases(settings, file, terrain).require()
    inflows = read_inflows(settings, file, terrain).require()
    releases = [*sampled_releases(settings, read, {"release_volume_factor": largest}), *map(mass_at, inflows)]
    angle = _least_friction(settings, file, terrain, releases)
    return angle, reachable(terrain, np.sum([release.thickness for release in releases], axis=0), angle)


def _least_friction(settings: "SiteSettings", file: Path, terrain: "Terrain", releases: "list[Release]") -> float:
    """Smallest friction angle [rad] of all members on any ground within reach."""
    from runout.errors import ZoneError

    try:
        zones = read_zones(settings, file, terrain)
    except ZoneError:  # no zone lies within this extent; SiteFiles.zones reports faults on the final extent
        zones = None
    return min(_least_of(settings, releases, zones, sampled) for sampled in settings.ensemble.sampled())


def _least_of(settings: "SiteSettings", releases: "list[Release]", zones: Any, sampled: Mapping[str, Any]) -> float:
    """Smallest friction angle [rad] of the members with some distributions."""
    from runout.model.basal_strength import forecast_strengths, least_angle

    friction = SiteFriction(settings)
    weak = "friction_angle_deg", "cohesion", "yield_stress"
    low = {name: d.support()[0] for name, d in sampled.items()}
    lowest = {name: value for name, value in low.items() if name in sampled_ranges(friction.law) or OF_RELEASE + PREFIX in name}
    of_material = {name: value for name, value in low.items() if name.rpartition(OF_RELEASE)[2] in weak}
    weakest, own = material(settings, of_material), OwnLaws(settings).under(releases, of_material)
    strength = forecast_strengths([r.material or weakest for r in own], releases, grid_spacing(settings, releases)[2])
    return least_angle(friction.of_releases(releases, lowest), strength, zones, _least_effective(settings, releases, sampled))


def _least_effective(settings: "SiteSettings", releases: "list[Release]", sampled: Mapping[str, Any]) -> list[float]:
    """Least share [1] of the normal stress that the grains of each release carry in any member, with mass of a wet bed."""
    from runout.config.bed import PORES, bed_ratio
    from runout.model.basal_strength import effective_shares

    pores = (*SAMPLED, PORES)
    highest = {name: d.support()[1] for name, d in sampled.items() if name.rpartition(OF_RELEASE)[2] in pores}
    return effective_shares(sampled_pores(releases, highest), bed_ratio(settings, highest))


def _largest(settings: "SiteSettings", name: str) -> float:
    """Largest value of a factor in the members."""
    largest = [sampled[name].support()[1] for sampled in settings.ensemble.sampled() if name in sampled]
    return max(largest, default=1.0)


def _kept(header: "Header", terrain: "Terrain", reach: np.ndarray, tried: Bounds, angle: float) -> DerivedExtent:
    """Extent of the cells within reach plus a margin, at most the extent that was tried."""
    from pyproj import Transformer

    rows, columns = np.flatnonzero(reach.any(axis=1)), np.flatnonzero(reach.any(axis=0))
    x, y = terrain.easting[columns[[0, -1]]], terrain.northing[rows[[-1, 0]]]
    more = [BEYOND * size + SHARE_BEYOND * float(np.ptp(ends)) for size, ends in zip(terrain.cell_size, (x, y), strict=True)]
    edges = [x[0] - more[0], y[0] - more[1], x[1] + more[0], y[1] + more[1]]
    if terrain.own_crs and terrain.crs:
        to_file = Transformer.from_crs(terrain.crs, terrain.own_crs, always_xy=True)
        west, south, east, north = edges
        edges = list(to_file.transform_bounds(west, south, east, north, densify_pts=EDGE_POINTS))
    limited = [max(a, b) if k < 2 else min(a, b) for k, (a, b) in enumerate(zip(edges, tried, strict=True))]
    sentence = (
        f"{_too_many(header)}; its extent is derived from the releases and the energy line at the least friction of "
        f"{math.degrees(angle):.3g} deg; terrain.extent sets another one"
    )
    return DerivedExtent((float(limited[0]), float(limited[1]), float(limited[2]), float(limited[3])), sentence)


def _too_many(header: "Header") -> str:
    return f"{header.shape[1]} x {header.shape[0]} cells are more than a site reads as a whole ({LARGEST_WHOLE:,})"


def _state(header: "Header") -> str:
    edges = ", ".join(f"{edge:.10g}" for edge in header.bounds)
    return f"state terrain.extent: [west, south, east, north] within [{edges}], {BYTES_PER_CELL} bytes of memory a cell"
