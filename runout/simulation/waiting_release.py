"""Releases that start later than the run, at a time or when the flow of another release arrives.

An excavated mass is ground until it starts: the flow of others goes over it and may come to lie on it. At its start the ground
falls to the sliding surface and the particles take its place. A release on the surface is not there before its start. It is then
put on the ground, or on what has come to lie there, column by column. So no mass enters in the place of another.
"""

import logging
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from runout.backends import footprints
from runout.backends.compile import array_binding
from runout.backends.protocol import Backend
from runout.backends.resting_particles import ReleaseParticles
from runout.backends.state import State, put_arrays
from runout.model.nodal_surface import NodalSurface
from runout.model.particle_source import gathered
from runout.model.particles import Particles, Sums
from runout.model.release import Placement, Release
from runout.model.release_start import Arrival
from runout.model.scene import Scene
from runout.simulation.observers import PeakMaps
from runout.simulation.plan_nodes import AreaSums
from runout.terrain import relief, sdf

LOGGER = logging.getLogger(__name__)
TRAVEL = 1.0  # cells that the fastest particle may go between two looks for an arrival


@dataclass(frozen=True)
class Closing:
    """Ground in the place of an excavated release that waits: by how much its coefficients are higher than at the end."""

    first: tuple[int, int]  # node of ``height[0, 0]``
    height: np.ndarray  # (nx, ny): [m]

    @classmethod
    def of(cls, release: Release, above: NodalSurface, below: NodalSurface, scene: Scene) -> "Closing":
        """That of a release, from the ground before and after it is dug out; what stands above the surface is ground, too."""
        depth, cell_size = release.excavation, release.terrain.cell_size
        columns, rows = (np.flatnonzero(depth.any(axis=axis))[[0, -1]] for axis in (0, 1))
        margin = math.ceil(relief.HALF_WIDTH) + int(sdf.STENCIL)
        sides = [
            (math.floor(low * size / h) - margin, math.ceil((high + 1) * size / h) + margin + 1)
            for (low, high), size, h in zip((columns, depth.shape[0] - 1 - rows[::-1]), cell_size, above.spacing, strict=True)
        ]
        first, shape = (sides[0][0], sides[1][0]), (sides[0][1] - sides[0][0], sides[1][1] - sides[1][0])
        higher, lower = (ground.on_nodes(first, shape).coefficients for ground in (above, below))
        heap = AreaSums.of_raster(release.heap, scene).on_nodes(first, shape, scene.spacing)
        return cls(first, higher - lower + heap)


class WaitingRelease:
    """A release that starts at a time.

    Parameters
    ----------
    release : Release
    number : int
        Of it among all releases.
    particles : ReleaseParticles
        Its own.
    closing : Closing or None
        Ground in its place.
    sums : Sums
        Of its particles.

    Attributes
    ----------
    started : float
        Time at which it started [s]; NaN before.
    """

    sudden = True

    def __init__(self, release: Release, number: int, particles: ReleaseParticles, closing: Closing | None, sums: Sums):
        self.release, self.number, self.particles, self.closing = release, number, particles, closing
        self.name, self.thickness = release.name, release.thickness
        self.reserved = self.expected = len(particles)
        self.waiting_mass, self.particle_volume = sums
        self.due = self.stop = release.start_time
        self.coming, self.started = True, math.nan
        self.scene: Scene | None = None

    def begin(self, scene: Scene) -> None:
        """Take the scene of the run."""
        self.scene = scene

    @property
    def has_started(self) -> bool:
        """Whether its particles are in the run."""
        return not math.isnan(self.started)

    def take(self, engine: Backend, time: float) -> Particles | None:
        """The particles of the release, at its start."""
        scene, ground = self.scene, self.scene.ground if self.scene else None
        assert scene is not None
        assert ground is not None
        if self.closing:
            engine.lower(self.closing.first, self.closing.height)
        particles = gathered(self.particles.of([self.number], ground))
        if self.release.placement is Placement.ON_SURFACE:
            width = [h / n for h, n in zip(scene.spacing, self.particles.how.per_axis, strict=True)][:2]
            lift(particles, engine.particles(), scene, (width[0], width[1]))
        self.due = self.stop = math.inf
        self.coming, self.waiting_mass, self.started = False, 0.0, time
        LOGGER.info("release %s starts at %.4g s", self.release.name, time)
        return particles

    def state(self) -> State:
        """Start, and what follows from it."""
        names = "due", "stop", "coming", "started", "waiting_mass"
        return {name: np.asarray(getattr(self, name)) for name in names}

    def restore(self, state: State) -> None:
        """Continue from :meth:`state`."""
        put_arrays(self, state)

    def content(self) -> Iterable[np.ndarray]:
        """What determines its particles, and the ground in its place."""
        yield from self.particles.content()
        yield np.array(self.number)
        if self.closing:
            yield from (np.array(self.closing.first), self.closing.height)


