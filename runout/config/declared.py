"""Makes the fields of a settings model from declared parameters (:mod:`runout.model.parameters`)."""

from collections.abc import Iterable
from dataclasses import MISSING
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, PlainSerializer, WithJsonSchema, WrapValidator

from runout.config.distributions import plausible_degrees, quantity
from runout.model.limits import Range
from runout.model.parameters import AUTO, Parameter

JSON_BOUNDS = {"ge": "minimum", "gt": "exclusiveMinimum", "le": "maximum", "lt": "exclusiveMaximum"}
_WORDS: Any = Literal


def declared_fields(parameters: Iterable[Parameter]) -> dict[str, Any]:
    """Type and field of each parameter, by its key."""
    return {p.key: (_type(p), _field(p)) for p in parameters}


def sampled_in(parameters: Iterable[Parameter]) -> dict[str, Range]:
    """Range of each parameter that an ensemble may sample, by its key."""
    return {p.key: p.valid for p in parameters if p.sampled and p.valid}


def _type(p: Parameter) -> Any:
    if p.choices:
        return _WORDS[tuple(word.value for word in p.choices)]  # plain text in the settings, as in the file
    if p.valid is None:
        return bool
    if p.is_automatic:
        bounds: Any = p.valid.bounds() if p.valid else {}
        limits = {JSON_BOUNDS[bound]: limit for bound, limit in bounds.items()}
        schema = WithJsonSchema({"anyOf": [{"type": "number", **limits}, {"const": AUTO}]})
        return Annotated[float, Field(**bounds), WrapValidator(_auto_or), PlainSerializer(lambda value: value), schema]
    return Annotated[float, AfterValidator(plausible_degrees)] if p.is_angle else float


def _auto_or(value: Any, number: Any) -> Any:
    """The word for a number that the run chooses, or the number that the other checks make of a value."""
    return value if isinstance(value, str) and value == AUTO else number(value)


def _field(p: Parameter) -> Any:
    default = ... if p.default is MISSING else p.default.value if p.choices else p.default
    words = f": {', '.join(p.choices)}" if p.choices else ""
    bounds: Any = p.valid.bounds() if p.valid and not p.is_automatic else {}  # those of _type hold for the number alone
    unit, hint = (p.valid.unit, p.valid.hint) if p.valid else ("", "")
    return quantity(p.description + words, default, unit=unit, hint=hint, **bounds)
