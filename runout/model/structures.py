"""Structures of a scene: the signed distance to their surfaces near them, and the patches that forces are booked on."""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.errors import ConfigError
from runout.model.facts import as_html, as_text, short
from runout.model.readers import reader
from runout.model.terrain import Terrain

if TYPE_CHECKING:
    from runout.model.release import Release

FINEST, WIDEST = 0.5, 2.0  # largest spacing of the lattice and least band, in the smallest and the largest spacing of the grid
NAMED = 5  # structures that a summary names
CELLS = 8  # of the lattice along an edge of a block; a block has CELLS + 1 nodes along it, shared with its neighbours


@dataclass(frozen=True)
class Patches:
    """Plane parts of the surfaces, each of about the size of a grid cell. In concave edges contact uses their planes."""

    # centre, normal: (p, 3): local position [m] and outward unit normal
    centre: np.ndarray
    normal: np.ndarray
    area: np.ndarray  # (p,) [m2]
    facade: np.ndarray  # (p,) of int: row of the facade that a patch belongs to
    friction: np.ndarray  # (p,): Coulomb coefficient of the surface [1]; NaN: that of the ground under the mass


@dataclass(frozen=True)
class StructureField:
    """Signed distance to all structures on a lattice of cubes, in the blocks of it that lie near a surface or inside.

    Node (i, j, k) of the lattice is at ``origin + spacing * (i, j, k)``, in local metres. Block (a, b, c) holds the nodes from
    ``CELLS * (a, b, c)`` to ``CELLS * (a + 1, b + 1, c + 1)``, both included.
    """

    # edge of a lattice cell [m]; at most half the spacing of the grid of the run, so that edges and thin walls are resolved
    spacing: float
    origin: tuple[float, float, float]  # local position of the first node [m]
    # (nx, ny, nz) of int32: row of `distance` and `patch` of each block; -1 where every structure is further away than `band`
    blocks: np.ndarray
    # (n, 9, 9, 9) of float32: distance [m] to the nearest surface, positive outside and negative inside, within `band`
    distance: np.ndarray
    patch: np.ndarray  # (n, 9, 9, 9) of int32: row of the patch nearest to each node
    band: float  # largest distance that the field resolves [m]; contact needs about three spacings of the grid
    patches: Patches  # where forces act

    def __post_init__(self) -> None:
        side = (len(self.distance), *(CELLS + 1,) * 3)
        if self.distance.shape != side or self.patch.shape != side:
            raise ConfigError(f"blocks of structures have shapes {self.distance.shape} and {self.patch.shape}; both must be {side}")
        if self.blocks.max(initial=-1) >= len(self.distance):
            raise ConfigError(f"a block of structures has row {self.blocks.max()} of {len(self.distance)}")
        n = len(self.patches.area)
        if self.patch.min(initial=0) < 0 or self.patch.max(initial=-1) >= n:
            raise ConfigError(f"nodes of structures have patches {self.patch.min()} to {self.patch.max()}; there are 0 to {n - 1}")
        if not np.isfinite(self.distance).all():
            raise ConfigError("a distance of structures is not a number")

    @property
    def nbytes(self) -> int:
        """Memory [byte]."""
        return self.blocks.nbytes + self.distance.nbytes + self.patch.nbytes

    def require_fits(self, spacing: tuple[float, float, float]) -> None:
        """ConfigError unless the lattice is fine enough, and wide enough, for contact on a grid with this ``spacing`` [m]."""
        if self.spacing > FINEST * min(spacing) * (1 + 1e-9):
            most = f"{FINEST * min(spacing):g} m, half the smallest spacing of the grid"
            raise ConfigError(f"the lattice of structures has cells of {self.spacing:g} m; use at most {most}")
        if self.band < WIDEST * max(spacing) * (1 - 1e-9):
            least = f"{WIDEST * max(spacing):g} m, {WIDEST:g} spacings of the grid"
            raise ConfigError(f"the distance of structures is known within {self.band:g} m; {least}, are needed")


