"""The command ``runout``: parses arguments and delegates."""

import logging
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, Literal

from runout import __version__, interrupt
from runout.errors import ConfigError, ExitCode, RunoutError

with interrupt.ended_at_once():  # it takes a moment
    from cyclopts import App, CycloptsError, Group, Parameter

    from runout import log
    from runout.ensemble.cluster import Cluster

LOGGER = logging.getLogger(__name__)
INTERRUPTED = 130  # exit code of shells for a command that Ctrl-C ended


@dataclass(frozen=True)
class Session:
    """Options of every command: verbosity and results folder."""

    verbosity: int = 0
    out: Path | None = None


Injected = Annotated[Session, Parameter(parse=False)]
SiteArgument = Annotated[Path, Parameter(help="Folder of the site, or its site.yaml.")]
Workers = Annotated[
    int | None, Parameter(name="--workers", help="Members that run at once [default: one per core, if memory holds them].")
]
Threads = Annotated[
    int | None,
    Parameter(name="--threads", help="Threads of each member [default: cores over members at once]."),
]
RetryFailed = Annotated[bool, Parameter(name="--retry-failed", negative="", help="Also repeat members whose failure is permanent.")]
Device = Annotated[str | None, Parameter(help="cpu, cuda:0, or auto: a GPU if there is one [default: what site.yaml says].")]
OnCluster = Annotated[Cluster | None, Parameter(name="*", group="Other machines")]
Force = Annotated[bool, Parameter(name="--force", negative="", help="Run even if nothing has changed.")]

app = App(
    name="runout",
    help="Geohazard runout assessment: from a DEM to hazard maps with a sparse 3D material point method.",
    version=__version__,
)
app.meta.group_parameters = Group("Options of every command", sort_key=0)


def new(
    folder: Path,
    *,
    dem: Annotated[str, Parameter(help="Elevation raster.")],
    release: Annotated[Path, Parameter(help="Polygons or thickness raster of the release.")],
    thickness: Annotated[str | None, Parameter(help="Attribute of the polygons that holds the thickness, or metres.")] = None,
    session: Injected,
) -> int:
    """Make a site folder: a commented site.yaml and inputs/."""
    from runout.config.scaffold import new_site

    made = new_site(folder, dem, release, thickness)
    LOGGER.info("made %s; set thickness and material in site.yaml, then: runout check %s", made, folder)
    return ExitCode.OK


def check(site: SiteArgument, *, device: Device = None, session: Injected) -> int:
    """List every problem of a site and forecast its run; change nothing."""
    from runout.workflow.preview import check_site

    return check_site(site, session.out, device)


def run(
    site: SiteArgument,
    *,
    workers: Workers = None,
    threads: Threads = None,
    device: Device = None,
    retry_failed: RetryFailed = False,
    force: Force = False,
    cluster: OnCluster = None,
    session: Injected,
) -> int:
    """Run all stages that are not up to date: terrain, release, ensemble, hazard, report."""
    from runout.workflow.hazard_map import STAGES

    choices = {"workers": workers, "threads": threads, "device": device, "retry_failed": retry_failed, "force": force}
    return _stages(site, STAGES, session, **choices, cluster=cluster)


def terrain(site: SiteArgument, *, force: Force = False, session: Injected) -> int:
    """Read and prepare the DEM; write results/terrain.nc."""
    return _stages(site, ("terrain",), session, force=force)


def release(site: SiteArgument, *, force: Force = False, session: Injected) -> int:
    """Read and check the release; write results/release.nc."""
    return _stages(site, ("release",), session, force=force)


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


def hazard(site: SiteArgument, *, force: Force = False, session: Injected) -> int:
    """Aggregate the finished members; write results/hazard.nc, maps/ and outlines.gpkg."""
    return _stages(site, ("hazard",), session, force=force)


def report(site: SiteArgument, *, force: Force = False, session: Injected) -> int:
    """Write results/report.html."""
    return _stages(site, ("report",), session, force=force)


def status(site: SiteArgument, *, session: Injected) -> int:
    """List done, failed and remaining members with reasons, and the stages that are up to date."""
    from runout.workflow.status import print_status

    return print_status(site, session.out)


def clean(site: SiteArgument, *, session: Injected) -> int:
    """Remove members that the settings do not use; `runout status` counts them."""
    from runout.workflow.status import clean as clean_site

    return clean_site(site, session.out)


