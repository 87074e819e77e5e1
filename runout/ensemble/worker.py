"""One worker process: receives groups of members from its parent process and reports progress and outcomes.

Messages go through a pair of connected sockets without an address, or a pipe; no port is opened.
"""

import logging
import multiprocessing
import os
import pickle
import signal
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from importlib import import_module
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from types import TracebackType
from typing import Protocol

from runout.ensemble.member import Member
from runout.errors import DeviceError
from runout.log import MEMBER
from runout.processes.imports import collect_rarely, hide_dask
from runout.processes.lifetime import children_allowed, end_with_parent, interrupts_kept
from runout.safe_start import ignore_settings

TICK_SECONDS = 0.5  # [s] between two progress messages of a worker
END_SECONDS = 10.0  # [s] that an idle worker has to end by itself

Group = tuple[Member, ...]  # members that are computed together: one, or several that share the launches of a GPU
Errors = Mapping[int, BaseException]  # errors of failed members of a group, by number


class Task(Protocol):
    """Function that computes a group of members; returns the errors of failed members by number.

    ``progress`` is to be called with the number of a member and the fraction of it that is done, 0 to 1; ``device`` is one of the
    GPUs that the members share, None where they do not.
    """

    def __call__(self, group: Group, /, *, progress: Callable[[int, float], None], device: str | None) -> Errors: ...


@dataclass(frozen=True)
class Ready:
    """A worker has started."""


@dataclass(frozen=True)
class Progress:
    """Fractions, 0 to 1, of running members."""

    fractions: dict[int, float]


@dataclass(frozen=True)
class Said:
    """A warning of a member: its number, the name of the logger, the level and the text."""

    member: int
    logger: str
    level: int
    text: str

    def repeat(self) -> None:
        """Log it in this process."""
        logging.getLogger(self.logger).log(self.level, "%s", self.text, extra={"member": self.member})


@dataclass(frozen=True)
class Done:
    """A group has ended, with an error of the group or errors of members, after so many seconds, with warnings of members."""

    error: BaseException | None = None
    errors: dict[int, BaseException] = field(default_factory=dict)
    seconds: float = field(default=0.0, compare=False)
    said: tuple[Said, ...] = ()


class MemberWarnings(logging.Handler):
    """Context that keeps the warnings of members, each text once a member, in the order in which they come."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said: dict[Said, None] = {}

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a warning; those of no member are on the inputs, which the parent process has logged."""
        member = MEMBER.get()
        if member is not None:
            self.said[Said(member, record.name, record.levelno, record.getMessage())] = None

    def __enter__(self) -> "MemberWarnings":
        logging.getLogger("runout").addHandler(self)
        return self

    def __exit__(self, *_: object) -> None:
        logging.getLogger("runout").removeHandler(self)


class Failures:
    """Context that keeps the error of a member as ``error``, so that the run continues; interrupts are not caught."""

    def __init__(self) -> None:
        self.error: BaseException | None = None

    def __enter__(self) -> "Failures":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> bool:
        self.error = error
        return isinstance(error, Exception)


def done(task: Task, group: Group, tell: Callable[[int, float], None], device: str | None) -> Done:
    """Message on the end of a group."""
    started, errors = time.perf_counter(), dict[int, BaseException]()
    with MemberWarnings() as warnings, Failures() as failures:
        errors.update(task(group, progress=tell, device=device))
    return Done(failures.error, errors, time.perf_counter() - started, tuple(warnings.said))


@dataclass
class Worker:
    """Parent's view of a worker process. ``group`` holds the members it computes; ``ready`` is true once it has started."""

    number: int
    process: BaseProcess
    pipe: Connection
    group: Group = ()
    ready: bool = False

    def assign(self, task: bytes) -> None:
        """Send it what it computes, as :func:`packed` makes it; waits until it has started."""
        self._send(task)

    def give(self, group: Group) -> None:
        """Send it a group of members."""
        self.group = group
        self._send(packed(group))

    def _send(self, message: bytes) -> None:
        """Send a message. If the worker has just died, :meth:`hear` detects that."""
        try:
            self.pipe.send_bytes(message)
        except OSError:
            self.pipe.close()

    def hear(self) -> Ready | Progress | Done | None:
        """Next message of the worker; None if it has died."""
        try:
            return self.pipe.recv()  # type: ignore[no-any-return]
        except (EOFError, OSError, pickle.UnpicklingError):  # incomplete message of a worker that died
            return None

    def dismiss(self) -> None:
        """Tell the worker to end: immediately if it is computing, else after it learns that no members are left."""
        if self.group or not self.ready:
            self.process.kill()
        self.pipe.close()

    def end(self) -> None:
        """Dismiss the worker and wait until it has ended."""
        self.dismiss()
        self.process.join(END_SECONDS)
        self.process.kill()
        self.process.join()


def packed(message: object) -> bytes:
    """A message to a worker, for :meth:`Worker.assign` a :class:`Task`."""
    return bytes(ForkingPickler.dumps(message))


def start_worker(number: int, device: str | None, imports: Sequence[str] = ()) -> Worker:
    """Start a worker process that runs a task on a device. It imports some modules, then waits for :meth:`Worker.assign`.

    Raises DeviceError if the system cannot start another process.
    """
    context = multiprocessing.get_context("spawn")  # a forked child dies once numba has started threads
    ours, its = context.Pipe()
    process = context.Process(target=_work, args=(its, device, os.getpid(), imports), name=f"runout-{number}", daemon=True)
    try:
        with interrupts_kept(), children_allowed():
            process.start()
    except OSError as cause:
        raise DeviceError(f"no worker process can be started ({cause.strerror}); run again with fewer workers") from cause
    finally:
        its.close()
    return Worker(number, process, ours)


def _work(pipe: Connection, device: str | None, parent: int, imports: Sequence[str]) -> None:
    """Main function of a worker process: compute groups of members until none are left.

    It then ends at once: the interpreter takes a second to close, and all files are written.
    """
    end_with_parent(parent)
    collect_rarely()
    hide_dask()
    ignore_settings()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in ("runout", "py.warnings"):  # the parent process has already logged messages on the inputs
        logging.getLogger(name).addHandler(logging.NullHandler())
    logging.captureWarnings(True)
    for name in imports:
        with suppress(ImportError):  # the member that needs it says so
            import_module(name)
    try:
        task = pipe.recv()
        pipe.send(Ready())
        while True:
            pipe.send(_portable(done(task, pipe.recv(), _teller(pipe), device)))
    except (EOFError, OSError):  # the parent closed the connection: no members are left
        os._exit(0)


def _teller(pipe: Connection) -> Callable[[int, float], None]:
    """Collects fractions of members and sends them periodically, since many members may share a launch."""
    fractions, told = dict[int, float](), time.monotonic()

    def tell(number: int, fraction: float) -> None:
        nonlocal told
        fractions[number] = fraction
        if time.monotonic() - told >= TICK_SECONDS:
            told = time.monotonic()
            pipe.send(Progress(dict(fractions)))
            fractions.clear()

    return tell


def _portable(outcome: Done) -> Done:
    """The message with errors that can be pickled; each keeps its traceback as a note."""
    errors = {number: _noted(error) for number, error in outcome.errors.items()}
    return replace(outcome, error=outcome.error and _noted(outcome.error), errors=errors)


def _noted(error: BaseException) -> BaseException:
    text = "in a worker process:\n" + "".join(traceback.format_exception(error))
    with Failures() as failures:
        pickle.loads(pickle.dumps(error))
    if failures.error is not None:
        error = RuntimeError(f"{type(error).__name__}: {error}")
    error.add_note(text)
    return error
