"""Validation: public data and friction -> run -> scores against tools, experiment or event -> record.

    python pipelines/validation.py OUT CASE

`runout validate` is the command; `--full` there uses the sizes of the documentation.
"""

import sys
from pathlib import Path

from runout.studies.validation import RECORD, named, run


def main(out: Path, case: str) -> Path:
    """Record of a case in ``out``, after printing a line for each run and each tool."""
    record = run(named(case), full=False, out=out)
    print("\n".join(record["results"]["lines"]))
    return out / RECORD.format(record["case"])


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
