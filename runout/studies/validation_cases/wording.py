"""Text that the pages of the validation share."""

from collections.abc import Callable, Mapping
from typing import Any

ENDING = """## How to make this page

    {command}

It writes this page, its table, its figure and a record with machine, versions and commit; without `--full` it takes the coarse
size of CI. `python -m runout.studies.documentation` makes the same files again from the record in `tests/benchmarks/records/`.
"""
COARSE = "The coarse size of CI has one run; `--full` makes the runs that show the differences and their reasons."


def told(record: Mapping[str, Any], text: str, numbers: Callable[[Mapping[str, Any]], Mapping[str, Any]]) -> str:
    """The text on the differences, with ``numbers`` of the results in its places; only a full record has them all."""
    return text.format(**numbers(record["results"])) if record["full"] else COARSE
