"""Command that varies parameters of a site and shows what they change."""

from typing import Annotated

from cyclopts import Parameter

from runout.commands.options import Device, Injected, SiteArgument, Threads, Workers, command

OneAtATime = Annotated[
    bool, Parameter(negative="", help="Vary one parameter after the other [default: all combinations of their values].")
]
Scenario = Annotated[
    str | None, Parameter(help="Scenario whose values the other parameters have, of a site with ensemble.scenarios.")
]
CellSize = Annotated[
    float | None, Parameter(help="Grid spacing [m] [default: cells of the site, or coarser ones that fit into --budget].")
]


@command()
def what_if(
    site: SiteArgument,
    *values: Annotated[str, Parameter(help="KEY=LOW:HIGH:STEP or KEY=A,B,C, such as basal_friction_angle_deg=15:25:1.")],
    one_at_a_time: OneAtATime = False,
    scenario: Scenario = None,
    cell_size: CellSize = None,
    budget: Annotated[str, Parameter(help="Time of all runs: 90s, 30min, 2h.")] = "5min",
    open: Annotated[bool, Parameter(negative="", help="Open the page in the browser.")] = False,
    workers: Workers = None,
    threads: Threads = None,
    device: Device = None,
    session: Injected,
) -> int:
    """Run a site for values of parameters; write a page with a map, a slider over them, and what they change.

    Writes SITE/results_what_if/PARAMETERS/, or --out. Goes on where it was broken off.
    """
    from runout.workflow.what_if import WhatIf, run

    asked = WhatIf(values, one_at_a_time, scenario, cell_size, budget)
    return run(site, session.out, asked, workers=workers, threads=threads, device=device, show=open)
