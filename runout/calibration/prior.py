"""The distributions of site.yaml as a unit cube: coordinate = probability that a parameter lies below its value."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.ensemble.design import quantiles, triangular, truncated_normal
from runout.errors import ConfigError

if TYPE_CHECKING:
    from runout.config.site import Site

RANKS = 1024  # probabilities at which the spread of a distribution is summed


@dataclass(frozen=True)
class Prior:
    """Sampled parameters with their distributions, which are independent of each other.

    In the cube the prior density is 1, whatever the distributions are. A discrete value has the middle of its step.
    """

    distributions: Mapping[str, Any]  # by the names of the parameters, in the order of the axes of the cube

    @classmethod
    def of(cls, site: "Site") -> "Prior":
        """The prior of a site.

        Raises ConfigError if the site samples no parameter, or its members are those of scenarios.
        """
        if site.settings.ensemble.scenarios:
            fix = "remove them for this command; the rest of ensemble.parameters is sampled then"
            raise ConfigError(f"{site.file}: ensemble.scenarios: members of scenarios are no sample of one distribution; {fix}")
        parameters = site.settings.ensemble.parameters
        if not parameters:
            fix = "add ensemble.parameters, such as basal_friction_angle_deg: {distribution: uniform, low: 12, high: 25}"
            raise ConfigError(f"{site.file}: ensemble: no parameter is sampled, so that all members are equal; {fix}")
        return cls(dict(parameters))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(self.distributions)

    def values(self, points: np.ndarray) -> np.ndarray:
        """Values (n, parameters) in the units of site.yaml at points (n, parameters) inside the cube."""
        inside = np.clip(points, 1e-9, 1.0 - 1e-9)
        columns = [quantiles(one, inside[:, k], name) for k, (name, one) in enumerate(self.distributions.items())]
        return np.column_stack(columns)

    def coordinates(self, values: np.ndarray) -> np.ndarray:
        """Points (n, parameters) of the cube that have values (n, parameters)."""
        columns = [probability_below(one, values[:, k]) for k, one in enumerate(self.distributions.values())]
        return np.column_stack(columns)

    def snapped(self, points: np.ndarray) -> np.ndarray:
        """Points (n, parameters) moved to the coordinates of their values, which differ for discrete parameters only."""
        if not any(one.distribution == "discrete" for one in self.distributions.values()):
            return points
        return self.coordinates(self.values(points))

    @property
    def deviations(self) -> np.ndarray:
        """Standard deviation (parameters,) of each parameter in the unit of site.yaml."""
        ranks = np.tile(((np.arange(RANKS) + 0.5) / RANKS)[:, None], len(self.names))
        return self.values(ranks).std(axis=0)  # type: ignore[no-any-return]


def probability_below(distribution: Any, values: np.ndarray) -> np.ndarray:
    """Probability (n,) that a parameter lies below values (n,): the inverse of :func:`runout.ensemble.design.quantiles`."""
    return np.asarray(BELOW[str(distribution.distribution)](distribution, np.asarray(values, np.float64)), np.float64)


def _uniform(distribution: Any, values: np.ndarray) -> np.ndarray:
    return (values - distribution.low) / (distribution.high - distribution.low)


def _discrete(distribution: Any, values: np.ndarray) -> np.ndarray:
    """Middle of the step of each value; the steps are in the order of the list, as in the table of members."""
    shares = np.asarray(distribution.frequencies, np.float64) / np.sum(distribution.frequencies)
    middles = np.cumsum(shares) - 0.5 * shares
    listed: Sequence[float] = list(distribution.values)
    return np.array([middles[int(np.argmin(np.abs(np.asarray(listed) - value)))] for value in values])


BELOW: Mapping[str, Callable[[Any, np.ndarray], np.ndarray]] = {
    "uniform": _uniform,
    "normal": lambda distribution, values: truncated_normal(distribution).cdf(values),
    "triangular": lambda distribution, values: triangular(distribution).cdf(values),
    "discrete": _discrete,
}
