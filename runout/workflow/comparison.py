"""Command ``runout compare``: prints the scores of one product against another, and writes page, maps and record."""

import logging
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from runout import log
from runout.errors import ExitCode
from runout.variables import PRINTED

if TYPE_CHECKING:
    from runout.scores.assessment import Assessment
    from runout.scores.comparison import Choices, Comparison
    from runout.scores.definitions import Score
    from runout.scores.members import Member

LOGGER = logging.getLogger("runout.compare")
PAGE, RECORD, TABLE = "comparison.html", "comparison.json", "members.csv"
LISTED = 10  # members that the terminal lists


def command(first: Path, second: Path, choices: "Choices", out: Path | None) -> int:
    """Compare two products and print the scores; with ``out`` also write page, record and difference maps."""
    from runout.scores.comparison import compare

    comparison = compare(first, second, choices)
    console = log.output()
    for change in comparison.changes:
        LOGGER.warning("%s", change)
    for line in (*lines(comparison.assessment), *member_lines(comparison)):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    if out is not None:
        for path in write(comparison, Path(out)):
            LOGGER.info("wrote %s", path)
    return ExitCode.OK


def lines(assessment: "Assessment") -> Iterator[str]:
    """One line for each thing that is scored, with the area or number that is unknown."""
    from runout.scores.definitions import undefined_reasons

    for of, counts in assessment.counts.items():
        scores = [score for score in assessment.scores if score.of == of]
        shown = ", ".join(_shown(score) for score in scores if not math.isnan(score.value))
        missing = undefined_reasons((score.name, not math.isnan(score.value)) for score in scores)
        shown = "; ".join(part for part in (shown, f"undefined: {missing}" if missing else "") if part)
        unknown = [f"{value:.4g} {_unit(name)} unknown" for name, value in counts.items() if name.startswith("unknown") and value]
        yield f"{of}: {shown}" + (f" ({', '.join(unknown)})" if unknown else "")


def member_lines(comparison: "Comparison") -> Iterator[str]:
    """The best member with its parameters and scores, then one line for each of the best members."""
    if not comparison.members:
        return
    best, *_ = comparison.members
    head = f"best of {len(comparison.members)} members by {comparison.ranked_by}"
    yield f"{head}: member {best.number}{_sampled(best)}"
    for of in dict.fromkeys(score.of for score in best.scores):
        shown = ", ".join(_shown(score) for score in best.scores if score.of == of and not math.isnan(score.value))
        yield f"member {best.number}, {of}: {shown or 'undefined'}"
    for member in comparison.members[:LISTED]:
        yield f"member {member.number}: {', '.join(_ranks(member)) or 'no score that ranks it'}{_sampled(member)}"
    if len(comparison.members) > LISTED:
        yield f"{len(comparison.members) - LISTED} members more: --out DIR writes all to {TABLE}"


def _ranks(member: "Member") -> Iterator[str]:
    """The scores by which members are ranked, with what they are of."""
    from runout.scores.members import RANKS

    by = next((name for name in RANKS if any(score.name == name for score in member.scores)), "")
    for score in member.scores:
        if score.name == by:
            yield f"{_shown(score) if not math.isnan(score.value) else f'{score.definition.title} undefined'} ({score.of})"


def _sampled(member: "Member") -> str:
    """The sampled parameters of a member with their units; empty if nothing was sampled."""
    from runout.config.parameter_variables import parameter_variable

    values = []
    for name, value in member.parameters.items():
        units = parameter_variable(name).units
        values.append(f"{name} {value:.4g}" + (f" {units}" if units not in ("1", "degree") else ""))
    return f"; {', '.join(values)}" if values else ""


def _shown(score: "Score") -> str:
    from runout.scores.definitions import printed

    units, divisor = PRINTED.get(score.units, (score.units, 1.0))
    error = "" if score.numerical_error is None else f" +- {score.numerical_error / divisor:.2g}"
    unit = "" if units == "1" else f" {units.replace('m s-1', 'm/s')}"
    return f"{score.definition.title} {printed(score.value / divisor):.3g}{error}{unit}"


def _unit(name: str) -> str:
    return "m2" if name.endswith("_m2") else name.removeprefix("unknown_")


def write(comparison: "Comparison", out: Path) -> list[Path]:
    """Paths of the page, the record and the difference maps with their styles, after writing each as a whole."""
    from runout.io.atomic import write_json, write_text
    from runout.report.comparison import comparison_page
    from runout.scores.comparison import summary

    maps = write_differences(comparison, out)
    record = write_json(summary(comparison) | {"maps": [path.name for path in maps]}, out / RECORD)
    table = [write_text(members_csv(comparison.members), out / TABLE)] if comparison.members else []
    return [write_text(comparison_page(comparison), out / PAGE), record, *table, *maps]


def write_differences(comparison: "Comparison", folder: Path) -> list[Path]:
    """Paths of a GeoTIFF and a QGIS style for every quantity that both products have, after writing them."""
    from runout.hazard.maps import write_own_maps
    from runout.io.netcdf import map_dataset
    from runout.scores.flow import DIFFERENCES

    maps = {DIFFERENCES[quantity]: comparison.difference(quantity) for quantity in comparison.quantities}
    if not maps:
        return []
    dataset = map_dataset(comparison.grid.terrain(), maps, title=f"{comparison.a.path.name} minus {comparison.b.path.name}")
    return write_own_maps(dataset, maps, folder)


def members_csv(members: "Sequence[Member]") -> str:
    """Table of members from the best to the worst: number, weight, sampled parameters, and a column for each score."""
    import pandas as pd

    rows = []
    for member in members:
        row: dict[str, float] = {"member": member.number, "weight": member.weight, **member.parameters}
        row |= {f"{score.of}: {score.definition.title} [{score.units}]": score.value for score in member.scores}
        rows.append(row)
    return str(pd.DataFrame(rows).to_csv(index=False))
