"""Options that name what a command writes; a place that cannot be written is refused before any work."""

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

from runout.commands.options import TRAITS
from runout.io.boundary import SITE_FILE
from runout.io.places import require_place, require_results


@dataclass(frozen=True)
class Written:
    """Mark of an option that names what a command writes."""

    folder: bool | None = False  # whether that is a folder; None: if the name has no ending
    instead: bool = False  # whether the command then writes nothing to the results folder


def require_places(command: Callable[..., Any], arguments: Mapping[str, Any], out: Path | None) -> None:
    """Raise ConfigError if the results folder or an option marked :class:`Written` names what cannot be written.

    ``arguments`` are the arguments of the command by name, ``out`` is the stated results folder.
    """
    named = list(_written(command, arguments))
    for name, mark, path in named:
        folder = not path.suffix if mark.folder is None else mark.folder
        require_place(name, path, folder=folder)
    if not TRAITS[command].writes or any(mark.instead for _, mark, _ in named):
        return
    results = _results_of(arguments.get("site"))
    if out is not None:
        require_results("--out", out)
    elif results is not None:
        require_results("--out [default]", results)


def _results_of(site: Any) -> Path | None:
    """Usual results folder of a site that is there."""
    if not isinstance(site, Path) or not (site.is_dir() or site.name == SITE_FILE):
        return None
    return (site if site.is_dir() else site.parent) / "results"


def _written(command: Callable[..., Any], arguments: Mapping[str, Any]) -> Iterator[tuple[str, Written, Path]]:
    """Name, mark and value of each option of a command that names what it writes."""
    hints = get_type_hints(command, include_extras=True)
    for name, parameter in inspect.signature(command).parameters.items():
        mark = next((part for part in get_args(hints.get(name)) if isinstance(part, Written)), None)
        value = arguments.get(name)
        for path in value if isinstance(value, list) else [value]:
            if mark is not None and isinstance(path, Path):
                positional = parameter.kind is parameter.POSITIONAL_OR_KEYWORD
                yield name.upper() if positional else f"--{name.replace('_', '-')}", mark, path
