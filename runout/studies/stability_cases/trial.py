"""One trial: runs a layout and reports whether it survived, was refused in advance, or failed."""

import time
from dataclasses import dataclass

from runout.backends.protocol import get_backend
from runout.errors import RunoutError
from runout.simulation.observers import PeakMaps
from runout.studies.stability_cases.invariants import Watch
from runout.studies.stability_cases.layout import Layout
from runout.studies.verification_cases.bodies import transfer

LOOKS = 40  # at least so many over a run
LARGEST = 5_000  # particles


@dataclass(frozen=True)
class Trial:
    """Outcome of one layout: ``verdict`` is "survived", "refused" or "failed"; ``reason`` explains the last two."""

    name: str
    layout: Layout
    backend: str
    verdict: str
    reason: str
    particles: int
    steps: int
    worst: dict[str, float]
    seconds: float


def attempt(name: str, layout: Layout, backend: str = "scan", device: str = "cpu") -> Trial:
    """Run one layout on one backend (one thread on the CPU), in the transfers of a run."""
    started = time.perf_counter()
    try:
        scene, particles, bed, entering = layout.built()
        engine = get_backend(backend, device, 1)
        engine.load(scene, particles)
        if bed:
            bed.begin(particles)
        if entering:
            entering.begin(scene, len(particles), PeakMaps(scene, 0.1 * layout.h), 0.0)
    except RunoutError as refusal:
        return Trial(name, layout, backend, "refused", str(refusal), 0, 0, {}, time.perf_counter() - started)
    watch = Watch(layout, scene, particles, engine.ledger(), bed, entering)
    every, reasons = max(1, layout.steps // LOOKS), list[str]()  # steps, which end with a transfer
    time_now = 0.0  # [s]
    try:
        while watch.steps < layout.steps and watch.look(engine):
            looked = watch.steps
            while watch.steps < looked + every:
                dt = engine.stable_step()
                count = transfer(engine, scene, dt)
                watch.passed(count * dt)
                time_now += count * dt
                if watch.steps == looked:
                    watch.close(watch.ledger(engine))
                if bed and time_now >= bed.due:
                    bed.update(engine, time_now)
                if entering and time_now >= entering.due:
                    watch.enter(engine, time_now)
                watch.steps += count
        watch.look(engine)
        watch.finish(engine)
    except RunoutError as stop:
        reasons.append(str(stop))
    reasons += watch.broken
    verdict = "failed" if reasons else "survived"
    return Trial(
        name, layout, backend, verdict, "; ".join(reasons), len(particles), watch.steps, watch.worst, time.perf_counter() - started
    )
