"""Particles that are made a chunk at a time, for backends that store them in arrays of their own."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from runout.model.particles import ARRAYS, Particles, Sums


class ParticleSource(Protocol):
    """Particles of a scene that can be made again and again; :class:`runout.model.particles.Particles` are one, too."""

    def __len__(self) -> int:
        """Number of particles."""

    def chunks(self, stressed: bool = True) -> Iterator[Particles]:
        """The particles in their order, the same in each call; without stress, which takes time, if not ``stressed``."""

    def sums(self, density: np.ndarray) -> Sums:
        """Sums over all particles, of releases with a ``density`` (releases,) [kg/m3]."""

    def content(self) -> Iterator[np.ndarray]:
        """Arrays that, with the scene, determine the particles."""


def gathered(source: ParticleSource) -> Particles:
    """All particles of a source."""
    if isinstance(source, Particles):
        return source
    particles, first = Particles.zeros(len(source)), 0
    for chunk in source.chunks():
        part = slice(first, first + len(chunk))
        for name in ARRAYS:
            getattr(particles, name)[part] = getattr(chunk, name)
        first = part.stop
    return particles


def slices(source: ParticleSource, stressed: bool = True) -> Iterator[tuple[slice, Particles]]:
    """Chunks of a source, each with its place among all particles."""
    first = 0
    for chunk in source.chunks(stressed):
        yield slice(first, first + len(chunk)), chunk
        first += len(chunk)


HELD = ("node", "offset", "strain", "mass", "volume", "radius")  # arrays of particles at rest that are not zero, but their release
OF_PORES = ("pore_excess", "pore_left")  # of those that are zero without pore pressure


@dataclass(frozen=True)
class CompactParticles:
    """Particles of releases, without history and forces, in the precision of a run: 60 bytes each in float32 at rest.

    A source that waits for its run.
    """

    parts: Sequence[tuple[dict[str, np.ndarray], np.ndarray]]  # of each chunk; the release is one number where all are the same
    total: Sums  # of the particles before they were rounded

    @classmethod
    def of(cls, source: ParticleSource, density: np.ndarray, dtype: type) -> "CompactParticles":
        """The particles of a source at rest, of releases with a ``density`` (releases,) [kg/m3]."""
        return cls([_compact(chunk, dtype) for chunk in source.chunks()], source.sums(density))

    @cached_property
    def number(self) -> int:
        """Number of particles: the runs of a launch ask for it between all steps."""
        return sum(len(arrays["mass"]) for arrays, _ in self.parts)

    def __len__(self) -> int:
        return self.number

    def chunks(self, stressed: bool = True) -> Iterator[Particles]:
        """The particles in their order."""
        first = 0
        for arrays, release in self.parts:
            chunk = Particles.at_rest(len(arrays["mass"]))
            for name, values in arrays.items():
                setattr(chunk, name, values)
            chunk.release[:], chunk.identity[:] = release, chunk.identity + first
            first += len(chunk)
            yield chunk

    def content(self) -> Iterator[np.ndarray]:
        """All arrays."""
        for arrays, release in self.parts:
            yield from (*arrays.values(), release)

    def sums(self, density: np.ndarray) -> Sums:
        """Sums over all particles."""
        return self.total


def _compact(chunk: Particles, dtype: type) -> tuple[dict[str, np.ndarray], np.ndarray]:
    names = (*HELD, *OF_PORES) if chunk.pore_left.any() else HELD
    names = names if chunk.rests else (*names, "velocity")
    arrays = {name: getattr(chunk, name).astype(ARRAYS[name][0] if name == "node" else dtype) for name in names}
    release = chunk.release
    return arrays, release[:1].copy() if (release == release[:1]).all() else release.astype(np.int16)
