"""The command ``runout``: parses arguments and delegates."""

import gc
import logging
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any

from runout import __version__, interrupt
from runout.errors import ExitCode, RunoutError

with interrupt.ended_at_once():  # it takes a moment
    from cyclopts import App, CycloptsError, Group, Parameter

    from runout import log
    from runout.commands import probes, sites, slopes, studies, view
    from runout.commands.options import Session
    from runout.commands.written import require_places

LOGGER = logging.getLogger(__name__)
INTERRUPTED = 130  # exit code of shells for a command that Ctrl-C ended

app = App(
    name="runout",
    help="Geohazard runout assessment: from a DEM to hazard maps with a sparse 3D material point method.",
    version=__version__,
)
app.meta.group_parameters = Group("Options of every command", sort_key=0)

COMMANDS: tuple[Callable[..., int], ...] = (
    *(*sites.COMMANDS, *probes.COMMANDS, *view.COMMANDS),
    *(*slopes.COMMANDS, *studies.COMMANDS),
)
for order, one in enumerate(COMMANDS):
    app.command(one, sort_key=order)


@app.meta.default
def launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    verbose: Annotated[bool, Parameter(name=["-v", "--verbose"], negative="", help="Say every detail.")] = False,
    quiet: Annotated[bool, Parameter(name=["-q", "--quiet"], negative="", help="Say warnings and errors only.")] = False,
    out: Annotated[Path | None, Parameter(help="Folder of the results [default: SITE/results].")] = None,
) -> int:
    """Run one command with the options of every command."""
    session = Session(verbosity=1 if verbose else -1 if quiet else 0, out=out)
    command, bound, injected = _parsed(app, tokens)
    log.to_terminal(session.verbosity)
    sys.excepthook = partial(_unexpected, session)
    if command not in sites.SHORT:
        gc.enable()
    if "session" in injected:
        bound.arguments["session"] = session
    require_places(command, bound.arguments, out)
    return command(*bound.args, **bound.kwargs) or ExitCode.OK


def main(tokens: Sequence[str] | None = None) -> int:
    """Run the command with the arguments ``tokens``, or those of the process if None; returns the exit code.

    With the arguments of the process, an interrupt ends the process at once.
    """
    from runout import caches

    if tokens is None:
        interrupt.end_at_once()
    try:
        caches.prepare()
        command, bound, _ = _parsed(app.meta, sys.argv[1:] if tokens is None else tokens)
        return int(command(*bound.args, **bound.kwargs) or ExitCode.OK)
    except CycloptsError as error:
        return _say(str(error), ExitCode.CONFIGURATION)
    except RunoutError as error:
        LOGGER.debug("traceback", exc_info=error)
        return _say(str(error), error.exit_code)
    except OSError as error:  # errors of the system that the user can remedy, such as a full disk
        LOGGER.debug("traceback", exc_info=error)
        from runout.io.atomic import reason

        return _say(f"{error.filename or 'input or output'}: {reason(error)}", ExitCode.FAILURE)
    except KeyboardInterrupt:
        return _say(interrupt.MESSAGE, INTERRUPTED)


def _parsed(application: App, tokens: Sequence[str]) -> tuple[Callable[..., Any], Any, dict[str, Any]]:
    return application.parse_args(list(tokens), exit_on_error=False, print_error=False)


def _say(message: str, code: int) -> int:
    log.console().print(f"[bold red]error:[/] {log.escaped(message)}")
    return int(code)


def _unexpected(session: Session, kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print an unexpected error in one line; the log file keeps its traceback."""
    _say(f"{kind.__name__}: {error}; this is a fault of runout, -v shows where", ExitCode.FAILURE)
    if session.verbosity > 0:
        sys.__excepthook__(kind, error, trace)
