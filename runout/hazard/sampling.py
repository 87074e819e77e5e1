"""Sampling error of probabilities: from the spread over parts of one Sobol net, or from weights alone."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.hazard.frequency import scenarios_of, shares
from runout.hazard.order import effective_sample_size, equal
from runout.model.limits import SMALLEST_NET

if TYPE_CHECKING:
    import pandas as pd

BLOCKS = 4
INDEPENDENT, EVENEST = 2.0, 4.0  # variance of the error of half of the members over that of all: least and largest that counts
SAFETY = 1.1  # stated over true is 0.8 to 1.4 with it for 7 flows of 1 to 4 parameters and 16 to 128 members (docs/guide/maps.md)


@dataclass(frozen=True)
class Estimator:
    """Estimator of the standard error of a probability P.

    Consecutive blocks of a Sobol net are nets themselves, so the spread of their probabilities P_b contains what the even cover
    of the parameters gains: s^2 = sum((P_b - P)^2) / (B (B - 1)) over B blocks. The whole net is more even than its blocks
    together, so that s alone is up to 2.3 times the true error: :func:`evenness` is the factor of a whole map that mends it.
    s^2 = P (1 - P) sum(w^2) holds for independent members.

    References
    ----------
    Owen A.B. (1997), Ann. Stat. 25, 1541 (scrambled nets); L'Ecuyer P., Lemieux C. (2002), in Modeling Uncertainty, Kluwer, 419
    (errors from the spread of randomised nets; here the nets are blocks of one).

    Attributes
    ----------
    blocks : int
        Number of blocks; 0: the error of independent members.
    reason : str
        Why there are no blocks.
    """

    blocks: int = 0
    reason: str = "the members are not known to be a Sobol net"

    @classmethod
    def of(cls, table: "pd.DataFrame", valid: Collection[Any]) -> "Estimator | Strata":
        """The estimator for valid members of a table, in its order; :func:`runout.ensemble.design.member_table` marks its nets."""
        if "scenario" in table:
            return Strata.of(table, valid)
        reason = no_net(table, valid)
        return cls(0, reason) if reason else cls(BLOCKS, "")

    def statement(self, members: int) -> str:
        """Formula and reason, for the attributes of a map."""
        if self.blocks:
            part = f"{self.blocks} consecutive blocks of {members // self.blocks} members of one Sobol net"
            of_blocks = f"sqrt(sum((P_b - P)^2) / {self.blocks * (self.blocks - 1)})"
            return f"spread of the probabilities P_b over {part}: {of_blocks}, times the evenness of the net in the map"
        return f"sqrt(P (1 - P) / effective_sample_size), as for independent members: {self.reason}"

    def spread(self, values: np.ndarray, members: np.ndarray, ensemble_size: int, limits: np.ndarray) -> np.ndarray | None:
        """Standard errors (limits, cells) from blocks; None if there are no blocks.

        Parameters
        ----------
        values : ndarray (cells, members with values)
            In ascending order of the members; the others have 0.
        members : ndarray (members with values,)
            Their numbers.
        ensemble_size : int
            Number of all members, a multiple of the number of blocks.
        limits : ndarray (limits,)
            Thresholds.
        """
        if not self.blocks:
            return None
        errors = np.zeros((len(limits), len(values)))
        for k, limit in enumerate(limits):
            if limit > 0:  # else all members reach it
                errors[k] = self.of_mean(values >= limit, members, ensemble_size)
        return errors

    def of_mean(self, values: np.ndarray, members: np.ndarray, ensemble_size: int) -> np.ndarray | None:
        """Standard error (cells,) of the mean over the members from blocks; parameters and None as of :meth:`spread`."""
        if not self.blocks:
            return None
        error: np.ndarray = np.std(self._of_blocks(values, members, ensemble_size), axis=0, ddof=1) / np.sqrt(self.blocks)
        return error

    def deviations(self, values: np.ndarray, members: np.ndarray, ensemble_size: int) -> np.ndarray:
        """Mean squares (2,) of the deviations of halves and of quarters from the mean of all members, summed over the known cells.

        Parameters as of :meth:`spread`; 0 without blocks. They add up over parts of a map.
        """
        if not self.blocks:
            return np.zeros(2)
        of_blocks = np.asarray(self._of_blocks(values, members, ensemble_size))
        halves, mean = of_blocks.reshape(2, -1, of_blocks.shape[1]).mean(axis=1), of_blocks.mean(axis=0)
        return np.array([np.nansum(np.square(parts - mean).mean(axis=0)) for parts in (halves, of_blocks)])

    def _of_blocks(self, values: np.ndarray, members: np.ndarray, ensemble_size: int) -> list[np.ndarray]:
        """Mean (cells,) of the members of each block."""
        size = ensemble_size // self.blocks
        ends = np.searchsorted(members, size * np.arange(self.blocks + 1))
        return [values[:, a:b].sum(axis=1, dtype=np.float64) / size for a, b in pairwise(ends)]


@dataclass(frozen=True)
class Strata:
    """Estimator of the standard error of a probability over scenarios, whose members are drawn for themselves.

    P is the sum of the shares f_s of the rate times the probabilities P_s of the scenarios; their errors are independent:
    s^2 = sum(f_s^2 s_s^2). The error s_s of a scenario is that of blocks of its net (:class:`Estimator`) or of
    independent members.

    References
    ----------
    Cochran W.G. (1977), Sampling Techniques, 3rd ed., eq. 5.7 (variance of a stratified estimate).

    Attributes
    ----------
    names : tuple of str
        Scenarios.
    places : tuple of ndarray
        Places of the members of each among the valid ones.
    weights : ndarray (members,)
        Weights of the valid members, of sum 1.
    blocks : tuple of int
        Blocks of the net of each scenario; 0: its members count as independent.
    reason : str
        Empty: the statement names the scenarios without blocks.
    """

    names: tuple[str, ...]
    places: tuple[np.ndarray, ...]
    weights: np.ndarray
    blocks: tuple[int, ...]
    reason: str = ""

    @classmethod
    def of(cls, table: "pd.DataFrame", valid: Collection[int]) -> "Strata":
        """The estimator for valid members of a table with scenarios."""
        names, weights = scenarios_of(table), shares(table, "weight", valid)
        scenarios = tuple(dict.fromkeys(names))
        lasting = names[table.index.isin(list(valid))]
        places = tuple(np.flatnonzero(lasting == name) for name in scenarios)
        nets = [
            _has_net(table.attrs, weights[place], int((names == name).sum())) for name, place in zip(scenarios, places, strict=True)
        ]
        return cls(tuple(map(str, scenarios)), places, weights / weights.sum(), tuple(BLOCKS if net else 0 for net in nets))

    def statement(self, members: int) -> str:
        """Formula, for the attributes of a map of so many members."""
        nets = [name for name, blocks in zip(self.names, self.blocks, strict=True) if blocks]
        others = [name for name in self.names if name not in nets]
        parts = [f"that of the spread over {BLOCKS} blocks of the net of each of {', '.join(nets)}"] if nets else []
        parts += [f"that of independent members of each of {', '.join(others)}"] if others else []
        factor = "" if others else ", times the evenness of the nets in the map"
        return f"sqrt(sum(f_s^2 s_s^2)) over {len(self.names)} scenarios of {members} members, s_s {' and '.join(parts)}{factor}"

    def spread(self, values: np.ndarray, members: np.ndarray, ensemble_size: int, limits: np.ndarray) -> np.ndarray:
        """Standard errors (limits, cells); parameters as those of :meth:`Estimator.spread`."""
        errors = [self.of_mean(values >= limit, members, ensemble_size) for limit in limits]
        return np.array(errors).reshape(len(limits), len(values))

    def deviations(self, values: np.ndarray, members: np.ndarray, _: int) -> np.ndarray:
        """Mean squares (2,) of the deviations in the nets of the scenarios, with the squares of their shares of the rate.

        Parameters as those of :meth:`Estimator.deviations`. 0 if a scenario has no net: its error needs no factor.
        """
        total = np.zeros(2)
        for place, blocks in zip(self.places, self.blocks if all(self.blocks) else (), strict=bool(all(self.blocks))):
            columns = np.flatnonzero(np.isin(members, place))
            within, share = np.searchsorted(place, members[columns]), self.weights[place].sum()
            total += share**2 * Estimator(blocks, "").deviations(values[:, columns], within, len(place))
        return total

    def of_mean(self, values: np.ndarray, members: np.ndarray, _: int) -> np.ndarray:
        """Standard error (cells,) of the mean over the members; parameters as those of :meth:`Estimator.spread`."""
        variance = np.zeros(len(values))
        for place, blocks in zip(self.places, self.blocks, strict=True):
            columns = np.flatnonzero(np.isin(members, place))
            own, weights, share = values[:, columns], self.weights[members[columns]], self.weights[place].sum()
            if blocks:
                within = np.searchsorted(place, members[columns])  # places within the scenario
                variance += share**2 * np.square(Estimator(blocks, "").of_mean(own, within, len(place)))  # type: ignore[arg-type]
            else:
                mean, square = own @ weights / share, np.square(own, dtype=np.float64) @ weights / share
                variance += np.maximum(square - mean**2, 0.0) * np.square(self.weights[place]).sum()
        return np.sqrt(variance)  # type: ignore[no-any-return]


def evenness(deviations: np.ndarray) -> float:
    """Factor of the spread over the quarters of a net that makes it the error of the whole net.

    Let the variance of the error of m of n members be e^2 x^k with n / m = 2^k; x is 2 for independent members, and 4 where the
    error falls like 1/n. The mean square of the deviations of parts from the whole is the difference of both variances:
    V_2 = e^2 (x - 1) for halves and V_4 = e^2 (x^2 - 1) for quarters. So x = V_4 / V_2 - 1, and e^2 = V_4 / (x^2 - 1) in the place
    of the V_4 / 3 of independent members. One cell has a single difference of halves, a map has many: V is summed over its cells.

    Parameters
    ----------
    deviations : ndarray (2,)
        V_2 and V_4, at any scale; 0 where there are none, which gives 1.
    """
    halves, quarters = (float(one) for one in deviations)
    if quarters <= 0.0:
        return 1.0
    x = min(max(quarters / halves - 1.0, INDEPENDENT), EVENEST) if halves > 0.0 else EVENEST
    return SAFETY * math.sqrt((INDEPENDENT**2 - 1.0) / (x**2 - 1.0))


def _has_net(attributes: Mapping[Any, Any], weights: np.ndarray, planned: int) -> bool:
    """Whether the valid members of a scenario are one whole net of equal weights."""
    whole = len(weights) == planned >= SMALLEST_NET and not planned & (planned - 1)
    return attributes.get("design") == "sobol" and whole and equal(weights)


def independent(probability: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Standard error sqrt(p (1 - p) / N_eff) of probabilities over independent members, for weights of sum 1."""
    error: np.ndarray = np.sqrt(probability * (1.0 - probability) / effective_sample_size(weights))
    return error


def no_net(table: "pd.DataFrame", valid: Collection[object]) -> str:
    """Why the valid members of a table are not one whole net of equal weights; empty if they are."""
    members = len(table)
    if table.attrs.get("design") != "sobol":
        return "the members are not known to be a Sobol net"
    if len(valid) != members:
        return f"{len(valid)} of {members} members are valid"
    if list(table.index) != list(range(members)):
        return "the members are not in the order of the net"
    if members < SMALLEST_NET:
        return f"{members} members are fewer than {SMALLEST_NET}"
    if members & (members - 1):
        return f"{members} members are not a power of two"
    return "" if equal(table["weight"].to_numpy(np.float64)) else "the members have different weights"


def rms(errors: np.ndarray, probability: np.ndarray) -> float:
    """Root mean square of standard errors (rows, columns) over the cells that any member reaches; 0 if there are none."""
    reached, squares = 0, 0.0
    for error, p in zip(errors, probability, strict=True):  # row by row: needs no second map
        wet = error[p > 0].astype(np.float64)
        reached, squares = reached + wet.size, squares + float(np.square(wet).sum())
    return math.sqrt(squares / reached) if reached else 0.0
