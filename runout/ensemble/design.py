"""Table of members: scrambled Sobol points, mapped by the inverse distribution of every sampled parameter."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.errors import ConfigError
from runout.forecast import engine_notes
from runout.io import source_code
from runout.io.provenance import checksum

if TYPE_CHECKING:
    import pandas as pd

SOBOL_BITS = 30  # points are multiples of 2**-30
MOST_NOTED = 2**16  # numbers in a note


@dataclass(frozen=True)
class Design:
    """Sampled parameters and seeds of all members.

    Member ``i`` depends only on the seed, the parameters and ``i``: a larger ensemble contains the members of a smaller one.

    Attributes
    ----------
    values : dict of str to list of float
        Values (members,) of each sampled parameter, in the unit of ``site.yaml``. Without parameters the members differ in their
        seed only.
    seeds : list of int
        Seeds (members,) of the particle sampling, 0 to 2**31 - 1.
    """

    values: dict[str, list[float]]
    seeds: list[int]

    @classmethod
    def of(cls, ensemble: Any, members: int | None = None) -> "Design":
        """The design that ``members`` (number), ``seed`` and ``parameters`` (name to distribution) of ``site.yaml`` make.

        ``members`` takes the place of the number that ``site.yaml`` states.

        Raises
        ------
        ConfigError
            If there is no member, or a distribution is not known or empty.
        """
        count, parameters = members or ensemble.members, dict(ensemble.parameters or {})
        if count < 1:
            raise ConfigError(f"ensemble.members is {count}; at least 1 is needed")
        return cls(_sampled(parameters, count, ensemble.seed), [member_seed(ensemble.seed, i) for i in range(count)])


def member_table(ensemble: Any, members: int | None = None) -> "pd.DataFrame":
    """Members of an ensemble, one a row; the first ``members`` if stated.

    Returns
    -------
    pandas.DataFrame
        Indexed by ``member`` from 0: one column per parameter in the unit of ``site.yaml``, ``weight`` [1] (they sum
        to 1) and ``seed`` of the particle sampling. ``attrs["design"]`` is "sobol" where parameters are sampled.

    Raises
    ------
    ConfigError
        See :meth:`Design.of`.
    """
    import pandas as pd

    design = Design.of(ensemble, members)
    count = len(design.seeds)
    table = pd.DataFrame(design.values, index=pd.RangeIndex(count, name="member"))
    table["weight"] = 1.0 / count
    table["seed"] = design.seeds
    if design.values:
        table.attrs["design"] = "sobol"
    return table


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


def _normal(distribution: Any, probability: np.ndarray) -> np.ndarray:
    """Quantiles of a normal distribution, truncated at the bounds if there are any."""
    from scipy.stats import truncnorm

    mean, deviation = distribution.mean, distribution.standard_deviation
    low = -np.inf if distribution.low is None else (distribution.low - mean) / deviation
    high = np.inf if distribution.high is None else (distribution.high - mean) / deviation
    return truncnorm.ppf(probability, low, high, loc=mean, scale=deviation)


def _triangular(distribution: Any, probability: np.ndarray) -> np.ndarray:
    from scipy.stats import triang

    low, width = distribution.low, distribution.high - distribution.low
    return triang.ppf(probability, (distribution.mode - low) / width, loc=low, scale=width)


def _discrete(distribution: Any, probability: np.ndarray) -> np.ndarray:
    frequencies = np.asarray(distribution.frequencies, np.float64)
    upper = np.cumsum(frequencies) / frequencies.sum()
    return np.asarray(distribution.values, np.float64)[np.searchsorted(upper[:-1], probability, side="right")]


INVERSE: Mapping[str, Callable[[Any, np.ndarray], np.ndarray]] = {
    "uniform": _uniform,
    "normal": _normal,
    "triangular": _triangular,
    "discrete": _discrete,
}
