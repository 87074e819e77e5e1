"""Numerical stability: options at their limits, alone and combined -> trials with invariants -> record.

    python pipelines/stability.py OUT [BACKEND]

`runout stress` is the command.
"""

import sys
from pathlib import Path

from runout.studies.stability_stress import stress


def main(out: Path, backend: str = "scan") -> bool:
    """Whether no trial failed, after writing the record to ``out``. A refused trial is no failure."""
    trials = stress(out, full=False, backend=backend)
    for verdict in ("survived", "refused", "failed"):
        print(f"{verdict}: {sum(trial.verdict == verdict for trial in trials)}")
    return not any(trial.verdict == "failed" for trial in trials)


if __name__ == "__main__":
    sys.exit(0 if main(Path(sys.argv[1]), *sys.argv[2:3]) else 1)
