"""Table of members: scrambled Sobol points, mapped by the inverse distribution of every sampled parameter.

An ensemble with scenarios has a net of points for each. A member has its share of the annual rate of its scenario, and its share of
the rate of all scenarios as weight.
"""

import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.friction import OF_RELEASE
from runout.config.scenarios import FAILS, scenario_rates
from runout.errors import ConfigError
from runout.forecast import engine_notes
from runout.io import source_code
from runout.io.provenance import checksum

if TYPE_CHECKING:
    import pandas as pd

SOBOL_BITS = 30  # points are multiples of 2**-30
MOST_NOTED = 2**16  # numbers in a note
VOLUME = 1024, 4096  # fewest and most points of a net that stands for the volume of the unit cube


@dataclass(frozen=True)
class Design:
    """Sampled parameters and seeds of all members.

    Member ``i`` depends only on the seed, the parameters and ``i``: a larger ensemble contains the members of a smaller one.
    """

    # values (members,) of each sampled parameter, in the unit of ``site.yaml``; NaN for that of the site. Without parameters the
    # members differ in their seed only
    values: dict[str, list[float]]
    seeds: list[int]  # seeds (members,) of the particle sampling, 0 to 2**31 - 1
    weights: list[float] = field(default_factory=list)  # weights (members,) of a sum of 1; empty if they are equal
    rates: list[float] = field(default_factory=list)  # annual rates (members,) [1/a]; empty if they are not known
    scenarios: list[str] = field(default_factory=list)  # names (members,) of their scenarios; empty without scenarios
    nets: bool = True  # whether the members of each scenario, or all without scenarios, are points of a Sobol net

    @classmethod
    def of(cls, ensemble: Any, members: int | None = None) -> "Design":
        """The design that ``members``, ``seed``, ``parameters``, ``scenarios`` or ``table`` of ``site.yaml`` make.

        ``members`` takes the place of the number that ``site.yaml`` states, of ensembles without scenarios and table.

        Raises ConfigError if there is no member, or a distribution is not known or empty.
        """
        count, parameters = members or ensemble.members, dict(ensemble.parameters or {})
        if count < 1:
            raise ConfigError(f"ensemble.members is {count}; at least 1 is needed")
        if getattr(ensemble, "scenarios", None):
            return _of_scenarios(ensemble)
        if getattr(ensemble, "table", None):
            return _of_table(ensemble)
        return cls(_sampled(parameters, count, ensemble.seed), [member_seed(ensemble.seed, i) for i in range(count)])

    def samples(self) -> list[dict[str, float]]:
        """Parameters of each member, without those for which it has the value of the site."""
        rows = zip(*self.values.values(), strict=True) if self.values else ((),) * len(self.seeds)
        members = [zip(self.values, map(float, row), strict=True) for row in rows]
        return [{name: value for name, value in member if not math.isnan(value)} for member in members]


def member_table(ensemble: Any, members: int | None = None) -> "pd.DataFrame":
    """Members of an ensemble, one a row; the first ``members`` if stated.

    Returns
    -------
    pandas.DataFrame
        Indexed by ``member`` from 0: one column per parameter in the unit of ``site.yaml``, ``weight`` [1] (they sum
        to 1) and ``seed`` of the particle sampling; ``annual_rate`` [1/a] and ``scenario`` where they are known.
        ``attrs["design"]`` is "sobol" where parameters are sampled by a net, of each scenario if there are some.

    Raises
    ------
    ConfigError
        See :meth:`Design.of`.
    """
    import pandas as pd

    design = Design.of(ensemble, members)
    count = len(design.seeds)
    table = pd.DataFrame(design.values, index=pd.RangeIndex(count, name="member"))
    table["weight"] = design.weights or 1.0 / count
    for column, stated in {"annual_rate": design.rates, "scenario": design.scenarios}.items():
        if stated:
            table[column] = stated
    table["seed"] = design.seeds
    if design.values and design.nets:
        table.attrs["design"] = "sobol"
    return table


@dataclass(frozen=True)
class NetPoints:
    """Points of the members of a net in the unit cube of its parameters, and points that stand for its volume.

    All points of one value of a discrete parameter are in the middle of its interval.
    """

    members: np.ndarray  # (members, parameters)
    volume: np.ndarray  # (points, parameters): a net of its own


