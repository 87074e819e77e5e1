"""Commands for many sources in one region: a site for each, and merged maps."""

import logging
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from cyclopts.validators import Number

from runout.commands.options import Changes, Device, Injected, SiteArgument, Threads, command
from runout.errors import ExitCode

LOGGER = logging.getLogger(__name__)
Sources = Annotated[
    int | None,
    Parameter(
        name="--workers",
        validator=Number(gte=1),
        help="Sources that run at once [default: one per core, or four per GPU, if memory holds them].",
    ),
]


@command(writes=False)
def regional(
    site: SiteArgument,
    *,
    annual_rate: Annotated[
        str | None, Parameter(help="Attribute of the polygons that holds the annual rate of each source.")
    ] = None,
    sites_only: Annotated[bool, Parameter(negative="", help="Write the sites of the sources, and run nothing.")] = False,
    workers: Sources = None,
    threads: Threads = None,
    device: Device = None,
    changes: Changes = (),
    session: Injected,
) -> int:
    """Run each release or polygon of a site as a site of its own and merge the maps; goes on where it was broken off.

    Writes SITE/regional, or the folder of --out: sources/NAME with site.yaml and results, merged.nc and maps/.
    """
    from runout.config.site import read_site
    from runout.io.places import require_place
    from runout.workflow.regional import FOLDER, run_regional, write_sources

    read = read_site(site, changes)
    folder = session.out or read.folder / FOLDER
    require_place("--out", folder, folder=True)
    if sites_only:
        places = write_sources(read, folder, annual_rate)
        LOGGER.info("wrote %d sites below %s", len(places), folder)
        return ExitCode.OK
    choices: dict[str, Any] = {"workers": workers, "threads": threads, "device": device}
    return run_regional(read, folder, annual_rate, **choices)


@command(writes=False)
def merge(
    site: Annotated[Path, Parameter(help="A site, its results, or its hazard.nc.")],
    *more: Annotated[Path, Parameter(help="Further ones.")],
    session: Injected,
) -> int:
    """Merge the hazard maps of several sites; --out FOLDER takes merged.nc and maps/ [default: merged]."""
    from runout.hazard.merging import product_of, write_merged
    from runout.io.places import require_place

    folder = session.out or Path("merged")
    require_place("--out", folder, folder=True)
    for path in write_merged([product_of(one) for one in (site, *more)], folder):
        LOGGER.debug("wrote %s", path)
    LOGGER.info("merged %d sites in %s", 1 + len(more), folder)
    return ExitCode.OK
