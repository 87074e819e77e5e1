"""Reads the numerical error of the maps from the convergence study of the site."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from runout.errors import StorageError
from runout.model.limits import is_number

NUMBERS = ("fine", "error")
WORDS = ("title", "unit")
REMEDY = "run `runout verify --convergence` for this site again, or remove the file"


def require_error_bars(content: Mapping[str, Any], path: Path) -> Mapping[str, Any]:
    """Content of ``convergence.json``, checked for the entries that the report prints: error bars and finest cell size.

    Raises
    ------
    StorageError
        If an entry is missing or has another type; the message names the first one.
    """
    wrong = next(_faults(content), None)
    if wrong:
        raise StorageError(f"{path}: {wrong}; {REMEDY}")
    return content


def _faults(content: Mapping[str, Any]) -> Iterator[str]:
    quantities, levels = content.get("quantities"), content.get("levels")
    if not isinstance(quantities, dict) or not quantities:
        yield "holds no quantities"
        return
    for name, entry in quantities.items():
        for key in (*NUMBERS, *WORDS):
            if not isinstance(entry, dict) or key not in entry:
                yield f"quantities.{name}.{key} is missing"
            elif not (isinstance(entry[key], str) if key in WORDS else entry[key] is None or is_number(entry[key])):
                yield f"quantities.{name}.{key} is {repr(entry[key])[:60]}"
    finest = levels[-1] if isinstance(levels, list) and levels else None
    size = finest.get("cell_size") if isinstance(finest, dict) else None
    if not isinstance(size, list) or not size or not is_number(size[0]):
        yield "the last of its levels has no cell_size"
