"""Facts about an object as one line of text, and as a table for notebooks."""

import re
from collections.abc import Mapping
from html import escape


def as_text(name: str, facts: Mapping[str, str]) -> str:
    """``Name(fact: value, ...)``, for ``__repr__``."""
    return f"{name}({', '.join(f'{key}: {value}' for key, value in facts.items())})"


def as_html(name: str, facts: Mapping[str, str]) -> str:
    """A table with a row for each fact, for ``_repr_html_``."""
    rows = "".join(f'<tr><th style="text-align:left">{escape(k)}</th><td>{escape(v)}</td></tr>' for k, v in facts.items())
    return f"<table><caption><b>{escape(name)}</b></caption>{rows}</table>"


def short(value: float, unit: str = "") -> str:
    """A number with four digits and its unit."""
    return f"{value:.4g} {unit}".rstrip()


def crs_name(wkt: str | None) -> str:
    """Name of a coordinate system of WKT."""
    match = re.match(r'\s*\w+\s*\[\s*"([^"]+)"', wkt or "")
    return match[1] if match else (wkt or "local coordinates")
