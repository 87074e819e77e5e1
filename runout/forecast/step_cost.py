"""Processor time of a step on this machine, from a few steps of a small layer: the particles of the site are not made.

It is measured once a day (:mod:`runout.forecast.engine_notes`), and anew after some minutes if other work disturbed the
measurement. A forecast that compiles nothing takes what was measured in the last month, or else that of a typical core. A
member notes what its steps took (:class:`StepTimer`), for the forecasts of the day.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from runout.backends.protocol import get_backend
from runout.forecast import engine_notes
from runout.forecast.engine_notes import StepCost
from runout.model.friction_laws import DEFAULT_FRICTION
from runout.model.limits import spacing_of
from runout.model.numerics import Scheme
from runout.model.particles import Particles
from runout.model.scene import STANDARD_GRAVITY, Raster, Scene
from runout.model.surface import Surface

if TYPE_CHECKING:
    from runout.backends.protocol import Backend

FEW, MANY = 6, 32  # cells along the sides of two layers, which are one cell thick
PER_CELL = (2, 2, 4)
UNTIMED_STEPS, TIMED_STEPS = 4, 24
REPEATS = 3  # measurements, of which the shortest counts
WAITED = 0.15  # share of the time that a measurement waits for a core, from which on other work disturbs it
STEP_SECONDS, PARTICLE_SECONDS = 2.5e-4, 3e-10  # [s] least time of a step on a GPU, and time per particle
SLOPE = 0.4  # of the ground
TYPICAL = StepCost(2e-4, 1e-7)  # of one core of the server on which it was chosen; of other machines a guess
SPREADING = 1.2  # cost of a particle-step of a flow, which spreads and is observed, over that of the layer
STAYED = 0.99  # share of the mass that is on the terrain at the end; otherwise particles were fewer than at the start


def engine_for(arguments: Mapping[str, Any]) -> "Backend":
    """Backend of a run with these arguments of :func:`runout.simulate`, on one thread."""
    return get_backend(arguments.get("backend", "scan"), arguments.get("device", "cpu"), 1)


def quick_step_cost(arguments: Mapping[str, Any], compiled: Callable[[], bool]) -> StepCost:
    """Cost of a step as it was in the last month; else measured if the kernels are ``compiled``, or :data:`TYPICAL`."""
    if arguments.get("device", "cpu") != "cpu":
        return step_cost(arguments)
    noted = engine_notes.noted_step_cost(arguments, engine_notes.MONTH)
    if noted:
        return noted
    return step_cost(arguments) if compiled() else TYPICAL


def step_cost(arguments: Mapping[str, Any]) -> StepCost:
    """Cost of a step of a run with these arguments of :func:`runout.simulate`, measured today or now."""
    device: Any = getattr(engine_for(arguments), "device", None) if arguments.get("device", "cpu") != "cpu" else None
    if device is not None and device.is_cuda:
        return StepCost(STEP_SECONDS, PARTICLE_SECONDS)
    noted = engine_notes.noted_step_cost(arguments)
    if noted:
        return noted
    cost, undisturbed = measured_step_cost(arguments)
    engine_notes.note_layer(arguments, cost, undisturbed=undisturbed)
    return cost


def measured_step_cost(arguments: Mapping[str, Any]) -> tuple[StepCost, bool]:
    """Cost of a step of a layer on the CPU, and whether no other work disturbed the measurement."""
    _timed(arguments, FEW)  # loads the kernels of the later steps, too
    few, many = (min(_timed(arguments, cells) for _ in range(REPEATS)) for cells in (FEW, MANY))
    particle = max(many.seconds - few.seconds, 0.0) / (many.particles - few.particles)
    cost = StepCost(max(few.seconds - few.particles * particle, 0.0), SPREADING * particle)
    return cost, max(few.waited, many.waited) < WAITED


class Timing(NamedTuple):
    """Processor time [s] of one step of a layer, share of the time that the process waited for a core, and particles."""

    seconds: float
    waited: float
    particles: int


def _timed(arguments: Mapping[str, Any], cells: int) -> Timing:
    """Timing of a layer that has ``cells`` along its sides."""
    engine, scene = engine_for(arguments), _scene(arguments, cells)
    particles = _layer(scene, cells)
    engine.load(scene, particles)
    for step in range(UNTIMED_STEPS + TIMED_STEPS):
        if step == UNTIMED_STEPS:
            started, began = time.process_time(), time.perf_counter()
        engine.step(engine.stable_step())
    worked, passed = time.process_time() - started, time.perf_counter() - began
    return Timing(worked / TIMED_STEPS, 1.0 - worked / passed, len(particles))


def _scene(arguments: Mapping[str, Any], cells: int) -> Scene:
    """A plane that falls to the east, for masses of each law of the run."""
    spacing, side = spacing_of(arguments["cell_size"]), 2 * cells
    x = np.arange(side + 1) * spacing[0]
    surface = Surface.through(np.repeat(SLOPE * (x[-1] - x)[:, None], side + 1, axis=1), spacing[:2])
    materials, frictions = _laws(arguments)
    chosen = tuple(m.chosen(math.sqrt(STANDARD_GRAVITY * x[-1]), spacing[2], STANDARD_GRAVITY) for m in materials)
    return Scene(spacing, surface, Raster(side, side, spacing[:2]), chosen, frictions, **Scheme.of(arguments).scheme())


def _laws(arguments: Mapping[str, Any]) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Materials and frictions of the releases, one of each pair of laws; of a run with one law those of the run."""
    basal = arguments.get("basal_friction") or math.radians(arguments["basal_friction_angle"])
    release = arguments.get("release", ())
    releases = release if isinstance(release, Sequence) else [release]
    pairs = [(r.material or arguments["material"], r.friction_on(basal)) for r in releases]
    of_run = arguments["material"], basal
    by_law = {_names(pair): pair for pair in pairs or [of_run]}
    if _names(of_run) in by_law:
        by_law[_names(of_run)] = of_run
    materials, frictions = zip(*by_law.values(), strict=True)
    return materials, tuple(math.tan(f) if isinstance(f, float) else f for f in frictions)


