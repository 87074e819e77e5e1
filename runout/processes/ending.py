"""Signal handler of a command. It imports only modules of the interpreter, so that it works from the first line of runout.

:mod:`runout.processes.interrupt` states the reason and handles actions before the end.
"""

import _signal as signal  # built-in module; ``signal`` would import ``enum``
import os
import sys

MESSAGE = "interrupted; finished work is kept, the same command continues"
CURSOR = b"\r\x1b[2K\x1b[?25h"  # clears the line of a progress bar and shows the cursor
NAMES = ("runout", "runout.exe", "runout-script.py")
AT_END: list = []  # functions that are called before the end


def is_command() -> bool:
    """Whether this process is the command ``runout`` or ``python -m runout``, and not a program that imports the package."""
    name = (getattr(sys, "argv", None) or [""])[0]  # may be absent in programs that embed Python
    if os.path.basename(name) in NAMES:
        return True
    return name == "-m" and any(pair == ("-m", "runout") for pair in zip(sys.orig_argv, sys.orig_argv[1:], strict=False))


def end_at_once() -> None:
    """Let signals end this process. Ignored signals, as in the background of a shell, stay ignored."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, end)


def end(number: int, frame: object) -> None:
    """Call all functions of :data:`AT_END`, print one line and end this process."""
    for other in (signal.SIGINT, signal.SIGTERM):
        signal.signal(other, signal.SIG_IGN)
    text = MESSAGE if number == signal.SIGINT else MESSAGE.replace("interrupted", "terminated")
    try:  # noqa: SIM105 - contextlib would have to be loaded
        os.write(2, (CURSOR if os.isatty(2) else b"") + f"error: {text}\n".encode())
    except OSError:  # the terminal was closed
        pass
    for act in reversed(AT_END[:]):
        try:  # noqa: SIM105
            act()
        except OSError:
            pass
    os._exit(128 + number)
