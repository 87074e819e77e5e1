"""Mass that enters a run while it goes on: releases that start later or by a trigger, and further sources such as an inflow.

A source waits beside the backend. When its time has come it gives particles, which the backend takes up
(:meth:`runout.backends.protocol.Backend.add`). Their mass and energy are booked.
"""

import logging
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np

from runout.backends.initial_stress import energy_at_start
from runout.backends.protocol import Backend, LedgerRow
from runout.backends.state import State, arrays_of, part, put_arrays
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.simulation.observers import PeakMaps

LOGGER = logging.getLogger(__name__)
RECORDED = "late_source", "late_source_start_time", "late_source_waiting_mass"  # attributes of a run


class Source(Protocol):
    """Something that gives mass to a run; what it has may be attributes or properties."""

    @property
    def name(self) -> str:
        """For the record."""

    @property
    def due(self) -> float:
        """Next time [s] at which it must be asked: after the first transfer that reaches it. Infinite if never again."""

    @property
    def stop(self) -> float:
        """Next time [s] that a transfer has to end at exactly, infinite without one. The last transfers before it are equal."""

    @property
    def coming(self) -> bool:
        """Whether it will give mass whatever the flow does. A run does not end at rest as long as it will."""

    @property
    def sudden(self) -> bool:
        """Whether it gives a whole mass at once. Maps then get the columns before and after, and the rule of rest starts anew."""

    @property
    def started(self) -> float:
        """Time at which its first mass entered [s]; NaN before."""

    @property
    def waiting_mass(self) -> float:
        """Mass [kg] that it holds and may give; 0 if that is not known in advance."""

    @property
    def thickness(self) -> np.ndarray | float:
        """Thickness (rows, columns) [m] of the release that it holds; 0 if it holds none."""

    @property
    def particle_volume(self) -> float:
        """Mean volume of its particles without stress [m3]."""

    @property
    def reserved(self) -> int:
        """Number of particles that it will give at once, numbered in advance; 0 for a source that gives them by and by."""

    @property
    def expected(self) -> int:
        """Number of particles that it will give in all, as far as that is known."""

    def begin(self, scene: Scene) -> None:
        """Take the scene of the run, on the ground that a bed may lower."""

    def take(self, engine: Backend, time: float) -> Particles | None:
        """Particles that enter at a time [s], None without any; sets the attributes anew. Identities are set by the caller."""

    def state(self) -> State:
        """All that changes, as arrays by name, for :meth:`restore`."""

    def restore(self, state: State) -> None:
        """Continue from :meth:`state`, after :meth:`begin`."""

    def content(self) -> Iterable[np.ndarray]:
        """Arrays that, with the scene, determine what it gives."""


@runtime_checkable
class Watcher(Protocol):
    """A source that looks where the flow is."""

    def watch(self, peaks: PeakMaps) -> None:
        """Look at these maps, which hold the thickness at the last observation."""


@dataclass
class Entered:
    """Sums over what has entered."""

    mass: float = 0.0  # [kg]
    energy: float = 0.0  # kinetic, potential and elastic energy where it entered [J]
    particles: int = 0  # number of those that were not numbered in advance


