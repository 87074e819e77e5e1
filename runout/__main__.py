"""The command ``runout`` as a process: a signal ends it with one line from here on, while libraries are loaded too."""

import sys

from runout.ending import end_at_once


def main() -> int:
    """Exit code of the command of this process."""
    end_at_once()
    from runout.cli import main as command

    return command()


if __name__ == "__main__":
    sys.argv[0] = "runout"  # as products name the command
    sys.exit(main())
