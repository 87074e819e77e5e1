"""What a score is: meaning, unit, range and best value, and the number itself. Each file of :mod:`runout.scores.measures` has some.

The report and the documentation print what is defined, and every comparison makes all scores that its evidence allows.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from runout.io.provenance import plain
from runout.model.registry import parts_of

WILKS = "Wilks 2011, sec. 8.2"
ROUNDING = 1e-6  # in the printed unit: of maps in single precision


@dataclass(frozen=True)
class Definition:
    """What a score is.

    Attributes
    ----------
    name : str
        Name in files.
    title : str
        Short name for tables.
    units : str
        UDUNITS unit, "1" for a pure number; "" where it is that of the map.
    low, high, best : float
        Range, and value of a perfect model.
    meaning : str
        One sentence; modelled over, or minus, observed.
    undefined : str
        Why a score has no value, where it has none.
    reference : str
        Paper.
    values : mapping of str to callable
        The number, from each kind of evidence that gives it: "area" (:class:`runout.scores.Contingency`), "field" and "volume"
        (:class:`runout.scores.FieldErrors`), "maps" (:class:`Pair`), "thalweg" (:class:`runout.scores.ThalwegErrors`), "arrival"
        and "points" (:class:`runout.scores.PointErrors`), "change" (:class:`runout.scores.ChangeErrors`), "reaches"
        (:class:`runout.scores.ReachErrors`). NaN where undefined.
    is_headline : bool
        Whether the table of the members of an ensemble has it.
    """

    name: str
    title: str
    units: str
    low: float
    high: float
    best: float
    meaning: str
    undefined: str
    reference: str = ""
    values: Mapping[str, Callable[[Any], float]] = field(default_factory=dict)
    is_headline: bool = False

    @property
    def range(self) -> str:
        """The range in words."""
        if math.isinf(self.low):
            return "any"
        return f"{self.low:g} or more" if math.isinf(self.high) else f"{self.low:g} to {self.high:g}"


@dataclass(frozen=True)
class Pair:
    """Two maps (rows, columns) of one quantity on the same cells, NaN where unknown, and the area of a cell [m2]."""

    modelled: np.ndarray
    observed: np.ndarray
    cell_area: Any


DEFINITIONS: dict[str, Definition] = {one.name: one for part in parts_of("runout.scores.measures") for one in part.SCORES}


def undefined_reasons(scores: Iterable[tuple[str, bool]]) -> str:
    """Titles of scores (name, whether it has a value) without one, grouped by the reason; empty if all have one."""
    titles: dict[str, list[str]] = {}
    for name, has_value in scores:
        if not has_value:
            titles.setdefault(DEFINITIONS[name].undefined, []).append(DEFINITIONS[name].title)
    return "; ".join(f"{', '.join(names)} ({reason})" for reason, names in titles.items())


def printed(value: float) -> float:
    """A value as it is printed: 0 where it is smaller than :data:`ROUNDING`."""
    return 0.0 if abs(value) < ROUNDING else value


@dataclass(frozen=True)
class Score:
    """One score.

    Attributes
    ----------
    of : str
        What is scored, such as "outline" or "thickness 0.5 m".
    name : str
        Key of :data:`DEFINITIONS`.
    value : float
        NaN where it is not defined.
    units : str
        Unit; that of the map where the definition states none.
    numerical_error : float or None
        Half width of the numerical error bar of the value, in its unit; None where it is not known.
    """

    of: str
    name: str
    value: float
    units: str = ""
    numerical_error: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "units", self.definition.units or self.units)

    @property
    def definition(self) -> Definition:
        """Meaning, range and best value."""
        return DEFINITIONS[self.name]

    def stored(self) -> dict[str, Any]:
        """The score as values for JSON; a value that is not defined is None, and ``undefined`` says why."""
        value = None if math.isnan(self.value) else plain(self.value)
        content: dict[str, Any] = {"of": self.of, "name": self.name, "value": value, "units": self.units}
        if value is None:
            content["undefined"] = self.definition.undefined
        return content if self.numerical_error is None else content | {"numerical_error": float(self.numerical_error)}
