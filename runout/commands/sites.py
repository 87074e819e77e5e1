"""Commands that make, run and compare sites."""

import logging
from collections.abc import Sequence
from pathlib import Path
from shlex import quote
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from runout.commands.options import Budget, Changes, Device, Injected, OnCluster, Session, SiteArgument, Threads, Workers, command
from runout.commands.written import Written
from runout.errors import ConfigError, ExitCode

LOGGER = logging.getLogger(__name__)
RetryFailed = Annotated[bool, Parameter(name="--retry-failed", negative="", help="Also repeat members whose failure is permanent.")]
PROCESS = (
    "Write published values of a process: rock_avalanche, ice_rock_avalanche, debris_flow, hillslope_debris_flow, mud_flow or "
    "snow_avalanche."
)
Force = Annotated[bool, Parameter(name="--force", negative="", help="Run even if nothing has changed.")]


@command(writes=False)
def new(
    folder: Annotated[Path, Written(folder=True)],
    *,
    dem: Annotated[str, Parameter(help="Elevation raster.")],
    release: Annotated[str, Parameter(help="Polygons or thickness raster of the release.")],
    thickness: Annotated[str | None, Parameter(help="Attribute of the polygons that holds the thickness, or metres.")] = None,
    crs: Annotated[str | None, Parameter(help="Coordinate system of a DEM that states none, such as EPSG:32632.")] = None,
    layer: Annotated[str | None, Parameter(help="Layer of the polygons, where their file has several.")] = None,
    process: Annotated[str | None, Parameter(help=PROCESS)] = None,
    cell_size: Annotated[float | None, Parameter(help="Grid spacing [m] [default: cells of the DEM].")] = None,
    session: Injected,
) -> int:
    """Make a site folder: a commented site.yaml and inputs/. At a terminal, `runout new` alone asks for all."""
    from runout.config.scaffold import new_site

    made = new_site(folder, dem, release, thickness, crs=crs, layer=layer, process=process, cell_size=cell_size)
    todo = (
        "look through its values"
        if process
        else "set the material in site.yaml"
        if thickness
        else "set thickness and material in site.yaml"
    )
    LOGGER.info("made %s; %s, then: runout check %s", made, todo, quote(str(folder)))
    return ExitCode.OK


@command(writes=False, short=True)
def check(site: SiteArgument, *, device: Device = None, changes: Changes = (), budget: Budget = None, session: Injected) -> int:
    """List every problem of a site and forecast its run; change nothing."""
    from runout.workflow.preview import check_site

    return check_site(site, session.out, device, changes, budget)


@command(short=True)
def run(
    site: SiteArgument,
    *more: Annotated[Path, Parameter(help="Further sites, which run one after the other.")],
    workers: Workers = None,
    threads: Threads = None,
    device: Device = None,
    retry_failed: RetryFailed = False,
    force: Force = False,
    cluster: OnCluster = None,
    changes: Changes = (),
    budget: Budget = None,
    session: Injected,
) -> int:
    """Run all stages that are not up to date: terrain, release, ensemble, hazard, report."""
    from runout.workflow.hazard_map import STAGES
    from runout.workflow.regional import run_each

    choices: dict[str, Any] = {"workers": workers, "threads": threads, "device": device, "retry_failed": retry_failed}
    choices |= {"force": force, "cluster": cluster, "changes": changes, "budget": budget}
    if not more:
        return _stages(site, STAGES, session, **choices)
    if session.out is not None:
        raise ConfigError(f"--out {session.out} is one folder, and {1 + len(more)} sites are given; remove it, or run one site")
    return run_each((site, *more), lambda one: _stages(one, STAGES, session, **choices))


@command(short=True)
def terrain(site: SiteArgument, *, force: Force = False, session: Injected) -> int:
    """Read and prepare the DEM; write results/terrain.nc."""
    return _stages(site, ("terrain",), session, force=force)


@command(short=True)
def release(site: SiteArgument, *, force: Force = False, session: Injected) -> int:
    """Read and check the release; write results/release.nc."""
    return _stages(site, ("release",), session, force=force)


@command(short=True)
def ensemble(
    site: SiteArgument,
    *,
    workers: Workers = None,
    threads: Threads = None,
    device: Device = None,
    retry_failed: RetryFailed = False,
    members: Annotated[str | None, Parameter(help="Run only these, such as 0:100; for jobs that share the folder.")] = None,
    cluster: OnCluster = None,
    session: Injected,
) -> int:
    """Run the remaining members; write results/members/."""
    choices = {"workers": workers, "threads": threads, "device": device, "retry_failed": retry_failed}
    return _stages(site, ("ensemble",), session, **choices, members=members, cluster=cluster)