class TriggeredRelease(WaitingRelease):
    """A release that starts when the flow of another one arrives inside its outline.

    The thickness is that of the columns that hold any of the mass, at the last observation for the maps; this costs nothing. Whose
    flow it is the particles say, where there is a third release. The release looks whenever the fastest particle may have gone
    :data:`TRAVEL` cells.

    Parameters
    ----------
    release, number, particles, closing, sums
        As of :class:`WaitingRelease`.
    other : int
        Number of the release whose flow arrives.
    before : WaitingRelease or None
        That release, if it waits itself.
    """

    def __init__(self, release: Release, number: int, particles: ReleaseParticles, closing: Closing | None, sums: Sums, other: int):
        super().__init__(release, number, particles, closing, sums)
        assert release.starts_when is not None
        self.trigger: Arrival = release.starts_when
        self.other = other
        self.before: WaitingRelease | None = None
        self.peaks: PeakMaps | None = None
        self.inside: np.ndarray | None = None  # which columns of the maps hold any of the mass
        self.due, self.stop, self.coming = 0.0, math.inf, False

    def take(self, engine: Backend, time: float) -> Particles | None:
        """The particles of the release, once the flow of the other has arrived."""
        if self.before is not None and not self.before.has_started:
            self.due = max(self.before.due, math.nextafter(time, math.inf))
            return None
        if self._has_arrived(engine):
            return super().take(engine, time)
        assert self.scene is not None
        h, g = self.scene.observed_length, math.hypot(*self.scene.gravity)
        self.due = time + float(array_binding().bed.time_to_travel(TRAVEL * h, engine.max_speed, max(g, 1e-12)))
        return None

    def watch(self, peaks: PeakMaps) -> None:
        """Look for the arrival in these maps."""
        inside = self.release.thickness > 0.0
        if peaks.on_lattice:
            edges = (np.arange(n + 1) * size for n, size in zip(peaks.thickness.shape[::-1], peaks.cell, strict=True))
            assert self.scene is not None
            inside = 1e-6 * math.prod(peaks.cell) < AreaSums.of_raster(inside.astype(float), self.scene).within(*edges).T
        self.peaks, self.inside = peaks, inside

    def _has_arrived(self, engine: Backend) -> bool:
        """Whether the flow of the other release is thick enough anywhere inside."""
        scene, peaks = self.scene, self.peaks
        assert scene is not None
        assert peaks is not None
        if not (peaks.thickness[self.inside] >= self.trigger.thickness).any():
            return False
        if len(scene.materials) == 2:
            return True
        present = engine.particles()
        own = present.take(present.release == self.other)
        columns = footprints.columns_of(scene, own, own.sums(scene.densities).mean_volume)
        depth = columns.volume / self.release.terrain.cell_area
        inside = self.release.thickness[*columns.window] > 0.0
        return bool((depth[inside] >= self.trigger.thickness).any())


def lift(particles: Particles, present: Particles, scene: Scene, width: tuple[float, float]) -> None:
    """Lift particles that enter above those that are ``present``, in place: by columns of a ``width`` [m] and their neighbours."""
    ground, spacing = scene.ground, np.array(scene.spacing)
    assert ground is not None
    own, others = particles.position(spacing), present.position(spacing)
    first = np.floor(own[:, :2].min(axis=0) / width).astype(np.int64) - 1
    shape = np.floor(own[:, :2].max(axis=0) / width).astype(np.int64) - first + 2
    column = np.floor(others[:, :2] / width).astype(np.int64) - first
    near = ((column >= 0) & (column < shape)).all(axis=1)
    if not near.any():
        return
    x, y, z = others[near].T
    elevation, east, north = ground.evaluate(x, y)
    top = np.zeros(shape)
    reach = present.radius[near] * np.sqrt(1.0 + east**2 + north**2)
    np.maximum.at(top, tuple(column[near].T), z - elevation + reach)
    around = np.pad(top, 1)
    top = np.max([around[i : i + shape[0], j : j + shape[1]] for i in range(3) for j in range(3)], axis=0)
    i, j = (np.floor(own[:, :2] / width).astype(np.int64) - first).T
    offset = particles.offset[:, 2] + top[i, j] / spacing[2]
    shift = np.floor(offset - 0.5)
    particles.offset[:, 2] = offset - shift
    particles.node[:, 2] += shift.astype(particles.node.dtype)


def hold_back(
    scene: Scene,
    particles: ReleaseParticles,
    releases: Sequence[Release],
    ground_dug: Callable[[Sequence[np.ndarray]], NodalSurface],
    waiting: list[WaitingRelease] | None,
) -> tuple[Scene, ReleaseParticles]:
    """Scene with ground in the place of the releases that wait, and the particles of the others.

    Parameters
    ----------
    scene : Scene
        On the ground below all releases.
    particles : ReleaseParticles
        Of all releases.
    releases : sequence of Release
    ground_dug : callable
        Ground below some excavations (rows, columns) [m].
    waiting : list or None
        Gets the releases that wait. None: none is held back.
    """
    if waiting is None or not any(release.waits for release in releases):
        return scene, particles
    at_once = [number for number, release in enumerate(releases) if not release.waits]
    later = [number for number, release in enumerate(releases) if release.waits]
    dug = [releases[number].excavation for number in at_once]
    nothing, closings, below = np.zeros(releases[0].terrain.shape), dict[int, Closing](), None
    for number in later:
        depth = releases[number].excavation
        if depth.any():
            above, below = below or ground_dug([nothing, *dug]), ground_dug([nothing, *dug, depth])
            dug.append(depth)
            closings[number] = Closing.of(releases[number], above, below, scene)
    ground = scene.ground
    assert ground is not None
    for closing in closings.values():
        ground = ground.with_room(closing.first, closing.height.shape)
    for closing in closings.values():
        ground.lower(closing.first, -closing.height)
    names = [release.name for release in releases]
    for number in later:
        own, release = particles.of([number], ground), releases[number]
        arguments = release, number, own, closings.get(number), own.sums(scene.densities)
        trigger = release.starts_when
        waiting.append(TriggeredRelease(*arguments, names.index(trigger.arrives)) if trigger else WaitingRelease(*arguments))
    by_number = {source.number: source for source in waiting}
    for source in waiting:
        if isinstance(source, TriggeredRelease):
            source.before = by_number.get(source.other)
    return replace(scene, surface=ground) if closings else scene, particles.of(at_once, ground)
