"""The input files of a site: which ones site.yaml names, their checksums, and what they hold, each read once."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from runout.config.bed import read_bed
from runout.config.document import Location
from runout.config.fetch import RemoteFile, locate
from runout.config.inflow import read_inflows
from runout.config.input_readers import build_obstacles, read_elevations, read_releases, read_zones
from runout.config.observations import READERS, read_observations
from runout.config.probes import read_probes
from runout.config.schema import SiteSettings
from runout.config.scheme import is_file
from runout.config.stated_at import Reading
from runout.config.structures import raise_placed, read_bodies, read_protected_areas
from runout.errors import InputError, StructureError
from runout.io.fingerprint import KnownFiles, Unchanged
from runout.io.input_copies import files_of
from runout.io.references import is_mesh, sample_path

if TYPE_CHECKING:
    import numpy as np

    from runout.config.extent import DerivedExtent
    from runout.model.bed import Bed
    from runout.model.friction import FrictionZones
    from runout.model.inflow import Inflow
    from runout.model.probes import Probes
    from runout.model.release import Release
    from runout.model.structures import Structures
    from runout.model.terrain import Terrain
    from runout.scores.observations import Observations
    from runout.structures.read import Bodies
    from runout.terrain.obstacles import Obstacles

T = TypeVar("T")
EACH = "*"
PLACES: dict[str, tuple[Location, ...]] = {  # settings that name input files, by what is read of them
    "terrain": (("terrain", "dem"), ("terrain", "obstacles", EACH, "polygons")),
    "releases": (
        ("release", EACH, "polygons"),
        ("release", EACH, "raster"),
        ("release", EACH, "pore_pressure", "ratio"),
        ("release", EACH, "pore_pressure", "ratio", "polygons"),
    ),
    "zones": (("terrain", "friction_zones", EACH, "polygons"), ("terrain", "friction_rasters", EACH)),
    "probes": (("probes", "points"), ("probes", "cross_sections")),
    "structures": (("structures", EACH, "file"),),
    "bed": (("bed", "polygons"), ("bed", "depth")),
    "inflows": tuple(("inflow", EACH, *key) for key in (("line",), ("polygon",), ("hydrograph",), ("pore_pressure", "ratio"))),
    "observations": tuple(("observations", name, key) for name, (key, _) in READERS.items()),
    "protected": (("structures", EACH, "protects"),),  # areas behind dams
    "scheme": (("hazard", "scheme"),),
    "design": (("ensemble", "table"),),
    "orthophoto": (("report", "orthophoto"),),
}
OF_MEMBERS = ("terrain", "releases", "zones", "probes", "structures", "bed", "inflows")  # parts that members depend on
OF_PRODUCTS = ("observations", "protected", "scheme", "design", "orthophoto")


def named_inputs(values: Any) -> Iterator[tuple[Location, Any]]:
    """Location and value of every setting that names an input file, in settings or in the plain values of a document."""
    for places in PLACES.values():
        for place in places:
            yield from _at(values, place)


def _at(value: Any, place: Location, location: Location = ()) -> Iterator[tuple[Location, Any]]:
    if location == ("bed",) and place == ("depth",) and next(_at(value, ("polygons",)), None):
        return  # an attribute of the polygons
    if location == ("hazard", "scheme") and not is_file(value):
        return  # one of runout
    if not place:
        if value and isinstance(value, str | RemoteFile):
            yield location, value
    elif place[0] == EACH:
        entries = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
        for key, entry in entries:
            yield from _at(entry, place[1:], (*location, key))
    else:
        inner = value.get(place[0]) if isinstance(value, Mapping) else getattr(value, str(place[0]), None)
        yield from _at(inner, place[1:], (*location, place[0]))


class SiteFiles:
    """Input files of a site. Each is read at its first use, and again only after one of those in use was written.

    A site is a value; this is where what its files hold is kept. The parts that members need travel to other processes. Paths are
    relative to the folder of ``file``, the site.yaml. ``known`` are checksums of the files, and what was computed from them.
    """

    def __init__(self, settings: SiteSettings, file: Path, known: KnownFiles | None = None):
        self.settings, self.file, self.known = settings, file, known or KnownFiles()
        self._watched: dict[str, Unchanged] = {}
        self._content: dict[tuple[Any, ...], Any] = {}

    def __getstate__(self) -> dict[str, Any]:
        needed = [key for key in self._content if key[0] in (*OF_MEMBERS, "extent") and key != ("structures",)]
        content = {key: self._content[key] for key in needed}
        watched = {part: files for part, files in self._watched.items() if part in OF_MEMBERS}
        return {**vars(self), "_content": content, "_watched": watched}

    def recorded_in(self, record: Path) -> "SiteFiles":
        """These files, whose checksums are kept in a record between runs."""
        files = copy(self)  # with the same content
        files._watched, files._content, files.known = self._watched, self._content, self.known.recorded_in(record)
        return files

    def of_settings(self, settings: SiteSettings) -> "SiteFiles":
        """The files of other settings. If these differ in probes or device only, nothing but the probes is read again."""
        own, files = self.settings, SiteFiles(settings, self.file, self.known)
        device = {name: getattr(own.simulation, name) for name in ("device", "backend", "threads")}
        alike = {"probes": own.probes, "simulation": settings.simulation.model_copy(update=device)}
        if settings.model_copy(update=alike) == own:
            anew = () if settings.probes == own.probes else ("probes",)
            files._watched |= {part: watched for part, watched in self._watched.items() if part not in anew}
            files._content |= {key: content for key, content in self._content.items() if key[0] not in anew}
        return files

    def paths(self, *parts: str) -> list[Path]:
        """Files of some parts with their side files, without site.yaml; by default those that members depend on.

        Raises InputError or StorageError if a public file cannot be downloaded or has another checksum than stated.
        """
        return list(dict.fromkeys(path for part in parts or OF_MEMBERS for path in self._watch(part).seen))

    def checksums(self, *parts: str) -> list[str]:
        """Checksums of the contents of :meth:`paths`.

        Raises InputError or StorageError if an input cannot be read.
        """
        return [self._checksum(path) for path in self.paths(*parts)]

    def _checksum(self, path: Path) -> str:
        try:
            return self.known.sha256(path)
        except OSError as cause:
            raise InputError(f"{path}: the input cannot be read ({cause.strerror}); put it there or mend site.yaml") from cause

    def _watch(self, part: str) -> Unchanged:
        """Guard of the files of a part. If a watched file was written, all that was read is forgotten."""
        if not all(watched.holds() for watched in self._watched.values()):
            self._watched.clear()
            self._content.clear()
        if part not in self._watched:
            sources = [source for place in PLACES[part] for _, source in _at(self.settings, place)]
            located = [locate(source, self.file.parent) for source in sources]
            self._watched[part] = Unchanged(path for one in located for path in _with_side_files(one))
        return self._watched[part]

    def _once(self, part: str, read: Callable[[], T], *of: Any) -> T:
        """What ``read`` returned at its first call for a part, and for what it was read besides."""
        with suppress(InputError):  # the reader names the setting
            self._watch(part)
        key = (part, *of)
        if key in self._content:
            return self._content[key]  # type: ignore[no-any-return]
        content = read()
        if not (isinstance(content, Reading) and content.problems):
            self._content[key] = content
        return content

    def _on_terrain(self, part: str, read: "Callable[[Terrain], T]", terrain: "Terrain | None" = None) -> T:
        """What ``read`` returns for the site's own terrain, once, or for another one."""
        own = self.terrain()
        return self._once(part, lambda: read(own)) if terrain is None or terrain is own else read(terrain)

    @property
    def extent(self) -> "DerivedExtent | None":
        """Extent that is read of a huge elevation raster if site.yaml states none; None for other rasters."""
        if self.settings.terrain.extent is not None or is_mesh(self.settings.terrain.dem):
            return None
        if ("extent",) not in self._content:
            from runout.config.extent import known_extent

            self._content["extent",] = known_extent(self)
        return self._content["extent",]  # type: ignore[no-any-return]

    def terrain(self) -> "Terrain":
        """The elevation raster, read and prepared, with the obstacles on it; DemError if it cannot be used."""
        return self._once("terrain", self._read_ground)[0]

    def obstacles(self) -> "list[Obstacles]":
        """The obstacles of each entry of site.yaml, which the terrain contains; DemError if they cannot be used."""
        return self._once("terrain", self._read_ground)[1]

    def _read_ground(self) -> "tuple[Terrain, list[Obstacles]]":
        derived = self.extent
        terrain = read_elevations(self.settings, self.file, derived.edges if derived else self.settings.terrain.extent)
        if derived:
            terrain = replace(terrain, changes=(derived.sentence, *terrain.changes))
        return build_obstacles(self.settings, self.file, terrain)

    def releases(self, terrain: "Terrain | None" = None) -> "Reading[list[Release]]":
        """The releases in the order of site.yaml with a volume factor of 1, and the problems of those that cannot be used."""
        return self._on_terrain("releases", partial(read_releases, self.settings, self.file), terrain)

    def zones(self, terrain: "Terrain | None" = None) -> "FrictionZones | None":
        """The friction zones; None if site.yaml states none. ZoneError if they cannot be used."""
        return self._on_terrain("zones", partial(read_zones, self.settings, self.file), terrain)

    def probes(self) -> "Probes | None":
        """Points and cross-sections at which members record series; None without any. ConfigError with all problems."""
        return self._on_terrain("probes", partial(read_probes, self.settings, self.file))

    def bed(self) -> "Bed | None":
        """The erodible bed, without sampled parameters; None if site.yaml states none. InputError if it cannot be used."""
        return self._on_terrain("bed", partial(read_bed, self.settings, self.file))

    def inflows(self) -> "Reading[list[Inflow]]":
        """The inflows in the order of site.yaml, without sampled parameters, and the problems of those that cannot be used."""
        return self._on_terrain("inflows", partial(read_inflows, self.settings, self.file))

    def observations(self) -> "Reading[Observations | None]":
        """The observations, None if site.yaml states none, and the problems of those that cannot be used."""
        return self._on_terrain("observations", partial(read_observations, self.settings, self.file))

    def bodies(self) -> "Bodies":
        """Bodies of structures and overhangs; StructureError with all problems of all files."""
        return self._on_terrain("structures", partial(read_bodies, self.settings, self.file))

    def protected_areas(self) -> "dict[str, np.ndarray]":
        """Covered area (rows, columns) [m2] of each cell behind each dam, by the name of its structures.

        Raises StructureError with all polygons that cannot be used, or lie beyond the terrain.
        """
        return self._on_terrain("protected", partial(read_protected_areas, self.settings, self.file))

    def structures(self, spacing: tuple[float, float, float]) -> "Structures | None":
        """Structures for a grid of ``spacing`` [m]; None without any. StructureError as of :func:`sound_bodies`."""
        if not may_hold_bodies(self.settings):
            return None
        from runout.structures.build import build_structures

        terrain = self.terrain()
        return self._once("structures", lambda: build_structures(sound_bodies(self, spacing).solids, terrain, spacing), spacing)


