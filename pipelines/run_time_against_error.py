"""Run time against error: problems with a known answer -> errors and times of grids, particles and steps -> page and figures.

    python pipelines/run_time_against_error.py OUT

`runout bench --error` is the command.
"""

import sys
from pathlib import Path

from runout.studies.error_against_time import command

if __name__ == "__main__":
    command(Path(sys.argv[1]))
