"""A site: its folder, its settings and its input files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runout.config import member_arguments as of_members
from runout.config.friction import SiteFriction
from runout.config.hazard import stated_conditions
from runout.config.read import load, site_file
from runout.config.release_laws import OwnLaws, laws_of
from runout.config.schema import SiteSettings
from runout.config.scheme import read_scheme
from runout.config.site_files import SiteFiles, may_hold_bodies
from runout.config.structures import COMPUTED_WITHOUT
from runout.model.erosion_laws import EROSIONS
from runout.model.joint_conditions import to_record
from runout.model.laws import LAWS

if TYPE_CHECKING:
    from runout.model.bed import Bed
    from runout.model.friction import FrictionZones
    from runout.model.inflow import Inflow
    from runout.model.materials import Material
    from runout.model.probes import Probes
    from runout.model.release import Release
    from runout.model.structures import Structures
    from runout.model.terrain import Terrain


@dataclass(frozen=True)
class SiteData:
    """Inputs that all members share: terrain, releases of volume factor 1, friction zones, structures, probes, bed, inflows."""

    terrain: "Terrain"
    releases: "tuple[Release, ...]"
    friction_zones: "FrictionZones | None"
    structures: "Structures | None" = None
    probes: "Probes | None" = None
    bed: "Bed | None" = None
    inflows: "tuple[Inflow, ...]" = ()

    @property
    def masses(self) -> "tuple[Release, ...]":
        """Releases, and the masses of the inflows at their lines as forecasts see them."""
        from runout.release.inlet import mass_at

        return (*self.releases, *map(mass_at, self.inflows))


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
    files : SiteFiles
        The input files. Each is read once, and again when one has changed; what was read travels to other processes.
    changes : tuple of str
        What the command line sets in place of site.yaml, each ``KEY=VALUE``.
    """

    folder: Path
    file: Path
    name: str
    settings: SiteSettings
    files: SiteFiles = field(default=None, compare=False, repr=False)  # type: ignore[assignment]
    changes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        files = self.files or SiteFiles(self.settings, self.file)
        object.__setattr__(self, "files", files if files.settings is self.settings else files.of_settings(self.settings))

    def with_settings(self, **sections: Any) -> "Site":
        """The site with other sections of site.yaml; inputs that may depend on them are read anew."""
        return replace(self, settings=self.settings.model_copy(update=sections))

    def on_device(self, device: str) -> "Site":
        """The site with another device (``SimulationSettings.on_device``); "cuda" spreads the members over all GPUs."""
        return self.with_settings(simulation=self.settings.simulation.on_device(device))

    def terrain(self) -> "Terrain":
        """The elevation raster, read and prepared, with the obstacles on it; DemError if it cannot be used."""
        return self.files.terrain()

    def releases(self, terrain: "Terrain | None" = None, sample: Mapping[str, float] | None = None) -> "list[Release]":
        """The releases in the order of site.yaml.

        Parameters
        ----------
        terrain : Terrain, optional
            On which they lie; that of :meth:`terrain` by default.
        sample : mapping of str to float, optional
            Sampled parameters; ``release_volume_factor`` [1] multiplies the volume, the outline stays.

        Raises
        ------
        ReleaseError
            If a release cannot be used.
        """
        return of_members.sampled_releases(self.settings, self.files.releases(terrain).require(), sample)

    def inflows(self, sample: Mapping[str, float] | None = None) -> "list[Inflow]":
        """The inflows in the order of site.yaml, with sampled parameters: ``discharge_factor`` [1] and ``inflow_delay`` [s].

        Raises
        ------
        InputError
            If an inflow cannot be used.
        """
        return of_members.sampled_inflows(self.settings, self.files.inflows().require(), sample)

    def masses(self, sample: Mapping[str, float] | None = None) -> "list[Release]":
        """The releases, and the masses of the inflows at their lines as forecasts see them; errors as those of both."""
        from runout.release.inlet import mass_at

        return [*self.releases(sample=sample), *map(mass_at, self.inflows(sample))]

    def friction_zones(self, terrain: "Terrain | None" = None) -> "FrictionZones | None":
        """The friction zones on a terrain, by default the site's own; None without any. ZoneError if they cannot be used."""
        return self.files.zones(terrain)

    def data(self) -> SiteData:
        """All that the inputs hold that members share.

        Raises
        ------
        InputError
            If an input cannot be used.
        """
        files, structures = self.files, None
        if may_hold_bodies(self.settings):
            structures = files.structures(of_members.grid_spacing(self.settings, self.masses()))
        releases, inflows = tuple(self.releases()), tuple(files.inflows().require())
        return SiteData(files.terrain(), releases, files.zones(), structures, files.probes(), files.bed(), inflows)

    def material(self, sample: Mapping[str, float] | None = None) -> "Material":
        """The material; sampled parameters replace the stated ones."""
        return of_members.material(self.settings, sample)

    def materials(self, releases: "Sequence[Release]", sample: Mapping[str, float] | None = None) -> "list[Material]":
        """The material of each of some releases in a member."""
        parameters = of_members.sampled(self.settings, sample)
        own = OwnLaws(self.settings).under(releases, parameters)
        of_site = self.material(sample)
        return [r.material or of_site for r in own]

    @property
    def friction(self) -> SiteFriction:
        """Basal friction of members and releases."""
        return SiteFriction(self.settings)

    def member_arguments(self, sample: Mapping[str, float] | None = None) -> dict[str, Any]:
        """Arguments of :func:`runout.simulate` for one member.

        Parameters
        ----------
        sample : mapping of str to float, optional
            Sampled parameters by the names and in the units of site.yaml. A whole row of the table of members is
            accepted: ``seed`` becomes the seed; ``weight``, ``annual_rate``, ``scenario`` and ``file`` are left out.
        """
        joint = {"joint_conditions": self.joint_conditions} if self.joint_conditions else {}
        return of_members.member_arguments(self.settings, self.data(), sample) | joint

    @cached_property
    def joint_conditions(self) -> list[dict[str, float]]:
        """Thresholds that members record at one time: those of ``hazard.joint`` and of the scheme that have no map."""
        hazard = self.settings.hazard
        if not (hazard.joint or hazard.scheme):
            return []
        scheme = read_scheme(hazard.scheme, self.folder).conditions if hazard.scheme else []
        return to_record([*stated_conditions(hazard), *scheme])

    def provenance(self, inputs: Sequence[Path], seed: int) -> dict[str, Any]:
        """:func:`runout.io.provenance.provenance` of a result that depends on some input files and a seed."""
        from runout.io.provenance import provenance

        return provenance(
            name=self.name, folder=self.folder, inputs=inputs, sha256=self.files.known.sha256, configuration=self.resolved(),
            seed=seed, device=self.settings.simulation.device, changes=self.changes,
        )  # fmt: skip

    def inputs(self) -> list[Path]:
        """All input files that members depend on with their side files, without site.yaml; public files are downloaded.

        Raises
        ------
        InputError, StorageError
            If a public file cannot be downloaded or has another checksum than stated.
        """
        return self.files.paths()

    def stated(self) -> dict[str, Any]:
        """What site.yaml and the command line state, without defaults, as plain values of a site.yaml that says the same."""
        return self.settings.model_dump(mode="json", exclude_unset=True, exclude_none=True)

    def resolved(self) -> dict[str, Any]:
        """Complete configuration with defaults as plain dicts, lists, numbers and text; angles in degrees.

        It contains the cell_size that accuracy sets and the default particles_per_cell, both without sampled parameters.
        """
        content = self._stated()
        simulation = content["simulation"]
        if "particles_per_cell" not in simulation:
            count = of_members.default_particles(self.settings, self.data(), simulation["cell_size"])
            simulation["particles_per_cell"] = list(count)
        return content

    def _stated(self) -> dict[str, Any]:
        """:meth:`resolved` without the default particles_per_cell. Releases are read only if the grid depends on them."""
        content = self.settings.model_dump(mode="json", exclude_none=True)
        if "cell_size" not in content["simulation"]:
            content["simulation"]["cell_size"] = of_members.cell_size(self.settings, self.masses())
        if self.files.extent is not None:
            content["terrain"]["extent"] = list(self.files.extent.edges)
        return content

    def computed(self) -> dict[str, Any]:
        """The part of :meth:`resolved` that determines the results: without device and sparse backend, which agree."""
        content, law = self._stated(), LAWS.find(self.settings.material.law)
        if law.source:
            content["material"]["source"] = law.source
        if self.friction.law.source:
            content["basal_friction"]["source"] = self.friction.law.source
        for mass, laws in zip([*content["release"], *content.get("inflow", ())], laws_of(self.settings).values(), strict=True):
            sources = {"material": laws[0].source, "basal_friction": laws[1].source}
            for key, source in sources.items():
                if source and "law" in mass.get(key, {}):
                    mass[key]["source"] = source
        if self.settings.bed and (source := EROSIONS.find(content["bed"]["erosion"]["law"]).source):
            content["bed"]["erosion"]["source"] = source
        for structure in content.get("structures", ()):
            for key in COMPUTED_WITHOUT:
                structure.pop(key, None)
        place = content["simulation"]
        del place["device"]
        place.pop("threads", None)
        if place["backend"] != "reference":
            place["backend"] = "sparse"
        return content


def read_site(path: Path | str, changes: Sequence[str] = ()) -> Site:
    """The site of a folder or a site.yaml; only site.yaml is read.

    Parameters
    ----------
    path : Path or str
    changes : sequence of str
        Settings that take the place of those of site.yaml, each ``KEY=VALUE`` (:func:`runout.config.document.set_values`).

    Raises
    ------
    ConfigError
        With all problems of the file.
    """
    file = site_file(path)
    settings = load(file, changes)
    return Site(file.parent, file, settings.name, settings, changes=tuple(changes))