@command(short=True)
def hazard(site: SiteArgument, *, force: Force = False, session: Injected) -> int:
    """Aggregate the finished members; write results/hazard.nc, maps/ and outlines.gpkg."""
    return _stages(site, ("hazard",), session, force=force)


@command(short=True)
def report(site: SiteArgument, *, force: Force = False, session: Injected) -> int:
    """Write results/report.html."""
    return _stages(site, ("report",), session, force=force)


@command(writes=False, short=True)
def status(site: SiteArgument, *, changes: Changes = (), session: Injected) -> int:
    """List done, failed and remaining members with reasons, and the stages that are up to date."""
    from runout.workflow.status import print_status

    return print_status(site, session.out, changes)


@command()
def clean(site: SiteArgument, *, session: Injected) -> int:
    """Remove members that the settings do not use; `runout status` counts them."""
    from runout.workflow.status import clean as clean_site

    return clean_site(site, session.out)


@command()
def simulate(
    site: SiteArgument,
    *,
    member: Annotated[int, Parameter(help="Number of the member, as in `runout status`.")] = 0,
    snapshots: Annotated[int, Parameter(help="Number of snapshots, evenly spaced in time.")] = 20,
    particles: Annotated[int, Parameter(help="Most particles that each snapshot keeps with position and speed.")] = 0,
    cell_size: Annotated[
        tuple[float, ...] | None,
        Parameter(consume_multiple=True, negative="", help="Grid spacing [m], one number or three [default: what site.yaml says]."),
    ] = None,
    device: Device = None,
    session: Injected,
) -> int:
    """Run one member and keep snapshots; write results/simulations/, never the members of the ensemble."""
    from runout.workflow.single_member import run as run_member

    choices = {"member": member, "snapshots": snapshots, "particles": particles}
    run_member(site, session.out, **choices, device=device, cell_size=cell_size)
    return ExitCode.OK


@command()
def reproduce(
    product: Annotated[Path, Parameter(help="A hazard.nc, or its results folder.")],
    *,
    site: Annotated[Path | None, Parameter(help="Folder with the inputs of the site [default: that above the results].")] = None,
    workers: Workers = None,
    threads: Threads = None,
    device: Device = None,
    session: Injected,
) -> int:
    """Run a hazard.nc again from the settings that it holds, and compare all maps to the bit; --out DIR keeps the new ones."""
    from runout.workflow.reproduction import reproduce as run_again

    return run_again(product, session.out, site, workers=workers, threads=threads, device=device)


@command()
def compare(
    first: Annotated[Path, Parameter(help="What is scored: a site, its results, hazard.nc, a member, run.nc, or a raster.")],
    second: Annotated[Path, Parameter(help="What it is scored against: one of these, an outline, or points.")],
    *,
    quantity: Annotated[
        str | None,
        Parameter(
            help="thickness, speed or another map quantity, arrival, eroded_depth, change or bed_share [default: all of both]."
        ),
    ] = None,
    threshold: Annotated[
        tuple[float, ...], Parameter(consume_multiple=True, negative="", help="Thicknesses [m], or values of --quantity.")
    ] = (),
    probability: Annotated[float, Parameter(help="Outline of an ensemble.")] = 0.5,
    thalweg: Annotated[Path | None, Parameter(help="Line of a vector file, for errors of front and sides.")] = None,
    half_width: Annotated[float, Parameter(help="Largest distance from the thalweg that counts [m].")] = float("inf"),
    slope_normal: Annotated[
        bool, Parameter(negative="", help="Rasters hold thickness normal to the slope; so do the scores.")
    ] = False,
    dem: Annotated[Path | None, Parameter(help="Elevation raster, where no product has one.")] = None,
    layer: Annotated[str | None, Parameter(help="Layer of the outline or points, where their file has several.")] = None,
    nodata: Annotated[Literal["unknown", "zero"], Parameter(help="What cells of rasters without a value mean.")] = "unknown",
    session: Injected,
) -> int:
    """Score a product against another one or an observation; --out DIR writes a page, a record and difference maps."""
    from runout.scores.comparison import Choices
    from runout.workflow.comparison import command

    choices = Choices(quantity, threshold, probability, thalweg, dem, half_width, slope_normal, nodata, layer)
    return command(first, second, choices, session.out)


def _stages(site: Path, stages: Sequence[str], session: Session, **choices: Any) -> int:
    from runout.workflow import hazard_map

    return hazard_map.run(site, session.out, stages, **choices).exit_code
