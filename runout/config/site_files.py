"""The input files of a site, read as site.yaml states: elevations, obstacles, friction zones and releases."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runout.config.fetch import locate
from runout.config.schema import ReleaseSettings, SiteSettings
from runout.config.site_friction import SiteFriction
from runout.config.site_structures import SiteStructures
from runout.config.stated_at import release_number, stated_at
from runout.io.side_files import files_of
from runout.io.source_kinds import is_mesh, sample_path

if TYPE_CHECKING:
    from runout.model.friction import FrictionZones
    from runout.model.release import Release
    from runout.model.terrain import Terrain
    from runout.structures.solid import Solid


@dataclass(frozen=True)
class SiteFiles:
    """The input files of a site. Each call reads them.

    Attributes
    ----------
    settings : SiteSettings
        The checked content of site.yaml.
    file : Path
        The site.yaml; other paths are relative to its folder.
    """

    settings: SiteSettings
    file: Path

    def elevations(self, extent: "Sequence[float] | None") -> "Terrain":
        """Elevations without obstacles within an extent (west, south, east, north), or of the whole raster if it is None.

        Raises
        ------
        DemError
            If they cannot be used.
        """
        with stated_at(self.file, "terrain", "dem"):
            return self._elevations(extent)

    def _elevations(self, extent: "Sequence[float] | None") -> "Terrain":
        stated = self.settings.terrain
        edges = None if extent is None else (extent[0], extent[1], extent[2], extent[3])
        from runout.terrain.averaging import averaged, smoothed

        if is_mesh(stated.dem):
            from runout.terrain.mesh import read_mesh_terrain

            terrain, blocks = read_mesh_terrain(self._located(stated.dem), stated.resolution, stated.crs, edges)[0], None
        else:
            from runout.terrain.read import read_terrain

            terrain, blocks = read_terrain(self._located(stated.dem), stated.crs, edges), stated.resolution
        terrain = smoothed(terrain, stated.smoothing, self.file.name) if stated.smoothing else terrain
        return averaged(terrain, blocks, self.file.name) if blocks else terrain

    def _overhangs(self, terrain: "Terrain") -> "list[Solid]":
        """Bodies of the overhangs of a mesh."""
        from runout.structures.overhangs import read_overhangs

        stated = self.settings.terrain
        return read_overhangs(self._located(stated.dem), terrain, stated.overhang_friction_angle_deg)

    def with_obstacles(self, terrain: "Terrain") -> "Terrain":
        """The terrain with the obstacles on it.

        Raises
        ------
        DemError
            If obstacles cannot be used.
        """
        for i, obstacle in enumerate(self.settings.terrain.obstacles or []):
            with stated_at(self.file, "terrain", "obstacles", i):
                terrain = terrain.with_obstacles(self._located(obstacle.polygons), obstacle.height, obstacle.layer)
        return terrain

    def friction_zones(self, terrain: "Terrain") -> "FrictionZones | None":
        """The friction zones and rasters on the terrain; None if site.yaml states none.

        Raises
        ------
        ZoneError
            If zones cannot be used.
        """
        stated, rasters = self.settings.terrain.friction_zones, self.settings.terrain.friction_rasters
        if not stated and not rasters:
            return None
        from runout.terrain.zones import together

        gridded = self._friction_rasters(rasters, terrain) if rasters else None
        zones = [self._zones(i, terrain) for i in range(len(stated or []))]
        return together(zones, gridded) if zones else gridded

    def _friction_rasters(self, rasters: Mapping[str, str], terrain: "Terrain") -> "FrictionZones":
        from runout.terrain.friction_rasters import read_friction_rasters

        paths = {key: self._located(path) for key, path in rasters.items()}
        with stated_at(self.file, "terrain", "friction_rasters"):
            return read_friction_rasters(paths, terrain, law=SiteFriction(self.settings).law.name)

    def _zones(self, number: int, terrain: "Terrain") -> "FrictionZones":
        """The friction zones of one entry."""
        from runout.terrain.zones import read_zones

        assert self.settings.terrain.friction_zones is not None
        stated = self.settings.terrain.friction_zones[number]
        law, choices = SiteFriction(self.settings).law.name, stated.model_dump(exclude={"polygons"})
        with stated_at(self.file, "terrain", "friction_zones", number):
            return read_zones(self._located(stated.polygons), terrain, law=law, **choices)

    def obstacles(self, terrain: "Terrain") -> list[tuple[Any, float]]:
        """Polygons (shapely, map coordinates) of the obstacles on the terrain, each with its height [m].

        Raises
        ------
        DemError
            If obstacles cannot be used.
        """
        from runout.terrain.obstacles import obstacle_parts

        stated = self.settings.terrain.obstacles or []
        parts = [obstacle_parts(terrain, self._located(o.polygons), o.height, o.layer) for o in stated]
        return [part for several in parts for part in several]

    def releases(self, terrain: "Terrain") -> "list[Release]":
        """The releases on the terrain, in the order of site.yaml, with a volume factor of 1.

        Raises
        ------
        ReleaseError
            If a release cannot be used.
        """
        return [self._placed_release(stated, terrain) for stated in self.settings.release]

    def _placed_release(self, stated: ReleaseSettings, terrain: "Terrain") -> "Release":
        key = "raster" if stated.polygons is None else "polygons"
        with stated_at(self.file, "release", partial(release_number, self.file, stated.name), key):
            return self._release(stated, terrain)

    def _release(self, stated: ReleaseSettings, terrain: "Terrain") -> "Release":
        from runout.release.read import read_raster, read_vector

        common: dict[str, Any] = {"volume": stated.volume, "placement": stated.placement, "name": stated.name}
        common["basal_friction_angle_deg"] = stated.basal_friction_angle_deg
        if stated.polygons is not None:
            path = self._located(stated.polygons)
            return read_vector(path, terrain, thickness=stated.thickness, edge=stated.edge, layer=stated.layer, **common)
        assert stated.raster is not None  # the settings hold one of the two
        return read_raster(self._located(stated.raster), terrain, sign=stated.sign or "positive", **common)

    def of_terrain(self) -> list[Path]:
        """Files of elevations and obstacles, with their side files.

        Raises
        ------
        InputError, StorageError
            If a public file cannot be downloaded or has another checksum than stated.
        """
        stated = self.settings.terrain
        return self._paths([stated.dem, *(obstacle.polygons for obstacle in stated.obstacles or [])])

    def all(self) -> list[Path]:
        """All input files with their side files, without site.yaml.

        Raises
        ------
        InputError, StorageError
            If a public file cannot be downloaded or has another checksum than stated.
        """
        stated = [self.settings.terrain.dem]
        for release in self.settings.release:
            stated += [source for source in (release.polygons, release.raster) if source is not None]
        stated += [zone.polygons for zone in self.settings.terrain.friction_zones or []]
        stated += [obstacle.polygons for obstacle in self.settings.terrain.obstacles or []]
        stated += (self.settings.terrain.friction_rasters or {}).values()
        stated += self.settings.probes.files() if self.settings.probes else []
        return self._paths([*stated, *self.structures.paths()])

    @property
    def structures(self) -> SiteStructures:
        """What site.yaml says of structures."""
        overhangs = self._overhangs if is_mesh(self.settings.terrain.dem) else None
        return SiteStructures(self.settings.structures or (), self.file, overhangs)

    def _paths(self, sources: Iterable[Any]) -> list[Path]:
        return [path for source in sources for path in _files(self._located(source))]

    def _located(self, source: Any) -> Any:
        return locate(source, self.file.parent)


def _files(source: str | Path) -> list[Path]:
    """Files of an input with their side files and sources; sample rasters are files of matplotlib."""
    if str(source).startswith("matplotlib:"):
        return [path for path in [sample_path(str(source))] if path]
    return files_of(source)
