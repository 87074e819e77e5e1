"""What ``runout calibrate`` states: ``calibration.json``, the lines of the terminal, the tables of the posterior and its figure."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.calibration.figures import posterior_figure
from runout.calibration.observed_scalars import ObservedScalar
from runout.calibration.posterior import Likelihood, Posterior, left_out
from runout.io.atomic import write_json, write_text
from runout.workflow.probe_products import write_figure

if TYPE_CHECKING:
    from runout.workflow.calibration import CalibrationChoices, Event

TABLE, RECORD, FIGURE = "posterior.csv", "calibration.json", "posterior.png"
FAR = 2.0  # standard deviations by which a prediction misses what was observed


def event_record(event: "Event", likelihood: Likelihood, scalars: Sequence[ObservedScalar], points: np.ndarray) -> dict[str, Any]:
    """What is observed of an event and what the posterior predicts; ``points`` (n, parameters) are a sample of it in its cube."""
    mean, spread = likelihood.prediction(points[::8])
    return {
        "members": len(event.members),
        "observations": compared(scalars, mean, spread, [one.q2 for one in likelihood.emulators]),
        "left_out_of_the_likelihood": dict(event.left_out),
        "misfits": list(_misfits(event, likelihood, scalars)),
        "grid_error": _grid_error(likelihood, points),
    }


def posterior_record(posterior: Posterior, choices: "CalibrationChoices") -> dict[str, Any]:
    """What is known of the parameters."""
    deviations, axes = posterior.directions()
    return {
        "choices": asdict(choices),
        "parameters": posterior.summary(),
        "marginals": posterior.marginals(),
        "correlation": posterior.correlation.tolist(),
        "principal_axes": {"standard_deviation_over_prior": deviations.tolist(), "axes": axes.tolist()},
        "statements": list(posterior.statements()),
        "chain": {"independent_points": posterior.effective, "converged": posterior.converged},
    }


def compared(
    scalars: Sequence[ObservedScalar], mean: np.ndarray, spread: np.ndarray, quality: Sequence[float] = ()
) -> dict[str, dict[str, Any]]:
    """Observed and predicted scalars by name; ``spread`` holds the standard error of the observation as well."""
    rows = {
        one.name: {
            "units": one.units, "observed": one.value, "standard_error": one.error, "predicted": float(mean[k]),
            "standard_deviation": float(spread[k]), "deviation": float((one.value - mean[k]) / spread[k]),
        }
        for k, one in enumerate(scalars)
    }  # fmt: skip
    for one, q2 in zip(scalars, quality, strict=False):
        rows[one.name]["held_out_q2"] = q2
    return rows


def _misfits(event: "Event", likelihood: Likelihood, scalars: Sequence[ObservedScalar]) -> Iterator[str]:
    """Sentences on observed values that no member comes near."""
    for one, emulator in zip(scalars, likelihood.emulators, strict=True):
        low, high = emulator.values.min(), emulator.values.max()
        if not low - FAR * one.error <= one.value <= high + FAR * one.error:
            yield (
                f"{one.name}: observed {one.value:.4g} {one.units}, all {len(event.members)} members lie between {low:.4g} and "
                f"{high:.4g}; widen the ranges of ensemble.parameters, or look for what the model lacks"
            )


def _grid_error(likelihood: Likelihood, points: np.ndarray) -> dict[str, Any] | None:
    """Offset by parameter in its unit, and the standard error that remains by scalar; None without pairs."""
    error, prior = likelihood.grid_error, likelihood.prior
    if error is None:
        return None
    moved = prior.values(points + error.offset) - prior.values(points)
    offsets = {name: float(moved[:, k].mean()) for k, name in enumerate(prior.names)}
    remaining = np.sqrt(np.diag(error.covariance)).tolist()
    return {"pairs": error.pairs, "offset": offsets, "remaining_standard_errors": remaining}


def validated(likelihood: Likelihood, scalars: Sequence[ObservedScalar]) -> dict[str, Any]:
    """Scalars of each observation predicted from all others; of each scalar where there is one observation only."""
    groups = [one.group for one in scalars]
    if len(set(groups)) == 1:  # all parts of an outline are one scalar
        groups = [one.name.rpartition(".")[0] if ".position." in one.name else one.name for one in scalars]
    if len(set(groups)) == 1:
        return {}
    predicted: dict[str, Any] = {}
    for group, (mean, spread) in left_out(likelihood, groups).items():
        of_group = [one for one, own in zip(scalars, groups, strict=True) if own == group]
        predicted |= compared(of_group, mean, spread)
    return predicted


def lines(record: dict[str, Any]) -> Iterator[str]:
    """What the terminal prints of ``calibration.json``, of one event or of several."""
    events = record.get("events", {"": record})
    scalars = sum(len(one["observations"]) for one in events.values())
    several = f"{len(events)} events, " if "events" in record else ""
    yield f"{several}{sum(one['members'] for one in events.values())} members, {scalars} observed scalars"
    yield f"  {'parameter':36}{'mean':>10}{'sd':>10}{'5 %':>10}{'50 %':>10}{'95 %':>10}{'sd/prior':>10}"
    for name, one in record["parameters"].items():
        columns = ("mean", "standard_deviation", "p5", "p50", "p95", "standard_deviation_over_prior")
        yield f"  {name:36}" + "".join(f"{one[column]:10.4g}" for column in columns)
    yield from record["statements"]
    for name, one in events.items():
        yield from _event_lines(name and f"{name}: ", one)
    if not record["chain"]["converged"]:
        points = record["chain"]["independent_points"]
        yield f"the chain is shorter than 20 autocorrelation times ({points:.0f} independent points): its percentiles are rough"


def _event_lines(begin: str, one: Mapping[str, Any]) -> Iterator[str]:
    """Lines of an event, of which headings and sentences begin with its name if there are several."""
    yield from _comparison_lines(f"{begin}fitted", one["observations"])
    yield from (begin + sentence for sentence in one["misfits"])
    yield from (f"{begin}{name}: left out: {reason}" for name, reason in one["left_out_of_the_likelihood"].items())
    if one["validation"]:
        others = "events" if begin else "observations"
        yield from _comparison_lines(f"{begin}validation, each predicted from the other {others}", one["validation"])
    else:
        yield f"{begin}validation: none, since one scalar was observed only"
    yield begin + _grid_line(one["grid_error"])


def _comparison_lines(heading: str, rows: dict[str, dict[str, Any]]) -> Iterator[str]:
    yield f"{heading}:"
    for name, one in rows.items():
        far = " (far)" if abs(one["deviation"]) > FAR else ""
        observed = f"observed {one['observed']:.4g} +- {one['standard_error']:.2g} {one['units']}"
        predicted = f"predicted {one['predicted']:.4g} +- {one['standard_deviation']:.2g}"
        yield f"  {name}: {observed}, {predicted}, {one['deviation']:+.1f} standard deviations{far}"


def _grid_line(error: dict[str, Any] | None) -> str:
    if error is None:
        return "error of the grid: not in these numbers, which hold for these cells; --fine-pairs 16 finds and removes it"
    offset = ", ".join(f"{name} {value:+.2g}" for name, value in error["offset"].items())
    return (
        f"error of the grid from {error['pairs']} pairs: {offset} makes these cells act like cells of half the size; the "
        "parameters above hold for the finer cells"
    )


def write(
    folder: Path, posterior: Posterior, record: dict[str, Any], rows: int, tables: "Mapping[str, Mapping[str, int]]"
) -> list[Path]:
    """Paths of tables, record and figure, after writing each as a whole.

    Parameters
    ----------
    tables : mapping of str to mapping of str to int
        By the name of each table, the axis of the posterior of each of its columns.
    """
    import pandas as pd

    sample, paths, checksums = posterior.subset(rows), [], {}
    for name, columns in tables.items():
        text = str(pd.DataFrame(sample[:, list(columns.values())], columns=list(columns)).to_csv(index=False))
        paths.append(write_text(text, folder / name))
        checksums[name] = sha256(paths[-1].read_bytes()).hexdigest()
    return [
        *paths,
        write_json({**record, "tables": checksums}, folder / RECORD),
        write_figure(posterior_figure(posterior), folder / FIGURE),
    ]