class Entering:
    """The sources of one run.

    Parameters
    ----------
    sources : sequence of Source
        They are asked in this order; each meets what those before it gave.
    """

    def __init__(self, sources: Sequence[Source]):
        self.sources, self.entered = tuple(sources), Entered()
        self.scene: Scene | None = None
        self.first, self.rounding = 0, 0.0  # number of the first particle that enters; error of a time [s]

    def begin(self, scene: Scene, particles: int, peaks: PeakMaps, rounding: float) -> None:
        """Take the scene of the run, which starts with so many ``particles``, and the maps at which sources may look.

        ``rounding`` [s] is the error of a time.
        """
        self.scene, self.first, self.rounding = scene, particles, rounding
        for source in self.sources:
            source.begin(scene)
            if isinstance(source, Watcher):
                source.watch(peaks)

    @property
    def reserved(self) -> int:
        """Number of particles that are numbered in advance, behind those at the start."""
        return sum(source.reserved for source in self.sources)

    @property
    def expected(self) -> int:
        """Number of particles that will enter, as far as that is known."""
        return sum(source.expected for source in self.sources)

    @property
    def due(self) -> float:
        """Next time [s] at which any source must be asked."""
        return min(source.due for source in self.sources)

    @property
    def stop(self) -> float:
        """Next time [s] that a transfer has to end at exactly."""
        return min(source.stop for source in self.sources)

    def mean_volume(self, particles: int, volume: float) -> float:
        """Mean volume [m3] of all particles that are known in advance, so many of a mean ``volume`` [m3] at the start included.

        Where none is known, that of the sources.
        """
        counts = np.array([particles, *(source.reserved for source in self.sources)])
        volumes = np.array([volume, *(source.particle_volume for source in self.sources)])
        return float(np.average(volumes, weights=counts) if counts.any() else volumes[1:].mean())

    @property
    def next_coming(self) -> float:
        """Next time [s] at which a source is asked that will give mass whatever the flow does."""
        return min((source.due for source in self.sources if source.coming), default=math.inf)

    @property
    def coming(self) -> bool:
        """Whether mass will enter whatever the flow does."""
        return any(source.coming for source in self.sources)

    @property
    def waiting_thickness(self) -> np.ndarray | float:
        """Thickness (rows, columns) [m] of the releases that have not started."""
        return sum(source.thickness for source in self.sources if source.waiting_mass > 0.0)

    @property
    def waiting_mass(self) -> float:
        """Mass [kg] that sources hold and have not given."""
        return math.fsum(source.waiting_mass for source in self.sources)

    def is_sudden(self, time: float) -> bool:
        """Whether a source that is due at a time [s] gives a whole mass at once."""
        return any(source.sudden and self._is_due(source, time) for source in self.sources)

    def _is_due(self, source: Source, time: float) -> bool:
        return source.due <= time + self.rounding

    def update(self, engine: Backend, time: float, born: int = 0) -> int:
        """Let the sources that are due at a time [s] give mass to the backend; returns the number of particles that entered.

        Those of a source that reserves numbers have these. Others are numbered behind all, and behind ``born`` ones of a bed.
        """
        assert self.scene is not None
        number, entered = self.first, 0
        for source in self.sources:
            own, number = number, number + source.reserved
            particles = source.take(engine, time) if self._is_due(source, time) else None
            if particles is None or not len(particles):
                continue
            if not source.reserved:
                own = self.first + self.reserved + self.entered.particles + born
                self.entered.particles += len(particles)
            particles.mass = particles.mass.astype(self.scene.dtype).astype(np.float64)  # as every backend has it
            particles.identity = own + np.arange(len(particles), dtype=np.int64)
            engine.add(particles)
            self._book(particles)
            entered += len(particles)
        return entered

    def _book(self, particles: Particles) -> None:
        assert self.scene is not None
        self.entered.mass += float(particles.mass.sum())
        self.entered.energy += energy_at_start(particles, self.scene)

    def ledger(self, row: LedgerRow) -> LedgerRow:
        """A row of the ledger with what has entered and what waits."""
        entered = self.entered
        return replace(row, entered_mass=entered.mass, entered_energy=entered.energy, waiting_mass=self.waiting_mass)

    def attributes(self) -> dict[str, Any]:
        """For the record: name, time of the start [s], NaN for never, and mass that has not entered [kg], source by source."""
        if not self.sources:
            return {}
        values = ([s.name for s in self.sources], [s.started for s in self.sources], [s.waiting_mass for s in self.sources])
        return dict(zip(RECORDED, values, strict=True))

    def content(self) -> Iterable[np.ndarray]:
        """Arrays that, with the scene, determine what enters."""
        for source in self.sources:
            yield from source.content()

    def state(self) -> State:
        """All that changes, as arrays by name, for :meth:`restore`."""
        state = arrays_of(self.entered, (), "entered.")
        if self.scene and self.scene.ground:
            state["change"] = self.scene.ground.change  # with all bits, in whatever order a bed and releases lowered it
        for number, source in enumerate(self.sources):
            state |= {f"source{number}.{name}": values for name, values in source.state().items()}
        return state

    def restore(self, state: State) -> None:
        """Continue from :meth:`state`, after :meth:`begin`. The ground becomes what it was."""
        put_arrays(self.entered, part(state, "entered."))
        if self.scene and self.scene.ground:
            self.scene.ground.restore(state["change"])
        for number, source in enumerate(self.sources):
            source.restore(part(state, f"source{number}."))


def never_started(record: Mapping[str, Any]) -> list[str]:
    """Names of the releases that waited until the end, from :meth:`Entering.attributes` of a run."""
    return [name for name, time, mass in _rows(record) if math.isnan(time) and mass > 0.0]


def sentences(record: Mapping[str, Any]) -> Iterator[str]:
    """What :meth:`Entering.attributes` of a run state, source by source."""
    for name, time, mass in _rows(record):
        never = f"{name} never started" + (f", {mass:.4g} kg are never released" if mass > 0.0 else "")
        yield never if math.isnan(time) else f"{name} started at {time:.4g} s"


def _rows(record: Mapping[str, Any]) -> Iterator[tuple[str, float, float]]:
    """Name, start [s] and waiting mass [kg] of each source; a file holds one value without a list."""
    columns = (np.atleast_1d(record.get(key, ())).tolist() for key in RECORDED)
    yield from zip(*columns, strict=True)
