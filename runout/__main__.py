"""Entry point of the command ``runout``. From here on a signal ends the process with one line, also during imports."""

import gc
import sys

from runout.ending import end_at_once
from runout.safe_start import begin, ignore_settings


def main() -> int:
    """Exit code of the command of this process."""
    end_at_once()
    begin()
    gc.disable()  # imports leave no garbage to look for; it is enabled before work that takes longer
    from runout.cli import main as command
    from runout.without_dask import hide_dask

    hide_dask()
    ignore_settings()
    return command()


if __name__ == "__main__":
    sys.argv[0] = "runout"  # name of the command in the products
    sys.exit(main())
