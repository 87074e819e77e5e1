"""Times cases of the benchmark. Repetitions of the cases alternate, so that other load on the machine affects all cases alike."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from runout.backends.protocol import get_backend
from runout.model.limits import CFL
from runout.simulation.observers import Ledger, PeakMaps
from runout.simulation.run import CROSSING
from runout.studies.sloping_layer import Layer

STEP_SHARE = 0.475 / CFL  # share of the stable step at the start, for a flow that accelerates; all records use it
UNTIMED_STEPS = 3
WORK_OF_A_RUN = 400_000  # particle-steps between two readings of the clock
WORK_ON_A_GPU = 2e9  # the same on a GPU, where the host waits for the device at each reading
NODE_BYTES = 64  # target for bytes per node


@dataclass(frozen=True)
class Case:
    """One layer on one way of computing it; ``index`` is "sparse" or the "dense" control."""

    layer: Layer
    threads: int = 1
    index: str = "sparse"
    device: str = "cpu"
    observed: bool = True

    def described(self) -> dict[str, Any]:
        """The choices, ready for JSON."""
        return {**asdict(self.layer), **{name: getattr(self, name) for name in ("threads", "index", "device", "observed")}}


def engine_of(case: Case) -> Any:
    """A backend for a case, without a scene: scan on the CPU, hash on a GPU."""
    return get_backend("scan" if case.device == "cpu" else "hash", case.device, case.threads, index=case.index)


@dataclass(frozen=True)
class Run:
    """A few steps: their number, seconds of one of them, whether the index was rebuilt, wall seconds of a step by stage."""

    steps: int
    step: float
    rebuilt: bool
    stages: dict[str, float]


@dataclass
class TimedRun:
    """A running case: steps of one length, with observations as often as in a simulation."""

    case: Case
    engine: Any = field(init=False)
    runs: list[Run] = field(default_factory=list)
    observing: list[float] = field(default_factory=list)  # seconds for each step

    def __post_init__(self) -> None:
        scene, particles = self.case.layer.build()
        self.n = len(particles)
        self.engine = engine_of(self.case)
        self.engine.load(scene, particles)
        self.peaks, self.ledger, self.now = PeakMaps(scene, 0.1), Ledger(), 0.0
        self.dt = STEP_SHARE * self.engine.stable_step()
        crossing = CROSSING * scene.observed_length / self.engine.ledger().max_speed
        self.steps = max(1, math.floor(crossing / self.dt))
        self.advance(UNTIMED_STEPS)
        self.observe()

    def advance(self, steps: int) -> None:
        """Make some steps, in one call if the backend can. The stable step is queried as in a simulation, which waits for a GPU."""
        if hasattr(self.engine, "steps"):
            self.engine.steps(self.dt, steps)
            self.engine.stable_step()
            return
        for _ in range(steps):
            self.engine.step(self.dt)
            self.engine.stable_step()

    def observe(self) -> None:
        """Maps and ledger of the present state."""
        if self.case.observed:
            self.peaks.observe(self.now, self.engine.columns())
            self.ledger.record(self.now, self.dt, self.engine.ledger(), self.engine.memory_bytes())

    def repeat(self) -> None:
        """The steps between two observations in short runs, and one observation."""
        clock = clock_of(self.case)
        for run in _runs(self.steps, self.n, WORK_OF_A_RUN if self.case.device == "cpu" else WORK_ON_A_GPU):
            before, rebuilds, started = dict(self.engine.counters.seconds), self.engine.counters.rebuilds, clock()
            self.advance(run)
            total = clock() - started
            stages = {name: (s - before.get(name, 0.0)) / run for name, s in self.engine.counters.seconds.items()}
            self.runs.append(Run(run, total / run, self.engine.counters.rebuilds > rebuilds, stages))
        started = clock()
        self.observe()
        self.observing.append((clock() - started) / self.steps)
        self.now += self.steps * self.dt

    def measured(self) -> dict[str, Any]:
        """Measurements of the repetitions, ready for JSON.

        Returns
        -------
        dict
            ``case``: the layer (``upwards``: particles of a cell above each other), threads, index, device, and whether it is
            observed. ``particles`` made, timed ``steps``, short ``runs`` that they were made in, ``clock`` "processor" or "wall".
            ``rate`` and ``rate_of_steps``: particle-steps per second with observers and without. ``median_over_best``: time of
            the median run over that of the best. ``ns_per_particle_step``: wall time of each stage, the best of its runs;
            ``index``: rebuilds, spread over all steps. ``rebuilds`` of the index, ``active_blocks`` that hold particles, and
            ``memory`` of :func:`memory_of`.
        """
        plain = [r for r in self.runs if not r.rebuilt] or self.runs
        middle = float(np.median([r.step for r in plain]))
        rebuilding = sum(r.steps * max(r.step - middle, 0.0) for r in self.runs if r.rebuilt) / sum(r.steps for r in self.runs)
        stepping, observing = min(r.step for r in plain) + rebuilding, min(self.observing)
        stages = {name: min(r.stages[name] for r in plain) for name in plain[0].stages}
        stages = {**stages, "index": rebuilding, "observers": observing}
        ns = {name: 1e9 * seconds / self.n for name, seconds in stages.items()}
        return {
            "case": self.case.described(),
            "particles": self.n,
            "steps": self.steps * len(self.observing),
            "runs": len(self.runs),
            "clock": "wall" if clock_of(self.case) is time.perf_counter else "processor",
            "rebuilds": self.engine.counters.rebuilds,
            "active_blocks": self.engine.ledger().active_blocks,
            "rate": self.n / (stepping + observing),
            "rate_of_steps": self.n / stepping,
            "median_over_best": middle / min(r.step for r in plain),
            "ns_per_particle_step": ns,
            "memory": memory_of(self.engine, self.n),
        }


def clock_of(case: Case) -> Callable[[], float]:
    """Clock: processor time for one thread, so that other load on the machine hardly counts; else wall time."""
    return time.process_time if case.threads == 1 and case.device == "cpu" else time.perf_counter


def _runs(steps: int, n: int, work: float) -> list[int]:
    """Lengths of short runs that add up to ``steps``; short runs are less likely to be disturbed."""
    length = min(max(int(work) // n, 1), steps)
    return [min(length, steps - done) for done in range(0, steps, length)]


def take_turns(timed_runs: Sequence[Any], repetitions: int, tick: Callable[[], None] = lambda: None) -> list[dict[str, Any]]:
    """Measurements of each case after ``repetitions`` rounds; each round reverses the order of the previous one."""
    for round_number in range(repetitions):
        for timed in timed_runs[:: 1 if round_number % 2 == 0 else -1]:
            timed.repeat()
        tick()
    return [timed.measured() for timed in timed_runs]


def memory_of(engine: Any, n: int) -> dict[str, float]:
    """Bytes of all arrays that a backend holds, for each of ``n`` particles too; nodes of the blocks that hold particles."""
    total = engine.bytes_used() if hasattr(engine, "bytes_used") else sum(dict(_arrays(engine, set())).values())
    nodes = 64 * engine.ledger().active_blocks
    return {
        "bytes": total,
        "active_nodes": nodes,
        "bytes_per_particle": total / n,
        "bytes_per_particle_beside_nodes": (total - NODE_BYTES * nodes) / n,
    }


def _arrays(part: Any, seen: set[int]) -> Iterator[tuple[int, int]]:
    """Identity and bytes of the arrays reachable from an object by its attributes; a scene is input and does not count."""
    if id(part) in seen or type(part).__name__ in ("Scene", "module"):
        return
    seen.add(id(part))
    if isinstance(part, np.ndarray):
        own = _owner(part)
        yield id(own), own.nbytes
    elif isinstance(part, dict | list | tuple) or (hasattr(part, "__dict__") and type(part).__module__.startswith("runout.")):
        items = part if isinstance(part, list | tuple) else part.values() if isinstance(part, dict) else vars(part).values()
        for item in items:
            yield from _arrays(item, seen)


def _owner(view: np.ndarray) -> np.ndarray:
    while isinstance(view.base, np.ndarray):
        view = view.base
    return view
