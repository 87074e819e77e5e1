"""One worker process: takes groups of members from the process that started it, and tells how far they are.

Messages go through a pair of connected sockets without an address, or a pipe: nothing listens.
"""

import logging
import multiprocessing
import os
import pickle
import signal
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import Protocol

from runout.ensemble.member import Member
from runout.errors import DeviceError
from runout.lifetime import end_with_parent, interrupts_kept

TICK_SECONDS = 0.5  # between two messages of a worker on the members that run
END_SECONDS = 10.0  # for an idle worker to end by itself

Group = tuple[Member, ...]  # members that are computed together: one, or many in the launches of a GPU
Errors = Mapping[int, BaseException]  # of the members of a group that failed, by number


class Task(Protocol):
    """What is done with a group of members; returns the errors of those that failed, by number.

    ``progress`` is to be called with the number of a member and the fraction of it that is done, 0 to 1; ``device`` is one of the
    GPUs that the members share, None where they do not.
    """

    def __call__(self, group: Group, /, *, progress: Callable[[int, float], None], device: str | None) -> Errors: ...


@dataclass(frozen=True)
class Ready:
    """A worker has started."""


@dataclass(frozen=True)
class Progress:
    """Fractions, 0 to 1, of members that run."""

    fractions: dict[int, float]


@dataclass(frozen=True)
class Done:
    """A group has ended, with an error of its own or with errors of members."""

    error: BaseException | None = None
    errors: dict[int, BaseException] = field(default_factory=dict)


class Failures:
    """Block in which an error of a member is kept as ``error``: it fails that member and not the run; an interrupt passes."""

    def __init__(self) -> None:
        self.error: BaseException | None = None

    def __enter__(self) -> "Failures":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> bool:
        self.error = error
        return isinstance(error, Exception)


def done(task: Task, group: Group, tell: Callable[[int, float], None], device: str | None) -> Done:
    """How a group ended."""
    with Failures() as failures:
        return Done(errors=dict(task(group, progress=tell, device=device)))
    return Done(failures.error)


@dataclass
class Worker:
    """A worker process as the process that started it sees it; ``group`` is what it works on, ``ready`` whether it has started."""

    number: int
    process: BaseProcess
    pipe: Connection
    group: Group = ()
    ready: bool = False

    def give(self, group: Group) -> None:
        """Hand it a group of members; one that has just died is found dead later."""
        self.group = group
        try:
            self.pipe.send(group)
        except OSError:
            self.pipe.close()

    def hear(self) -> Ready | Progress | Done | None:
        """What it says next; None if it has died."""
        try:
            return self.pipe.recv()  # type: ignore[no-any-return]
        except (EOFError, OSError, pickle.UnpicklingError):  # a message that its death cut off
            return None

    def dismiss(self) -> None:
        """Tell it to end: at once if it works, else when it has heard that there is no more to do."""
        if self.group or not self.ready:
            self.process.kill()
        self.pipe.close()

    def end(self) -> None:
        """Dismiss it and wait until it has ended."""
        self.dismiss()
        self.process.join(END_SECONDS)
        self.process.kill()
        self.process.join()


def start_worker(number: int, task: Task, device: str | None) -> Worker:
    """A new worker process that does ``task`` on a device.

    Raises
    ------
    DeviceError
        If the system starts no further process.
    """
    context = multiprocessing.get_context("spawn")  # a fork after numba has started its threads kills the child
    ours, its = context.Pipe()
    process = context.Process(target=_work, args=(its, task, device, os.getpid()), name=f"runout-{number}", daemon=True)
    try:
        with interrupts_kept():
            process.start()
    except OSError as cause:
        raise DeviceError(f"no worker process can be started ({cause.strerror}); run again with fewer workers") from cause
    finally:
        its.close()
    return Worker(number, process, ours)


def _work(pipe: Connection, task: Task, device: str | None, parent: int) -> None:
    """Do groups of members until there are no more; what a worker process runs."""
    end_with_parent(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in ("runout", "py.warnings"):  # the process that started it has said what the inputs have to say
        logging.getLogger(name).addHandler(logging.NullHandler())
    logging.captureWarnings(True)
    try:
        pipe.send(Ready())
        while True:
            pipe.send(_portable(done(task, pipe.recv(), _teller(pipe), device)))
    except (EOFError, OSError):  # the other end was closed: there is no more to do
        return


def _teller(pipe: Connection) -> Callable[[int, float], None]:
    """Collects the fractions of members and sends them now and then: members that share a launch are many."""
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
    """The same with errors that can travel to another process; each keeps its traceback as a note."""
    errors = {number: _noted(error) for number, error in outcome.errors.items()}
    return Done(outcome.error and _noted(outcome.error), errors)


def _noted(error: BaseException) -> BaseException:
    text = "in a worker process:\n" + "".join(traceback.format_exception(error))
    with Failures() as failures:
        pickle.loads(pickle.dumps(error))
    if failures.error is not None:
        error = RuntimeError(f"{type(error).__name__}: {error}")
    error.add_note(text)
    return error
