"""Commands that write time series at probes and profiles along lines."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from runout.commands.options import Device, Injected, SiteArgument, Threads, Workers, command
from runout.errors import ExitCode

Picture = Annotated[Literal["png", "svg"], Parameter(help="Format of the figures.")]


@command()
def probe(
    site: SiteArgument,
    *,
    points: Annotated[Path | None, Parameter(help="Points of a vector file [default: probes of site.yaml].")] = None,
    cross_sections: Annotated[
        Path | None, Parameter(name=["--cross-sections", "--line"], help="Lines across the flow, of a vector file.")
    ] = None,
    points_layer: Annotated[str | None, Parameter(help="Layer of the points, where their file has several.")] = None,
    cross_sections_layer: Annotated[str | None, Parameter(help="Layer of the lines, where their file has several.")] = None,
    interval: Annotated[float | None, Parameter(help="Time between two values [s] [default: a 200th of end_time].")] = None,
    member: Annotated[int | None, Parameter(help="Number of a member [default with files: 0; else the ensemble].")] = None,
    members: Annotated[str | None, Parameter(help="all: run every member that has no series at these probes.")] = None,
    picture: Picture = "png",
    workers: Workers = None,
    threads: Threads = None,
    device: Device = None,
    session: Injected,
) -> int:
    """Write time series of the flow at points and through cross-sections to results/probes/."""
    from runout.workflow.probes import ProbeChoices, run

    choices = ProbeChoices(points, cross_sections, points_layer, cross_sections_layer, interval, member, members, picture)
    run(site, session.out, choices, workers=workers, threads=threads, device=device)
    return ExitCode.OK


@command()
def profile(
    site: SiteArgument,
    *,
    line: Annotated[Path, Parameter(help="Lines of a vector file: a thalweg, or across the flow.")],
    layer: Annotated[str | None, Parameter(help="Layer of the lines, where their file has several.")] = None,
    member: Annotated[int | None, Parameter(help="Number of a member [default: percentiles over all that are done].")] = None,
    picture: Picture = "png",
    session: Injected,
) -> int:
    """Write ground, peak thickness and speed, arrival and deposit along lines to results/profiles/."""
    from runout.workflow.probes import run_profiles

    run_profiles(site, session.out, line, layer=layer, member=member, picture=picture)
    return ExitCode.OK
