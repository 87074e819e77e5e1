"""Prints the state of a site: its members with reasons of failure, files that are not used, and its stages."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from runout.ensemble.status import State
from runout.errors import ExitCode

if TYPE_CHECKING:
    from rich.console import Console

    from runout.workflow.study import Study

MARKS = {State.DONE: "[green]done[/]", State.FAILED: "[red]failed[/]", State.LEFT: "left"}
MEGABYTE = 1e6  # bytes
MOST_ROWS = 60  # largest number of members that are listed


def print_status(site_path: Path, out: Path | None = None, changes: Sequence[str] = ()) -> int:
    """Print members and stages of a site, with ``changes`` of its settings; exit code 3 when members failed, else 0."""
    from runout import log
    from runout.workflow.study import Study

    study, console = Study.open(site_path, out, changes=changes), log.output()
    counts = Counter(standing.state for standing in study.standings)
    console.print(f"[bold]{study.site.name}[/]: " + ", ".join(f"{counts[state]} members {state}" for state in MARKS))
    if study.growth:
        console.print(study.growth.statement(), markup=False)
    _print_members(console, study)
    unused = study.unused
    if unused:
        size = sum(path.stat().st_size for path in unused)
        remedy = f"`runout clean {quote(str(site_path))}` removes them"
        console.print(f"{statement(len(unused), size)} are kept for other settings; {remedy}", markup=False)
    print_stages(console, study)
    return ExitCode.PARTIAL_ENSEMBLE if study.failed else ExitCode.OK


def statement(files: int, size: int) -> str:
    """Number and size [byte] of files of members that are not used."""
    return f"{files} files of members that these settings do not use ({size / MEGABYTE:.3g} MB)"


def clean(site_path: Path, out: Path | None = None) -> int:
    """Remove the files of members that the settings of a site do not use; the exit code."""
    from runout import log
    from runout.ensemble.member import plan_members
    from runout.ensemble.written import remove_unused
    from runout.workflow.study import Study

    study = Study.open(site_path, out)
    log.output().print(f"removed {statement(*remove_unused(study.results, plan_members(study.site)))}")
    return ExitCode.OK


def _print_members(console: "Console", study: "Study") -> None:
    from rich.markup import escape
    from rich.table import Table

    shown = study.standings
    if len(shown) > MOST_ROWS:
        shown = [standing for standing in shown if standing.state == "failed"]
    parameters = list(study.standings[0].member.parameters)
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("member", *parameters, "state"):
        table.add_column(name, justify="left" if name == "state" else "right", no_wrap=True)
    table.add_column("reason", overflow="fold")
    for standing in shown:
        values = [f"{value:.4g}" for value in standing.member.parameters.values()]
        table.add_row(str(standing.member.number), *values, MARKS[standing.state], escape(standing.reason))
    console.print(table)


def print_stages(console: "Console", study: "Study") -> None:
    """Print the stages that a run would do, with reasons."""
    from rich.markup import escape

    from runout.workflow.study import PLAN

    console.print("[bold]a run would[/]")
    waits = ""
    for stage in PLAN:
        reason = study.why_stale(stage) or waits
        if reason and stage.name != "terrain" and stage.name != "release":
            waits = waits or f"{stage.name} comes first"
        console.print(f"  {stage.name:9}" + (f"{stage.purpose}: {escape(reason)}" if reason else "nothing: it is up to date"))
