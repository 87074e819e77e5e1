"""Numerical error of the maps of a site: runs on several grids, shifted and reseeded -> error bars -> JSON and page.

    python pipelines/numerical_error_of_a_site.py sites/jacksboro [OUT]

`runout verify SITE --convergence` is the command. `tests/benchmarks/error_bar_coverage.py` measures how often such bars hold.
"""

import sys
from pathlib import Path

from runout.studies.convergence import command

if __name__ == "__main__":
    sys.exit(command(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else None))
