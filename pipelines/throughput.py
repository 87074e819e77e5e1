"""Throughput: layers of different size, threads and precision -> particle-steps per second and memory -> JSON.

    python pipelines/throughput.py OUT

`runout bench` is the command.
"""

import sys
from pathlib import Path

from runout.studies.work_precision import Choices, report, run

if __name__ == "__main__":
    out = Path(sys.argv[1])
    report(run(Choices(), out / "bench.json"))
