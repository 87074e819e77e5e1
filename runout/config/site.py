"""A site: its folder, its settings, and the terrain, releases and zones that they define."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from runout.config.material import sampled_ranges
from runout.config.overrides import on_device, with_cell_size
from runout.config.read import load, site_file
from runout.config.schema import SiteSettings
from runout.config.site_data import SiteData
from runout.config.site_files import SiteFiles
from runout.config.site_friction import SiteFriction
from runout.config.site_observations import SiteObservations
from runout.config.site_probes import SiteProbes
from runout.config.site_structures import SiteStructures
from runout.config.structures import COMPUTED_WITHOUT
from runout.errors import ConfigError, InputError
from runout.forecast.accuracy import CHOICES, CellSize, choices
from runout.io.fingerprint import Unchanged
from runout.io.known_files import KnownFiles
from runout.io.source_kinds import is_mesh
from runout.model.laws import LAWS
from runout.model.limits import spacing_of

if TYPE_CHECKING:
    from runout.config.extent import DerivedExtent
    from runout.config.probes import ProbeSettings
    from runout.model.friction import FrictionZones
    from runout.model.materials import Material
    from runout.model.probes import Probes
    from runout.model.release import Release
    from runout.model.structures import Structures
    from runout.model.terrain import Terrain

T = TypeVar("T")
ROW_EXTRAS = ("weight", "seed", "file")  # columns of the table of members besides the parameters


@dataclass(frozen=True)
class Site:
    """One site folder.

    Attributes
    ----------
    folder, file : Path
        The folder and its site.yaml.
    name : str
        Short name.
    settings : SiteSettings
        The checked content of site.yaml, defaults filled in; angles in degrees.
    known : KnownFiles
        What an earlier run found out about the input files.

    Terrain and releases are read once, and again when one of their files has changed. They travel with the site to other
    processes.
    """

    folder: Path
    file: Path
    name: str
    settings: SiteSettings
    known: KnownFiles = field(default_factory=KnownFiles, compare=False, repr=False)
    _kept: dict[str, tuple[Unchanged, Any]] = field(default_factory=dict, init=False, compare=False, repr=False)

    def with_same_inputs(self, *, settings: SiteSettings | None = None, known: KnownFiles | None = None) -> "Site":
        """The site with other settings, on which no input depends, or another record of its files; nothing is read again."""
        other = replace(self, settings=settings or self.settings, known=known or self.known)
        other._kept.update(self._kept)
        other.__dict__.update({name: self.__dict__[name] for name in ("derived_extent", "_grid") if name in self.__dict__})
        return other

    def terrain(self) -> "Terrain":
        """The elevation raster, read and prepared, with the obstacles on it.

        Raises
        ------
        DemError
            If it cannot be used.
        """
        return self._read_once("terrain", self._sources.of_terrain, self._read_terrain)

    @property
    def _sources(self) -> SiteFiles:
        return SiteFiles(self.settings, self.file)

    def _read_once(self, name: str, files: Callable[[], Iterable[Path]], read: Callable[[], T]) -> T:
        """What ``read`` returned when it was first called, unless one of its files was written since."""
        kept = self._kept.get(name)
        if kept is None or not kept[0].holds():
            kept = self._kept[name] = (Unchanged(files()), read())
        return kept[1]  # type: ignore[no-any-return]

    def _read_terrain(self) -> "Terrain":
        stated, sources = self.settings.terrain.extent, self._sources
        if stated is not None or self.derived_extent is None:
            return sources.with_obstacles(sources.elevations(stated))
        terrain = sources.elevations(self.derived_extent.edges)
        return sources.with_obstacles(replace(terrain, changes=(self.derived_extent.sentence, *terrain.changes)))

    def read_elevations(self, extent: "Sequence[float] | None") -> "Terrain":
        """Elevations without obstacles within an extent (west, south, east, north), or of the whole raster if it is None.

        Raises
        ------
        DemError
            If they cannot be used.
        """
        return self._sources.elevations(extent)

    @cached_property
    def derived_extent(self) -> "DerivedExtent | None":
        """Extent that is read of a huge elevation raster if site.yaml states none; None for other rasters."""
        from runout.config.extent import known_extent

        whole = self.settings.terrain.extent is not None or is_mesh(self.settings.terrain.dem)
        return None if whole else known_extent(self)

    def friction_zones(self, terrain: "Terrain") -> "FrictionZones | None":
        """The friction zones on the terrain; None if site.yaml states none.

        Raises
        ------
        ZoneError
            If zones cannot be used.
        """
        return self._read_on("zones", terrain, self._sources.friction_zones)

    def obstacles(self, terrain: "Terrain") -> list[tuple[Any, float]]:
        """Polygons (shapely, map coordinates) of the obstacles on the terrain, each with its height [m].

        Raises
        ------
        DemError
            If obstacles cannot be used.
        """
        return self._sources.obstacles(terrain)

    def releases(self, terrain: "Terrain", sample: Mapping[str, float] | None = None) -> "list[Release]":
        """The releases on the terrain, in the order of site.yaml.

        Parameters
        ----------
        sample : mapping of str to float, optional
            Sampled parameters; ``release_volume_factor`` [1] multiplies the volume, the outline stays.

        Raises
        ------
        ReleaseError
            If a release cannot be used.
        """
        return self._scaled(self._read_on("releases", terrain, self._sources.releases), sample)

    def _read_on(self, name: str, terrain: "Terrain", read: "Callable[[Terrain], T]") -> T:
        """What ``read`` returns for a terrain, kept if that is the site's own."""
        own = self._kept.get("terrain")
        if own is None or own[1] is not terrain:
            return read(terrain)
        return self._read_once(name, self.inputs, lambda: read(terrain))

    def _scaled(self, releases: "Sequence[Release]", sample: Mapping[str, float] | None) -> "list[Release]":
        factor = self._known(sample).get("release_volume_factor", 1.0)
        return [r.scaled(factor) if factor != 1.0 else r for r in self.friction.under(releases, self._known(sample))]

    def data(self) -> SiteData:
        """All that the inputs hold, read once for many members.

        Raises
        ------
        InputError
            If an input cannot be used.
        """
        return self._read_once("data", self.inputs, self._read_data)

    def _read_data(self) -> SiteData:
        terrain = self.terrain()
        releases = self.releases(terrain)
        zones, probes = self.friction_zones(terrain), self.probes(terrain)
        return SiteData(terrain, tuple(releases), zones, self._built(terrain, releases), probes)

    def _built(self, terrain: "Terrain", releases: "Sequence[Release]") -> "Structures | None":
        """The structures for the grid of the site."""
        stated = self.structures
        return stated.on_grid(terrain, releases, spacing_of(self.grid(releases)["cell_size"])) if stated.possible else None

    @property
    def structures(self) -> SiteStructures:
        """What site.yaml says of structures."""
        return self._sources.structures

    def probes(self, terrain: "Terrain") -> "Probes | None":
        """Points and cross-sections at which members record time series; None without any. Raises ConfigError with all problems."""
        return self._read_on("probes", terrain, SiteProbes(self.settings.probes, self.file).read)

    def material(self, sample: Mapping[str, float] | None = None) -> "Material":
        """The material; sampled parameters replace the stated ones."""
        return self.settings.material.material(self._known(sample))

    @property
    def friction(self) -> SiteFriction:
        """Basal friction of members and releases."""
        return SiteFriction(self.settings)

    def member_arguments(self, sample: Mapping[str, float] | None = None, data: SiteData | None = None) -> dict[str, Any]:
        """Arguments of :func:`runout.simulate` for one member.

        Parameters
        ----------
        sample : mapping of str to float, optional
            Sampled parameters by the names and in the units of site.yaml. A whole row of the table of members is
            accepted: ``seed`` becomes the seed, ``weight`` and ``file`` are left out.
        data : SiteData, optional
            That of :meth:`data`, where it has been read already.
        """
        sampled = self._known(sample)
        data = data or self.data()
        stated = self.settings.simulation
        grid = self._grid
        count = _fixed(stated.particles_per_cell)
        if count is None:
            count = self.default_particles(data, grid["cell_size"], sampled)
        return {
            "terrain": data.terrain,
            "release": self._scaled(data.releases, sampled),
            "material": self.material(sampled),
            **self.friction.arguments(sampled),
            "friction_zones": data.friction_zones,
            **({"structures": data.structures} if data.structures else {}),
            "cell_size": _fixed(grid["cell_size"]),
            "particles_per_cell": count,
            "end_time": stated.end_time,
            "backend": stated.backend,
            "device": stated.device,
            "precision": stated.precision,
            "seed": int((sample or {}).get("seed", self.settings.ensemble.seed)),
            "cfl": grid["cfl"],
            "transfer": stated.transfer,
            "flip_ratio": stated.flip_ratio,
            "f_bar": stated.f_bar,
            "sleep_speed": stated.sleep_speed,
            "substeps": stated.substeps,
            "initial_stress": stated.initial_stress,
            "stop": stated.stop_when_at_rest,
            "arrival_threshold": stated.arrival_threshold,
            **({"snapshot_times": even_times(stated.end_time, stated.snapshots)} if stated.snapshots else {}),
            **({"probes": data.probes} if data.probes else {}),
        }

    def grid(self, releases: "Sequence[Release]") -> dict[str, Any]:
        """cell_size [m] and cfl: as stated, else from simulation.accuracy and ``releases`` with a volume factor of 1.

        All members have the same grid, whatever their volume factor.
        """
        stated = self.settings.simulation.model_dump(include=set(CHOICES))
        if stated["cell_size"] is not None:
            return stated
        size = choices(self.settings.simulation.accuracy, releases, {})["cell_size"]
        return {**stated, "cell_size": size}

    def default_particles(
        self, data: SiteData, cell_size: "CellSize | Sequence[float]", sample: Mapping[str, float] | None = None
    ) -> tuple[int, int, int]:
        """Default particles per cell (px, py, pz) for cells of ``cell_size`` [m]."""
        from runout.release.arrangement import default_particles

        sampled = self._known(sample)
        height = cell_size[2] if isinstance(cell_size, Sequence) else cell_size
        releases, basal = self._scaled(data.releases, sampled), self.friction.of_run(sampled)
        return default_particles(releases, self.material(sampled), basal, height, data.friction_zones)

    @cached_property
    def _grid(self) -> dict[str, Any]:
        """:meth:`grid` of the site's releases. They are read only if the grid depends on them."""
        return self.grid(self.releases(self.terrain()) if self.settings.simulation.cell_size is None else [])

    def inputs(self) -> list[Path]:
        """All input files with their side files, without site.yaml; public files are downloaded.

        Raises
        ------
        InputError, StorageError
            If a public file cannot be downloaded or has another checksum than stated.
        """
        return self._sources.all()

    @property
    def observed(self) -> SiteObservations:
        """What site.yaml says of observations. Members do not depend on them."""
        return SiteObservations(self.settings.observations, self.file)

    def observation_checksums(self) -> list[tuple[str, str]]:
        """Names and checksums of the files of the observations, and of the areas behind dams.

        Raises
        ------
        InputError, StorageError
            If one cannot be read or downloaded.
        """
        return [(path.name, self._checksum(path)) for path in (*self.observed.paths(), *self.structures.protected())]

    def checksums(self) -> list[str]:
        """Checksums of the contents of :meth:`inputs`.

        Raises
        ------
        InputError, StorageError
            If an input cannot be read.
        """
        return [self._checksum(path) for path in self.inputs()]

    def _checksum(self, path: Path) -> str:
        try:
            return self.known.sha256(path)
        except OSError as cause:
            raise InputError(f"{path}: the input cannot be read ({cause.strerror}); put it there or mend site.yaml") from cause

    def resolved(self) -> dict[str, Any]:
        """Complete configuration with defaults as plain dicts, lists, numbers and text; angles in degrees.

        It contains the cell_size that accuracy sets and the default particles_per_cell, both without sampled parameters.
        """
        content = self._stated()
        simulation = content["simulation"]
        if "particles_per_cell" not in simulation:
            simulation["particles_per_cell"] = list(self.default_particles(self.data(), simulation["cell_size"]))
        return content

    def _stated(self) -> dict[str, Any]:
        """:meth:`resolved` without the default particles_per_cell."""
        content = self.settings.model_dump(mode="json", exclude_none=True)
        if "cell_size" not in content["simulation"]:
            content["simulation"]["cell_size"] = self._grid["cell_size"]
        if self.derived_extent is not None:
            content["terrain"]["extent"] = list(self.derived_extent.edges)
        return content

    def computed(self) -> dict[str, Any]:
        """The part of :meth:`resolved` that determines the results: without device and sparse backend, which agree."""
        content, law = self._stated(), LAWS.find(self.settings.material.law)
        if law.source:
            content["material"]["source"] = law.source
        if self.friction.law.source:
            content["basal_friction"]["source"] = self.friction.law.source
        for structure in content.get("structures", ()):
            for key in COMPUTED_WITHOUT:
                structure.pop(key, None)
        place = content["simulation"]
        del place["device"]
        place.pop("threads", None)
        if place["backend"] != "reference":
            place["backend"] = "sparse"
        return content

    def on_device(self, device: str) -> "Site":
        """The site with another device, see :func:`runout.config.overrides.on_device`; "cuda" spreads the members over all GPUs."""
        simulation = on_device(self.settings.simulation, device)
        return self.with_same_inputs(settings=self.settings.model_copy(update={"simulation": simulation}))

    def with_cell_size(self, cell_size: Sequence[float]) -> "Site":
        """The site with another grid spacing [m], see :func:`runout.config.overrides.with_cell_size`."""
        simulation = with_cell_size(self.settings.simulation, cell_size)
        return replace(self, settings=self.settings.model_copy(update={"simulation": simulation}))

    def with_probes(self, probes: "ProbeSettings | None") -> "Site":
        """The site with other probes: its members are others, too."""
        return replace(self, settings=self.settings.model_copy(update={"probes": probes}))

    def _known(self, sample: Mapping[str, float] | None) -> dict[str, float]:
        """The sampled parameters; an unknown name is refused."""
        if not sample:  # a site with an invalid material block has no material
            return {}
        ranges = sampled_ranges(LAWS.find(self.settings.material.law), self.friction.law)
        unknown = [name for name in sample if name not in ranges and name not in ROW_EXTRAS]
        if unknown:
            raise ConfigError(f"{unknown[0]}: not a parameter of a member; choose among {', '.join(ranges)}")
        return {name: float(value) for name, value in sample.items() if name in ranges}


def read_site(path: Path | str) -> Site:
    """The site of a folder or a site.yaml; only site.yaml is read.

    Raises
    ------
    ConfigError
        With all problems of the file.
    """
    file = site_file(path)
    settings = load(file)
    return Site(file.parent, file, settings.name, settings)


def even_times(end_time: float, count: int) -> tuple[float, ...]:
    """Times [s] of ``count`` snapshots from 0 to ``end_time`` [s]."""
    return tuple(end_time * k / max(1, count - 1) for k in range(count))


def _fixed(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
