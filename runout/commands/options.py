"""Options that several commands share."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from runout.ensemble.cluster import Cluster


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
RetryFailed = Annotated[bool, Parameter(name="--retry-failed", negative="", help="Also repeat members whose failure is permanent.")]
Device = Annotated[str | None, Parameter(help="cpu, cuda:0, or auto: a GPU if there is one [default: what site.yaml says].")]
OnCluster = Annotated[Cluster | None, Parameter(name="*", group="Other machines")]
Force = Annotated[bool, Parameter(name="--force", negative="", help="Run even if nothing has changed.")]
