"""Entry point of the command ``runout``. From here on a signal ends the process with one line, also during imports."""

import os
import sys

from runout.processes.ending import end_at_once
from runout.safe_start import begin, ignore_settings


def main() -> int:
    """Exit code of the command of this process."""
    end_at_once()
    begin()
    _restart_in_utf8()
    from runout.processes.imports import collect_rarely, give_blas_one_thread, hide_dask

    collect_rarely()
    give_blas_one_thread()
    hide_dask()
    from runout.cli import main as command

    ignore_settings()
    return command()


def _restart_in_utf8() -> None:
    """Start the process again in the UTF-8 mode of Python if its locale has another encoding: GDAL takes UTF-8 file names only."""
    if sys.getfilesystemencoding() != "utf-8":
        os.environ["PYTHONUTF8"] = "1"  # for the workers
        os.execv(sys.executable, [sys.executable, "-X", "utf8", *sys.orig_argv[1:]])


if __name__ == "__main__":
    sys.argv[0] = "runout"  # name of the command in the products
    sys.exit(main())
