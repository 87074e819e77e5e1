"""Annual rates of the members of an ensemble, and what follows from them in each cell.

The members of a scenario share its rate. A value is exceeded at the summed rate of the members that reach it. The value at a return
period T is the largest one that is reached at a rate of 1/T or more. Rates are expected numbers of events in a year [1/a]; the
probability of at least one event in a year is 1 - exp(-rate), which is nearly the rate where that is small.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from runout.errors import PartialEnsembleError

if TYPE_CHECKING:
    import pandas as pd

ROUNDING = 1e-9  # of summed rates, relative: three rates of 1/300 reach 1/100
_VALUES = 2**20  # that are sorted at a time


@dataclass(frozen=True)
class Frequencies:
    """Annual rates of the valid members."""

    rate: np.ndarray  # rates (members,) of the valid members, in their order [1/a]
    scenario: tuple[str, ...]  # name of the scenario of each
    scenario_rates: Mapping[str, float]  # rate of each scenario [1/a], the sum over its members

    @classmethod
    def of(cls, table: "pd.DataFrame", valid: Collection[int]) -> "Frequencies | None":
        """Frequencies of the ``valid`` members of a table, in its order; None if the table has no annual rates.

        The valid members of a scenario take over the rates of its others, so that the rate of the scenario stays.
        """
        if "annual_rate" not in table:
            return None
        rate = shares(table, "annual_rate", valid)
        names = [str(name) for name in scenarios_of(table)[table.index.isin(list(valid))]]
        totals = {name: float(rate[[other == name for other in names]].sum()) for name in dict.fromkeys(names)}
        return cls(rate, tuple(names), totals)

    def statement(self) -> str:
        """Scenarios with their annual rates, as text."""
        return "; ".join(f"{name or 'all members'}: {rate:.6g} events a year" for name, rate in self.scenario_rates.items())

    @property
    def total(self) -> float:
        """Rate at which any scenario happens [1/a]."""
        return float(self.rate.sum())


def scenarios_of(table: "pd.DataFrame") -> np.ndarray:
    """Name of the scenario (members,) of each member of a table; one empty name for all without scenarios."""
    return table["scenario"].to_numpy(object) if "scenario" in table else np.full(len(table), "", object)


def shares(table: "pd.DataFrame", column: str, valid: Collection[int]) -> np.ndarray:
    """Values (members,) of a column of weights or rates of the ``valid`` members, which keep the sum of each scenario.

    Raises PartialEnsembleError if no member of a scenario is valid, so that its events would be missing in all maps.
    """
    values, names, counts = table[column].to_numpy(np.float64), scenarios_of(table), table.index.isin(list(valid))
    scaled = values.copy()
    for name in dict.fromkeys(names):
        of_scenario = names == name
        lasting = values[of_scenario & counts].sum()
        if lasting == 0.0:
            raise PartialEnsembleError(
                f"scenario {name}: no member is valid, so that the maps would be without its events; mend the cause"
            )
        if not counts[of_scenario].all():
            scaled[of_scenario] *= values[of_scenario].sum() / lasting
    return scaled[counts]


def annual_exceedance(values: np.ndarray, threshold: float, rate: np.ndarray) -> np.ndarray:
    """Annual rate (y, x) [1/a] at which ``values`` reach a threshold.

    Parameters
    ----------
    values : ndarray
        Values (members, y, x); a cell in which one is NaN has no rate.
    threshold : float
        Above 0, in the unit of the values; it is compared in their precision.
    rate : ndarray
        Rates (members,) [1/a].
    """
    limit, total = np.asarray(threshold, values.dtype), np.zeros(values.shape[1:])
    for one, of_member in zip(values, rate, strict=True):
        total += np.where(np.isnan(one), np.nan, (one >= limit) * of_member)
    return total


def at_return_period(values: np.ndarray, rate: np.ndarray, years: float) -> np.ndarray:
    """Largest value (y, x) that is reached at an annual rate of 1/``years`` or more.

    NaN where the flow arrives at a lower rate, and where a value of a member is NaN.

    Parameters
    ----------
    values : ndarray
        Values (members, y, x); 0 where it does not arrive.
    rate : ndarray
        Rates (members,) [1/a].
    years : float
        Return period [a].
    """
    cells = values.reshape(len(values), -1)
    at_period = np.full(cells.shape[1], np.nan, values.dtype)
    for part in _parts(*cells.shape):
        falling = np.argsort(-cells[:, part], axis=0, kind="stable")  # NaN last
        ordered = np.take_along_axis(cells[:, part], falling, axis=0)
        frequent = np.cumsum(rate[falling], axis=0) >= (1.0 - ROUNDING) / years
        value = np.take_along_axis(ordered, frequent.argmax(axis=0)[None], axis=0)[0]
        known = frequent.any(axis=0) & (value > 0) & ~np.isnan(cells[:, part]).any(axis=0)
        at_period[part] = np.where(known, value, np.nan)
    return at_period.reshape(values.shape[1:])


def _parts(members: int, cells: int) -> Iterator[slice]:
    """Parts of the cells that bound the memory of a sort."""
    size = max(1, _VALUES // max(1, members))
    return (slice(first, first + size) for first in range(0, cells, size))
