"""Structures of files on a terrain: reading, problems, and the field for the grid of a run."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike

from runout.errors import StructureError
from runout.model.limits import spacing_of
from runout.model.release import Release
from runout.model.structures import Structures
from runout.model.terrain import Terrain
from runout.structures.build import build_structures
from runout.structures.facades import numbered
from runout.structures.inspection import low_structures, placement_problems, release_overlaps, repeated_bodies, thin_walls
from runout.structures.overhangs import read_overhangs
from runout.structures.readers import reader_of
from runout.structures.solid import Solid
from runout.structures.source import CONCRETE, StructureSource

LOGGER = logging.getLogger(__name__)


@dataclass(frozen=True)
class Bodies:
    """Bodies of all files, each with a name of its own, and what was changed or assumed."""

    solids: tuple[Solid, ...]
    changes: tuple[str, ...] = ()

    def and_more(self, solids: Sequence[Solid]) -> "Bodies":
        """These and other bodies, each with a name of its own."""
        every = (*self.solids, *solids)
        names = numbered([solid.name for solid in every])
        return Bodies(tuple(replace(s, name=name) for s, name in zip(every, names, strict=True)), self.changes)


def read_bodies(sources: Sequence[StructureSource], terrain: Terrain, keys: Sequence[str] = ()) -> Bodies:
    """The bodies of files, each on the ground or above it.

    ``keys`` are what names each file, for messages; they begin those of its bodies, too. Raises StructureError with all problems of
    all files.
    """
    read = [reader_of(source.path).read(source, terrain) for source in sources]
    begin = [f"{key}: " for key in keys] or [""] * len(read)
    solids = [replace(solid, place=key + solid.place) for key, one in zip(begin, read, strict=True) for solid in one.solids]
    problems = [key + problem for key, one in zip(begin, read, strict=True) for problem in one.problems]
    problems += repeated_bodies(solids) + placement_problems(solids, terrain)
    if problems:
        raise StructureError(problems)
    changes = [change for one in read for change in one.changes]
    return Bodies((), tuple(dict.fromkeys(changes))).and_more(solids)


def require_readable(source: StructureSource) -> None:
    """Raise InputError if a file cannot be read, wherever its structures stand."""
    reader_of(source.path).require_readable(source)


def require_sound(
    solids: Sequence[Solid], terrain: Terrain, spacing: tuple[float, float, float], releases: Sequence[Release] = (),
    inflows: Sequence[Release] = (),
) -> None:  # fmt: skip
    """Raise StructureError with all walls that are too thin for a grid, and all structures in a release, or where mass enters."""
    problems = thin_walls(solids, terrain, spacing) + release_overlaps(solids, releases, inflows)
    if problems:
        raise StructureError(problems)


def structures_from_file(
    path: str | PathLike[str],
    terrain: Terrain,
    cell_size: float | tuple[float, float, float],
    *,
    layer: str | None = None,
    name: str = "structure",
    height: float | str | None = None,
    base: float | str | None = None,
    clearance: float | str | None = None,
    top: str = "flat",
    friction_angle_deg: float = CONCRETE,
    units: str | None = None,
    crs: str | None = None,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Structures:
    """Structures of one file for a grid; see :meth:`runout.Structures.from_file`."""
    source = StructureSource(
        path, layer, name, height, base, clearance, top, friction_angle_deg, units, crs, offset,  # type: ignore[arg-type]
    )  # fmt: skip
    return structures_from_sources([source], terrain, cell_size)


def structures_from_sources(
    sources: Sequence[StructureSource] | StructureSource,
    terrain: Terrain,
    cell_size: float | tuple[float, float, float],
    *,
    overhangs: str | PathLike[str] | None = None,
    overhang_friction_angle_deg: float | None = None,
    releases: Sequence[Release] = (),
) -> Structures:
    """Structures of several files for a grid; see :meth:`runout.Structures.from_sources`."""
    sources = [sources] if isinstance(sources, StructureSource) else sources
    for number, source in enumerate(sources):
        if not isinstance(source, StructureSource):
            raise StructureError(f"sources[{number}] is {source!r}; give a runout.StructureSource of the file")
    spacing, bodies = spacing_of(cell_size), read_bodies(sources, terrain)
    if overhangs is not None:
        bodies = bodies.and_more(read_overhangs(overhangs, terrain, overhang_friction_angle_deg))
    require_sound(bodies.solids, terrain, spacing, releases)
    for warning in low_structures(bodies.solids, terrain, spacing):
        LOGGER.warning("%s", warning)
    structures = build_structures(bodies.solids, terrain, spacing)
    if structures is None:
        named = ", ".join(str(source.path) for source in sources) or overhangs or "no file"
        raise StructureError(f"{named}: holds no structure; leave structures out of the run")
    return structures
