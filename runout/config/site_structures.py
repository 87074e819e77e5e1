"""The structures of a site: read as site.yaml states, and made for its grid."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.document import Document, read_document
from runout.config.fetch import locate
from runout.config.stated_at import within_site
from runout.config.structures import PROTECTED, StructureSettings
from runout.errors import InputError, StructureError

if TYPE_CHECKING:
    from runout.model.release import Release
    from runout.model.structures import Structures
    from runout.model.terrain import Terrain
    from runout.structures.read import Bodies
    from runout.structures.solid import Solid
    from runout.structures.source import StructureSource


@dataclass(frozen=True)
class SiteStructures:
    """What site.yaml says of structures.

    Attributes
    ----------
    stated : sequence of StructureSettings
    file : Path
        The site.yaml; other paths are relative to its folder.
    overhangs : callable, optional
        Gives bodies of the overhangs of the terrain, if that is a mesh.
    """

    stated: Sequence[StructureSettings]
    file: Path
    overhangs: "Callable[[Terrain], list[Solid]] | None" = None

    @property
    def possible(self) -> bool:
        """Whether the site may have bodies: structures, or overhangs of a mesh."""
        return bool(self.stated) or self.overhangs is not None

    def paths(self) -> list[Any]:
        """Files of the structures, as site.yaml names them."""
        return [stated.file for stated in self.stated]

    def protected(self) -> list[Path]:
        """Files of the areas behind dams. Members do not depend on them."""
        return [Path(locate(stated.protects, self.file.parent)) for stated in self.stated if stated.protects]

    def protected_areas(self, terrain: "Terrain") -> "dict[str, np.ndarray]":
        """Covered area (rows, columns) [m2] of each cell behind each dam, by the name of its structures.

        Raises
        ------
        StructureError
            With all polygons that cannot be used, or lie beyond the terrain.
        """
        found: dict[str, np.ndarray] = {}
        problems: list[str] = []
        for number, stated in enumerate(self.stated):
            if stated.protects:
                name = f"{stated.name} {len(found) + 1}" if stated.name in found else stated.name
                try:
                    path = Path(locate(stated.protects, self.file.parent))
                    found[name] = _protected_area(path, stated.protects_layer, terrain)
                except InputError as error:
                    problems.append(f"structures[{number}].protects: {error}")
        self._raise(problems)
        return found

    def sources(self) -> "list[StructureSource]":
        """What is stated of each file."""
        return [self._source(stated) for stated in self.stated]

    def _source(self, stated: StructureSettings) -> "StructureSource":
        from runout.structures.source import StructureSource, Top

        given = stated.model_dump(exclude_none=True, exclude={"file", "top", "offset", *PROTECTED})
        offset = tuple(stated.offset or (0.0, 0.0, 0.0))
        return StructureSource(Path(locate(stated.file, self.file.parent)), **given, top=Top(stated.top or "flat"), offset=offset)  # type: ignore[arg-type]

    def require_readable(self) -> None:
        """Raise StructureError with all files that cannot be read, wherever their structures stand."""
        from runout.structures.read import require_readable

        problems = []
        for number, source in enumerate(self.sources()):
            try:
                require_readable(source)
            except InputError as error:
                problems.append(f"structures[{number}].file: {error}")
        self._raise(problems)

    def bodies(self, terrain: "Terrain") -> "Bodies":
        """Bodies of all files.

        Raises
        ------
        StructureError
            With all problems of all files.
        """
        from runout.structures.read import read_bodies

        try:
            read = read_bodies(self.sources(), terrain, [f"structures[{k}].file" for k in range(len(self.stated))])
        except StructureError as error:
            self._raise(error.problems)
            raise
        return read.and_more(self.overhangs(terrain)) if self.overhangs else read

    def sound_bodies(
        self, terrain: "Terrain", releases: "Sequence[Release]", spacing: tuple[float, float, float] | None
    ) -> "Bodies":
        """Bodies of all files and overhangs, for a grid of ``spacing`` [m] if it is known.

        Raises
        ------
        StructureError
            With all problems: of files, placement, areas behind dams, thickness of walls, and overlaps with releases.
        """
        from runout.structures.read import Bodies, require_sound

        problems: list[str] = []
        bodies = Bodies(())
        try:
            bodies = self.bodies(terrain)
            if bodies.solids and spacing:
                require_sound(bodies.solids, terrain, spacing, releases)
        except StructureError as error:
            problems += error.problems
        try:
            self.protected_areas(terrain)
        except StructureError as error:
            problems += error.problems
        self._raise(problems)
        return bodies

    def _raise(self, problems: Sequence[str]) -> None:
        """Raise problems that begin with a key of the structures with its line of site.yaml."""
        if problems:
            document = read_document(self.file) if self.file.is_file() else Document(self.file.name)
            raise StructureError([self._placed(problem, document) for problem in problems])

    def _placed(self, problem: str, document: Document) -> str:
        problem = within_site(problem, self.file.parent)
        begins = re.match(r"structures\[(\d+)\]\.(\w+): ", problem)
        if begins is None:
            return problem
        stated = self.stated[int(begins[1])]
        blocks = document.value(("structures",))
        same = [k for k, block in enumerate(blocks or ()) if block == stated.model_dump(exclude_unset=True)]
        number = int(begins[1])
        if same and number not in same:  # blocks with wrong keys are not among those stated
            number = same[0]
        return str(document.problem(("structures", number, begins[2]), "")) + problem[begins.end() :]

    def on_grid(
        self, terrain: "Terrain", releases: "Sequence[Release]", spacing: tuple[float, float, float]
    ) -> "Structures | None":
        """Structures for a grid of ``spacing`` [m]; None for a site without any.

        Raises
        ------
        StructureError
            With all problems: of files, placement, thickness of walls, and overlaps with releases.
        """
        if not self.possible:
            return None
        from runout.structures.build import build_structures

        return build_structures(self.sound_bodies(terrain, releases, spacing).solids, terrain, spacing)


def _protected_area(path: Path, layer: str | None, terrain: "Terrain") -> np.ndarray:
    """Covered area (rows, columns) [m2] of each cell in the polygons of a file."""
    import shapely

    from runout.io.polygons import read_polygons
    from runout.terrain.overlay import on_cells

    parts = read_polygons(path, terrain, layer, "protected area", key="protects_layer").polygons
    covered, _, _ = on_cells(np.array([shapely.union_all(parts)]), np.ones(1), terrain)
    if not covered.any():
        x, y = shapely.union_all(parts).representative_point().coords[0]
        at = f"at easting {x:.1f}, northing {y:.1f}"
        raise StructureError(f"{path}: the protected area {at} lies beyond the terrain {terrain.source}; move it")
    return covered.T[::-1] * terrain.cell_area
