"""Structures of files on a terrain: reading, problems, and the field for the grid of a run.

Overhangs of a terrain become bodies too: columns of cells between underside and top.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike

import numpy as np

from runout.errors import StructureError
from runout.model.limits import checked, spacing_of
from runout.model.release import Release
from runout.model.structures import Structures
from runout.model.terrain import Terrain
from runout.structures.build import build_structures
from runout.structures.facades import mesh_facades, numbered
from runout.structures.inspection import low_structures, placement_problems, release_overlaps, repeated_bodies, thin_walls
from runout.structures.readers import reader_of
from runout.structures.solid import Solid
from runout.structures.source import CONCRETE, StructureSource
from runout.terrain.mesh import Overhangs, overhangs_on

LOGGER = logging.getLogger(__name__)


def read_overhangs(path: str | PathLike[str], terrain: Terrain, friction_angle_deg: float | None = None) -> list[Solid]:
    """Bodies of what overhangs a terrain in the mesh that it was made of.

    ``friction_angle_deg`` is that of the rock; by default it is that of the ground under the mass. Raises DemError if the file
    cannot be used, or the terrain was not made of a mesh.
    """
    friction = math.nan
    if friction_angle_deg is not None:
        friction = math.tan(math.radians(checked("basal_friction_angle", friction_angle_deg, place=str(path))))
    return overhang_bodies(overhangs_on(path, terrain), terrain, friction)


def overhang_bodies(overhangs: Overhangs, terrain: Terrain, friction: float) -> list[Solid]:
    """A body for each group of cells that touch; its corners have the mean elevation of its cells there.

    ``friction`` is the Coulomb coefficient of the rock [1]; NaN: that of the ground under the mass.
    """
    from scipy.ndimage import label

    bodies = []
    layer = _layers(overhangs, terrain.shape)
    for number in np.unique(layer):
        chosen = np.flatnonzero(layer == number)
        cells = np.zeros(terrain.shape, bool)
        cells[overhangs.row[chosen], overhangs.column[chosen]] = True
        group, count = label(cells)
        own = group[overhangs.row[chosen], overhangs.column[chosen]]
        bodies += [_body(overhangs, chosen[own == k], terrain, friction) for k in range(1, count + 1)]
    return bodies


def _layers(overhangs: Overhangs, shape: tuple[int, int]) -> np.ndarray:
    """Number of the overhangs below each one in its cell (n,)."""
    cell = overhangs.row * shape[1] + overhangs.column
    order = np.lexsort([overhangs.bottom, cell])
    first = np.concatenate([[True], np.diff(cell[order]) != 0]) if len(cell) else np.zeros(0, bool)
    place = np.arange(len(cell))
    layer = np.empty(len(cell), int)
    layer[order] = place - np.maximum.accumulate(np.where(first, place, 0))
    return layer


def _body(overhangs: Overhangs, chosen: np.ndarray, terrain: Terrain, friction: float) -> Solid:
    """The body of some cells that touch."""
    rows = terrain.shape[0]
    row, column = rows - 1 - overhangs.row[chosen], overhangs.column[chosen]  # from the south
    corner = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])  # counterclockwise: east, north
    node = (column[:, None] + corner[:, 0]) * (rows + 1) + row[:, None] + corner[:, 1]
    used, at = np.unique(node, return_inverse=True)
    at, n = at.reshape(-1, 4), len(used)
    share = np.bincount(at.ravel(), minlength=n)
    bottom, top = (
        np.bincount(at.ravel(), np.repeat(z[chosen], 4), n) / share for z in (overhangs.bottom, overhangs.top)
    )  # fmt: skip
    plan = np.column_stack([used // (rows + 1) * terrain.cell_size[0], used % (rows + 1) * terrain.cell_size[1]])
    vertices = np.concatenate([np.column_stack([plan, bottom]), np.column_stack([plan, top])])
    upper = np.concatenate([at[:, [0, 1, 2]], at[:, [0, 2, 3]]])
    sides = np.concatenate([at[:, [k, (k + 1) % 4]] for k in range(4)])
    seen = {tuple(pair) for pair in sides.tolist()}
    rim = np.array([pair for pair in sides.tolist() if (pair[1], pair[0]) not in seen])
    a, b = rim.T
    faces = np.concatenate([upper + n, upper[:, ::-1], np.column_stack([a, b, b + n]), np.column_stack([a, b + n, a + n])])
    facade, facades = mesh_facades(vertices, faces)
    place = f"{terrain.source}: overhang of {len(chosen)} cells"
    return Solid("overhang", vertices, faces, facade, facades, friction, place, clearance=0.0)


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
