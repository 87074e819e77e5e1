"""Makes the record of a study of the validation."""

import argparse
from pathlib import Path

from runout.studies.validation import run
from tests.benchmarks import validation_studies


def main() -> None:
    """Write the record and print its rows."""
    parser = argparse.ArgumentParser(description=validation_studies.__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=validation_studies.NAMES)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--coarse", action="store_true", help="one run, as in the tests")
    a = parser.parse_args()
    command = f"python -m tests.benchmarks.validation_studies {a.name} --out DIR"
    record = run(validation_studies.study(a.name), not a.coarse, a.out, command)
    print("\n".join(record["results"]["lines"]))


if __name__ == "__main__":
    main()