@dataclass(frozen=True, repr=False)
class Structures:
    """Structures by name, with their facades and the field that backends use.

    Attributes
    ----------
    names : tuple of str
        Of the structures.
    facades : tuple of str
        Name of each facade, such as "south" or "top".
    structure : ndarray (f,) of int
        Row of the structure of each facade.
    field : StructureField
        For the grid of a run.
    """

    names: tuple[str, ...]
    facades: tuple[str, ...]
    structure: np.ndarray
    field: StructureField

    def _facts(self) -> dict[str, str]:
        names = ", ".join(self.names[:NAMED]) + (f" and {len(self.names) - NAMED} more" if len(self.names) > NAMED else "")
        patches, height = self.field.patches, self.field.patches.centre[:, 2]
        area = short(float(patches.area.sum()), "m2")
        return {
            "structures": f"{len(self.names)}: {names}",
            "facades": f"{len(self.facades)} of {area} above ground, in {len(patches.area)} patches",
            "elevation": f"{height.min():.1f} to {height.max():.1f} m" if len(height) else "unknown",
            "distance field": f"lattice of {short(self.field.spacing, 'm')}, {short(self.field.nbytes / 1e6, 'MB')}",
        }

    def __repr__(self) -> str:
        return as_text("Structures", self._facts())

    def _repr_html_(self) -> str:
        return as_html("Structures", self._facts())

    @classmethod
    def from_file(
        cls,
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
        friction_angle_deg: float = 20.0,
        units: str | None = None,
        crs: str | None = None,
        offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> "Structures":
        """Structures of footprints or a closed mesh on a terrain, for runs with cells of ``cell_size`` [m].

        Parameters
        ----------
        path : path
            GeoPackage, Shapefile, GeoJSON or FlatGeobuf of polygons, or OBJ, PLY, STL or GLB.
        layer : str, optional
            Of a vector file with several.
        name : str
            Of structures without an attribute ``name``.
        height, base, clearance : float or str, optional
            Of footprints [m], numbers or names of attributes: top above the mean ground, elevation that replaces the mean ground,
            underside above it. A mesh that states a clearance may hang above the ground.
        top : str
            "flat", or "along_ground": the top of footprints follows the ground.
        friction_angle_deg : float
            Of the surfaces [deg]; an attribute ``friction_deg`` replaces it.
        units, crs, offset : str, str, tuple of float
            Of a mesh: m, cm, mm or ft; coordinate system, by default that of the terrain; what is added to its coordinates [m].

        Raises
        ------
        StructureError
            With all problems: holes, placement, walls thinner than two cells.
        """
        structures: Structures = reader("Structures.from_file")(
            path, terrain, cell_size, layer=layer, name=name, height=height, base=base, clearance=clearance, top=top,
            friction_angle_deg=friction_angle_deg, units=units, crs=crs, offset=offset,
        )  # fmt: skip
        return structures

    @classmethod
    def from_sources(
        cls,
        sources: Sequence[Any],
        terrain: Terrain,
        cell_size: float | tuple[float, float, float],
        *,
        overhangs: str | PathLike[str] | None = None,
        overhang_friction_angle_deg: float | None = None,
        releases: "Sequence[Release]" = (),
    ) -> "Structures":
        """Structures of several files on a terrain, each with a name of its own, for runs with cells of ``cell_size`` [m].

        Parameters
        ----------
        sources : sequence of StructureSource
            Files, and what is stated of each; as ``structures`` of site.yaml.
        overhangs : path, optional
            Mesh that the terrain was made of; what overhangs in it is added.
        overhang_friction_angle_deg : float, optional
            Of the rock that overhangs [deg]; by default that of the ground under the mass.
        releases : sequence of Release
            Structures in their mass are refused.

        Raises
        ------
        StructureError
            With all problems of all files: holes, placement, walls thinner than two cells, structures in a release.
        DemError
            If the mesh of the overhangs cannot be used.
        """
        structures: Structures = reader("Structures.from_sources")(
            sources, terrain, cell_size, overhangs=overhangs, overhang_friction_angle_deg=overhang_friction_angle_deg,
            releases=releases,
        )  # fmt: skip
        return structures

    @classmethod
    def from_overhangs(
        cls,
        path: str | PathLike[str],
        terrain: Terrain,
        cell_size: float | tuple[float, float, float],
        *,
        friction_angle_deg: float | None = None,
    ) -> "Structures":
        """Structures of what overhangs a terrain in the mesh that it was made of, for runs with cells of ``cell_size`` [m].

        Parameters
        ----------
        path : path
            The mesh that :meth:`runout.Terrain.from_mesh` read.
        friction_angle_deg : float, optional
            Of the rock [deg]; by default that of the ground under the mass.

        Raises
        ------
        DemError
            If the file cannot be used, or the terrain has other cells than those of a mesh.
        StructureError
            If nothing overhangs, or rock is thinner than two cells.
        """
        return cls.from_sources((), terrain, cell_size, overhangs=path, overhang_friction_angle_deg=friction_angle_deg)
