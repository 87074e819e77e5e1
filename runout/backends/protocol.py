"""What every backend offers; :func:`get_backend` is the only place that imports one."""

from dataclasses import dataclass, field
from importlib import import_module
from typing import Protocol

import numpy as np

from runout.errors import DeviceError
from runout.model.particles import Particles
from runout.model.scene import Scene

BACKENDS = ("scan", "hash", "reference")


@dataclass
class LedgerRow:
    """Sums over all particles at one time; what has been lost or dissipated is counted from the start."""

    mass: float  # [kg] on the domain
    escaped_mass: float  # [kg] left over the edge of the domain
    momentum: np.ndarray  # (3,) [kg m/s]
    kinetic_energy: float  # [J], with the affine part
    potential_energy: float  # [J], against local elevation 0
    elastic_energy: float  # [J]
    basal_dissipation: float  # [J] by friction and impact at the ground
    plastic_dissipation: float  # [J] inside the material
    escaped_energy: float  # [J] carried over the edge
    basal_impulse: np.ndarray  # (3,) [N s] by the ground on the mass
    max_speed: float  # [m/s] of any particle
    active_blocks: int
    contact_particles: int


@dataclass
class Columns:
    """What stands over each cell of the raster (rows, columns): sums over its column of particles."""

    volume: np.ndarray  # [m3]
    mass: np.ndarray  # [kg]
    momentum: np.ndarray  # (rows, columns, 3) [kg m/s]


@dataclass
class Counters:
    """Work done since ``load``; what CI gates instead of seconds."""

    steps: int = 0
    particle_steps: int = 0
    rebuilds: int = 0
    seconds: dict[str, float] = field(default_factory=dict)


class Backend(Protocol):
    """A backend addresses: it decides where nodes live and in which order loops run; it holds no formula."""

    counters: Counters

    def load(self, scene: Scene, particles: Particles) -> None:
        """Take over a scene and its particles."""

    def stable_step(self) -> float:
        """Largest admissible time step [s] from the acoustic and the particle limit."""

    def step(self, dt: float) -> None:
        """One explicit step of ``dt`` [s]."""

    def particles(self) -> Particles:
        """The particles as they are, in the order of their identity."""

    def ledger(self) -> LedgerRow:
        """Sums of the present state."""

    def columns(self) -> Columns:
        """Sums over the columns of the raster's cells."""


def get_backend(name: str, device: str = "cpu", threads: int | None = None) -> Backend:
    """Backend by name: "scan" (numba, CPU), "reference" (NumPy) or "hash" (warp)."""
    if name not in BACKENDS:
        raise DeviceError(f"backend is {name!r}; choose one of {', '.join(BACKENDS)}")
    if name == "hash":
        raise DeviceError("backend 'hash' (GPU) is not part of this version; use backend='scan' on the CPU")
    if device != "cpu":
        raise DeviceError(f"device is {device!r}; backend {name!r} runs on 'cpu' only")
    backend = import_module(f"runout.backends.{name}.backend").create(threads)
    return backend  # type: ignore[no-any-return]
