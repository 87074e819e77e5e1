"""Likelihood of several events that share parameters: the product of the likelihoods of the events.

Each event has its own emulators, standard errors and error of the grid, since another place is another function of the parameters.
A parameter of one event alone, such as the volume of its release, is an axis of the joint cube that the other events do not see.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from runout.calibration.posterior import Likelihood
from runout.calibration.prior import Prior
from runout.errors import ConfigError

OF_EVENT = ": "  # between the name of an event and that of its own parameter


@dataclass(frozen=True)
class JointPrior:
    """Parameters of several events in one cube."""

    prior: Prior  # shared parameters under their names, then those of single events as ``EVENT: NAME``
    axes: dict[str, list[int]]  # by event, the axes of the joint cube that its own parameters have, in the order of its own prior

    @classmethod
    def of(cls, priors: Mapping[str, Prior], own: Sequence[str] = ()) -> "JointPrior":
        """The joint prior of events by name; parameters named in ``own`` are not shared.

        Raises ConfigError if an event lacks a shared parameter, states another distribution of it, or nothing is shared; all
        faults at once.
        """
        names = list(dict.fromkeys(name for prior in priors.values() for name in prior.names))
        shared = [name for name in names if name not in own]
        problems = [
            *(f"--own {name}: no site samples it; they sample {', '.join(names)}" for name in own if name not in names),
            *(fault for name in shared if (fault := _fault(name, priors))),
        ]
        if not problems and not shared:
            problems.append(f"--own {' '.join(own)}: no parameter is left that the sites share; calibrate each site alone")
        if problems:
            raise ConfigError("\n".join(problems))
        first = next(iter(priors.values()))
        joint: dict[str, Any] = {name: first.distributions[name] for name in shared}
        for event, prior in priors.items():
            joint |= {event + OF_EVENT + name: one for name, one in prior.distributions.items() if name in own}
        order = list(joint)
        axes = {
            event: [order.index(name if name in shared else event + OF_EVENT + name) for name in prior.names]
            for event, prior in priors.items()
        }
        return cls(Prior(joint), axes)

    @property
    def shared(self) -> list[str]:
        """Names of the parameters that all events share."""
        return [name for name in self.prior.names if OF_EVENT not in name]


def _fault(name: str, priors: Mapping[str, Prior]) -> str:
    """Why a parameter cannot be shared, with the remedy; empty if it can."""
    with_it = {event: prior.distributions[name] for event, prior in priors.items() if name in prior.distributions}
    remedy = f"or write --own {name}, so that each event has its own"
    if lacking := [event for event in priors if event not in with_it]:
        return f"{name}: sampled by {', '.join(with_it)}, not by {', '.join(lacking)}; sample it in all sites, {remedy}"
    if all(one == next(iter(with_it.values())) for one in with_it.values()):
        return ""
    all_priors = "; ".join(f"{event} {_words(one)}" for event, one in with_it.items())
    return f"{name}: a shared parameter has one prior, but the sites state several ({all_priors}); state the same one, {remedy}"


def _words(distribution: Any) -> str:
    """A distribution with its numbers."""
    return " ".join(f"{value:g}" if isinstance(value, float) else f"{value}" for _, value in distribution if value is not None)


@dataclass(frozen=True)
class JointLikelihood:
    """Probability density of the observed scalars of all events."""

    prior: Prior  # of the joint cube
    events: Mapping[str, Likelihood]  # that of each event by name
    axes: Mapping[str, Sequence[int]]  # see :class:`JointPrior`

    def log_density(self, points: np.ndarray) -> np.ndarray:
        """Log density (n,) at points (n, parameters); minus infinity outside of the cube."""
        inside = np.all((points > 0.0) & (points < 1.0), axis=1)
        density = np.where(inside, 0.0, -np.inf)
        for event, likelihood in self.events.items():
            density[inside] += likelihood.log_density(points[inside][:, self.axes[event]])
        return density

    def without(self, event: str) -> "JointLikelihood":
        """The likelihood of all other events; the parameters of this event alone keep their prior."""
        return replace(self, events={name: one for name, one in self.events.items() if name != event})
