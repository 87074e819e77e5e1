"""Commands on parameters: which of them matter, and which values agree with an observed event."""

from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from runout.commands.options import Device, Injected, SiteArgument, Threads, Workers, command
from runout.commands.sites import RetryFailed

Errors = Annotated[
    tuple[str, ...],
    Parameter(name="--error", consume_multiple=True, negative="", help="Standard errors: outline.area=5% gauges.speed=0.5."),
]
Without = Annotated[
    tuple[str, ...],
    Parameter(consume_multiple=True, negative="", help="Observations that do not count: deposit gauges.speed."),
]
Rounds = Annotated[int, Parameter(validator=Number(gte=0, lte=8), help="Rounds of further runs in the posterior.")]
Points = Annotated[int, Parameter(validator=Number(gte=1, lte=1024), help="Runs of each round.")]
FinePairs = Annotated[
    int,
    Parameter(validator=Number(gte=0, lte=1024), help="Members that run on halved cells too, for the error of the grid."),
]
Rows = Annotated[int, Parameter(validator=Number(gte=1, lte=100_000), help="Rows of posterior.csv.")]


@command()
def sensitivity(site: SiteArgument, *, session: Injected) -> int:
    """Shares of the sampled parameters in the variance of area, run-out and volumes, from the members that have run.

    Writes results/sensitivity/; needs 32 members, scikit-learn and SALib.
    """
    from runout.workflow.sensitivity import run

    return run(site, session.out)


@command()
def calibrate(
    site: SiteArgument,
    *,
    error: Errors = (),
    without: Without = (),
    rounds: Rounds = 2,
    points: Points = 16,
    fine_pairs: FinePairs = 0,
    rows: Rows = 256,
    workers: Workers = None,
    threads: Threads = None,
    device: Device = None,
    retry_failed: RetryFailed = False,
    session: Injected,
) -> int:
    """Sampled parameters that agree with the observations of a site; runs what it needs and goes on where it was broken off.

    Writes results/calibration/ with posterior.csv, a table for an ensemble; needs 16 members, scikit-learn and emcee.
    """
    from runout.workflow.calibration import CalibrationChoices
    from runout.workflow.calibration import run as run_calibration

    choices = CalibrationChoices(error, without, rounds, points, fine_pairs, rows)
    how = {"workers": workers, "threads": threads, "device": device}
    return run_calibration(site, session.out, choices, **how, retry_failed=retry_failed)  # type: ignore[arg-type]
