"""Command ``runout compare``: prints the scores of one product against another, and writes page, maps and record."""

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from runout import log
from runout.errors import ExitCode

if TYPE_CHECKING:
    from runout.scores.assessment import Assessment
    from runout.scores.comparison import Choices, Comparison

LOGGER = logging.getLogger("runout.compare")
PAGE, RECORD = "comparison.html", "comparison.json"


def command(first: Path, second: Path, choices: "Choices", out: Path | None) -> int:
    """Compare two products and print the scores; with ``out`` also write page, record and difference maps."""
    from runout.scores.comparison import compare

    found = compare(first, second, choices)
    console = log.output()
    for change in found.changes:
        LOGGER.warning("%s", change)
    for line in lines(found.found):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    if out is not None:
        for path in write(found, Path(out)):
            LOGGER.info("wrote %s", path)
    return ExitCode.OK


def lines(found: "Assessment") -> Iterator[str]:
    """One line for each thing that is scored, with the area or number that is unknown."""
    for of, counts in found.counts.items():
        scores = [score for score in found.scores if score.of == of]
        shown = ", ".join(
            f"{score.definition.title} {score.value:.3g}"
            + (f" +- {score.numerical_error:.2g}" if score.numerical_error is not None else "")
            + ("" if score.units == "1" else f" {score.units.replace('m s-1', 'm/s')}")
            for score in scores
        )
        unknown = [f"{value:.4g} {_unit(name)} unknown" for name, value in counts.items() if name.startswith("unknown") and value]
        yield f"{of}: {shown}" + (f" ({', '.join(unknown)})" if unknown else "")


def _unit(name: str) -> str:
    return "m2" if name.endswith("_m2") else name.removeprefix("unknown_")


def write(found: "Comparison", out: Path) -> list[Path]:
    """Paths of the page, the record and the difference maps with their styles, after writing each as a whole."""
    from runout.io.atomic import write_json, write_text
    from runout.report.comparison import comparison_page
    from runout.report.difference_maps import write_differences
    from runout.scores.comparison import summary

    maps = write_differences(found, out)
    record = write_json(summary(found) | {"maps": [path.name for path in maps]}, out / RECORD)
    return [write_text(comparison_page(found), out / PAGE), record, *maps]
