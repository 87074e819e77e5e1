"""Scene: everything a backend needs besides the particles."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from runout.errors import ConfigError, StabilityError
from runout.model.laws import LAWS, Law
from runout.model.materials import Material
from runout.model.surface import Surface

STANDARD_GRAVITY = 9.81
LARGEST_CFL = 0.6  # an isolated particle in 3D is unstable near 0.52 to 0.6


@dataclass(frozen=True)
class Raster:
    """Cells of the elevation raster in local coordinates: where observers put what they see.

    ``rows`` count from the north, ``columns`` from the west; the outer south-west corner is the local origin.
    """

    rows: int
    columns: int
    cell_size: tuple[float, float]


@dataclass(frozen=True)
class Scene:
    """A runout scene on a grid of uniform spacing.

    Parameters
    ----------
    spacing : tuple of float
        Grid spacing (dx, dy, dz) [m].
    surface : Surface or None
        Sliding surface; None for no ground at all.
    raster : Raster
        Cells of the elevation raster. Its outline is the domain: what leaves it is booked as escaped.
    materials : tuple of Material
        One per release, all of one law.
    friction : tuple of float
        Basal friction coefficient tan(angle) per release [1].
    gravity : tuple of float
        Acceleration [m/s2].
    cfl : float
        Courant number of the acoustic limit, at most 0.6.
    precision : str
        "float32" or "float64".
    """

    spacing: tuple[float, float, float]
    surface: Surface | None
    raster: Raster
    materials: tuple[Material, ...]
    friction: tuple[float, ...]
    gravity: tuple[float, float, float] = (0.0, 0.0, -STANDARD_GRAVITY)
    cfl: float = 0.4
    precision: str = "float32"
    contact_band: float = field(default=0.02)  # a particle closer than this [cells] is in contact

    def __post_init__(self) -> None:
        if len(self.spacing) != 3 or not all(np.isfinite(h) and h > 0 for h in self.spacing):
            raise ConfigError(f"cell_size is {self.spacing}; it must be positive, one number or (dx, dy, dz)")
        if not 0 < self.cfl <= LARGEST_CFL:
            raise StabilityError(f"cfl is {self.cfl:g}; an isolated particle is unstable above {LARGEST_CFL:g}, use 0.4")
        if self.precision not in ("float32", "float64"):
            raise ConfigError(f"precision is {self.precision!r}; choose float32 or float64")
        if len({m.law for m in self.materials}) != 1:
            raise ConfigError("the materials of one run must follow one law; give every release the same kind of material")
        if len(self.friction) != len(self.materials):
            raise ConfigError(f"{len(self.friction)} friction coefficients for {len(self.materials)} releases")

    @property
    def law(self) -> Law:
        """The law that all materials follow."""
        return LAWS[self.materials[0].law]

    @property
    def wave_speed(self) -> float:
        """Largest speed of pressure waves [m/s]."""
        return max(m.wave_speed for m in self.materials)

    @property
    def dtype(self) -> Any:
        """NumPy type of the state."""
        return np.float32 if self.precision == "float32" else np.float64
