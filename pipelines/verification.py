"""Verification: closed forms and convergence orders -> table of errors and bounds -> record.

    python pipelines/verification.py OUT [CASE ...]

`runout verify` is the command; `--full` there uses the sizes of the documentation.
"""

import sys
from pathlib import Path

from runout.studies.verification import run


def main(out: Path, cases: list[str]) -> bool:
    """Whether every bound holds, after writing the record of the cases to ``out``."""
    findings = run(cases, out=out)
    for finding in findings:
        print(f"{finding.case.name}: {'holds' if finding.holds else 'FAILS'}")
    return all(finding.holds for finding in findings)


if __name__ == "__main__":
    sys.exit(0 if main(Path(sys.argv[1]), sys.argv[2:]) else 1)
