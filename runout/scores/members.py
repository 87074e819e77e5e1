"""Scores of the members of an ensemble, one by one, and of their probabilities, against one other product.

A percentile of each cell is a map that no member has: where members reach different places it holds less than any of them. So an
ensemble is scored by its members and by the areas that a stated share of them reaches.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from runout.io.member_maps import member_table
from runout.scores.assessment import Assessment
from runout.scores.definitions import Score
from runout.scores.flow import Flow

FOLDER, TABLE = "members", "members.nc"  # of the results
BOOKKEEPING = (
    "weight",
    "annual_rate",
    "scenario",
    "seed",
    "file",
    "status",
    "failure_reason",
)  # columns of the table that are no parameters
RANKS = {"csi": -1.0, "rmse": 1.0, "arrival_rmse": 1.0}  # the first that members have ranks them; -1: the largest is the best


@dataclass(frozen=True)
class Member:
    """A valid member of an ensemble and its scores."""

    number: int
    weight: float  # share of the ensemble [1]
    parameters: Mapping[str, float]  # what was sampled, in the units of the table of members
    path: Path  # its maps
    scores: tuple[Score, ...] = ()  # empty until it is scored

    def stored(self) -> dict[str, Any]:
        """Values for JSON."""
        parameters = dict(self.parameters)
        return {"member": self.number, "parameters": parameters, "scores": [score.stored() for score in self.scores]}


@dataclass
class Probabilities:
    """Weighted areas of members, and the size of the area of each [m2], by quantity and threshold."""

    shares: dict[tuple[str, float], np.ndarray] = field(default_factory=dict)
    areas: dict[tuple[str, float], list[float]] = field(default_factory=dict)

    def add(self, flow: Flow, weight: float, keys: Sequence[tuple[str, float]]) -> None:
        """Add the areas in which a member reaches thresholds."""
        for key in keys:
            reached = flow.area(*key)
            self.shares[key] = self.shares.get(key, 0.0) + weight * reached
            self.areas.setdefault(key, []).append(float(np.nansum(reached)) * flow.grid.cell_area)

    def unlike_members(self, flow: Flow) -> Iterator[str]:
        """Sentences on areas of a probability that are smaller or larger than the area of every member."""
        for (quantity, threshold), areas in self.areas.items():
            own = float(np.nansum(flow.area(quantity, threshold))) * flow.grid.cell_area
            if own < min(areas):
                than = "smaller"
            elif own > max(areas):
                than = "larger"
            else:
                continue
            yield (
                f"{quantity} of {threshold:g}: the area with P >= {flow.probability:g}, {own:.4g} m2, is {than} than that of every "
                f"member ({min(areas):.4g} to {max(areas):.4g} m2), since members reach different places; use the scores of members"
            )


def valid_members(results: Path) -> list[Member]:
    """Valid members of a results folder; empty unless their table and all their files are there."""
    if not (results / TABLE).is_file():
        return []
    table = member_table(results / TABLE)
    valid = table[table["status"] == "valid"]
    paths = [results / FOLDER / str(name) for name in valid["file"]]
    if not all(path.is_file() for path in paths):
        return []
    total, names = float(valid["weight"].sum()), [name for name in valid.columns if name not in BOOKKEEPING]
    return [
        Member(int(number), float(row["weight"]) / total, {name: float(row[name]) for name in names}, path)
        for (number, row), path in zip(valid.iterrows(), paths, strict=True)
    ]


def ranked(members: Sequence[Member]) -> tuple[tuple[Member, ...], str]:
    """Members with scores from the best to the worst, and what ranks them, in words."""
    names = {score.name for member in members for score in member.scores}
    by = next((name for name in RANKS if name in names), None)
    if by is None:
        return tuple(members), "number"
    return tuple(sorted(members, key=lambda member: _loss(member, by))), f"mean {by.replace('_', ' ').upper()}"


def _loss(member: Member, by: str) -> float:
    """Mean of a score of a member with the sign for which less is better; one without a value counts as the worst."""
    values = [RANKS[by] * score.value for score in member.scores if score.name == by]
    worst = 0.0 if RANKS[by] < 0 else math.inf
    return sum(worst if math.isnan(value) else value for value in values) / max(len(values), 1)


def brier(probability: np.ndarray, share: np.ndarray) -> float:
    """Mean square difference of a probability and the reached share of cells, where either is above 0; NaN where none is.

    Brier score of the cells that count (Wilks 2011, section 8.4.2): dry cells that all members leave dry do not dilute it.
    """
    counts = (probability > 0) | (share > 0)
    known = counts & np.isfinite(probability) & np.isfinite(share)
    return float(np.mean((probability[known] - share[known]) ** 2)) if known.any() else math.nan


def add_brier(found: Assessment, of: str, probability: np.ndarray, share: np.ndarray) -> None:
    """Add the Brier score of a probability against the reached share of cells (rows, columns)."""
    found.add(of, iter([Score(of, "brier", brier(probability, share))]))


def scored_members(members: Sequence[Member], assess: Callable[[Member], Assessment]) -> Iterator[Member]:
    """Members with their scores."""
    from dataclasses import replace

    for member in members:
        yield replace(member, scores=tuple(assess(member).scores))
