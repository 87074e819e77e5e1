"""Variations of the settings of a run, one at a time, and a backend whose steps are timed."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from runout.backends.protocol import get_backend
from runout.model.limits import PARTICLES_PER_CELL
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.release.sample import particles_per_axis
from runout.studies.timing import memory_of
from tests.benchmarks.error_cases.node_contact import node_contact

CHUNK = 10  # steps of one length
NODES = "nodes"  # the reference backend with the usual contact
PLAN, _, UPWARDS = particles_per_axis(PARTICLES_PER_CELL)  # of a cell, by default
REPEATED_BELOW = 2.0  # [s] of processor time; longer runs are made once
BOUNDLESS = 10**6  # [cells] in a direction without periodicity


@dataclass(frozen=True)
class Variation:
    """One change from the defaults of ``runout.simulate``.

    Attributes
    ----------
    name : str
    per_axis : int
        Particles along each axis of a cell; in flows only in plan.
    upwards : int, optional
        Particles above each other in a cell of a flow; where none are stated, the arrangement is that of ``runout.simulate``.
    scene : mapping
        Fields of :class:`runout.model.scene.Scene` that change: ``cfl``, ``precision``.
    arguments : mapping
        What changes besides on real terrain: arguments of ``runout.simulate``, parameters of the material, and ``flat``, by how
        much a cell is wider than high.
    backend : str
        Of runout, or :data:`NODES`.
    slow : bool
        Left out on all but the two coarsest grids.
    only_on : tuple of str
        Names of the problems that it is measured on; all when empty.
    """

    name: str
    per_axis: int = PLAN
    upwards: int | None = None
    scene: Mapping[str, Any] = field(default_factory=dict)
    arguments: Mapping[str, Any] = field(default_factory=dict)
    backend: str = "scan"
    slow: bool = False
    only_on: tuple[str, ...] = ()

    @property
    def particles(self) -> tuple[int, int, int]:
        """Of a full cell of a flow that thins: east, north and up."""
        return self.per_axis, self.per_axis, self.upwards or UPWARDS


BASE = Variation("defaults")
ELASTIC = ("U9", "T1", "T5")  # U7 is a matter of the reference backend alone
TERRAIN = ("terrain", "fine_terrain")
THINNING = ("F3", *TERRAIN)
FLOWS = (*THINNING, "F5")
SET_BY_FLOW = (*TERRAIN, "coulomb_only")  # where the speed of the flow decides how stiff the mass is; on the others its weight does
SET_BY_WEIGHT = ("terrain_25", "fine_terrain_20")
STIFFNESS = (
    Variation("waves 3 times the flow", arguments={"wave_ratio": 3.0}, only_on=SET_BY_FLOW),
    Variation("waves 5 times the flow", arguments={"wave_ratio": 5.0}, only_on=SET_BY_FLOW),
    Variation("waves 10 times the flow", arguments={"wave_ratio": 10.0}, only_on=(*SET_BY_FLOW, *SET_BY_WEIGHT)),
    Variation("strain by weight 1 %", arguments={"weight_strain": 0.01}, only_on=SET_BY_WEIGHT),
    Variation("strain by weight 3 %", arguments={"weight_strain": 0.03}, only_on=SET_BY_WEIGHT),
)
FEW = (BASE.name, *(v.name for v in STIFFNESS), "CFL 0.4", "1 substep")  # of the problems that rank stiffness
VARIATIONS = (
    BASE,
    Variation("1 particle per axis", per_axis=1, upwards=1),
    Variation("3 particles per axis", per_axis=3, upwards=3),
    Variation("2 x 2 x 1 particles", upwards=1, only_on=FLOWS),
    Variation("2 x 2 x 2 particles", upwards=2, only_on=FLOWS),
    Variation("2 x 2 x 4 particles", upwards=UPWARDS, only_on=("F5",)),
    Variation("3 x 3 x 1 particles", per_axis=3, upwards=1, only_on=THINNING),
    Variation("1 x 1 x 8 particles", per_axis=1, upwards=8, only_on=FLOWS),
    *STIFFNESS,
    Variation("CFL 0.2", scene={"cfl": 0.2}),
    Variation("CFL 0.4", scene={"cfl": 0.4}),
    Variation("CFL 0.5", scene={"cfl": 0.5}),
    Variation("1 substep", scene={"substeps": 1}),
    *(Variation(f"{n} substeps", scene={"substeps": n}, only_on=("U9", "T1", "T5", *FLOWS)) for n in (2, 8)),
    Variation("float64", scene={"precision": "float64"}, only_on=(*ELASTIC, *FLOWS)),
    Variation("cells half as high", arguments={"flat": 2.0}, only_on=("terrain",)),
    Variation("cells a quarter as high", arguments={"flat": 4.0}, only_on=("terrain",), slow=True),
    Variation("hash on the CPU", backend="hash", slow=True, only_on=("T1", "T5", "terrain")),
    Variation("reference", scene={"precision": "float64"}, backend="reference", slow=True, only_on=ELASTIC),
    Variation("reference, contact at nodes", scene={"precision": "float64"}, backend=NODES, slow=True, only_on=("T1", "T5")),
)


def selectable(variation: Variation) -> bool:
    """Whether this version of runout knows all fields of a scene that a variation changes."""
    return set(variation.scene) <= {f.name for f in fields(Scene)}


@dataclass(frozen=True)
class Outcome:
    """Result of one run.

    Attributes
    ----------
    error : float
        Relative error of the quantity that the problem states.
    value : float
        Quantity of interest, nan where there is none.
    particles, steps, particle_steps, blocks : int
        ``blocks`` at the end.
    seconds : float
        Processor time of the steps on one thread [s].
    wall, setup : float
        Wall time of the steps, and of all before the first [s].
    bytes : float
        Of all arrays of the backend.
    """

    error: float
    value: float
    particles: int
    steps: int
    particle_steps: int
    blocks: int
    seconds: float
    wall: float
    setup: float
    bytes: float


def engine_of(variation: Variation, options: Mapping[str, Any] = MappingProxyType({})) -> Any:
    """The backend that a variation names, on the CPU and on one thread; ``options`` as in :func:`get_backend`."""
    if variation.backend == NODES:
        return node_contact()
    return get_backend(variation.backend, "cpu", threads=1, **options)


class March:
    """A backend on one thread that makes and times the steps of one run."""

    def __init__(self, scene: Scene, particles: Particles, variation: Variation, period: tuple[int, int, int] | None = None):
        self.variation, self.began = variation, time.perf_counter()
        self.scene = replace(scene, **{"precision": "float32", **variation.scene})
        options: dict[str, Any] = {"index": "dense"} if period and variation.backend == "scan" else {}
        self.engine = engine_of(variation, options)
        if period:
            self.engine.period = period if options else np.where(np.array(period) > 0, period, BOUNDLESS)
        self.engine.load(self.scene, particles)
        self.engine.stable_step()
        self.n, self.now, self.seconds, self.wall = len(particles), 0.0, 0.0, 0.0
        self.setup = time.perf_counter() - self.began

    def substeps(self, dt: float, most: float) -> int:
        """Of ``dt`` [s] in the next transfer, which lasts ``most`` [s] at most where that is longer than ``dt``."""
        return min(self.scene.substep_count(dt, self.engine.max_speed), max(1, int(min(most / dt + 1e-9, 64))))

    def step(self, dt: float, most: float) -> None:
        """One transfer, which lasts ``most`` [s] at most where that is longer than ``dt`` [s]."""
        processor, wall, substeps = time.process_time(), time.perf_counter(), self.substeps(dt, most)
        self.engine.step(dt, substeps)
        self.seconds += time.process_time() - processor
        self.wall += time.perf_counter() - wall
        self.now += substeps * dt

    def until(self, end: float, look: Callable[[], None] = lambda: None) -> None:
        """Step with nearly the largest time step until ``end`` [s]; ``look`` is called after every :data:`CHUNK` steps."""
        done = 0
        dt = 0.0
        while self.now < end * (1 - 1e-12):
            if done % CHUNK == 0 or self.now + dt > end:
                dt = min(0.95 * self.engine.stable_step(), end - self.now)
            self.step(dt, end - self.now)
            done += 1
            if done % CHUNK == 0:
                look()

    def positions(self) -> np.ndarray:
        """Places (n, 3) [m] of the particles."""
        return self.engine.particles().position(np.array(self.scene.spacing))  # type: ignore[no-any-return]

    def outcome(self, error: float, value: float = float("nan")) -> Outcome:
        """Result of the run."""
        counters, memory = self.engine.counters, memory_of(self.engine, self.n)
        blocks = memory["active_nodes"] // 64
        work = (counters.steps, counters.particle_steps, int(blocks))
        return Outcome(float(error), float(value), self.n, *work, self.seconds, self.wall, self.setup, float(memory["bytes"]))
