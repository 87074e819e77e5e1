"""Posterior of the sampled parameters from observed scalars, sampled by MCMC, and what of the parameters it identifies.

Kennedy & O'Hagan 2001, J. R. Stat. Soc. B 63:425, with emulators of scalars; the error of a grid is an offset of one parameter
and a covariance of what the offset leaves (:class:`GridError`).

The likelihood of several events that share parameters is the product of the likelihoods of the events. Each event has its own
emulators, standard errors and error of the grid, since another place is another function of the parameters. A parameter of one
event alone, such as the volume of its release, is an axis of the joint cube that the other events do not see.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Protocol

import numpy as np

from runout.calibration.emulator import Emulator, of_extra, one_thread
from runout.calibration.prior import Prior
from runout.ensemble.design import sobol_points
from runout.errors import ConfigError

STARTS = 4096  # Sobol points of the cube from which the walkers are drawn
WALKERS, STEPS, MOST_STEPS = 256, 400, 2400  # an emulator predicts 256 points in the time of 16
LENGTHS = 20.0  # autocorrelation times that a chain must have
KEPT = 4096  # points of a chain, at most
PERCENTILES = (5.0, 50.0, 95.0)
USUAL_OFFSET, LARGEST_OFFSET = 0.1, 0.25  # of the side of the cube
IDENTIFIED = 0.7  # standard deviation over that of the prior, below which a parameter is identified: half of its variance is gone
TRADES = 0.7  # absolute correlation from which two parameters replace each other
EDGE, LEANS = 0.05, 0.2  # outer share of the prior, and its posterior probability from which the posterior leans on the bound
OF_EVENT = ": "  # between the name of an event and that of its own parameter


class Density(Protocol):
    """What can be sampled: a log density over the cube of a prior."""

    @property
    def prior(self) -> Prior:
        """Distributions of the axes of the cube."""

    def log_density(self, points: np.ndarray) -> np.ndarray:
        """Log density (n,) at points (n, parameters); minus infinity outside of the cube."""


@dataclass(frozen=True)
class GridError:
    """Error of the grid as coarse-fine pairs show it: the fine grid at a point acts like the coarse grid beside it."""

    # (parameters,): step in the cube from a point to the point at which the coarse grid gives what the fine one gives here
    offset: np.ndarray
    covariance: np.ndarray  # (scalars, scalars): of what remains
    pairs: int  # number of pairs


@dataclass(frozen=True)
class Likelihood:
    """Probability density of the observed scalars at points of the cube.

    Normal, with the squares of the standard errors on the diagonal, and the errors of the emulators with the correlation of their
    residuals; log density up to a constant.
    """

    prior: Prior
    emulators: tuple[Emulator, ...]  # one for each scalar
    # observed, errors (scalars,): values and their standard errors
    observed: np.ndarray
    errors: np.ndarray
    grid_error: GridError | None = None

    @property
    def correlation(self) -> np.ndarray:
        """Correlation (scalars, scalars) of the held-out residuals of the emulators, less 2 % so that it has a factor."""
        residuals = np.stack([one.residuals for one in self.emulators])
        return np.atleast_2d(np.corrcoef(residuals)) * 0.98 + 0.02 * np.eye(len(residuals))  # type: ignore[no-any-return]

    def predicted(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean (n, scalars) and covariance (n, scalars, scalars) of modelled scalars at points (n, parameters)."""
        moved = self.prior.snapped(points) + (0.0 if self.grid_error is None else self.grid_error.offset)
        mean, deviation = (np.stack(part, axis=1) for part in zip(*(one.predict(moved) for one in self.emulators), strict=True))
        covariance = deviation[:, :, None] * self.correlation * deviation[:, None, :]
        return mean, covariance + (0.0 if self.grid_error is None else self.grid_error.covariance)

    def log_density(self, points: np.ndarray) -> np.ndarray:
        """Log density (n,) at points (n, parameters); minus infinity outside of the cube."""
        inside = np.all((points > 0.0) & (points < 1.0), axis=1)
        density = np.full(len(points), -np.inf)
        if inside.any():
            mean, covariance = self.predicted(points[inside])
            lower = np.linalg.cholesky(covariance + np.diag(np.square(self.errors)))
            scaled = np.linalg.solve(lower, (self.observed - mean)[:, :, None])[:, :, 0]
            half_log_determinant = np.log(np.diagonal(lower, axis1=1, axis2=2)).sum(axis=1)
            density[inside] = -0.5 * np.square(scaled).sum(axis=1) - half_log_determinant
        return density

    def prediction(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (scalars,), with the standard error, of what is observed over equally likely points."""
        mean, covariance = self.predicted(points)
        variance = np.diagonal(covariance, axis1=1, axis2=2).mean(axis=0) + mean.var(axis=0) + np.square(self.errors)
        return mean.mean(axis=0), np.sqrt(variance)

    def only(self, chosen: Sequence[int]) -> "Likelihood":
        """The likelihood of some of the scalars, by their places."""
        at = np.array(chosen, int)
        error = self.grid_error
        if error is not None:
            error = replace(error, covariance=error.covariance[np.ix_(at, at)])
        return Likelihood(self.prior, tuple(self.emulators[k] for k in at), self.observed[at], self.errors[at], error)


@dataclass(frozen=True)
class Posterior:
    """Sample of the posterior."""

    prior: Prior
    points: np.ndarray  # (n, parameters): equally weighted points of the cube
    effective: float  # number of independent points that are as certain
    converged: bool  # whether the chain is 20 times as long as its autocorrelation time

    @property
    def values(self) -> np.ndarray:
        """The parameters (n, parameters) in the units of site.yaml."""
        return self.prior.values(self.points)

    @property
    def narrowing(self) -> np.ndarray:
        """Standard deviation of each parameter over that of its prior (parameters,) [1]."""
        return self.values.std(axis=0) / self.prior.deviations  # type: ignore[no-any-return]

    @property
    def correlation(self) -> np.ndarray:
        """Correlation (parameters, parameters) of the parameters."""
        return np.atleast_2d(np.corrcoef(self.values.T))

    def directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Standard deviations (parameters,) along the principal axes over those of the prior [1], ascending, and the axes in rows.

        Parameters count in standard deviations of their prior. A deviation far below 1 is a combination that the observations fix.
        """
        scaled = self.values / self.prior.deviations
        variances, axes = np.linalg.eigh(np.atleast_2d(np.cov(scaled.T)))
        return np.sqrt(np.maximum(variances, 0.0)), axes.T

    def subset(self, count: int) -> np.ndarray:
        """Values (count, parameters) of points that are evenly spread over the chain; points repeat if there are fewer."""
        return self.values[np.linspace(0, len(self.points) - 1, count).round().astype(int)]

    def spread_points(self, count: int) -> np.ndarray:
        """Points (count, parameters) that stand for the posterior: the centres of clusters of its sample."""
        with of_extra("scikit-learn"):
            from sklearn.cluster import KMeans
        clusters = KMeans(count, n_init=1, random_state=0).fit(self.points)
        return np.asarray(clusters.cluster_centers_).clip(0.0, 1.0)

    def summary(self) -> dict[str, dict[str, float]]:
        """Mean, standard deviation, percentiles and narrowing of each parameter."""
        percentiles = np.percentile(self.values, PERCENTILES, axis=0)
        columns = zip(self.prior.names, self.values.T, percentiles.T, self.narrowing, strict=True)
        return {
            name: {
                "mean": float(values.mean()),
                "standard_deviation": float(values.std()),
                **{f"p{q:g}": float(value) for q, value in zip(PERCENTILES, at, strict=True)},
                "standard_deviation_over_prior": float(narrowing),
            }
            for name, values, at, narrowing in columns
        }

    def marginals(self, bins: int = 32) -> dict[str, dict[str, list[float]]]:
        """Shares of prior and posterior in equal bins of each parameter over the range of a sample of the prior, and the edges."""
        ranks = (np.arange(STARTS) + 0.5) / STARTS
        of_prior = self.prior.values(np.tile(ranks[:, None], len(self.prior.names)))
        shares = {}
        for k, name in enumerate(self.prior.names):
            edges = np.linspace(of_prior[:, k].min(), of_prior[:, k].max(), bins + 1)
            counts = [np.histogram(sample[:, k].clip(edges[0], edges[-1]), edges)[0] for sample in (of_prior, self.values)]
            prior, posterior = ((one / one.sum()).tolist() for one in counts)
            shares[name] = {"edges": edges.tolist(), "prior": prior, "posterior": posterior}
        return shares

    def statements(self) -> Iterator[str]:
        """What the observations say of the parameters, and where the posterior leans on the prior."""
        names, traded = self.prior.names, set()
        for i, j in combinations(range(len(names)), 2):
            if abs(self.correlation[i, j]) >= TRADES:
                traded |= {i, j}
                how = "rises with" if self.correlation[i, j] > 0 else "falls with"
                yield (
                    f"{names[i]} and {names[j]} trade: a line, not a point; {names[i]} {how} {names[j]} "
                    f"(correlation {self.correlation[i, j]:.2f}), use their rows together"
                )
        for k, name in enumerate(names):
            if self.narrowing[k] > IDENTIFIED:
                alone = " alone" if k in traded else ""
                yield f"{name} is not identifiable{alone}: its spread is {self.narrowing[k]:.0%} of the prior's"
        for k, name in enumerate(names):
            yield from self._leaning(k, name)

    def _leaning(self, k: int, name: str) -> Iterator[str]:
        low, high = self.prior.distributions[name].support()
        sides = (("lower", low, self.points[:, k] < EDGE), ("upper", high, self.points[:, k] > 1.0 - EDGE))
        for side, bound, outer in sides:
            if outer.mean() > LEANS and self.prior.distributions[name].distribution != "discrete":
                yield (
                    f"the posterior of {name} leans on the range: {outer.mean():.0%} of it lies in the outer {EDGE:.0%} of the "
                    f"prior at its {side} end ({bound:g}); widen the range in ensemble.parameters if such values are possible"
                )


def sampled_posterior(likelihood: Density, seed: int = 0, most_steps: int = MOST_STEPS) -> Posterior:
    """Sample of the posterior by the affine-invariant walkers of emcee (Foreman-Mackey et al. 2013, PASP 125:306).

    Walkers start at Sobol points of the cube that are drawn by a tempered likelihood, so that separate modes get their share.
    """
    with of_extra("emcee"):
        import emcee
    state = np.random.RandomState(seed)
    sampler = emcee.EnsembleSampler(WALKERS, len(likelihood.prior.names), likelihood.log_density, vectorize=True)
    converged, time = False, np.inf
    with one_thread():
        start: Any = emcee.State(_starts(likelihood, WALKERS, state), random_state=state.get_state())
        while not converged and sampler.iteration < most_steps:
            start = sampler.run_mcmc(start, STEPS)
            time = float(np.nan_to_num(sampler.get_autocorr_time(tol=0), nan=np.inf).max())
            converged = sampler.iteration >= LENGTHS * time
    discarded = sampler.iteration // 4
    chain = sampler.get_chain(discard=discarded, flat=True)
    sample = chain[np.linspace(0, len(chain) - 1, min(KEPT, len(chain))).round().astype(int)]
    return Posterior(likelihood.prior, sample, min(len(sample), len(chain) / max(time, 1.0)), bool(converged))


def _starts(likelihood: Density, count: int, state: np.random.RandomState) -> np.ndarray:
    """Different points (count, parameters) of the cube with a density near the largest."""
    points = sobol_points(STARTS, len(likelihood.prior.names), 0)
    density = likelihood.log_density(points)
    weights, power = np.ones(STARTS), 1.0
    while power > 1e-6:
        weights = np.exp(power * (density - density.max()))
        if weights.sum() ** 2 / np.square(weights).sum() >= 2 * count:
            break
        power *= 0.7
    return points[state.choice(STARTS, count, replace=False, p=weights / weights.sum())]  # type: ignore[no-any-return]


def left_out(likelihood: Likelihood, groups: Sequence[str], seed: int = 0) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Predicted mean and standard deviation, with the standard error, of the scalars of each group from all other groups.

    ``groups``: group of each scalar.
    """
    predicted = {}
    for group in dict.fromkeys(groups):
        inside = [k for k, one in enumerate(groups) if one == group]
        others = [k for k, one in enumerate(groups) if one != group]
        points = sampled_posterior(likelihood.only(others), seed, STEPS).points[::8]
        predicted[group] = likelihood.only(inside).prediction(points)
    return predicted


def grid_error(likelihood: Likelihood, points: np.ndarray, coarse: np.ndarray, fine: np.ndarray) -> GridError:
    """Error of the grid from scalars (pairs, scalars) of coarse and fine runs at the same points (pairs, parameters) of the cube.

    The likelihood has no error of the grid yet. The offset is that which explains the differences best, by least squares in
    standard errors with the size of the offset as a further term: a parameter that changes nothing keeps its place.
    """
    from scipy.optimize import least_squares

    noise = np.array([one.noise for one in likelihood.emulators])
    scale, here = np.hypot(likelihood.errors, noise), _means(likelihood, points)

    def remainder(offset: np.ndarray) -> np.ndarray:
        return (fine - coarse) - (_means(likelihood, points + offset) - here)  # type: ignore[no-any-return]

    def misfits(offset: np.ndarray) -> np.ndarray:
        return np.concatenate([(remainder(offset) / scale).ravel(), offset / USUAL_OFFSET])

    start, bounds = np.zeros(points.shape[1]), (-LARGEST_OFFSET, LARGEST_OFFSET)
    with one_thread():
        offset = least_squares(misfits, start, bounds=bounds, diff_step=1e-3).x
        rest = remainder(offset)
    return GridError(offset, rest.T @ rest / max(len(points) - 1, 1), len(points))


def _means(likelihood: Likelihood, points: np.ndarray) -> np.ndarray:
    return np.stack([one.mean(points) for one in likelihood.emulators], axis=1)


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
