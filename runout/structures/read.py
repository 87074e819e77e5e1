"""Structures of files on a terrain: reading, problems, and the field for the grid of a run."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

from runout.errors import StructureError, member_of
from runout.model.limits import spacing_of
from runout.model.release import Release
from runout.model.structures import Structures
from runout.model.terrain import Terrain
from runout.structures.build import build_structures
from runout.structures.facades import numbered
from runout.structures.footprints import read_footprints
from runout.structures.inspection import placement_problems, release_overlaps, thin_walls
from runout.structures.meshes import read_meshes
from runout.structures.solid import Solid
from runout.structures.source import CONCRETE, StructureSource, Top


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


def read_bodies(sources: Sequence[StructureSource], terrain: Terrain) -> Bodies:
    """The bodies of files, each on the ground or above it.

    Raises
    ------
    StructureError
        With all problems of all files.
    """
    read = [read_meshes(s, terrain) if s.is_mesh else read_footprints(s, terrain) for s in sources]
    solids = [solid for one in read for solid in one.solids]
    problems = [problem for one in read for problem in one.problems] + placement_problems(solids, terrain)
    if problems:
        raise StructureError(problems)
    changes = [change for one in read for change in one.changes]
    return Bodies((), tuple(dict.fromkeys(changes))).and_more(solids)


def require_sound(
    solids: Sequence[Solid], terrain: Terrain, spacing: tuple[float, float, float], releases: Sequence[Release] = ()
) -> None:
    """Raise StructureError with all walls that are too thin for a grid, and all structures in a release."""
    problems = thin_walls(solids, terrain, spacing) + release_overlaps(solids, releases)
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
    follows = member_of(Top, top, "top", StructureError)
    source = StructureSource(
        Path(path), layer, name, height, base, clearance, follows, friction_angle_deg, units, crs, offset
    )  # fmt: skip
    spacing, bodies = spacing_of(cell_size), read_bodies([source], terrain)
    require_sound(bodies.solids, terrain, spacing)
    made = build_structures(bodies.solids, terrain, spacing)
    if made is None:
        raise StructureError(f"{path}: holds no structure")
    return made
