"""Tables of scores for pages: one row for what is scored, one column a score."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from runout.config.parameter_variables import parameter_variable
from runout.report.wording import MINUS, THIN, UNKNOWN, number, quantity, unit
from runout.scores.definitions import DEFINITIONS, printed, undefined_reasons
from runout.variables import PRINTED


@dataclass
class ScoreTable:
    """Scores of the same kinds."""

    heading: str  # of the first column
    columns: list[tuple[str, str, str]]
    rows: list[tuple[str, list[str]]] = field(default_factory=list)
    # scores without a value and why, and the rows of which this is true
    reasons: dict[str, list[str]] = field(default_factory=dict)

    @property
    def undefined(self) -> list[str]:
        """Sentences on the scores without a value."""
        return [f"Undefined for {', '.join(rows)}: {reason}." for reason, rows in self.reasons.items()]


def score_tables(scores: Sequence[Mapping[str, Any]], heading: str = "Scored") -> list[ScoreTable]:
    """Tables of scores as :meth:`runout.scores.Score.stored` makes them."""
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for score in scores:
        groups.setdefault(score["of"], []).append(score)
    tables: dict[tuple[tuple[str, str], ...], ScoreTable] = {}
    for of, members in groups.items():
        kinds = tuple((score["name"], score["units"]) for score in members)
        if kinds not in tables:
            tables[kinds] = ScoreTable(heading, [column(*kind) for kind in kinds])
        tables[kinds].rows.append((of, [cell(score) for score in members]))
        missing = undefined_reasons((score["name"], score["value"] is not None) for score in members)
        if missing:
            tables[kinds].reasons.setdefault(missing, []).append(of)
    return list(tables.values())


def column(name: str, units: str) -> tuple[str, str, str]:
    """Title, unit with best value, and meaning of a score."""
    definition = DEFINITIONS[name]
    shown = unit(PRINTED.get(units, (units, 1.0))[0])
    best = f"best {definition.best:g}"
    return definition.title, f"{shown}, {best}" if shown else best, f"{definition.meaning}; range: {definition.range}"


def cell(score: Mapping[str, Any]) -> str:
    """Value and numerical error bar."""
    divisor = PRINTED.get(score["units"], ("", 1.0))[1]
    value = number_of(None if score["value"] is None else printed(score["value"] / divisor))
    error = score.get("numerical_error")
    return value if error is None or value == UNKNOWN else f"{value}{THIN}±{THIN}{number(error / divisor, 2)}"


def number_of(value: float | None) -> str:
    """A value of a score; a dash if it is not defined."""
    if value is None:
        return UNKNOWN
    return number(value) if abs(value) >= 0.0005 or value == 0 else f"{MINUS if value < 0 else ''}0.000"


def range_table(
    ensemble: Sequence[Mapping[str, Any]],
    members: Mapping[str, Sequence[Mapping[str, Any]]],
    parameters: Mapping[str, Mapping[str, float]],
) -> list[ScoreTable]:
    """Table of the sampled parameters and the scores of each member; names of what is scored become part of the columns.

    Parameters
    ----------
    ensemble : sequence of mappings
        Stored scores whose kinds are the columns.
    members : mapping of str to sequence
        Stored scores by member.
    parameters : mapping of str to mapping
        Sampled parameters of each member by name.
    """
    kinds = [(score["of"], score["name"], score["units"]) for score in ensemble if DEFINITIONS[score["name"]].is_headline]
    sampled = list(next(iter(parameters.values()), {}))
    columns = [parameter_column(name) for name in sampled]
    for of, name, units in kinds:
        title, best, meaning = column(name, units)
        columns.append((title, f"{of}; {best}", meaning))
    table = ScoreTable("Member", columns)
    for member, scores in members.items():
        found = {(score["of"], score["name"]): score for score in scores}
        values = [number(parameters[member][name]) for name in sampled]
        values += [cell(found[of, name]) if (of, name) in found else UNKNOWN for of, name, _ in kinds]
        table.rows.append((member, values))
    return [table] if table.rows and kinds else []


def reach_tables(reaches: Mapping[str, Sequence[float]] | None, members: Any) -> list[ScoreTable]:
    """Table of the volumes by reach, empty for a site without reaches.

    Parameters
    ----------
    reaches : mapping or None
        Volumes as :meth:`runout.scores.ReachErrors.stored` makes them.
    members : xarray.DataArray (members, reaches) or None
        Volumes of the members [m3].
    """
    if reaches is None or members is None:
        return []
    units, meaning = unit("m3"), "net change of volume of the ground, negative where it was lowered"
    columns = [(title, units, meaning) for title in ("Observed", "Mean of the members", "Smallest member", "Largest member")]
    table, ends = ScoreTable("Reach", columns), reaches["ends_m"]
    rows = zip(ends[:-1], ends[1:], reaches["observed_m3"], reaches["modelled_m3"], members.values.T, strict=True)
    for start, end, observed, modelled, every in rows:
        volumes = (observed, modelled, every.min(), every.max())
        table.rows.append((f"{number(start)} to {number(end)}{THIN}m", [number(volume) for volume in volumes]))
    return [table]


def parameter_column(name: str) -> tuple[str, str, str]:
    """Title, unit and meaning of a sampled parameter."""
    variable = parameter_variable(name)
    return variable.long_name.capitalize(), unit(variable.units), "sampled parameter"


def counts_in_words(counts: Mapping[str, Any]) -> str:
    """Areas, volumes and numbers in words."""
    return "; ".join(f"{_words(name)} {_amount(name, value)}" for name, value in counts.items())


def _words(name: str) -> str:
    for suffix in ("_m2", "_m3", "_m"):
        name = name.removesuffix(suffix)
    return name.replace("_", " ")


def _amount(name: str, value: float | None) -> str:
    units = next((u for suffix, u in (("_m2", "m2"), ("_m3", "m3"), ("_m", "m")) if name.endswith(suffix)), "1")
    return UNKNOWN if value is None else quantity(value, units)
