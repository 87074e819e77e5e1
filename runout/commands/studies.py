"""Commands that measure, verify and validate, and that examine the machine."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from runout.commands.options import Device, Injected, command
from runout.commands.written import Written
from runout.errors import ConfigError, ExitCode


@command()
def bench(
    *,
    full: Annotated[bool, Parameter(negative="", help="Up to 1e7 particles (hours).")] = False,
    json: Annotated[Path | None, Parameter(help="Write all measurements to this file."), Written()] = None,
    device: Annotated[str, Parameter(help="cpu, or cuda:0.")] = "cpu",
    threads: Annotated[tuple[int, ...], Parameter(consume_multiple=True, negative="")] = (1, 2),
    precision: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = ("float32", "float64"),
    session: Injected,
) -> int:
    """Measure the cost of a step on this machine against size, threads, precision, depth and sparsity."""
    from runout.studies import work_precision

    choices = work_precision.Choices(full=full, device=device, threads=threads, precision=precision)
    record = json or (session.out / work_precision.FILE if session.out else None)
    work_precision.report(work_precision.run(choices, record))
    return ExitCode.OK


@command()
def verify(
    *cases: Annotated[str, Parameter(help="Names such as U6 or sliding-box [default: all].")],
    full: Annotated[
        bool,
        Parameter(negative="", help="At the sizes of the documentation; takes about an hour; an interrupted run continues."),
    ] = False,
    json: Annotated[
        list[Path] | None,
        Parameter(consume_multiple=(0, 1), negative="", help="Write JSON to this file, or print it when none is named."),
        Written(),
    ] = None,
    slope: Annotated[float | None, Parameter(help="Slope of the sliding box's plane [deg].")] = None,
    azimuth: Annotated[float | None, Parameter(help="Azimuth of that plane, from east to north [deg].")] = None,
    offset: Annotated[float | None, Parameter(help="Height of that plane above a node [cells].")] = None,
    precision: Annotated[str | None, Parameter(help="float32 or float64, of the sliding box.")] = None,
    settled: Annotated[bool | None, Parameter(help="Whether the sliding box starts from balanced stresses.")] = None,
    convergence: Annotated[bool, Parameter(negative="", help="Of a site instead: the numerical error of its maps.")] = False,
    second_grid: Annotated[
        bool, Parameter(negative="", help="Of a site instead: maps of the numerical error, from all members on coarser cells.")
    ] = False,
    device: Device = None,
    session: Injected,
) -> int:
    """Check the scheme against closed forms and its orders of convergence; --out DIR writes a record.

    `runout verify SITE --convergence` finds the numerical error of run-out, areas and maps of a site, from runs on several grids;
    `runout verify SITE --second-grid` finds that of each cell, and adds it to the maps of the site.
    """
    if convergence and second_grid:
        raise ConfigError("--convergence and --second-grid are two studies; give one of them, then the other")
    if convergence or second_grid:
        return _of_site(cases, session.out, device, second_grid)
    from runout.studies.verification import command

    plane = {"slope": slope, "azimuth": azimuth, "offset": offset, "precision": precision, "settled": settled}
    return command(cases, full, session.out, json, {name: value for name, value in plane.items() if value is not None})


def _of_site(sites: Sequence[str], out: Path | None, device: str | None, second_grid: bool) -> int:
    option = "--second-grid" if second_grid else "--convergence"
    if len(sites) != 1:
        raise ConfigError(f"{option} takes one site, {len(sites)} are given; say `runout verify SITE {option}`")
    if second_grid:
        from runout.workflow.hazard_map import run_second_grid

        return run_second_grid(Path(sites[0]), out, device).exit_code
    from runout.studies.convergence import command

    return command(Path(sites[0]), out, device)


@command()
def validate(
    *cases: Annotated[str, Parameter(help="Names such as coulomb-only; without one, the list of all.")],
    full: Annotated[bool, Parameter(negative="", help="At the sizes of the documentation; takes minutes a case.")] = False,
    session: Injected,
) -> int:
    """Run a case beside published tools, an experiment or an observed event; --out DIR writes a record."""
    from runout.studies.validation import command

    return command(cases, full, session.out)


@command()
def stress(
    *,
    full: Annotated[bool, Parameter(negative="", help="Every choice alone and 200 at once; takes some minutes.")] = False,
    backend: Annotated[str, Parameter(help="scan, hash or reference.")] = "scan",
    device: Annotated[str, Parameter(help="cpu, or cuda:0 with --backend hash.")] = "cpu",
    session: Injected,
) -> int:
    """Test extreme values of every setting of a run; --out DIR writes a record."""
    from runout.studies.stability_stress import command

    return command(session.out, full, backend, device)


@command(writes=False)
def doctor(*, session: Injected) -> int:
    """List installed libraries, devices and caches, with problems and remedies."""
    from runout.workflow.doctor import examine

    return examine()
