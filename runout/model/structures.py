"""Structures of a scene: the signed distance to their surfaces near them, and the patches that forces are booked on."""

from dataclasses import dataclass

import numpy as np

from runout.errors import ConfigError

FINEST, WIDEST = 0.5, 2.0  # largest spacing of the lattice and least band, in the smallest and the largest spacing of the grid
CELLS = 8  # of the lattice along an edge of a block; a block has CELLS + 1 nodes along it, shared with its neighbours


@dataclass(frozen=True)
class Patches:
    """Plane parts of the surfaces, each of about the size of a grid cell.

    Attributes
    ----------
    centre, normal : ndarray (p, 3)
        Local position [m] and outward unit normal.
    area : ndarray (p,)
        [m2]
    facade : ndarray (p,) of int
        Row of the facade that a patch belongs to.
    friction : ndarray (p,)
        Coulomb coefficient of the surface [1].
    """

    centre: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    facade: np.ndarray
    friction: np.ndarray


@dataclass(frozen=True)
class StructureField:
    """Signed distance to all structures on a lattice of cubes, in the blocks of it that lie near a surface or inside.

    Node (i, j, k) of the lattice is at ``origin + spacing * (i, j, k)``, in local metres. Block (a, b, c) holds the nodes from
    ``CELLS * (a, b, c)`` to ``CELLS * (a + 1, b + 1, c + 1)``, both included.

    Attributes
    ----------
    spacing : float
        Edge of a lattice cell [m]; at most half the spacing of the grid of the run, so that edges and thin walls are resolved.
    origin : tuple of float
        Local position of the first node [m].
    blocks : ndarray (nx, ny, nz) of int32
        Row of ``distance`` and ``patch`` of each block; -1 where every structure is further away than ``band``.
    distance : ndarray (n, 9, 9, 9) of float32
        Distance [m] to the nearest surface, positive outside and negative inside, within ``band``.
    patch : ndarray (n, 9, 9, 9) of int32
        Row of the patch nearest to each node.
    band : float
        Largest distance that the field resolves [m]; contact needs about three spacings of the grid.
    patches : Patches
        Where forces act.
    """

    spacing: float
    origin: tuple[float, float, float]
    blocks: np.ndarray
    distance: np.ndarray
    patch: np.ndarray
    band: float
    patches: Patches

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


@dataclass(frozen=True)
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
