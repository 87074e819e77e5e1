"""Values of parameters that a user varies: ``KEY=LOW:HIGH:STEP`` or ``KEY=A,B,C``, as a table of members (CSV).

A sampled parameter that is not varied has the median of its distribution in every member, so that two members differ in
the varied parameters alone.
"""

import csv
import io
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation

import numpy as np

from runout.config.design_table import SCENARIO, SEED, cell_fault
from runout.config.document import PREFIXES, SAMPLED, shortened
from runout.config.friction import OF_RELEASE
from runout.config.member_arguments import ROW_EXTRAS, member_ranges
from runout.config.scenarios import FAILS
from runout.config.schema import EnsembleSettings, SiteSettings
from runout.config.wording import choice_fix
from runout.ensemble.design import member_table, quantiles
from runout.errors import ConfigError, Problem
from runout.model.limits import Range

FORM = "write KEY=LOW:HIGH:STEP or KEY=A,B,C, such as basal_friction_angle_deg=15:25:1"
MOST_RUNS = 500
ROUNDING = 1e-12  # of summed weights


@dataclass(frozen=True)
class Sweep:
    """Values of parameters, and the members that they make."""

    varied: dict[str, tuple[float, ...]]  # values of each varied parameter in the units of site.yaml
    constant: dict[str, float]  # other sampled parameters with their medians
    one_at_a_time: bool = False  # whether one parameter is varied after the other, instead of all combinations

    def rows(self) -> list[dict[str, float]]:
        """Parameters of each member; a parameter that a row lacks has the value of site.yaml. No row is repeated."""
        if self.one_at_a_time:
            rows = [{**self.constant, name: value} for name, values in self.varied.items() for value in values]
        else:
            fixed = {name: value for name, value in self.constant.items() if name not in self.varied}
            rows = [fixed | dict(zip(self.varied, values, strict=True)) for values in itertools.product(*self.varied.values())]
        return [dict(row) for row in dict.fromkeys(tuple(sorted(row.items())) for row in rows)]

    def label(self, row: Mapping[str, float]) -> str:
        """A member by its varied parameters, such as ``basal_friction_angle_deg 15``."""
        return ", ".join(f"{name} {row[name]:g}" for name in self.varied if name in row)

    def table(self, seed: int) -> str:
        """The members as a table for ``ensemble.table``; all have the same seed."""
        rows, text = self.rows(), io.StringIO()
        writer = csv.DictWriter(text, [*dict.fromkeys(name for row in rows for name in row), SEED], lineterminator="\n")
        writer.writeheader()
        writer.writerows({**row, SEED: seed} for row in rows)
        return text.getvalue()


def read_sweep(settings: SiteSettings, stated: Sequence[str], scenario: str | None = None, one_at_a_time: bool = False) -> Sweep:
    """The sweep of a site that texts ``KEY=LOW:HIGH:STEP``, both ends included, or ``KEY=A,B,C`` state.

    A key is that of ``ensemble.parameters`` or of ``site.yaml``, or words that only one of these has. The other parameters have
    their medians, of a site with scenarios those of ``scenario``. With ``one_at_a_time`` one parameter is varied after the other.
    Raises ConfigError with all keys and values that cannot be used, and for each the remedy.
    """
    ranges, problems = member_ranges(settings), list[Problem]()
    varied: dict[str, tuple[float, ...]] = {}
    for text in stated:
        key, _, values = (part.strip() for part in text.partition("="))
        try:
            name = _parameter(key, ranges)
            numbers = tuple(_values(values, name, ranges[name]))
            if name in varied:
                raise ConfigError(f"{name} is varied twice; keep one of the two")
            varied[name] = numbers
        except ConfigError as error:
            problems.append(Problem("what-if", None, shortened(key), str(error)))
    _require_scenario(settings.ensemble, scenario)
    runs = sum(map(len, varied.values())) if one_at_a_time else math.prod(map(len, varied.values()))
    if not problems and not 2 <= runs <= MOST_RUNS:
        remedy = "two values are needed for a comparison" if runs < 2 else f"at most {MOST_RUNS} are drawn; use a longer step"
        problems.append(Problem("what-if", None, "", f"{' '.join(stated)} makes {runs} run{'s' * (runs != 1)}", remedy))
    if problems:
        raise ConfigError(problems)
    return Sweep(varied, median_parameters(settings, scenario), one_at_a_time)


def _parameter(key: str, ranges: Mapping[str, Range]) -> str:
    """Name of the sampled parameter that a key means."""
    if not key:
        raise ConfigError(f"there is no key; {FORM}")
    key = key.removeprefix(".".join(SAMPLED) + ".")
    *block, last = key.split(".")
    name = PREFIXES.get(tuple(block), ".".join(block) + ".") + last if tuple(block) in PREFIXES else key
    if name in ranges:
        return name
    words = set(key.lower().replace(".", "_").split("_"))
    alike = [one for one in ranges if OF_RELEASE not in one and words <= set(one.split("_"))]
    if len(alike) == 1:
        return alike[0]
    fix = f"did you mean {' or '.join(alike)}?" if alike else choice_fix(key, (one for one in ranges if OF_RELEASE not in one))
    raise ConfigError(f"members have no such parameter ({fix}); other settings: runout run SITE --set {key}=VALUE --out DIR")


