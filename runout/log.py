"""What a command says: rich on the terminal, JSON lines in a file, progress with the time that is left."""

import json
import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from runout.io.atomic import storage_error

if TYPE_CHECKING:
    from rich.console import Console

LOGGER = logging.getLogger("runout")
WARNINGS = logging.getLogger("py.warnings")  # of libraries: in the log file always, on the terminal with -v
STANDARD_FIELDS = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime"}
LEVELS = {-1: logging.WARNING, 0: logging.INFO, 1: logging.DEBUG}


class JsonLines(logging.Formatter):
    """One JSON object a line: time (UTC), level, where, message, and whatever was passed as ``extra``."""

    def format(self, record: logging.LogRecord) -> str:
        """The line of a record."""
        line = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **{k: v for k, v in vars(record).items() if k not in STANDARD_FIELDS},
        }
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


@cache  # one for messages and bars, so that they do not write over each other
def console() -> "Console":
    """The terminal for messages: standard error, so that standard output carries only what was asked for."""
    from rich.console import Console

    return Console(stderr=True, highlight=False, soft_wrap=True)


def output() -> "Console":
    """Standard output, for what was asked for; wide where nobody's terminal sets the width."""
    from rich.console import Console

    return Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else 160)


class Terminal(logging.Handler):
    """Messages on the terminal, a line each and never wrapped, so that paths can be copied; none is said twice in a run."""

    def __init__(self, level: int):
        super().__init__(level)
        self.said: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        """Print one message; what is a warning or worse says so."""
        if record.getMessage() in self.said:
            return
        self.said.add(record.getMessage())
        from rich.text import Text

        style = "yellow" if record.levelno < logging.ERROR else "bold red"
        mark = f"{record.levelname.lower()}: " if record.levelno >= logging.WARNING else ""
        console().print(Text.assemble((mark, style), (record.getMessage(), "dim" if record.levelno < logging.INFO else "")))
        if record.exc_info:
            console().print(logging.Formatter().formatException(record.exc_info), markup=False, style="dim")


def _terminals() -> list[Terminal]:
    return [handler for handler in LOGGER.handlers if isinstance(handler, Terminal)]


def to_terminal(verbosity: int = 0) -> None:
    """Send the messages of runout to the terminal: -1 warnings only, 0 what happens, 1 every detail."""
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
    """Keep the terminal silent while something runs that says what it finds in another way."""
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
        handler = logging.FileHandler(path, encoding="utf-8")
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
        with suppress(OSError):  # a full disk, which the products tell of
            handler.close()


@contextmanager
def progress(what: str) -> Iterator[Callable[[float], None]]:
    """A bar with the time that is left; call what it gives with the finished fraction, 0 to 1."""
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), TextColumn("left"))
    hidden = not LOGGER.handlers or min(h.level for h in LOGGER.handlers) > logging.INFO
    with Progress(*columns, TimeRemainingColumn(elapsed_when_finished=False), console=console(), disable=hidden) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda fraction: bar.update(task, completed=min(max(float(fraction), 0.0), 1.0))


def escaped(text: str) -> str:
    """Text with its brackets kept as they are when rich prints it."""
    from rich.markup import escape

    return escape(text)
