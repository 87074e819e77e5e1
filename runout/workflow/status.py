"""Prints the state of a site: its members with reasons of failure, and its stages."""

from pathlib import Path
from typing import TYPE_CHECKING

from runout.errors import ExitCode

if TYPE_CHECKING:
    from rich.console import Console

    from runout.workflow.study import Study

MARKS = {"done": "[green]done[/]", "failed": "[red]failed[/]", "left": "left"}
MOST_ROWS = 60  # largest number of members that are listed


def print_status(site_path: Path, out: Path | None = None) -> int:
    """Print members and stages of a site; exit code 3 when members failed, else 0."""
    from runout import log
    from runout.workflow.study import Study

    study, console = Study.open(site_path, out), log.output()
    counts = study.status["state"].value_counts()
    console.print(f"[bold]{study.site.name}[/]: " + ", ".join(f"{counts.get(state, 0)} members {state}" for state in MARKS))
    _print_members(console, study)
    print_stages(console, study)
    return ExitCode.PARTIAL_ENSEMBLE if study.failed else ExitCode.OK


def _print_members(console: "Console", study: "Study") -> None:
    from rich.markup import escape
    from rich.table import Table

    shown = study.status if len(study.status) <= MOST_ROWS else study.status[study.status["state"] == "failed"]
    parameters = [name for name in shown.columns if name not in ("state", "reason")]
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("member", *parameters, "state"):
        table.add_column(name, justify="left" if name == "state" else "right", no_wrap=True)
    table.add_column("reason", overflow="fold")
    for row in shown.itertuples():
        values = [f"{value:.4g}" for value in row[1 : 1 + len(parameters)]]
        table.add_row(str(row.Index), *values, MARKS[row.state], escape(row.reason))
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
