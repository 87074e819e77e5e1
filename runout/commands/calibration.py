"""Commands on parameters: which of them matter, and which values agree with an observed event."""

from pathlib import Path
from typing import Annotated, Literal

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
Outline = Annotated[
    Literal["area", "boundary"], Parameter(help="What of an outline counts beside its run-out: area, or boundary in eight parts.")
]
Own = Annotated[
    tuple[str, ...],
    Parameter(consume_multiple=True, negative="", help="Of several sites: parameters that each has for itself."),
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
    *more: Annotated[Path, Parameter(help="Further sites, whose events share the parameters; needs --out.")],
    error: Errors = (),
    without: Without = (),
    rounds: Rounds = 2,
    points: Points = 16,
    fine_pairs: FinePairs = 0,
    rows: Rows = 256,
    outline: Outline = "area",
    own: Own = (),
    workers: Workers = None,
    threads: Threads = None,
    device: Device = None,
    retry_failed: RetryFailed = False,
    session: Injected,
) -> int:
    """Sampled parameters that agree with the observations of a site; runs what it needs and goes on where it was broken off.

    Writes results/calibration/ with posterior.csv, a table for an ensemble; needs 16 members, scikit-learn and emcee. Of several
    sites: one posterior of the parameters that they share.
    """
    from runout.errors import ConfigError
    from runout.workflow import calibration, joint_calibration

    choices = calibration.CalibrationChoices(error, without, rounds, points, fine_pairs, rows, outline)
    how = {"workers": workers, "threads": threads, "device": device, "retry_failed": retry_failed}
    if more:
        return joint_calibration.run((site, *more), session.out, choices, own, **how)  # type: ignore[arg-type]
    if own:
        raise ConfigError(f"--own {' '.join(own)}: one site shares no parameter; remove it, or state further sites")
    return calibration.run(site, session.out, choices, **how)  # type: ignore[arg-type]
