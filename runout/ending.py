"""What a signal does to a command, with nothing loaded but what the interpreter has: it holds from the first line of runout on.

:mod:`runout.interrupt` says why, and what may be done before the end.
"""

import _signal as signal  # the module of the interpreter itself: ``signal`` would load ``enum`` first
import os
import sys

MESSAGE = "interrupted; what is finished is kept, the same command goes on from there"
CURSOR = b"\r\x1b[2K\x1b[?25h"  # clears a line with a bar and shows the cursor that it hid
NAMES = ("runout", "runout.exe", "runout-script.py")
AT_END: list = []  # what is called before the end


def is_command() -> bool:
    """Whether this process is the command ``runout`` or ``python -m runout``, and no program that imports the package."""
    name = (getattr(sys, "argv", None) or [""])[0]  # a program that embeds Python may have none
    if os.path.basename(name) in NAMES:
        return True
    return name == "-m" and any(pair == ("-m", "runout") for pair in zip(sys.orig_argv, sys.orig_argv[1:], strict=False))


def end_at_once() -> None:
    """Let signals end this process from now on; one that is ignored, as in the background of a shell, stays ignored."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, end)


def end(number: int, frame: object) -> None:
    """End this process with one line, after all of :data:`AT_END`."""
    for other in (signal.SIGINT, signal.SIGTERM):
        signal.signal(other, signal.SIG_IGN)
    text = MESSAGE if number == signal.SIGINT else MESSAGE.replace("interrupted", "terminated")
    try:  # noqa: SIM105 - contextlib would have to be loaded
        os.write(2, (CURSOR if os.isatty(2) else b"") + f"error: {text}\n".encode())
    except OSError:  # a terminal that was closed
        pass
    for act in reversed(AT_END[:]):
        try:  # noqa: SIM105
            act()
        except OSError:
            pass
    os._exit(128 + number)
