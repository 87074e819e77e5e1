"""Stability stress test: runs extreme values of every setting and checks invariants; writes a record.

A trial runs a layout and reports whether it survived, was refused in advance, or failed.
"""

import logging
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from runout import __version__
from runout.backends.protocol import get_backend
from runout.errors import ExitCode, RunoutError
from runout.io.atomic import write_json
from runout.simulation.observers import PeakMaps
from runout.studies.stability_cases.invariants import Watch
from runout.studies.stability_cases.layout import Layout
from runout.studies.stability_cases.matrix import one_at_a_time, pinned, sampled
from runout.studies.verification_cases.bodies import transfer
from runout.studies.work_precision import commit

LOOKS = 40  # at least so many over a run
LARGEST = 5_000  # particles
LOGGER = logging.getLogger("runout.stress")
FILE = "stress.json"
DEFAULTS = asdict(Layout())


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


def stress(out: Path | None = None, full: bool = False, backend: str = "scan", device: str = "cpu") -> list[Trial]:
    """All trials, in their order.

    Parameters
    ----------
    out : Path or None
        Folder for the record :data:`FILE`; nothing is written when None.
    full : bool
        Every choice alone and the Latin hypercube (some minutes) instead of the pinned set (seconds).
    backend : str
        "scan", "hash" or "reference".
    device : str
        "cpu", or "cuda:0" for the backend "hash".

    Raises
    ------
    StorageError
        If the folder cannot be written.
    ConfigError, DeviceError
        If there is no such backend or device: before a trial, which would count it as refused.
    """
    get_backend(backend, device, 1)
    started, trials = time.perf_counter(), list[Trial]()
    for name, layout in [*one_at_a_time(), *sampled()] if full else pinned():
        trials.append(attempt(name, layout, backend, device))
        LOGGER.log(logging.WARNING if trials[-1].verdict == "failed" else logging.INFO, "%s", as_line(trials[-1]))
    count = Counter(t.verdict for t in trials)
    LOGGER.info("%d survived, %d refused, %d failed", count["survived"], count["refused"], count["failed"])
    if out is not None:
        chosen = {"--full": full, f"--backend {backend}": backend != "scan", f"--device {device}": device != "cpu"}
        said = " ".join(["runout stress", *(option for option, chosen_option in chosen.items() if chosen_option), "--out DIR"])
        content = {**as_json(trials, time.perf_counter() - started), "command": said, "backend": backend, "device": device}
        LOGGER.info("wrote %s", write_json(content, out / FILE))
    return trials


def command(out: Path | None, full: bool, backend: str, device: str = "cpu") -> ExitCode:
    """Command ``runout stress``; the exit code is 1 if a trial fails."""
    return ExitCode.FAILURE if any(t.verdict == "failed" for t in stress(out, full, backend, device)) else ExitCode.OK


def as_json(trials: Sequence[Trial], seconds: float) -> dict[str, Any]:
    """The trials, ready for a JSON file: what each changes from the defaults, its verdict and its worst invariants."""
    rows = [{name: value for name, value in asdict(t).items() if name not in ("layout", "backend")} for t in trials]
    changed_rows = [{**row, "changed": _changed(t)} for row, t in zip(rows, trials, strict=True)]
    return {"version": __version__, "commit": commit(), "seconds": seconds, "defaults": DEFAULTS, "trials": changed_rows}


def as_line(trial: Trial) -> str:
    """Line for the terminal on a trial."""
    why = f": {trial.reason}" if trial.reason else ""
    return f"{trial.verdict}: {trial.name} ({changes(_changed(trial))}), {trial.particles} particles, {trial.steps} steps{why}"


def _changed(trial: Trial) -> dict[str, Any]:
    return {name: value for name, value in asdict(trial.layout).items() if value != DEFAULTS[name]}


def changes(changed: Mapping[str, Any]) -> str:
    """What a trial changes, in words."""
    return ", ".join(f"{name} {_shown(value)}" for name, value in changed.items())


def _shown(value: Any) -> str:
    if isinstance(value, tuple | list):
        return f"({', '.join(map(str, value))})"
    return f"{value:.3g}" if isinstance(value, float) else str(value)