def may_hold_bodies(settings: SiteSettings) -> bool:
    """Whether there may be bodies: structures, or overhangs of a mesh."""
    return bool(settings.structures) or is_mesh(settings.terrain.dem)


def sound_bodies(files: SiteFiles, spacing: tuple[float, float, float] | None) -> "Bodies":
    """Bodies of structures and overhangs, for a grid of ``spacing`` [m] if it is known.

    Raises StructureError with all problems: of files, placement, areas behind dams, thickness of walls, and overlaps with releases
    and inflows.
    """
    from runout.release.inlet import mass_at
    from runout.structures.read import Bodies, require_sound

    problems: list[str] = []
    bodies = Bodies(())
    try:
        bodies = files.bodies()
        if bodies.solids and spacing:
            entering = [mass_at(one) for one in files.inflows().content]
            require_sound(bodies.solids, files.terrain(), spacing, files.releases().content, entering)
    except StructureError as error:
        problems += error.problems
    try:
        files.protected_areas()
    except StructureError as error:
        problems += error.problems
    raise_placed(problems, files.settings, files.file)
    return bodies


def _with_side_files(source: str | Path) -> list[Path]:
    """Files of an input with their side files and sources; sample rasters are files of matplotlib."""
    if str(source).startswith("matplotlib:"):
        return [path for path in [sample_path(str(source))] if path]
    return files_of(source)
