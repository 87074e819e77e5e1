"""First lines of a command: standard streams exist, and no file of the working directory changes what the command does.

A site may come from elsewhere, and its user enters the folder. Python would import from it: ``python -m`` and ``python -c`` put
the working directory before the standard library. Numba and matplotlib read their settings there; those of numba may name a cache,
and a cache holds code. This module imports only modules of the interpreter, so that it runs before any other import.
"""

import os
import sys

SAFE_PATH = "PYTHONSAFEPATH"  # variable that keeps the working directory off the search path of child processes
STREAMS = (("stdin", "r"), ("stdout", "w"), ("stderr", "w"))
NUMBA_SETTINGS, MATPLOTLIB_SETTINGS = ".numba_config.yaml", "matplotlibrc"


def begin() -> None:
    """Open missing standard streams; take the working directory off the search path, here and in child processes."""
    open_streams()
    if SAFE_PATH not in os.environ:  # a second call must not remove a place that PYTHONPATH names
        here, own = _working_directory(), os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
        if not sys.flags.safe_path and sys.path and sys.path[0] in ("", here) and here != own:  # own: a checkout of runout
            del sys.path[0]
        os.environ[SAFE_PATH] = "1"


def open_streams() -> None:
    """Open the null device in place of standard streams that the caller closed.

    Otherwise the next file that is opened gets the number of the stream, and messages are written into it.
    """
    for number, (name, mode) in enumerate(STREAMS):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # it gets the lowest free number, which is this one
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115 - for the whole process
    sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]  # signs that its encoding lacks, as of stderr


def ignore_settings() -> None:
    """Keep numba and matplotlib from using settings in the working directory; costs nothing where there are none."""
    if os.path.exists(NUMBA_SETTINGS):
        _ignore_numba_settings()
    if os.path.exists(MATPLOTLIB_SETTINGS):
        import logging

        logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it reports each line of the file that it does not know
        import matplotlib

        matplotlib.rcdefaults()
        matplotlib.use("agg")  # ``rcdefaults`` keeps the drawing module that the file names


def _ignore_numba_settings() -> None:
    """Import the configuration of numba as where PyYAML is missing, which reads no file; later reads find none."""
    import warnings

    present = sys.modules.pop("yaml", None)
    sys.modules["yaml"] = None  # type: ignore[assignment]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from numba.core import config
    finally:
        del sys.modules["yaml"]
        if present is not None:
            sys.modules["yaml"] = present
    config._config_fname = ""
    config.reload_config()


def _working_directory() -> str:
    try:
        return os.getcwd()
    except OSError:  # it was removed
        return ""