def nets_of(ensemble: Any, members: int | None = None) -> dict[str, NetPoints]:
    """Points of the net of each scenario by its name, or of all members by the name ""; none for a table of the user."""
    parameters = dict(getattr(ensemble, "parameters", None) or {})
    if getattr(ensemble, "table", None):
        return {}
    if not getattr(ensemble, "scenarios", None):
        return {"": _net_of(parameters, members or ensemble.members, ensemble.seed)} if parameters else {}
    drawn = {one.name: _drawn({**parameters, **one.parameters}) for one in ensemble.scenarios}
    counts = {one.name: one.members or ensemble.members for one in ensemble.scenarios}
    return {name: _net_of(of, counts[name], scenario_seed(ensemble.seed, name)) for name, of in drawn.items() if of}


def _net_of(parameters: Mapping[str, Any], count: int, seed: int) -> NetPoints:
    distributions = [parameters[name] for name in sorted(parameters)]
    sizes = (count, seed), (min(max(VOLUME[0], 4 * count), VOLUME[1]), seed + 1)
    return NetPoints(*(_middles(distributions, sobol_points(n, len(parameters), of_net)) for n, of_net in sizes))


def _middles(distributions: Sequence[Any], points: np.ndarray) -> np.ndarray:
    """Points (members, parameters); those of a discrete parameter in the middle of the interval of their value."""
    for column, distribution in zip(points.T, distributions, strict=True):
        if distribution.distribution == "discrete":
            edges = np.append(0.0, np.cumsum(distribution.frequencies) / np.sum(distribution.frequencies))
            place = np.searchsorted(edges[1:-1], column, side="right")
            column[:] = 0.5 * (edges[place] + edges[place + 1])
    return points