def _values(text: str, name: str, valid: Range) -> Iterator[float]:
    """Numbers of ``LOW:HIGH:STEP`` or ``A,B,C``, each within the range of the parameter."""
    parts = [part.strip() for part in text.replace(",", ":").split(":")]
    try:
        numbers = [Decimal(part) for part in parts]
    except InvalidOperation:
        raise ConfigError(f"{text!r} holds no values; {FORM}") from None
    if not all(number.is_finite() for number in numbers) or ("," in text and ":" in text):
        raise ConfigError(f"{text!r} holds no values; {FORM}")
    values = list(_steps(text, *numbers)) if ":" in text and len(numbers) == 3 else numbers
    if ":" in text and len(numbers) != 3:
        raise ConfigError(f"{text} is no LOW:HIGH:STEP; add a step, such as {parts[0]}:{parts[-1]}:1, or separate values by commas")
    if len(set(values)) < len(values):
        raise ConfigError(f"{text} repeats a value; remove one")
    for value in values:
        if fault := cell_fault(name, str(value), {name: valid}):
            raise ConfigError("; ".join(part for part in fault if part))
    return map(float, values)


def _steps(text: str, low: Decimal, high: Decimal, step: Decimal) -> Iterator[Decimal]:
    """Numbers from ``low`` by ``step`` to ``high``, both included."""
    if step == 0:
        raise ConfigError(f"the step of {text} is 0; write one such as {low}:{high}:{abs(high - low) / 4 or 1}")
    if low == high:
        raise ConfigError(f"{text} has one value, from {low} to {high}; move an end")
    count = math.floor((high - low) / step) + 1
    if count < 1:
        raise ConfigError(f"the step {step} does not lead from {low} to {high}; write {low}:{high}:{-step}")
    if count < 2 or count > MOST_RUNS:
        why = "longer than the range" if count < 2 else f"so short that there are {count} values, more than {MOST_RUNS}"
        raise ConfigError(f"the step {step} is {why}; write one such as {low}:{high}:{(high - low) / 4}")
    return (low + k * step for k in range(count))


def median_parameters(settings: SiteSettings, scenario: str | None = None) -> dict[str, float]:
    """Median of every sampled parameter of a site in the units of site.yaml.

    Of a scenario those of its distributions, and which releases fail in it. Of a site with scenarios of which none is named,
    or with a table, the weighted medians of the members; all releases fail then unless a scenario of the table is named.
    """
    ensemble = settings.ensemble
    if ensemble.table is not None or (ensemble.scenarios and scenario is None):
        return _medians_of_members(ensemble, scenario)
    of_scenario = next((one for one in ensemble.scenarios or () if one.name == scenario), None)
    sampled = {**ensemble.parameters, **(of_scenario.parameters if of_scenario else {})}
    medians = {name: float(quantiles(one, np.array([0.5]), name)[0]) for name, one in sampled.items()}
    if of_scenario and of_scenario.releases:
        masses = [mass.name for mass in (*settings.release, *(settings.inflow or ()))]
        medians |= {name + OF_RELEASE + FAILS: float(name in of_scenario.releases) for name in masses}
    return medians


def _medians_of_members(ensemble: EnsembleSettings, scenario: str | None) -> dict[str, float]:
    """Weighted medians of the columns of the table of members, or of the rows of a scenario."""
    table = member_table(ensemble)
    if scenario is not None:
        table = table[table[SCENARIO] == scenario]
    medians = {}
    for name in (str(column) for column in table.columns if column not in ROW_EXTRAS):
        stated = table[table[name].notna()]
        if len(stated) and (scenario is not None or not name.endswith(FAILS)):
            ordered = stated.sort_values(name)
            reached = ordered["weight"].cumsum().to_numpy()
            medians[name] = float(ordered[name].iloc[int((reached >= (0.5 - ROUNDING) * reached[-1]).argmax())])
    return medians


def _require_scenario(ensemble: EnsembleSettings, scenario: str | None) -> None:
    """Raise ConfigError unless the scenario of a site with scenarios is named."""
    names = [one.name for one in ensemble.scenarios or ()] or list(dict.fromkeys(ensemble.rows.scenarios if ensemble.rows else ()))
    if names and scenario is None:
        raise ConfigError(f"the site has scenarios; name the one whose values the other parameters have: --scenario {names[0]}")
    if scenario is not None and scenario not in names:
        fix = choice_fix(scenario, names) if names else "remove --scenario: the site has none"
        raise ConfigError(f"--scenario: there is no scenario {scenario!r}; {fix}")
