"""Stability stress test: runs extreme values of every setting and checks invariants; writes a record."""

import logging
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from runout import __version__
from runout.backends.protocol import get_backend
from runout.errors import ExitCode
from runout.io.atomic import write_json
from runout.studies.stability_cases.layout import Layout
from runout.studies.stability_cases.matrix import one_at_a_time, pinned, sampled
from runout.studies.stability_cases.trial import Trial, attempt
from runout.studies.work_precision import commit

LOGGER = logging.getLogger("runout.stress")
FILE = "stress.json"
DEFAULTS = asdict(Layout())


def stress(out: Path | None = None, full: bool = False, backend: str = "scan", device: str = "cpu") -> list[Trial]:
    """All trials of a backend on a device, in their order; with a folder ``out`` also its record :data:`FILE`.

    A ``full`` test takes every choice alone and the Latin hypercube (some minutes), otherwise the pinned set (seconds). Raises
    ConfigError or DeviceError if there is no such backend or device: before a trial, which would count it as refused.
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
