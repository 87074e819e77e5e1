"""Sampling error of probabilities and means: from the members of one Sobol net, or from weights alone."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.ensemble.design import NetPoints
from runout.hazard.frequency import scenarios_of, shares
from runout.hazard.net_error import FITTED, error_of_net
from runout.hazard.order import effective_sample_size, equal
from runout.model.limits import SMALLEST_NET

if TYPE_CHECKING:
    import pandas as pd

BLOCKS = 4
ROUNDING = 1e-9  # of sums of products
NO_NETS: Mapping[str, NetPoints] = MappingProxyType({})
SAFETY = 1.12  # stated over true is 0.8 to 1.5 with it for flows of 1 to 6 parameters and 16 to 128 members (docs/guide/maps.md)


@dataclass(frozen=True)
class Scatter:
    """Sums over cells of a map for each net: squares of the spread over blocks, and products of the first members."""

    spreads: tuple[float, ...] = ()
    products: tuple[np.ndarray, ...] = ()  # (members, members), see :func:`runout.hazard.net_error.error_of_net`

    def __add__(self, other: "Scatter") -> "Scatter":
        spreads = tuple(a + b for a, b in zip(self.spreads, other.spreads, strict=True))
        return Scatter(spreads, tuple(a + b for a, b in zip(self.products, other.products, strict=True)))

    def factor(self, nets: Sequence[NetPoints]) -> float:
        """Factor of the spread over blocks that makes it the error of the whole nets, for a whole map; 1 without spread.

        The spread counts as it is for a net whose first members are all alike: they tell nothing of how the values vary.
        """
        spread = math.fsum(self.spreads)
        if spread <= 0.0:
            return 1.0
        each = zip(self.spreads, self.products, nets, strict=True)
        squares = (SAFETY**2 * error_of_net(sums, points) if _vary(sums) else square for square, sums, points in each)
        return math.sqrt(math.fsum(squares) / spread)


@dataclass(frozen=True)
class Estimator:
    """Estimator of the standard error of a probability P.

    Consecutive blocks of a Sobol net are nets themselves, so the spread of their probabilities P_b contains what the even cover
    of the parameters gains: s^2 = sum((P_b - P)^2) / (B (B - 1)) over B blocks. The whole net is more even than its blocks
    together, so that s alone is up to 5 times the true error: :meth:`factor` of a whole map mends it.
    s^2 = P (1 - P) sum(w^2) holds for independent members.

    References
    ----------
    Owen A.B. (1997), Ann. Stat. 25, 1541 (scrambled nets); L'Ecuyer P., Lemieux C. (2002), in Modeling Uncertainty, Kluwer, 419
    (errors from the spread of randomised nets; here the nets are blocks of one).
    """

    blocks: int = 0  # number of blocks; 0: the error of independent members
    reason: str = "the members are not known to be a Sobol net"  # why there are no blocks
    points: NetPoints | None = None  # points of the net; without them the spread over blocks alone is the error

    @classmethod
    def of(cls, table: "pd.DataFrame", valid: Collection[Any], nets: Mapping[str, NetPoints] = NO_NETS) -> "Estimator | Strata":
        """The estimator for valid members of a table, in its order; :func:`runout.ensemble.design.member_table` marks its nets.

        ``nets`` are those of :func:`runout.ensemble.design.nets_of`.
        """
        if "scenario" in table:
            return Strata.of(table, valid, nets)
        reason = no_net(table, valid)
        return cls(0, reason) if reason else cls(BLOCKS, "", nets.get(""))

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

    def scatter(self, values: np.ndarray, members: np.ndarray, ensemble_size: int) -> Scatter:
        """Sums over the known cells, which add up over parts of a map; parameters as of :meth:`spread`."""
        if self.points is None:
            return Scatter()
        known = values[np.isfinite(values).all(axis=1)].astype(np.float64)
        spread = float(np.square(self.of_mean(known, members, ensemble_size)).sum())  # type: ignore[arg-type]
        first = members < FITTED
        deviation = np.zeros((len(known), min(ensemble_size, FITTED)))
        deviation[:, members[first]] = known[:, first]
        deviation -= known.sum(axis=1, keepdims=True) / ensemble_size
        return Scatter((spread,), (deviation.T @ deviation,))

    def factor(self, scatter: Scatter) -> float:
        """Factor of the spread for a whole map, see :meth:`Scatter.factor`."""
        return 1.0 if self.points is None else scatter.factor([self.points])

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
    """

    names: tuple[str, ...]  # scenarios
    places: tuple[np.ndarray, ...]  # places of the members of each among the valid ones
    weights: np.ndarray  # (members,): weights of the valid members, of sum 1
    blocks: tuple[int, ...]  # blocks of the net of each scenario; 0: its members count as independent
    points: tuple[NetPoints, ...] = ()  # points of the net of each scenario; none without them
    reason: str = ""  # empty: the statement names the scenarios without blocks

    @classmethod
    def of(cls, table: "pd.DataFrame", valid: Collection[int], nets: Mapping[str, NetPoints] = NO_NETS) -> "Strata":
        """The estimator for valid members of a table with scenarios."""
        names, weights = scenarios_of(table), shares(table, "weight", valid)
        scenarios = tuple(dict.fromkeys(names))
        lasting = names[table.index.isin(list(valid))]
        places = tuple(np.flatnonzero(lasting == name) for name in scenarios)
        whole = [
            _has_net(table.attrs, weights[place], int((names == name).sum())) for name, place in zip(scenarios, places, strict=True)
        ]
        points = tuple(nets[name] for name in scenarios) if all(whole) and set(scenarios) <= nets.keys() else ()
        blocks = tuple(BLOCKS if net else 0 for net in whole)
        return cls(tuple(map(str, scenarios)), places, weights / weights.sum(), blocks, points)

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

    def scatter(self, values: np.ndarray, members: np.ndarray, _: int) -> Scatter:
        """Sums over the known cells with the squares of the shares of the rate; parameters as of :meth:`Estimator.scatter`."""
        spreads, products = [], []
        for place, points in zip(self.places if self.points else (), self.points, strict=True):
            columns = np.flatnonzero(np.isin(members, place))
            within, square = np.searchsorted(place, members[columns]), float(self.weights[place].sum()) ** 2
            own = Estimator(BLOCKS, "", points).scatter(values[:, columns], within, len(place))
            spreads.append(square * own.spreads[0])
            products.append(square * own.products[0])
        return Scatter(tuple(spreads), tuple(products))

    def factor(self, scatter: Scatter) -> float:
        """As :meth:`Estimator.factor`; 1 if a scenario has no net: its error needs no factor."""
        return scatter.factor(self.points)

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


def _vary(products: np.ndarray) -> bool:
    """Whether members (members, members) of which there are sums of products differ in any cell."""
    total = float(np.trace(products))
    return total - float(products.sum()) / len(products) > ROUNDING * total


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
