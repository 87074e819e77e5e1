"""Previews a run of a site: its problems, or its stages and cost. Changes nothing."""

from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from runout import log
from runout.errors import BudgetError, CapacityError, ConfigError, ExitCode, RunoutError

if TYPE_CHECKING:
    from rich.console import Console

    from runout.config.site import Site
    from runout.workflow.check import Findings
    from runout.workflow.study import Study


def check_site(
    site_path: Path,
    out: Path | None = None,
    device: str | None = None,
    changes: Sequence[str] = (),
    budget: str | None = None,
) -> int:
    """Print problems and warnings of a site, with ``changes`` of its settings, the stages of a run with reasons, and its forecast.

    With a ``budget`` such as "30min" cells and members are those that fit (:mod:`runout.workflow.time_budget`).

    Returns
    -------
    int
        Exit code: 0 ready to run, 2 problems, 4 over its budget.
    """
    from rich.text import Text

    from runout.io.places import fault_in_results
    from runout.workflow.check import inspect

    console = log.output()
    with log.muted():
        found = inspect(_counted(console, site_path, changes) or site_path, changes=changes)
    results = out or (site_path if site_path.is_dir() else site_path.parent) / "results"
    if budget is not None and found.site is not None and not found.problems:
        with log.muted():
            changes = [*changes, *_fitting(console, found.site, budget, results, changes, device)]
            found = inspect(site_path, changes=changes)
    found.problems += filter(None, [fault_in_results(results)])
    for problem in found.problems:
        console.print(Text.assemble(("problem ", "bold red"), problem))
    for warning in found.warnings:
        console.print(Text.assemble(("warning ", "yellow"), warning))
    for note in found.notes:
        console.print(Text.assemble(("note    ", "dim"), note))
    if found.problems or found.site is None:
        console.print(f"[bold]{len(found.problems)} problem{'s' * (len(found.problems) != 1)}; nothing was changed[/]")
        return ExitCode.CONFIGURATION
    if found.zones:
        console.print(found.zones.statement(), markup=False)
    return _print_plan(console, found, found.site, out, device)


def _fitting(
    console: "Console", site: "Site", budget: str, results: Path, changes: Sequence[str], device: str | None
) -> tuple[str, ...]:  # fmt: skip
    """Settings that fit into a time, after printing the choices."""
    from runout.forecast.step_cost import quick_step_cost
    from runout.workflow.compilation import kernels_noted
    from runout.workflow.time_budget import TimeBudget, best

    site = site if device is None else site.on_device(device)
    cost_of = partial(quick_step_cost, compiled=partial(kernels_noted, site))
    limit = TimeBudget.of(site, budget, results, changes, cost_of=cost_of)
    choices = limit.choices()
    for line in limit.lines(choices):
        console.print(line, markup=False)
    return limit.settings(best(choices))


def _counted(console: "Console", site_path: Path, changes: Sequence[str]) -> "Site | None":
    """Print the number of particles before all that takes time; the site, or None if its settings are wrong."""
    from runout.config.site import read_site
    from runout.workflow.plan import particle_count, particle_line

    try:
        site = read_site(site_path, changes)
    except ConfigError:
        return None
    with suppress(RunoutError):  # the inspection names all problems
        console.print(particle_line(particle_count(site)))
    return site


def _print_plan(console: "Console", found: "Findings", site: "Site", out: Path | None, device: str | None) -> int:
    from runout.config.member_arguments import default_particles
    from runout.forecast.accuracy import lines
    from runout.forecast.numerical_error import read_convergence, require_error_bars, statements
    from runout.model.limits import spacing_of
    from runout.release.statements import statement
    from runout.workflow import check_stiffness
    from runout.workflow.probes import other_members
    from runout.workflow.status import print_stages
    from runout.workflow.study import Study

    study = Study.of(site if device is None else site.on_device(device), out)
    data, grid = site.data(), site.member_arguments()
    particles = partial(default_particles, site.settings, data)
    for release in data.releases:
        console.print(statement(release), markup=False)
    for one in data.inflows:
        console.print(f"inflow    {one.name}: {one.statement(spacing_of(grid['cell_size']))}", markup=False)
    if found.resolution and not found.resolution.is_coarse:  # else a warning states it
        console.print(f"flow      about {found.resolution.statement()}", markup=False)
    measured = read_convergence(study.results)
    if measured:
        require_error_bars(measured, study.results / "convergence.json")
    for line in lines(site.settings.simulation.accuracy, data.masses, grid, particles, measured):
        console.print(line, markup=False)
    if measured:
        size = measured["levels"][-1]["cell_size"][0]
        console.print(f"          measured on this site, cells of {size:g} m: {'; '.join(statements(measured))}", markup=False)
    stated = site.materials(data.releases)
    for line in check_stiffness.lines(stated, found.stiffness, [r.name for r in data.releases]):
        console.print(line, markup=False)
    print_stages(console, study)
    if said := other_members(study):
        console.print(f"probes    {said}", markup=False)
    if study.growth:
        console.print(f"ensemble  {study.growth.statement()}", markup=False)
    return _print_forecast(console, study)


def _print_forecast(console: "Console", study: "Study") -> int:
    """Print the forecast of a run, for which nothing is compiled."""
    from rich.text import Text

    from runout.forecast.step_cost import quick_step_cost
    from runout.workflow.compilation import kernels_noted
    from runout.workflow.plan import forecast, particle_line

    try:
        with log.muted():
            cost_of = partial(quick_step_cost, compiled=partial(kernels_noted, study.site))
            expected = forecast(study.site, study.left_at_most, cost_of=cost_of)
    except (BudgetError, CapacityError) as error:
        console.print(Text.assemble(("over budget ", "bold red"), str(error)))
        return error.exit_code
    for line in expected.lines():
        if line != particle_line(expected.particles):
            console.print(line, markup=False)
    over = expected.over_budget(study.site.settings.budget)
    for line in over:
        console.print(Text.assemble(("over budget ", "bold red"), line))
    return ExitCode.OVER_BUDGET if over else ExitCode.OK
