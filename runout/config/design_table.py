"""Reads the members of an ensemble from a table (CSV) of its user: a row a member, checked cell by cell."""

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runout.config.document import shortened
from runout.config.wording import nearest
from runout.errors import ConfigError, Problem
from runout.model.limits import Range, looks_like_radians, radians_remedy

WEIGHT, RATE, SCENARIO, SEED = "weight", "annual_rate", "scenario", "seed"
OWN = {WEIGHT: Range(0, 1, open_low=True), RATE: Range(0, 1e3, "1/a", open_low=True), SEED: Range(0, 2**31 - 1)}
ROUNDING = 1e-3  # of weights as written, relative
MOST_ROWS = 100_000
LARGEST = 32 * 2**20  # [bytes]


@dataclass(frozen=True)
class DesignTable:
    """Members as a table states them."""

    # values (members,) in the units of site.yaml; NaN where the member has the value of the site
    parameters: dict[str, list[float]]
    # of ``weight`` [1], ``annual_rate`` [1/a] and ``seed``, those that are stated
    columns: dict[str, list[float]] = field(default_factory=dict)
    scenarios: list[str] = field(default_factory=list)  # scenario of each member; empty if the table has none

    @property
    def size(self) -> int:
        """Number of members."""
        return len(next(iter({**self.parameters, **self.columns}.values())))


def read_design(path: Path, name: str, ranges: Mapping[str, Range]) -> tuple[DesignTable | None, list[Problem]]:
    """The table, and all its problems, each with line and column; no table if there are any.

    Parameters
    ----------
    path : Path
        CSV with a heading. Columns: parameters, and of ``weight``, ``annual_rate``, ``scenario`` and ``seed`` those that are known.
    name : str
        The file in messages.
    ranges : mapping of str to Range
        Range of each parameter that a member of the site may have.
    """
    try:
        rows = _rows(path)
    except (OSError, UnicodeDecodeError, csv.Error, ConfigError) as cause:
        return None, [Problem(name, None, "", f"cannot be read as a table ({cause})", "save it as CSV in UTF-8")]
    if len(rows) < 2:
        return None, [Problem(name, 1, "", f"has {len(rows)} lines", "write a heading, and a line for each member")]
    problems = [Problem(name, line, *map(shortened, words)) for line, *words in _faults(rows, ranges)]
    return (None, problems) if problems else (_table(rows), [])


Rows = list[tuple[int, list[str]]]  # line and cells


def _rows(path: Path) -> Rows:
    """Lines that are not blank, with their numbers."""
    if path.stat().st_size > LARGEST:
        raise ConfigError(f"more than {LARGEST} bytes")
    with open(path, newline="", encoding="utf-8-sig") as file:
        reader = csv.reader(file, strict=True)
        return [(reader.line_num, [cell.strip() for cell in row]) for row in reader if len(row) > 1 or any(map(str.strip, row))]


def _faults(rows: Rows, ranges: Mapping[str, Range]) -> Iterator[tuple[int, str, str, str]]:
    """Line, column, what is wrong, remedy."""
    (first, names), *members = rows
    known = [*ranges, *OWN, SCENARIO]
    for k, column in enumerate(names):
        if column in names[:k]:
            yield first, column, "this column was already given", "keep one of the two"
        elif column not in known:
            near = nearest(column, known)
            fix = (
                f"did you mean {near!r}?"
                if near
                else f"use a parameter that the ensemble may sample, {', '.join(OWN)} or {SCENARIO}"
            )
            yield first, column, "no parameter of the members has this name", fix
    if len(members) > MOST_ROWS:
        yield first, "", f"{len(members)} members are more than {MOST_ROWS}", "use fewer"
    if len(names) == names.count(SCENARIO):
        yield first, "", "no column has numbers", "add a parameter, annual_rate, weight or seed"
    whole = True
    for line, cells in members:
        if len(cells) != len(names):
            whole = False
            yield (
                line,
                "",
                f"has {len(cells)} cells; the heading has {len(names)}",
                "give every column a cell, empty for the site's own value",
            )
            continue
        if not any(cells):
            whole = False
            yield line, "", "all cells are empty", "remove the line; a member with the values of the site states its weight or seed"
            continue
        for column, text in zip(names, cells, strict=True):
            if column in known and (fault := cell_fault(column, text, ranges)):
                whole = False
                yield line, column, *fault
    if whole and len(set(names)) == len(names):
        yield from _of_columns(rows)


def cell_fault(column: str, text: str, ranges: Mapping[str, Range]) -> tuple[str, str] | None:
    """What is wrong with a cell, and the remedy; None if it is sound."""
    if column == SCENARIO:
        return None if text else ("is empty", "name the scenario of every member, or remove the column")
    if not text:
        return None if column in ranges else ("is empty", "write a number, or remove the column")
    try:
        value = float(text)
    except ValueError:
        return f"{text!r} is no number", f"write {text.replace(',', '.')}" if "," in text else "write a number with a point"
    valid = OWN[column] if column in OWN else ranges[column]
    if column == SEED and not value.is_integer():
        return f"{text} is no whole number", "write one from 0 on"
    if valid.degrees and looks_like_radians(value):
        return f"{value:g} deg is suspiciously small; angles are in degrees here", radians_remedy(value)
    return None if valid.holds(value) else (f"{text} is out of range; {valid.allowed()}", valid.hint)


def _of_columns(rows: Rows) -> Iterator[tuple[int, str, str, str]]:
    """Weights and rates that do not fit together, and members that are listed twice."""
    (first, names), *members = rows
    columns = {name: [cells[k] for _, cells in members] for k, name in enumerate(names)}
    weights, rates = ([float(text) for text in columns.get(name, ())] for name in (WEIGHT, RATE))
    if weights and abs(sum(weights) - 1.0) > ROUNDING:
        yield first, WEIGHT, f"the weights add up to {sum(weights):.6g}", "they are shares of the ensemble; divide each by that"
    for (line, _), weight, rate in zip(members, weights, rates, strict=False):
        share = rate / sum(rates)
        if abs(weight - share) > ROUNDING * share:
            yield (
                line,
                WEIGHT,
                f"{weight:g} is not the share of its rate, {share:.6g}",
                "remove the column weight; rates set the weights",
            )
            break
    if SEED in columns:
        own = [k for k, name in enumerate(names) if name not in (WEIGHT, RATE, SCENARIO)]
        seen: dict[tuple[str, ...], int] = {}
        for line, cells in members:
            earlier = seen.setdefault(tuple(cells[k] for k in own), line)
            if earlier != line:
                yield (
                    line,
                    "",
                    f"repeats the member of line {earlier}",
                    "keep one with the sum of both weights, or give it another seed",
                )


def _table(rows: Rows) -> DesignTable:
    (_, names), *members = rows
    columns = {name: [cells[k] for _, cells in members] for k, name in enumerate(names)}
    numbers = {name: _numbers(cells) for name, cells in columns.items() if name != SCENARIO}
    parameters = {name: values for name, values in numbers.items() if name not in OWN}
    return DesignTable(parameters, {n: v for n, v in numbers.items() if n in OWN}, columns.get(SCENARIO, []))


def _numbers(cells: Sequence[str]) -> list[float]:
    return [float(text) if text else math.nan for text in cells]


def as_stated(table: DesignTable) -> dict[str, Any]:
    """Columns of a table as a site.yaml states sampled parameters, for the checks of these."""
    return {name: {"distribution": "discrete", "values": values} for name, values in table.parameters.items()}
