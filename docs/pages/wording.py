"""Text that the pages of the validation share."""

from collections.abc import Callable, Mapping
from typing import Any

ENDING = """## How to make this page

    {command}

It writes a record with machine, versions and commit; without `--full` it takes the coarse size of CI. Copy the record to
`tests/benchmarks/records/`; `python -m docs.pages` then writes this page, its table and its figure.
"""
HEADING = "## Differences, and their reasons\n\n"
COARSE = "The coarse size of CI has one run; `--full` makes the runs that show the differences and their reasons."


def told(record: Mapping[str, Any], text: str, numbers: Callable[[Mapping[str, Any]], Mapping[str, Any]]) -> str:
    """The text on the differences, with ``numbers`` of the results in its places; only a full record has them all."""
    return text.format(**numbers(record["results"])) if record["full"] else COARSE
