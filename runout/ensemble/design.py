"""Table of members: scrambled Sobol points, mapped by the inverse distribution of every sampled parameter."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.errors import ConfigError

if TYPE_CHECKING:
    import pandas as pd

SOBOL_BITS = 30  # points are multiples of 2**-30


def member_table(ensemble: Any) -> "pd.DataFrame":
    """Members of an ensemble, one per row.

    Member ``i`` depends only on the seed, the parameters and ``i``: a larger ensemble contains the members of a smaller one.

    Parameters
    ----------
    ensemble : EnsembleSettings
        ``members`` (number), ``seed`` and ``parameters`` (name to distribution) as in ``site.yaml``.

    Returns
    -------
    pandas.DataFrame
        Indexed by ``member`` from 0: one column per parameter in the unit of ``site.yaml``, ``weight`` [1] (they sum
        to 1) and ``seed`` of the particle sampling. Without parameters the members differ in their seed only.

    Raises
    ------
    ConfigError
        If the number of members is below 1, or a distribution is unknown or empty.
    """
    import pandas as pd

    count, parameters = ensemble.members, dict(ensemble.parameters or {})
    if count < 1:
        raise ConfigError(f"ensemble.members is {count}; at least 1 is needed")
    names = sorted(parameters)  # independent of the order in the file
    points = sobol_points(count, len(names), ensemble.seed)
    sampled = {name: quantiles(parameters[name], points[:, i], name) for i, name in enumerate(names)}
    table = pd.DataFrame({name: sampled[name] for name in parameters}, index=pd.RangeIndex(count, name="member"))
    table["weight"] = 1.0 / count
    table["seed"] = [member_seed(ensemble.seed, i) for i in range(count)]
    return table


def sobol_points(count: int, dimensions: int, seed: int) -> np.ndarray:
    """Scrambled Sobol points (count, dimensions), strictly between 0 and 1; more points keep the first ones."""
    from scipy.stats import qmc

    if dimensions == 0:
        return np.empty((count, 0))
    whole = (count - 1).bit_length()  # scipy warns unless the number is a power of two; the first points are the same
    points = qmc.Sobol(dimensions, scramble=True, bits=SOBOL_BITS, seed=seed).random_base2(whole)[:count]
    return points + 0.5**SOBOL_BITS / 2  # 0 would give an infinite quantile of a normal distribution


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
