"""Sobol indices of a scalar of the members: shares of its variance by parameter, from an emulator, with intervals."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.calibration.emulator import Emulator, of_extra, varies
from runout.calibration.prior import Prior

FEWEST, LEAST_Q2 = 32, 0.9  # members, and held-out share of the variance, below which indices are refused
DRAWS = 100  # functions of the emulator
MOST_POINTS = 3072  # of a drawn function: its covariance takes 8 bytes times their square
BASE = 4096  # Saltelli base of the mean of the emulator
INTERVAL = (5.0, 95.0)  # percentiles


@dataclass(frozen=True)
class SobolIndices:
    """Shares of the variance of a scalar."""

    names: tuple[str, ...]  # parameters
    # first, total (parameters,): share of the variance by a parameter alone, and with all its interactions [1]
    first: np.ndarray
    total: np.ndarray
    # first_interval, total_interval (2, parameters): 5 and 95 %: uncertainty of the emulator and of the sum over its points
    first_interval: np.ndarray
    total_interval: np.ndarray
    unexplained: float  # share of the variance of the members that no parameter explains [1]

    def stored(self) -> dict[str, Any]:
        """Values for JSON, by parameter."""
        return {
            "unexplained": self.unexplained,
            "parameters": {
                name: {
                    "first": float(self.first[k]),
                    "first_5_95": self.first_interval[:, k].tolist(),
                    "total": float(self.total[k]),
                    "total_5_95": self.total_interval[:, k].tolist(),
                }
                for k, name in enumerate(self.names)
            },
        }


def why_refused(members: int, values: np.ndarray, emulator: Emulator | None) -> str:
    """Why indices of values (members,) would say nothing, with the remedy; empty if they can be trusted."""
    if members < FEWEST:
        return f"{members} members have run; {FEWEST} are needed: set ensemble.members to {FEWEST} or more and run the ensemble"
    if not varies(values):
        return f"it is {values[0]:.4g} in all members; no parameter changes it"
    if emulator is not None and emulator.q2 < LEAST_Q2:
        return (
            f"its emulator predicts {max(emulator.q2, 0.0):.2f} of the variance of members that it has not seen, {LEAST_Q2:g} is "
            f"needed; double ensemble.members from {members}, or narrow the ranges of the parameters"
        )
    return ""


def sobol_indices(emulator: Emulator, prior: Prior) -> SobolIndices:
    """First-order and total Sobol indices under the prior.

    Saltelli's sample (Saltelli et al. 2010, Comput. Phys. Commun. 181:259, table 2) is evaluated by the mean of the emulator. The
    interval is that of indices of functions drawn from the emulator, each with rows of the sample drawn anew (Le Gratiet, Cannamela
    & Iooss 2014, SIAM/ASA J. Uncertainty Quantification 2:336, algorithm 1).
    """
    first, total = _analysed(emulator.mean(prior.snapped(saltelli_sample(prior, BASE))), prior)
    width = len(prior.names) + 2
    base = 2 ** int(np.log2(MOST_POINTS // width))
    blocks = emulator.draws(prior.snapped(saltelli_sample(prior, base)), DRAWS, seed=0).reshape(DRAWS, base, width)
    generator = np.random.default_rng(1)
    drawn = [_analysed(one[generator.integers(0, base, base)].ravel(), prior) for one in blocks]
    intervals = [np.percentile([pair[k] for pair in drawn], INTERVAL, axis=0) for k in (0, 1)]
    for estimate, interval in zip((first, total), intervals, strict=True):
        interval[0], interval[1] = np.minimum(interval[0], estimate), np.maximum(interval[1], estimate)
        interval.clip(0.0, 1.0, out=interval)
    unexplained = min(1.0, emulator.noise**2 / emulator.scale**2)
    return SobolIndices(prior.names, first, total, intervals[0], intervals[1], unexplained)


def saltelli_problem(prior: Prior) -> dict[str, Any]:
    """The cube of a prior as SALib describes it."""
    return {"num_vars": len(prior.names), "names": list(prior.names), "bounds": [[0.0, 1.0]] * len(prior.names)}


def saltelli_sample(prior: Prior, base: int) -> np.ndarray:
    """Saltelli's sample (base (parameters + 2), parameters) of the cube."""
    with of_extra("SALib"):
        from SALib.sample import sobol
    return np.asarray(sobol.sample(saltelli_problem(prior), base, calc_second_order=False, seed=0))


def _analysed(values: np.ndarray, prior: Prior) -> tuple[np.ndarray, np.ndarray]:
    """First-order and total indices (parameters,) of values at Saltelli's sample."""
    with of_extra("SALib"):
        from SALib.analyze import sobol
    indices = sobol.analyze(saltelli_problem(prior), values, calc_second_order=False, num_resamples=2, seed=0)
    return np.clip(indices["S1"], 0.0, 1.0), np.clip(indices["ST"], 0.0, 1.0)
