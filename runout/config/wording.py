"""Wording of values and choices in messages."""

import difflib
from collections.abc import Iterable, Mapping
from typing import Any


def nearest(word: str, choices: Iterable[str]) -> str | None:
    """The choice most similar to a word; None if no choice is similar."""
    by_lower = {choice.lower(): choice for choice in choices}
    match = difflib.get_close_matches(word.lower(), by_lower, n=1, cutoff=0.6)
    return by_lower[match[0]] if match else None


def choice_fix(value: Any, names: Iterable[str]) -> str:
    """Remedy for an unknown word."""
    names = list(names)
    near = nearest(str(value), names)
    return f"did you mean {near!r}?" if near else f"choose one of {', '.join(names)}"


def shown(value: Any) -> str:
    """A value and its kind, as a message states them."""
    if value is None:
        return "has no value"
    if isinstance(value, bool):
        return f"{str(value).lower()} is a yes or no"
    if isinstance(value, Mapping):
        return "is a block"
    kind = {str: "text", list: "a list", int: "a number", float: "a number"}.get(type(value), "a date")
    return f"{value!r} is {kind}" if isinstance(value, str) else f"{value} is {kind}"
