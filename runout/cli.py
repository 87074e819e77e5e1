"""The command ``runout``: parses arguments and delegates."""

import inspect
import logging
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from shlex import quote
from types import TracebackType
from typing import Annotated, Any

from runout import __version__
from runout.errors import ExitCode, RunoutError
from runout.processes import interrupt

with interrupt.ended_at_once():  # it takes a moment
    from cyclopts import App, CycloptsError, Group, Parameter

    from runout import log
    from runout.commands.options import TRAITS, Session
    from runout.commands.written import require_places
    from runout.model.registry import parts_of

LOGGER = logging.getLogger(__name__)
INTERRUPTED, BROKEN_PIPE = 130, 141  # exit codes of shells for a command that Ctrl-C ended, or whose output nobody reads

app = App(
    name="runout",
    help="Geohazard runout assessment: from a DEM to hazard maps with a sparse 3D material point method.",
    version=__version__,
)
app.meta.group_parameters = Group("Options of every command", sort_key=0)

parts_of("runout.commands", first=("sites", "what_if", "probes", "view"))
COMMANDS = tuple(TRAITS)
for order, one in enumerate(COMMANDS):
    app.command(one, sort_key=order)
app.register_install_completion_command(help="Let bash, zsh or fish complete commands, options and folders.")


@app.meta.default
def launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    verbose: Annotated[bool, Parameter(name=["-v", "--verbose"], negative="", help="Say every detail.")] = False,
    quiet: Annotated[bool, Parameter(name=["-q", "--quiet"], negative="", help="Say warnings and errors only.")] = False,
    out: Annotated[Path | None, Parameter(help="Folder of the results [default: SITE/results].")] = None,
) -> int:
    """Run one command with the options of every command."""
    session = Session(verbosity=1 if verbose else -1 if quiet else 0, out=out)
    if tokens[:1] == ("new",):
        from runout.config.questions import with_answers

        tokens = tuple(with_answers(tokens))
    command, bound, injected = _parsed(app, tokens)
    if command not in COMMANDS:  # of cyclopts, which prints help or the version
        return _printed(command, bound)
    log.to_terminal(session.verbosity)
    sys.excepthook = partial(_unexpected, session)
    if "session" in injected:
        bound.arguments["session"] = session
    require_places(command, bound.arguments, out)
    return command(*bound.args, **bound.kwargs) or ExitCode.OK


def main(tokens: Sequence[str] | None = None) -> int:
    """Run the command with the arguments ``tokens``, or those of the process if None; returns the exit code.

    With the arguments of the process, an interrupt ends the process at once.
    """
    from runout.processes import caches

    if tokens is None:
        interrupt.end_at_once()
    try:
        caches.prepare()
        command, bound, _ = _parsed(app.meta, sys.argv[1:] if tokens is None else tokens)
        code = command(*bound.args, **bound.kwargs) if command is launch else _printed(command, bound)
        sys.stdout.flush()
        return int(code or ExitCode.OK)
    except CycloptsError as error:
        return _say(f"{str(error).rstrip(' ,.')}; {_usage(error)}", ExitCode.CONFIGURATION)
    except RunoutError as error:
        LOGGER.debug("traceback", exc_info=error)
        return _say(str(error), error.exit_code)
    except BrokenPipeError:
        log.silence_output()
        return BROKEN_PIPE
    except OSError as error:  # errors of the system that the user can remedy, such as a full disk
        LOGGER.debug("traceback", exc_info=error)
        from runout.io.atomic import reason

        log.silence_output()
        return _say(f"{error.filename or 'input or output'}: {reason(error)}", ExitCode.FAILURE)
    except KeyboardInterrupt:
        return _say(interrupt.MESSAGE, INTERRUPTED)


def _usage(error: CycloptsError) -> str:
    """What the command of a wrong call needs, and what lists its options."""
    if error.target not in COMMANDS:
        from runout.io.boundary import exists

        named = next((token for token in error.unused_tokens or () if exists(Path(token))), None)
        site = f"to check this site: runout check {quote(named)}; " if named else ""
        return f"{site}runout --help lists all commands"
    name = " ".join(["runout", *(error.command_chain or ())])
    words = []
    for one in inspect.signature(error.target).parameters.values():
        if one.default is one.empty and one.kind is not one.VAR_POSITIONAL and one.name != "session":
            words.append(f"--{one.name} {one.name.upper()}" if one.kind is one.KEYWORD_ONLY else one.name.upper())
    return f"usage: {' '.join([name, *words])}; all options: {name} --help"


def _parsed(application: App, tokens: Sequence[str]) -> tuple[Callable[..., Any], Any, dict[str, Any]]:
    return application.parse_args(list(tokens), exit_on_error=False, print_error=False)


def _printed(command: Callable[..., Any], bound: Any) -> int:
    """Call a function of cyclopts that prints help or the version."""
    bound.arguments["console"] = log.plain_output()
    command(*bound.args, **bound.kwargs)
    return ExitCode.OK


def _say(message: str, code: int) -> int:
    with suppress(OSError):  # nobody can read it
        log.console().print(f"[bold red]error:[/] {log.escaped(message)}")
    return int(code)


def _unexpected(session: Session, kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print an unexpected error in one line; the log file keeps its traceback."""
    _say(f"{kind.__name__}: {error}; this is a fault of runout, -v shows where", ExitCode.FAILURE)
    if session.verbosity > 0:
        sys.__excepthook__(kind, error, trace)