def _names(pair: tuple[Any, Any]) -> tuple[str, str]:
    """Laws of a material, and of a friction or its angle [rad]."""
    return pair[0].law, getattr(pair[1], "law", DEFAULT_FRICTION)


def _layer(scene: Scene, cells: int) -> Particles:
    """A layer on the plane, one cell thick."""
    spacing = np.array(scene.spacing)
    counts = np.array(PER_CELL) * (cells, cells, 1)
    lattice = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3) + 0.5
    place = lattice * (spacing / PER_CELL) + spacing * (cells // 2, cells // 2, 0)
    assert scene.surface is not None
    place[:, 2] += scene.surface.elevation(place[:, 0], place[:, 1])
    p = Particles.at(place, spacing)
    p.volume[:] = np.prod(spacing / PER_CELL)
    p.release[:] = np.arange(len(p)) % len(scene.materials)
    p.mass[:], p.radius[:] = p.volume * scene.densities[p.release], 0.125 * spacing[2] / PER_CELL[2]
    return p


class StepTimer:
    """Processor time of the steps of a member: it counts from the first call of its progress on, after all preparation.

    ``progress``: called with the fraction, 0 to 1, that this object is called with.
    """

    def __init__(self, progress: Callable[[float], None] | None = None):
        self.progress = progress
        self.first: float | None = None
        self.started = self.seconds = 0.0

    def __call__(self, fraction: float) -> None:
        if self.first is None:
            self.first, self.started = fraction, time.process_time()
        self.seconds = time.process_time() - self.started
        if self.progress:
            self.progress(fraction)

    def note(self, arguments: Mapping[str, Any], result: Any) -> None:
        """Note the result's cost of a step, if the member ran as a whole on one thread of the CPU and its mass stayed the same."""
        series = getattr(result, "series", {})
        mass = series.get("mass", ())
        alone = arguments.get("device", "cpu") == "cpu" and arguments["threads"] == 1 and "entered_mass" not in series
        if alone and self.first == 0.0 and len(mass) and mass[-1] >= STAYED * mass[0]:
            engine_notes.note_member(arguments, self.seconds, result.steps, result.steps * result.n_particles)
