"""Numerics of a run: grid, particles, time step, precision and substeps, in one record from site.yaml and Python to the scene."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from numbers import Integral
from typing import Any, Self

from runout.errors import ConfigError, StabilityError
from runout.model.limits import CFL, LARGEST_CFL, checked, is_number, spacing_of


@dataclass(frozen=True, kw_only=True)
class Scheme:
    """Choices of a step. Each is a setting of ``simulation`` in site.yaml and an argument of :func:`runout.simulate`.

    Parameters
    ----------
    cfl : float
        Courant number of the acoustic limit, at most 0.6. The limit of an isolated particle can shorten the steps.
    precision : str
        "float32" or "float64".
    substeps : int
        Most substeps of a transfer between particles and grid, 1 to 64 (:mod:`runout.physics.substeps`).

    Raises
    ------
    ConfigError, StabilityError
        If a value is out of range.
    """

    cfl: float = CFL
    precision: str = "float32"
    substeps: int = 4

    def __post_init__(self) -> None:
        if not is_number(self.cfl):
            raise ConfigError(f"cfl is {self.cfl!r}; it must be a number, {CFL:g} is usual")
        if not 0 < self.cfl <= LARGEST_CFL:
            raise StabilityError(f"cfl is {self.cfl:g}; an isolated particle is unstable above {LARGEST_CFL:g}, use {CFL:g}")
        if self.precision not in ("float32", "float64"):
            raise ConfigError(f"precision is {self.precision!r}; choose float32 or float64")
        checked("substeps", self.substeps, error=ConfigError)
        if not isinstance(self.substeps, Integral):
            raise ConfigError(f"substeps is {self.substeps!r}; it must be a whole number")

    @classmethod
    def names(cls) -> set[str]:
        """Names of the choices."""
        return {f.name for f in fields(cls)}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """The record with the values of a mapping that have the names of choices; defaults for the others."""
        return cls(**{name: values[name] for name in cls.names() & values.keys()})

    def scheme(self) -> dict[str, Any]:
        """The choices of :class:`Scheme` by name."""
        return {f.name: getattr(self, f.name) for f in fields(Scheme)}

    def of_kernels(self) -> dict[str, Any]:
        """The choices that change which kernels are compiled."""
        return {name: value for name, value in self.scheme().items() if name != "cfl"}


@dataclass(frozen=True, kw_only=True)
class Numerics(Scheme):
    """Choices of a run.

    Parameters
    ----------
    cell_size : float or (dx, dy, dz)
        Grid spacing [m].
    particles_per_cell : int or (nx, ny, nz), optional
        8 is (2, 2, 2). The default depends on the releases (:mod:`runout.release.arrangement`).
    initial_stress : str
        "at_rest": releases start with the stress of their own weight; "none": without stress.
    seed : int
        Seed of the positions of the particles.
    """

    cell_size: float | tuple[float, float, float]
    particles_per_cell: int | tuple[int, int, int] | None = None
    initial_stress: str = "at_rest"
    seed: int = 0

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Grid spacing (dx, dy, dz) [m]; ConfigError if it is out of range."""
        return spacing_of(self.cell_size)
