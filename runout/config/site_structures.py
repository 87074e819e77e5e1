"""The structures of a site: read as site.yaml states, and made for its grid."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.fetch import locate
from runout.config.structures import StructureSettings

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
    folder : Path
        Of the site; paths are relative to it.
    overhangs : callable, optional
        Gives bodies of the overhangs of the terrain, if that is a mesh.
    """

    stated: Sequence[StructureSettings]
    folder: Path
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
        return [Path(locate(stated.protects, self.folder)) for stated in self.stated if stated.protects]

    def protected_areas(self, terrain: "Terrain") -> "dict[str, np.ndarray]":
        """Covered area (rows, columns) [m2] of each cell behind each dam, by the name of its structures.

        Raises
        ------
        ReleaseError
            If polygons cannot be used.
        StructureError
            If they lie beyond the terrain.
        """
        import shapely

        from runout.errors import StructureError
        from runout.io.polygons import read_polygons
        from runout.terrain.overlay import on_cells

        found: dict[str, np.ndarray] = {}
        for stated, path in zip((one for one in self.stated if one.protects), self.protected(), strict=True):
            parts = read_polygons(path, terrain, None, "protected area").polygons
            covered, _, _ = on_cells(np.array([shapely.union_all(parts)]), np.ones(1), terrain)
            if not covered.any():
                x, y = shapely.union_all(parts).representative_point().coords[0]
                at = f"at easting {x:.1f}, northing {y:.1f}"
                raise StructureError(f"{path}: the protected area {at} lies beyond the terrain {terrain.source}; move it")
            name = f"{stated.name} {len(found) + 1}" if stated.name in found else stated.name
            found[name] = covered.T[::-1] * terrain.cell_area
        return found

    def sources(self) -> "list[StructureSource]":
        """What is stated of each file."""
        return [self._source(stated) for stated in self.stated]

    def _source(self, stated: StructureSettings) -> "StructureSource":
        from runout.structures.source import StructureSource, Top

        given = stated.model_dump(exclude_none=True, exclude={"file", "top", "offset", "protects"})
        offset = tuple(stated.offset or (0.0, 0.0, 0.0))
        return StructureSource(Path(locate(stated.file, self.folder)), **given, top=Top(stated.top or "flat"), offset=offset)  # type: ignore[arg-type]

    def bodies(self, terrain: "Terrain") -> "Bodies":
        """Bodies of all files.

        Raises
        ------
        StructureError
            With all problems of all files.
        """
        from runout.structures.read import Bodies, read_bodies

        read = read_bodies(self.sources(), terrain) if self.stated else Bodies(())
        return read.and_more(self.overhangs(terrain)) if self.overhangs else read

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
        from runout.structures.read import require_sound

        solids = self.bodies(terrain).solids
        self.protected_areas(terrain)  # refuses them before the run, not after it
        require_sound(solids, terrain, spacing, releases)
        return build_structures(solids, terrain, spacing)
