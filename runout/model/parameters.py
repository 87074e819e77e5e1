"""Declared parameters: each is declared once, in the class of its law, and everything else derives from the declaration.

A law is a frozen dataclass whose fields are made by :func:`parameter`, :func:`choice` and :func:`switch`. site.yaml, ensembles,
checks, documentation and tests read the declarations with :func:`parameters_of`.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass
from enum import StrEnum
from typing import Any, Literal

from runout.errors import MaterialError
from runout.model.limits import Range, checked_within

AUTO: Literal["auto"] = "auto"  # in the place of a number that the run chooses


@dataclass(frozen=True)
class Parameter:
    """Declaration of one parameter."""

    name: str  # in Python
    description: str  # one line, for the comment in site.yaml and for tables
    valid: Range | None  # range and unit of a number; None for a choice or a switch
    choices: type[StrEnum] | None  # values of a choice; None for a number or a switch
    # default value; `dataclasses.MISSING` for a required parameter, :data:`AUTO` for a number that the run chooses
    default: Any
    typical: Any  # value for examples and tests; the default if there is one
    sampled: bool  # whether an ensemble may sample it

    @property
    def key(self) -> str:
        """Name in site.yaml and in tables of members; keys of angles end in ``_deg``."""
        return f"{self.name}_deg" if self.is_angle else self.name

    @property
    def is_angle(self) -> bool:
        """Whether the parameter is an angle in degrees."""
        return self.valid is not None and self.valid.degrees

    @property
    def is_automatic(self) -> bool:
        """Whether :data:`AUTO` may stand in the place of the number."""
        return isinstance(self.default, str) and self.default == AUTO and self.valid is not None

    def si(self, value: Any) -> float:
        """The value as a number in SI units and radians; choices have no such value."""
        return math.radians(value) if self.is_angle else float(value)

    def checked(self, value: Any, error: Callable[[str], Exception] = MaterialError) -> Any:
        """The value converted to its type. Raises the given error if it is not valid; states name, value, and range or choices."""
        if self.is_automatic and isinstance(value, str) and value == AUTO:
            return AUTO
        if self.valid:
            checked_within(self.valid, self.name, value, error=error)
            return value
        if self.choices:
            try:
                return self.choices(value)
            except ValueError:
                raise error(f"{self.name} is {value!r}; choose one of {', '.join(self.choices)}") from None
        if not isinstance(value, bool):
            raise error(f"{self.name} is {value!r}; it must be True or False")
        return value


def parameter(
    description: str,
    *,
    low: float,
    high: float,
    unit: str = "",
    default: Any = MISSING,
    typical: float | None = None,
    open_low: bool = False,
    degrees: bool = False,
    sampled: bool = False,
    hint: str = "",
) -> Any:
    """Field of a dataclass for a number.

    Parameters
    ----------
    description : str
        One line, without unit and range.
    low, high : float
        Valid range, both ends included unless ``open_low``.
    unit : str
        SI, or ``deg``; empty for a pure number.
    default : float or "auto", optional
        Default value; a parameter without one is required. With :data:`AUTO` the run chooses the number.
    typical : float, optional
        Value for examples and tests; required if the default is no number.
    open_low : bool
        ``low`` itself is not valid.
    degrees : bool
        The number is an angle in degrees; its key in site.yaml ends in ``_deg``, and values that look like radians are refused.
    sampled : bool
        Ensembles may sample it.
    hint : str
        Remedy for values outside the range.
    """
    valid = Range(low, high, unit, hint, open_low, degrees)
    return _field(Parameter("", description, valid, None, default, default if typical is None else typical, sampled))


def choice(description: str, words: type[StrEnum], default: StrEnum) -> Any:
    """Field of a dataclass for one value of an enumeration."""
    return _field(Parameter("", description, None, words, default, default, sampled=False))


def switch(description: str, default: bool) -> Any:
    """Field of a dataclass for a truth value."""
    return _field(Parameter("", description, None, None, default, default, sampled=False))


def parameters_of(law: type) -> tuple[Parameter, ...]:
    """Declared parameters of a class in the order of declaration, those of its bases first."""
    return tuple(
        dataclasses.replace(field.metadata["parameter"], name=field.name)
        for field in dataclasses.fields(law)
        if "parameter" in field.metadata
    )


def numpydoc(law: type) -> str:
    """Docstring of a class with a section on its declared parameters."""
    text = (law.__doc__ or "").rstrip()
    lines = [line for p in parameters_of(law) for line in _documented(p)]
    return "\n".join([text, "", "    Parameters", "    ----------", *lines, "    "])


def _documented(p: Parameter) -> Iterator[str]:
    number = "float or 'auto'" if p.is_automatic else "float"
    kind = number if p.valid else p.choices.__name__ if p.choices else "bool"
    plain = p.valid is None or p.is_automatic
    known = "" if p.default is MISSING else f", default {p.default}" if plain else f", default {p.default:g}"
    unit = f" [{p.valid.unit or '1'}], {p.valid.words()}" if p.valid else ""
    yield f"    {p.name} : {kind}{known}"
    yield f"        {p.description[0].upper()}{p.description[1:]}{unit}."


def _field(declared: Parameter) -> Any:
    return dataclasses.field(default=declared.default, metadata={"parameter": declared})
