"""What makes a function a command, and options that several commands share."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from runout.ensemble.cluster import Cluster


@dataclass(frozen=True)
class Traits:
    """What the command line has to know of a command before it runs."""

    writes: bool = True  # whether it writes to a results folder, which is refused before any work if it cannot be written
    short: bool = False  # whether it imports more than it works, so that looking for garbage costs more than it frees


TRAITS: dict[Callable[..., int], Traits] = {}  # by function, in the order of definition


def command(*, writes: bool = True, short: bool = False) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Decorator that makes a function of a file in :mod:`runout.commands` a command of its name; its docstring is the help."""

    def register(function: Callable[..., int]) -> Callable[..., int]:
        TRAITS[function] = Traits(writes, short)
        return function

    return register


@dataclass(frozen=True)
class Session:
    """Options of every command: verbosity and results folder."""

    verbosity: int = 0
    out: Path | None = None


Injected = Annotated[Session, Parameter(parse=False)]
SiteArgument = Annotated[Path, Parameter(help="Folder of the site, or its site.yaml.")]
Workers = Annotated[
    int | None,
    Parameter(
        name="--workers", validator=Number(gte=1), help="Members that run at once [default: one per core, if memory holds them]."
    ),
]
Threads = Annotated[
    int | None,
    Parameter(name="--threads", validator=Number(gte=1), help="Threads of each member [default: cores over members at once]."),
]
Device = Annotated[str | None, Parameter(help="cpu, cuda:0, or auto: a GPU if there is one [default: what site.yaml says].")]
Changes = Annotated[
    tuple[str, ...],
    Parameter(
        name="--set", consume_multiple=True, negative="", help="KEY=VALUE in place of what site.yaml states; several may follow."
    ),
]
Budget = Annotated[
    str | None, Parameter(name="--budget", help="Choose cells and number of members that fit into a time: 90s, 30min, 2h.")
]
OnCluster = Annotated[Cluster | None, Parameter(name="*", group="Other machines")]