def simulate(
    site: SiteArgument,
    *,
    member: Annotated[int, Parameter(help="Number of the member, as in `runout status`.")] = 0,
    snapshots: Annotated[int, Parameter(help="Number of snapshots, evenly spaced in time.")] = 20,
    cell_size: Annotated[
        tuple[float, ...] | None,
        Parameter(consume_multiple=True, negative="", help="Grid spacing [m], one number or three [default: what site.yaml says]."),
    ] = None,
    device: Device = None,
    session: Injected,
) -> int:
    """Run one member and keep snapshots; write results/simulations/, never the members of the ensemble."""
    from runout.workflow.single_member import run as run_member

    run_member(site, session.out, member=member, snapshots=snapshots, device=device, cell_size=cell_size)
    return ExitCode.OK


def compare(
    first: Annotated[Path, Parameter(help="What is scored: a site, its results, hazard.nc, a member, run.nc, or a raster.")],
    second: Annotated[Path, Parameter(help="What it is scored against: one of these, an outline, or points.")],
    *,
    quantity: Annotated[
        str | None, Parameter(help="thickness, deposit, change, speed, pressure or arrival [default: all that both have].")
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


def bench(
    *,
    error: Annotated[
        bool, Parameter(negative="", help="Error against time instead: problems with a known answer; --out DIR writes a page.")
    ] = False,
    published: Annotated[
        bool, Parameter(negative="", help="The benchmarks of the published sparse method instead; --out DIR writes a page.")
    ] = False,
    full: Annotated[
        bool, Parameter(negative="", help="Up to 1e7 particles (hours); with --error or --published finer grids (half an hour).")
    ] = False,
    json: Annotated[Path | None, Parameter(help="Write all measurements to this file.")] = None,
    figure: Annotated[Path | None, Parameter(help="Draw it to this file (.png, .svg, .pdf).")] = None,
    against: Annotated[Path | None, Parameter(help="Prototype script to measure side by side.")] = None,
    device: Annotated[str, Parameter(help="cpu, or cuda:0.")] = "cpu",
    threads: Annotated[tuple[int, ...], Parameter(consume_multiple=True, negative="")] = (1, 2),
    precision: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = ("float32", "float64"),
    session: Injected,
) -> int:
    """Measure the cost of a step on this machine against size, threads, precision, depth and sparsity; or error against time."""
    if error:
        from runout.studies import error_against_time

        error_against_time.command(session.out, full)
        return ExitCode.OK
    if published:
        from runout.studies import published_benchmarks

        published_benchmarks.command(session.out, full, device, json)
        return ExitCode.OK
    from runout.studies import work_precision

    choices = work_precision.Choices(full=full, device=device, threads=threads, precision=precision, against=against)
    work_precision.report(work_precision.run(choices, json, figure))
    return ExitCode.OK


def verify(
    *cases: Annotated[str, Parameter(help="Names such as U6 or sliding-box [default: all].")],
    full: Annotated[
        bool,
        Parameter(negative="", help="At the sizes of the documentation; takes about an hour; an interrupted run continues."),
    ] = False,
    json: Annotated[
        list[Path] | None,
        Parameter(consume_multiple=(0, 1), negative="", help="Write JSON to this file, or print it when none is named."),
    ] = None,
    slope: Annotated[float | None, Parameter(help="Slope of the sliding box's plane [deg].")] = None,
    azimuth: Annotated[float | None, Parameter(help="Azimuth of that plane, from east to north [deg].")] = None,
    offset: Annotated[float | None, Parameter(help="Height of that plane above a node [cells].")] = None,
    precision: Annotated[str | None, Parameter(help="float32 or float64, of the sliding box.")] = None,
    settled: Annotated[bool | None, Parameter(help="Whether the sliding box starts from balanced stresses.")] = None,
    convergence: Annotated[bool, Parameter(negative="", help="Of a site instead: the numerical error of its maps.")] = False,
    device: Device = None,
    session: Injected,
) -> int:
    """Check the scheme against closed forms and its orders of convergence; --out DIR writes page and figure.

    `runout verify SITE --convergence` finds the numerical error of the maps of a site, from three grids.
    """
    if convergence:
        return _convergence(cases, session.out, device)
    from runout.studies.verification import command

    plane = {"slope": slope, "azimuth": azimuth, "offset": offset, "precision": precision, "settled": settled}
    return command(cases, full, session.out, json, {name: value for name, value in plane.items() if value is not None})


def _convergence(sites: Sequence[str], out: Path | None, device: str | None) -> int:
    from runout.studies.convergence import command

    if len(sites) != 1:
        raise ConfigError(f"--convergence takes one site, {len(sites)} are given; say `runout verify SITE --convergence`")
    return command(Path(sites[0]), out, device)


def validate(
    *cases: Annotated[str, Parameter(help="Names such as coulomb-only; without one, the list of all.")],
    full: Annotated[bool, Parameter(negative="", help="At the sizes of the documentation; takes minutes a case.")] = False,
    session: Injected,
) -> int:
    """Run a case beside published tools, an experiment or an observed event; --out DIR writes its page."""
    from runout.studies.validation import command

    return command(cases, full, session.out)


def stress(
    *,
    full: Annotated[bool, Parameter(negative="", help="Every choice alone and 200 at once; takes some minutes.")] = False,
    backend: Annotated[str, Parameter(help="scan, hash or reference.")] = "scan",
    device: Annotated[str, Parameter(help="cpu, or cuda:0 with --backend hash.")] = "cpu",
    session: Injected,
) -> int:
    """Test extreme values of every setting of a run; --out DIR writes a page."""
    from runout.studies.stability_stress import command

    return command(session.out, full, backend, device)


def doctor(*, session: Injected) -> int:
    """List installed libraries, devices and caches, with problems and remedies."""
    from runout.doctor import examine

    return examine()


COMMANDS: tuple[Callable[..., int], ...] = (
    *(new, check, run),
    *(terrain, release, ensemble, hazard, report),
    *(status, clean, simulate, compare, bench, verify, validate, stress, doctor),
)
for order, one in enumerate(COMMANDS):
    app.command(one, sort_key=order)


@app.meta.default
def launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    verbose: Annotated[bool, Parameter(name=["-v", "--verbose"], negative="", help="Say every detail.")] = False,
    quiet: Annotated[bool, Parameter(name=["-q", "--quiet"], negative="", help="Say warnings and errors only.")] = False,
    out: Annotated[Path | None, Parameter(help="Folder of the results [default: SITE/results].")] = None,
) -> int:
    """Run one command with the options of every command."""
    session = Session(verbosity=1 if verbose else -1 if quiet else 0, out=out)
    command, bound, injected = _parsed(app, tokens)
    log.to_terminal(session.verbosity)
    sys.excepthook = partial(_unexpected, session)
    if "session" in injected:
        bound.arguments["session"] = session
    return command(*bound.args, **bound.kwargs) or ExitCode.OK


def main(tokens: Sequence[str] | None = None) -> int:
    """Run the command with the arguments ``tokens``, or those of the process if None; returns the exit code.

    With the arguments of the process, an interrupt ends the process at once.
    """
    from runout import caches

    if tokens is None:
        interrupt.end_at_once()
    try:
        caches.prepare()
        command, bound, _ = _parsed(app.meta, sys.argv[1:] if tokens is None else tokens)
        return int(command(*bound.args, **bound.kwargs) or ExitCode.OK)
    except CycloptsError as error:
        return _say(str(error), ExitCode.CONFIGURATION)
    except RunoutError as error:
        LOGGER.debug("traceback", exc_info=error)
        return _say(str(error), error.exit_code)
    except OSError as error:  # errors of the system that the user can remedy, such as a full disk
        LOGGER.debug("traceback", exc_info=error)
        from runout.io.atomic import reason

        return _say(f"{error.filename or 'input or output'}: {reason(error)}", ExitCode.FAILURE)
    except KeyboardInterrupt:
        return _say(interrupt.MESSAGE, INTERRUPTED)


def _parsed(application: App, tokens: Sequence[str]) -> tuple[Callable[..., Any], Any, dict[str, Any]]:
    return application.parse_args(list(tokens), exit_on_error=False, print_error=False)


def _stages(site: Path, stages: Sequence[str], session: Session, **choices: Any) -> int:
    from runout.workflow import hazard_map

    return hazard_map.run(site, session.out, stages, **choices).exit_code


def _say(message: str, code: int) -> int:
    log.console().print(f"[bold red]error:[/] {log.escaped(message)}")
    return int(code)


def _unexpected(session: Session, kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print an unexpected error in one line; the log file keeps its traceback."""
    _say(f"{kind.__name__}: {error}; this is a fault of runout, -v shows where", ExitCode.FAILURE)
    if session.verbosity > 0:
        sys.__excepthook__(kind, error, trace)
