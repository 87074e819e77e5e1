"""Messages of a command: rich on the terminal, JSON lines in a file, one line of progress with the remaining time."""

import json
import logging
import os
import re
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

from rich.console import Console, RenderableType
from rich.live import Live
from rich.markup import escape
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from runout.io.atomic import storage_error
from runout.io.boundary import open_regular

LOGGER = logging.getLogger("runout")
WARNINGS = logging.getLogger("py.warnings")  # loggers of libraries: always in the log file, on the terminal with -v
STANDARD_FIELDS = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime"}
MEMBER: ContextVar[int | None] = ContextVar("member", default=None)  # number of the member that is being simulated
REPORT_SECONDS = 30.0  # between two lines of progress in a file or pipe
LEAST_SHARE = 0.01  # of a work that must be finished before the remaining time is estimated
SHORTEST_BAR, LONGEST_BAR = 8, 40  # columns
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
    own: int | None = getattr(record, "member", None)
    return MEMBER.get() if own is None else own


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

    A file or pipe gets the messages of every member; a screen gets the first of those that differ in their numbers only.
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
        if key in self.said:
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


class StatusLine:
    """The one line that says how far a command is: stage, member, share done, time left.

    A screen shows it below the messages and replaces it; a file or pipe gets it every :data:`REPORT_SECONDS`, without control
    characters.

    Parameters
    ----------
    hidden : bool
        Whether nothing is shown.
    """

    def __init__(self, *, hidden: bool):
        self.hidden, self.stage = hidden, ""
        self.reported = time.monotonic()
        self.begin("")
        self.live = Live(console=console(), get_renderable=self._drawn, refresh_per_second=4, transient=True)

    def __enter__(self) -> "StatusLine":
        if not self.hidden and console().is_terminal:
            self.live.start()
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):  # the terminal is gone
            self.live.stop()

    def begin(self, what: str) -> None:
        """Begin a part of the work, of which no share is known yet."""
        self.what, self.detail, self.start = what, "", time.monotonic()
        self.fraction: float | None = None
        self.remaining: float | None = None

    def update(self, fraction: float, detail: str = "", remaining: float | None = None) -> None:
        """State the finished fraction, 0 to 1, what is finished in words, and the time left [s]; None: as long as so far."""
        self.fraction, self.detail, self.remaining = min(max(float(fraction), 0.0), 1.0), detail, remaining
        if self.remaining is None and self.fraction > LEAST_SHARE:
            self.remaining = (time.monotonic() - self.start) * (1.0 / self.fraction - 1.0)
        if not self.hidden and not console().is_terminal and time.monotonic() - self.reported >= REPORT_SECONDS:
            self.reported = time.monotonic()
            with suppress(OSError):
                console().print(self.text(), markup=False)

    def text(self, width: int | None = None) -> str:
        """The line; without its less important parts where it is wider than ``width`` columns."""
        share = "" if self.fraction is None else f"{100 * self.fraction:.0f} %"
        left = "" if self.remaining is None else f"{duration(max(1.0, self.remaining))} left"
        where = ": ".join(part for part in (self.stage, self.what) if part)
        if self.fraction is None and where:
            left = duration(max(1, round(time.monotonic() - self.start)))
        name = self.stage.rpartition(", ")[2] or where
        versions = ((where, self.detail, share, left), (name, self.detail, share, left), (name, share, left), (share, left))
        lines = [", ".join(part for part in parts if part) for parts in versions]
        return next((line for line in lines if width is None or len(line) <= width), lines[-1][:width])

    def _drawn(self) -> RenderableType:
        """The line with a bar, if there is room for one."""
        width = console().width - 1  # a full line would wrap on some terminals
        text = self.text(width)
        room = min(width - len(text) - 1, LONGEST_BAR)
        if self.fraction is None or room < SHORTEST_BAR:
            return Text(text, no_wrap=True, overflow="crop")
        row = Table.grid(padding=(0, 1, 0, 0))
        row.add_row(Text(text, no_wrap=True), ProgressBar(total=1.0, completed=self.fraction, width=room))
        return row


LINE: ContextVar[StatusLine | None] = ContextVar("line", default=None)  # that is shown


@contextmanager
def _status_line() -> Iterator[StatusLine]:
    """Context of the line of a command: that of the context around it, if there is one."""
    if (outer := LINE.get()) is not None:
        yield outer
        return
    with StatusLine(hidden=not LOGGER.handlers or min(h.level for h in LOGGER.handlers) > logging.INFO) as line:
        token = LINE.set(line)
        try:
            yield line
        finally:
            LINE.reset(token)


@contextmanager
def hidden_progress() -> Iterator[None]:
    """Context without lines of progress, for one of several runs at the same time."""
    with StatusLine(hidden=True) as line:
        token = LINE.set(line)
        try:
            yield
        finally:
            LINE.reset(token)


@contextmanager
def progress_of_stages() -> Iterator[Callable[[str], None]]:
    """Context of one line for all stages of a run. Call the returned function with the name of each when it begins."""
    with _status_line() as line:

        def begin(stage: str) -> None:
            line.stage = stage
            line.begin("")

        yield begin


@contextmanager
def progress(what: str) -> Iterator[Callable[..., None]]:
    """Context of a part of the work with a line that says how far it is; see :meth:`StatusLine.update` for what it returns."""
    with _status_line() as line:
        line.begin(what)
        yield line.update


def duration(seconds: float) -> str:
    """Duration as text: 40 s, 3 min 20 s, 2 h 5 min."""
    if seconds < 100:
        return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes_left = divmod(minutes, 60)
    return f"{hours} h {minutes_left} min" if hours else f"{minutes} min {rest} s"


def escaped(text: str) -> str:
    """Text whose brackets rich prints literally."""
    return escape(text)