def _drawn(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters that have more than one value."""
    return {name: one for name, one in parameters.items() if one.distribution != "discrete" or len(one.values) > 1}


def _of_scenarios(ensemble: Any) -> Design:
    """Members of one scenario after the other; a scenario with more members keeps the first ones."""
    rates = scenario_rates(ensemble.scenarios)
    total = math.fsum(rates)
    sources = list(dict.fromkeys(name for one in ensemble.scenarios for name in one.releases or ()))
    blocks, weights, of_members, names, seeds = [], [], [], [], []
    for scenario, rate in zip(ensemble.scenarios, rates, strict=True):
        count, seed = scenario.members or ensemble.members, scenario_seed(ensemble.seed, scenario.name)
        blocks.append((count, _of_scenario(ensemble, scenario, count, seed, sources)))
        weights += [rate / total / count] * count
        of_members += [rate / count] * count
        names += [scenario.name] * count
        seeds += [member_seed(seed, k) for k in range(count)]
    columns = dict.fromkeys(name for _, block in blocks for name in block)
    values = {name: [v for count, block in blocks for v in block.get(name, [math.nan] * count)] for name in columns}
    return Design(values, seeds, weights, of_members, names)


def _of_scenario(ensemble: Any, scenario: Any, count: int, seed: int, sources: list[str]) -> dict[str, list[float]]:
    """Values (count,) of the parameters of a scenario, and which of the ``sources`` fail; all fail where it names none."""
    stated = {**ensemble.parameters, **scenario.parameters}
    drawn = _sampled(_drawn(stated), count, seed)
    values = {name: drawn[name] if name in drawn else [float(one.values[0])] * count for name, one in stated.items()}
    if scenario.releases:
        values |= {name + OF_RELEASE + FAILS: [float(name in scenario.releases)] * count for name in sources}
    return values


def scenario_seed(seed: int, name: str) -> int:
    """Seed of the net and of the members of a scenario: other scenarios do not change them."""
    return member_seed(seed, zlib.crc32(name.encode()))


def _of_table(ensemble: Any) -> Design:
    """Members as the table of the user states them; its rates set the weights."""
    rows = ensemble.rows
    weights, rates = rows.columns.get("weight", []), rows.columns.get("annual_rate", [])
    shares = rates or weights
    seeds = [int(seed) for seed in rows.columns.get("seed", [])] or [member_seed(ensemble.seed, k) for k in range(rows.size)]
    total = math.fsum(shares)
    return Design(rows.parameters, seeds, [share / total for share in shares], rates, rows.scenarios, nets=False)


def _sampled(parameters: Mapping[str, Any], count: int, seed: int) -> dict[str, list[float]]:
    """Values (count,) of each parameter, from the notes of this machine if they are there.

    To import the part of scipy that makes them takes 0.8 s; so long a command without a run would take more.
    """
    if not parameters or count * len(parameters) > MOST_NOTED:
        return _newly_sampled(parameters, count, seed)
    stated = [[name, vars(distribution)] for name, distribution in parameters.items()]
    of = [version("scipy"), source_code.checksums().members, count, seed, stated]
    noted = engine_notes.known("design", of, engine_notes.MONTH)
    if isinstance(noted, dict) and noted.get("checksum") == checksum(noted.get("values")):
        return {name: noted["values"][name] for name in parameters}
    values = _newly_sampled(parameters, count, seed)
    engine_notes.note("design", of, {"checksum": checksum(values), "values": values})
    return values


def _newly_sampled(parameters: Mapping[str, Any], count: int, seed: int) -> dict[str, list[float]]:
    names = sorted(parameters)  # independent of the order in the file
    points = sobol_points(count, len(names), seed)
    sampled = {name: quantiles(parameters[name], points[:, i], name).tolist() for i, name in enumerate(names)}
    return {name: sampled[name] for name in parameters}


def sobol_points(count: int, dimensions: int, seed: int) -> np.ndarray:
    """Scrambled Sobol points (count, dimensions), strictly between 0 and 1; more points keep the first ones."""
    if dimensions == 0:
        return np.empty((count, 0))
    from scipy.stats import qmc

    sampler = qmc.Sobol(dimensions, scramble=True, bits=SOBOL_BITS, seed=seed)
    points = sampler.random_base2((count - 1).bit_length())[:count]  # scipy warns unless the number is a power of two
    return points + 0.5**SOBOL_BITS / 2  # type: ignore[no-any-return]  # 0 would give an infinite quantile of a normal distribution


def member_seed(seed: int, member: int) -> int:
    """Seed of the particle sampling of one member, 0 to 2**31 - 1."""
    return int(np.random.SeedSequence([seed, member]).generate_state(1)[0] >> 1)


def quantiles(distribution: Any, probability: np.ndarray, name: str = "parameter") -> np.ndarray:
    """Values of a parameter below which it lies with ``probability`` (n,) [1], strictly between 0 and 1."""
    kind = str(distribution.distribution)
    if kind not in INVERSE:
        raise ConfigError(f"ensemble.parameters.{name}: distribution {kind!r} is not known; choose one of {', '.join(INVERSE)}")
    values = np.asarray(INVERSE[kind](distribution, probability), np.float64)
    if not np.isfinite(values).all():
        raise ConfigError(f"ensemble.parameters.{name}: the {kind} distribution has no values between its bounds; widen them")
    return values


def _uniform(distribution: Any, probability: np.ndarray) -> np.ndarray:
    return distribution.low + (distribution.high - distribution.low) * probability


def truncated_normal(distribution: Any) -> Any:
    """Normal distribution of scipy, truncated at the bounds if there are any."""
    from scipy.stats import truncnorm

    mean, deviation = distribution.mean, distribution.standard_deviation
    low = -np.inf if distribution.low is None else (distribution.low - mean) / deviation
    high = np.inf if distribution.high is None else (distribution.high - mean) / deviation
    return truncnorm(low, high, loc=mean, scale=deviation)


def triangular(distribution: Any) -> Any:
    """Triangular distribution of scipy."""
    from scipy.stats import triang

    low, width = distribution.low, distribution.high - distribution.low
    return triang((distribution.mode - low) / width, loc=low, scale=width)


def _discrete(distribution: Any, probability: np.ndarray) -> np.ndarray:
    frequencies = np.asarray(distribution.frequencies, np.float64)
    upper = np.cumsum(frequencies) / frequencies.sum()
    return np.asarray(distribution.values, np.float64)[np.searchsorted(upper[:-1], probability, side="right")]


INVERSE: Mapping[str, Callable[[Any, np.ndarray], np.ndarray]] = {
    "uniform": _uniform,
    "normal": lambda distribution, probability: truncated_normal(distribution).ppf(probability),
    "triangular": lambda distribution, probability: triangular(distribution).ppf(probability),
    "discrete": _discrete,
}
