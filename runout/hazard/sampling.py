"""Sampling error of probabilities: from the spread over parts of one Sobol net, or from weights alone."""

import math
from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from runout.hazard.order import effective_sample_size, equal
from runout.model.limits import SMALLEST_NET

if TYPE_CHECKING:
    import pandas as pd

BLOCKS = 4


@dataclass(frozen=True)
class Estimator:
    """Estimator of the standard error of a probability P.

    Consecutive blocks of a Sobol net are nets themselves, so the spread of their probabilities P_b contains what the even cover
    of the parameters gains: s^2 = sum((P_b - P)^2) / (B (B - 1)) over B blocks. Since the whole net is more even than its blocks
    together, s is 1.0 to 1.5 times the true error with 3 or 4 parameters and noise, and up to 2.3 times with one
    (``docs/guide/maps.md``). s^2 = P (1 - P) sum(w^2) holds for independent members.

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
    def of(cls, table: "pd.DataFrame", valid: Collection[object]) -> "Estimator":
        """The estimator for valid members of a table, in its order; :func:`runout.ensemble.design.member_table` marks its nets."""
        reason = no_net(table, valid)
        return cls(0, reason) if reason else cls(BLOCKS, "")

    def statement(self, members: int) -> str:
        """Formula and reason, for the attributes of a map."""
        if self.blocks:
            part = f"{self.blocks} consecutive blocks of {members // self.blocks} members of one Sobol net"
            return f"spread of the probabilities P_b over {part}: sqrt(sum((P_b - P)^2) / {self.blocks * (self.blocks - 1)})"
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
        size = ensemble_size // self.blocks
        ends = np.searchsorted(members, size * np.arange(self.blocks + 1))
        errors = np.zeros((len(limits), len(values)))
        for k, limit in enumerate(limits):
            if limit > 0:  # else all members reach it
                of_block = [(values[:, a:b] >= limit).sum(axis=1) / size for a, b in pairwise(ends)]
                errors[k] = np.std(of_block, axis=0, ddof=1) / np.sqrt(self.blocks)
        return errors


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
