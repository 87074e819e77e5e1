"""Runs a case of the fuzz and says what became of it; also as a command: ``python tests/fuzz/fuzz_cases.py FIRST COUNT``."""

import contextlib
import io
import logging
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

from odd_arrays import call_odd_array
from odd_commands import call_odd_command
from odd_sites import write_odd_site

from runout.config import extent
from runout.errors import RunoutError
from runout.forecast.step_cost import StepCost
from runout.workflow import plan, preview

LARGEST_DERIVED = 2_000_000  # cells that a site on a huge raster may need here, so that memory and time of a case are bounded
LIMIT, WAITING_LIMIT = 30, 300  # [s] of processor time of a case, most of which take some hundredths, and of waiting


class Overdue(BaseException):
    """A case that takes too long."""


@dataclass(frozen=True)
class Fault:
    """A case that ended in an error that nobody foresaw, or not at all."""

    seed: int
    kind: str
    text: str


def site_case(seed: int) -> tuple[str, Fault | None]:
    """``runout check`` of the site of a seed: outcome (ready, refused), or the fault."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz"))
    try:
        kind = write_odd_site(folder / "site", seed)
        return _outcome(seed, kind, lambda: preview.check_site(folder / "site"))
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def array_case(seed: int) -> tuple[str, Fault | None]:
    """A call of the Python interface with the arguments of a seed."""
    return _outcome(seed, "array", lambda: call_odd_array(seed))


def command_case(seed: int) -> tuple[str, Fault | None]:
    """A call of a command with odd options."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz"))
    try:
        return _outcome(seed, "command", lambda: call_odd_command(folder, seed))
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _outcome(seed: int, kind: str, act: Callable[[], object]) -> tuple[str, Fault | None]:
    try:
        with limited(), quiet() as said:
            code = act()
    except RunoutError as error:
        return ("refused", None) if str(error).strip() else ("fault", Fault(seed, kind, f"an empty {type(error).__name__}"))
    except (Exception, Overdue):  # noqa: BLE001 - this is what is looked for
        return "fault", Fault(seed, kind, traceback.format_exc(limit=-14))
    if "Traceback" in said.getvalue() or "fault of runout" in said.getvalue():
        return "fault", Fault(seed, kind, said.getvalue())
    return ("refused" if code else "ready"), None


@contextlib.contextmanager
def limited() -> Iterator[None]:
    """A limit of time for what is called."""

    def overdue(*_: object) -> None:
        raise Overdue(f"longer than {LIMIT} s of work, or {WAITING_LIMIT} s in all")

    timers = {signal.ITIMER_PROF: (signal.SIGPROF, LIMIT), signal.ITIMER_REAL: (signal.SIGALRM, WAITING_LIMIT)}
    before = {number: signal.signal(number, overdue) for number, _ in timers.values()}
    for timer, (_, seconds) in timers.items():
        signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        for timer in timers:
            signal.setitimer(timer, 0)
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def quiet() -> Iterator[io.StringIO]:
    """What is printed and logged is kept."""
    said, level = io.StringIO(), logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            warnings.simplefilter("ignore")
            yield said
    finally:
        logging.disable(level)


def run(first: int, count: int, calibrated_every: int = 0) -> tuple[dict[str, int], list[Fault]]:
    """Outcomes of ``count`` cases from a seed on, and the faults; every so many runs its calibration as well."""
    outcomes: dict[str, int] = {}
    faults = []
    for seed in range(first, first + count):
        case = array_case if seed % 5 == 0 else command_case if seed % 5 in (1, 2) else site_case
        real = calibrated_every and seed % calibrated_every == 0
        stored = mock.patch.object(plan, "step_cost", return_value=StepCost(1e-4, 3e-8))
        calibrated = contextlib.nullcontext() if real else stored
        with calibrated, mock.patch.object(extent, "LARGEST_DERIVED", LARGEST_DERIVED):
            outcome, fault = case(seed)
        outcomes[outcome] = outcomes.get(outcome, 0) + 1
        if fault:
            faults.append(fault)
    return outcomes, faults


def main(first: int, count: int, calibrated_every: int = 0) -> int:
    """Run cases one hundred at a time, print each fault when it is found; how many there were."""
    outcomes: dict[str, int] = {}
    number = 0
    for start in range(first, first + count, 100):
        told, faults = run(start, min(100, first + count - start), calibrated_every)
        outcomes = {name: outcomes.get(name, 0) + told.get(name, 0) for name in {**outcomes, **told}}
        for fault in faults:
            print(f"--- seed {fault.seed} ({fault.kind})\n{fault.text}", flush=True)
        number += len(faults)
    print(outcomes)
    return number


if __name__ == "__main__":
    sys.exit(min(main(*map(int, sys.argv[1:])), 1))
