"""Messages of a command: rich on the terminal, JSON lines in a file, progress bars with remaining time."""

import json
import logging
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.text import Text

from runout.io.atomic import storage_error
from runout.io.regular import open_regular

LOGGER = logging.getLogger("runout")
WARNINGS = logging.getLogger("py.warnings")  # loggers of libraries: always in the log file, on the terminal with -v
STANDARD_FIELDS = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime"}
MEMBER: ContextVar[int | None] = ContextVar("member", default=None)  # number of the member that is being simulated
LEVELS = {-1: logging.WARNING, 0: logging.INFO, 1: logging.DEBUG}


@contextmanager
def of_member(number: int) -> Iterator[None]:
    """Context whose messages are those of a member."""
    token = MEMBER.set(number)
    try:
        yield
    finally:
        MEMBER.reset(token)


def member_of(record: logging.LogRecord) -> int | None:
    """Number of the member of a message; None if it is of none."""
    stated: int | None = getattr(record, "member", None)
    return MEMBER.get() if stated is None else stated


class JsonLines(logging.Formatter):
    """One JSON object per line: time (UTC), level, logger, message, and the values passed as ``extra``."""

    def format(self, record: logging.LogRecord) -> str:
        """A log record as one line."""
        line = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **({} if member_of(record) is None else {"member": member_of(record)}),
            **{k: v for k, v in vars(record).items() if k not in STANDARD_FIELDS},
        }
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


class PipeConsole(Console):
    """Console whose reader may end first: a command goes on without messages, and ends without results."""

    def on_broken_pipe(self) -> None:
        """Print no more; BrokenPipeError if results are lost."""
        self.quiet = True
        if not self.stderr:
            raise BrokenPipeError


@cache  # messages and bars share one console, so that they do not overwrite each other
def console() -> Console:
    """Console for messages on standard error; standard output carries only results."""
    return PipeConsole(stderr=True, highlight=False, soft_wrap=True, emoji=False)


def output() -> Console:
    """Console for results on standard output; wide if it is not a terminal."""
    return PipeConsole(highlight=False, soft_wrap=True, emoji=False, width=None if sys.stdout.isatty() else 160)


def plain_output() -> Console:
    """Console of standard output as rich makes it, for help."""
    return PipeConsole()


def silence_output() -> None:
    """Discard what is left of standard output, which cannot be written; else the interpreter reports it at its end."""
    with suppress(OSError, ValueError):  # ValueError: in tests, standard output is no file
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)


class Terminal(logging.Handler):
    """Messages on the terminal: one line each without wrapping, so that paths can be copied; repeated messages are left out.

    A file or pipe gets the messages of every member, and those marked ``progress``, in place of the bar; a screen gets the first of
    those that differ in their numbers only.
    """

    def __init__(self, level: int):
        super().__init__(level)
        self.said: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        """Print one message; warnings and errors are marked."""
        text, member, on_screen = record.getMessage(), member_of(record), console().is_terminal
        named = text if member is None or text.startswith(f"member {member}") else f"member {member}: {text}"
        key = text if on_screen else named
        if on_screen and named != text:  # one of those that differ in their numbers; the file has all
            key = re.sub(r"\d[\d.e+-]*", "#", text)
        if key in self.said or (on_screen and getattr(record, "progress", False)):
            return
        self.said.add(key)
        style = "yellow" if record.levelno < logging.ERROR else "bold red"
        mark = f"{record.levelname.lower()}: " if record.levelno >= logging.WARNING else ""
        with suppress(OSError):  # the terminal is gone, or its file is full; the work goes on
            console().print(Text.assemble((mark, style), (named, "dim" if record.levelno < logging.INFO else "")))
            if record.exc_info:
                console().print(logging.Formatter().formatException(record.exc_info), markup=False, style="dim")


def _terminals() -> list[Terminal]:
    return [handler for handler in LOGGER.handlers if isinstance(handler, Terminal)]


def to_terminal(verbosity: int = 0) -> None:
    """Send the messages of runout to the terminal: -1 warnings, 0 information, 1 all details."""
    for old in _terminals():
        LOGGER.removeHandler(old)
    LOGGER.addHandler(Terminal(LEVELS[verbosity]))
    LOGGER.setLevel(logging.DEBUG)
    logging.raiseExceptions = False  # a log file on a full disk must not print tracebacks
    logging.captureWarnings(True)
    WARNINGS.propagate = verbosity > 0
    WARNINGS.addHandler(logging.NullHandler())


@contextmanager
def muted() -> Iterator[None]:
    """Context without messages on the terminal, for code that reports its findings in another way."""
    levels = {terminal: terminal.level for terminal in _terminals()}
    for terminal in levels:
        terminal.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for terminal, level in levels.items():
            terminal.setLevel(level)


@contextmanager
def to_file(path: Path) -> Iterator[None]:
    """Append every message, details and tracebacks included, to ``path`` as JSON lines.

    Raises
    ------
    StorageError
        If the folder cannot be made or the file not be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = open_regular(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        handler = logging.StreamHandler(os.fdopen(descriptor, "a", encoding="utf-8"))
    except OSError as error:
        raise storage_error(path, error) from error
    handler.setFormatter(JsonLines())
    for terminal in _terminals():
        terminal.said.clear()
    before = LOGGER.level
    LOGGER.setLevel(logging.DEBUG)
    for logger in (LOGGER, WARNINGS):
        logger.addHandler(handler)
    try:
        yield
    except BaseException as error:
        LOGGER.debug("ended by %s", type(error).__name__, exc_info=error)
        raise
    finally:
        LOGGER.setLevel(before)
        for logger in (LOGGER, WARNINGS):
            logger.removeHandler(handler)
        with suppress(OSError):  # full disk; the writers of products report it
            handler.stream.close()


@contextmanager
def progress(what: str) -> Iterator[Callable[[float], None]]:
    """Context of a progress bar with remaining time. Call the returned function with the finished fraction, 0 to 1."""
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), TextColumn("left"))
    hidden = not LOGGER.handlers or min(h.level for h in LOGGER.handlers) > logging.INFO
    with Progress(*columns, TimeRemainingColumn(elapsed_when_finished=False), console=console(), disable=hidden) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda fraction: bar.update(task, completed=min(max(float(fraction), 0.0), 1.0))


def escaped(text: str) -> str:
    """Text whose brackets rich prints literally."""
    return escape(text)
