"""Readers of the elevations, obstacles, friction zones and releases that site.yaml names. Each call reads the files."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runout.config import pore_pressure
from runout.config.fetch import locate
from runout.config.friction import SiteFriction
from runout.config.release_start import start_of
from runout.config.schema import ReleaseSettings, SiteSettings
from runout.config.stated_at import Reading, entry_number, read_each, stated_at
from runout.io.references import is_mesh

if TYPE_CHECKING:
    from runout.model.friction import FrictionZones
    from runout.model.release import Release
    from runout.model.terrain import Terrain
    from runout.terrain.obstacles import Obstacles


def read_elevations(settings: SiteSettings, file: Path, extent: Sequence[float] | None) -> "Terrain":
    """Elevations without obstacles within an extent (west, south, east, north), or of the whole raster if it is None.

    Raises DemError if they cannot be used.
    """
    with stated_at(file, "terrain", "dem"):
        return _elevations(settings, file, extent)


def _elevations(settings: SiteSettings, file: Path, extent: Sequence[float] | None) -> "Terrain":
    from runout.terrain.averaging import averaged, smoothed

    ground, path = settings.terrain, locate(settings.terrain.dem, file.parent)  # of a sample, only its name
    edges = None if extent is None else (extent[0], extent[1], extent[2], extent[3])
    if is_mesh(ground.dem):
        from runout.terrain.mesh import read_mesh_terrain

        terrain, blocks = read_mesh_terrain(Path(path), ground.resolution, ground.crs, edges)[0], None
    else:
        from runout.terrain.read import read_terrain

        terrain, blocks = read_terrain(path, ground.crs, edges), ground.resolution
    terrain = smoothed(terrain, ground.smoothing, file.name) if ground.smoothing else terrain
    return averaged(terrain, blocks, file.name) if blocks else terrain


def build_obstacles(settings: SiteSettings, file: Path, terrain: "Terrain") -> "tuple[Terrain, list[Obstacles]]":
    """The terrain with the obstacles on it, and the obstacles of each file.

    Raises DemError if obstacles cannot be used.
    """
    from runout.terrain.obstacles import build

    obstacles = []
    for number, entry in enumerate(settings.terrain.obstacles or []):
        with stated_at(file, "terrain", "obstacles", number):
            terrain, built = build(terrain, locate(entry.polygons, file.parent), entry.height, entry.layer)
        obstacles.append(built)
    return terrain, obstacles


def read_zones(settings: SiteSettings, file: Path, terrain: "Terrain") -> "FrictionZones | None":
    """The friction zones and rasters on the terrain; None if site.yaml states none.

    Raises ZoneError if zones cannot be used.
    """
    rasters, entries = settings.terrain.friction_rasters, settings.terrain.friction_zones or []
    if not entries and not rasters:
        return None
    from runout.terrain.zones import read_zones, together

    gridded = _friction_rasters(settings, file, terrain, rasters) if rasters else None
    zones = []
    for number, entry in enumerate(entries):
        law, choices = SiteFriction(settings).law.name, entry.model_dump(exclude={"polygons"})
        with stated_at(file, "terrain", "friction_zones", number):
            zones.append(read_zones(locate(entry.polygons, file.parent), terrain, law=law, **choices))
    return together(zones, gridded) if zones else gridded


def _friction_rasters(settings: SiteSettings, file: Path, terrain: "Terrain", rasters: Mapping[str, str]) -> "FrictionZones":
    from runout.terrain.friction_rasters import read_friction_rasters

    paths: dict[str, Any] = {key: locate(path, file.parent) for key, path in rasters.items()}
    with stated_at(file, "terrain", "friction_rasters"):
        return read_friction_rasters(paths, terrain, law=SiteFriction(settings).law.name)


def read_releases(settings: SiteSettings, file: Path, terrain: "Terrain") -> "Reading[list[Release]]":
    """The releases on the terrain, in the order of site.yaml, with a volume factor of 1 and the friction of their files."""
    return read_each(partial(_placed_release, entry, file, terrain) for entry in settings.release)


def _placed_release(entry: ReleaseSettings, file: Path, terrain: "Terrain") -> "Release":
    key = "raster" if entry.polygons is None else "polygons"
    number = partial(entry_number, file, "release", entry.name)
    with stated_at(file, "release", number, key):
        release = _release(entry, file, terrain)
        if start := start_of(entry):
            release = replace(release, **start)
    if entry.pore_pressure is None:
        return release
    with stated_at(file, "release", number, "pore_pressure", "ratio"):
        pore = pore_pressure.made(entry.pore_pressure, file, terrain)
        pore.require_known(release.thickness, f"release {entry.name}")
        return replace(release, pore_pressure=pore)


def _release(entry: ReleaseSettings, file: Path, terrain: "Terrain") -> "Release":
    from runout.release.read import read_raster, read_vector

    common: dict[str, Any] = entry.model_dump(include={"volume", "placement", "name", "basal_friction_angle_deg"})
    if entry.polygons is not None:
        path = locate(entry.polygons, file.parent)
        return read_vector(path, terrain, thickness=entry.thickness, edge=entry.edge, layer=entry.layer, **common)
    assert entry.raster is not None  # the settings hold one of the two
    return read_raster(locate(entry.raster, file.parent), terrain, sign=entry.sign or "positive", **common)
