"""Stability stress test: push every choice of a run to its end and see that nothing breaks, as a table and a page."""

import logging
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from pipelines.stability_cases.invariants import LIMITS
from pipelines.stability_cases.layout import Layout
from pipelines.stability_cases.matrix import one_at_a_time, pinned, sampled
from pipelines.stability_cases.trial import Trial, attempt
from runout import __version__
from runout.backends.protocol import get_backend
from runout.errors import ExitCode
from runout.io.atomic import write_json, write_text

LOGGER = logging.getLogger("runout.stress")
DEFAULTS = asdict(Layout())
OPENING = """# Stability

A mass of sand on a small terrain, with every choice of the run pushed to its end: first each alone, then all at once in
{samples} runs of a Latin hypercube. Written by `{command}`; do not edit. Version {version}, backend {backend}, {seconds:.0f} s.

Each run must end in one of two ways. It **survives**: {invariants}. Or it is **refused** in advance, before the first step, with
a reason. Anything else has **failed**. On a GPU: {{doc}}`benchmarks/gpu`.

**{survived} survived, {refused} were refused, {failed} failed.**

"""
INVARIANTS = (
    "nothing in the state is not a number; mass with what escaped is exact; momentum is that of gravity and of the ground's "
    "impulses; the sum of all energies never rises by more than 1e-3 of the drop of potential energy "
    "(in single precision and 2e-8 of the weight times a cell in each step, by rounding); no particle is faster than "
    "sqrt(v0^2 + 2 g dz) + 2 sqrt(g H) + 5 %, nor the centre of mass than its fall and the strain at the start allow; no layer of "
    "particles has its middle deeper than a tenth of a cell in the ground (of the raster and of the grid's nodes), or than a cell "
    "where walls and pits are narrower "
    "than two cells; "
    "what must rest creeps at less than 1 mm/s; "
    "of a mass on a plane that ends in a cliff at most 3 % stay behind the edge"
)


def stress(out: Path | None = None, full: bool = False, backend: str = "scan", device: str = "cpu") -> list[Trial]:
    """All trials, in their order.

    Parameters
    ----------
    out : Path or None
        Folder for ``stress.md`` and ``stress.json``; nothing is written when None.
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
        said = " ".join(["runout stress", *(option for option, given in chosen.items() if given)])
        write_json({"version": __version__, "trials": [asdict(t) for t in trials]}, out / "stress.json")
        write_text(as_markdown(trials, f"{said} --out {out.name}", backend, time.perf_counter() - started), out / "stress.md")
    return trials


def command(out: Path | None, full: bool, backend: str, device: str = "cpu") -> ExitCode:
    """What ``runout stress`` does; fails if a trial has failed."""
    return ExitCode.FAILURE if any(t.verdict == "failed" for t in stress(out, full, backend, device)) else ExitCode.OK


def as_line(trial: Trial) -> str:
    """What the terminal says of a trial."""
    why = f": {trial.reason}" if trial.reason else ""
    return f"{trial.verdict}: {trial.name} ({_changes(trial)}), {trial.particles} particles, {trial.steps} steps{why}"


def as_markdown(trials: Sequence[Trial], said: str, backend: str, seconds: float) -> str:
    """The page: what holds, the worst of every invariant, then the tables of trials."""
    alone = [t for t in trials if not t.name.startswith("sample")]
    together = [t for t in trials if t.name.startswith("sample")]
    count = Counter(t.verdict for t in trials)
    verdicts = {name: count[name] for name in ("survived", "refused", "failed")}
    head = {"samples": len(together), "command": said, "version": __version__, "backend": backend, "seconds": seconds}
    parts = [OPENING.format(**head, **verdicts, invariants=INVARIANTS), _worst(trials)]
    parts.append("## Each choice alone\n\n" + _table(alone))
    if together:
        odd = [t for t in together if t.verdict != "survived"]
        said_of = f"{len(together) - len(odd)} of {len(together)} survived.\n\n"
        parts.append("## All choices at once\n\n" + said_of + (_table(odd) if odd else ""))
    return "\n".join(parts)


def _worst(trials: Sequence[Trial]) -> str:
    lines = ["## Worst of every invariant among the survivors\n", "| invariant | worst | limit |", "|---|---|---|"]
    survivors = [t for t in trials if t.verdict == "survived"]
    for name, limit in LIMITS.items():
        bound = f"{limit:g}" if limit < float("inf") else "reported"
        lines.append(f"| {name} | {max((t.worst[name] for t in survivors), default=0.0):.2g} | {bound} |")
    return "\n".join(lines) + "\n"


def _table(trials: Sequence[Trial]) -> str:
    lines = [
        "| axis | changed | particles | steps | verdict | energy rise | sinking [h] | reason |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for t in trials:
        measured = f"{t.worst['energy']:.1g} | {t.worst['sinking']:.2g}" if t.worst else "- | -"
        verdict = f"**{t.verdict}**" if t.verdict == "failed" else t.verdict
        reason = t.reason.replace("|", "/")
        lines.append(f"| {t.name} | {_changes(t)} | {t.particles} | {t.steps} | {verdict} | {measured} | {reason} |")
    return "\n".join(lines) + "\n"


def _changes(trial: Trial) -> str:
    """What a layout changes, in words."""
    changed = {name: value for name, value in asdict(trial.layout).items() if value != DEFAULTS[name]}
    return ", ".join(f"{name} {value:.3g}" if isinstance(value, float) else f"{name} {value}" for name, value in changed.items())
