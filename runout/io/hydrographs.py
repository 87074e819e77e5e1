"""Reads hydrographs: CSV files with a header and the columns time [s], discharge [m3/s] and, if it is known, velocity [m/s]."""

import csv
import re
from os import PathLike
from pathlib import Path

import numpy as np

from runout.errors import ConfigError, InputError, Problem
from runout.io.boundary import LARGEST_TEXT, as_path, require_regular
from runout.model.inflow import Hydrograph, hydrograph_problems

COLUMNS = {"time": ("s", "sec", "seconds"), "discharge": ("m3/s", "m^3/s", "m³/s", "m3 s-1", "cms"), "velocity": ("m/s", "m s-1")}
REQUIRED = ("time", "discharge")
DELIMITERS = ",;\t"
MOST = 20  # problems of a file that are listed


def read_hydrograph(path: str | PathLike[str]) -> Hydrograph:
    """The hydrograph of a CSV file. Columns are divided by commas, semicolons or tabs; lines that begin with # are left out.

    Raises InputError if the file cannot be read. Raises ConfigError with all rows that cannot be used, each with its line.
    """
    source = as_path(path, InputError)
    require_regular(source, InputError)
    if source.stat().st_size > LARGEST_TEXT:
        raise InputError(f"{source}: is larger than {LARGEST_TEXT} bytes; a hydrograph has a row for each time")
    try:
        text = source.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as cause:
        raise InputError(f"{source}: is no text ({cause.__class__.__name__}); export it as CSV in UTF-8") from cause
    numbered = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and not line.lstrip().startswith("#")]
    if not numbered:
        raise ConfigError([_problem(source, None, "", "has no rows", "write a header time,discharge and a row for each time")])
    places, problems = _header(source, *numbered[0])
    delimiter = _delimiter(numbered[0][1])
    rows, of_line = [], []
    for number, line in numbered[1:] if not problems else []:
        cells = next(csv.reader([line], delimiter=delimiter))
        values = {name: _number(source, number, name, cells, place, problems) for name, place in places.items()}
        rows.append(values)
        of_line.append(number)
    columns = {name: np.array([row[name] for row in rows], np.float64) for name in places}
    if not problems or rows:
        listed = {(problem.line, problem.key) for problem in problems}
        series = columns["time"], columns["discharge"], columns.get("velocity")
        of_series = [_placed(source, message) for message in hydrograph_problems(*series, [f"@{number}" for number in of_line])]
        problems += [problem for problem in of_series if (problem.line, problem.key) not in listed]
        problems.sort(key=lambda problem: problem.line or 0)
    if problems:
        more = len(problems) - MOST
        rest = [_problem(source, None, "", f"{more} more rows cannot be used", "mend those first")] if more > 0 else []
        raise ConfigError(problems[:MOST] + rest)
    return Hydrograph(columns["time"], columns["discharge"], columns.get("velocity"), str(source))


def _problem(source: Path, line: int | None, key: str, message: str, fix: str) -> Problem:
    return Problem(str(source), line, key, message, fix)


def _placed(source: Path, message: str) -> Problem:
    """A problem from a message of :func:`hydrograph_problems`, whose rows are called ``@line``."""
    parts = re.match(r"@(\d+): (\w+) is (.*?); (.*)", message, re.DOTALL)
    if not parts:
        text, _, fix = message.partition("; ")
        return _problem(source, None, "", text, fix)
    line, column, value, fix = parts.groups()
    return _problem(source, int(line), column, f"is {value}", fix)


def _delimiter(header: str) -> str:
    return max(DELIMITERS, key=header.count)


def _header(source: Path, line: int, text: str) -> tuple[dict[str, int], list[Problem]]:
    """Place of each known column, and what is wrong with the header."""
    places: dict[str, int] = {}
    problems = []
    cells = next(csv.reader([text], delimiter=_delimiter(text)))
    for place, cell in enumerate(cells):
        name, unit = _name_and_unit(cell)
        if name not in COLUMNS:
            continue
        if name in places:
            problems.append(_problem(source, line, name, "there are two columns of this name", "remove one of them"))
        if unit and unit not in COLUMNS[name]:
            wanted = COLUMNS[name][0]
            fix = f"convert it to {wanted}, and write [{wanted}]"
            problems.append(_problem(source, line, name, f"the column is in {unit!r}", fix))
        places.setdefault(name, place)
    missing = [name for name in REQUIRED if name not in places]
    if missing:
        header = ", ".join(cell.strip() for cell in cells)[:80]
        wanted = "write a header time,discharge (and velocity) in the first line"
        said = f"there is no column {' and no column '.join(missing)} among {header!r}"
        problems.append(_problem(source, line, "", said, wanted))
    return places, problems


def _name_and_unit(cell: str) -> tuple[str, str]:
    """Name of a column in lower case, and the unit in its brackets."""
    parts = re.fullmatch(r"\s*([^\[(]*?)\s*(?:[\[(]\s*(.*?)\s*[\])])?\s*", cell)
    return (parts[1].lower(), (parts[2] or "").lower()) if parts else (cell.strip().lower(), "")


def _number(source: Path, line: int, name: str, cells: list[str], place: int, problems: list[Problem]) -> float:
    """The number of a cell; what is wrong with it is added to the problems."""
    text = cells[place].strip() if place < len(cells) else ""
    try:
        return float(text)
    except ValueError:
        said = f"{text[:40]!r} is no number" if text else "has no value"
        fix = "write a decimal point" if re.fullmatch(r"[-+]?\d+,\d+", text) else "write a number, or remove the row"
        problems.append(_problem(source, line, name, said, fix))
        return float("nan")
