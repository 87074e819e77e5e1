"""``runout calibrate SITE_A SITE_B ...``: one posterior of the parameters that several events share."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from runout.calibration.observed_scalars import ObservedScalar, concerns, with_errors
from runout.calibration.posterior import OF_EVENT, STEPS, JointLikelihood, JointPrior, Posterior, sampled_posterior
from runout.errors import ConfigError, ExitCode
from runout.io import source_code
from runout.io.atomic import read_json, write_json
from runout.io.provenance import checksum
from runout.workflow.calibration import FINE, FOLDER, ROUNDS, CalibrationChoices, Event, Runner, grid_error_of, state
from runout.workflow.calibration_record import TABLE, compared, event_record, posterior_record, write
from runout.workflow.study import Study

LOGGER = logging.getLogger("runout.calibration")
Counted = dict[str, list[ObservedScalar]]  # scalars in the likelihood, by event


def run(
    sites: Sequence[Path], out: Path | None, choices: CalibrationChoices, own: Sequence[str], retry_failed: bool, **how: Any
) -> int:
    """Calibrate several sites; prints the posterior and writes ``OUT/calibration/``. Finished runs are not run again.

    Members of the ensembles go to the results of each site, further members to ``OUT/calibration/NAME/``.

    Parameters
    ----------
    own : sequence of str
        Parameters that each event has for itself.
    how : workers, threads, device
        As :func:`runout.workflow.calibration.run`.

    Raises
    ------
    ConfigError, InputError, PartialEnsembleError, BudgetError
        Without ``out``; if two sites have one name, or their parameters cannot be shared; as for one site.
    """
    choices.require()
    if out is None:
        raise ConfigError(f"calibrate: {len(sites)} sites have one posterior; write --out FOLDER for it")
    studies = _named([Study.open(site, None, how["workers"], retry_failed, how["device"], how["threads"]) for site in sites])
    events = {name: Event.measured(study.site, choices.outline) for name, study in studies.items()}
    joint = JointPrior.of({name: event.prior for name, event in events.items()}, own)
    _state_errors(events, choices)
    codes = [event.run_ensemble(studies[name], retry_failed=retry_failed, **how) for name, event in events.items()]
    runners = {name: Runner(how["workers"], study.threads, retry_failed) for name, study in studies.items()}
    folder = out / FOLDER
    likelihood, counted = _refined(events, joint, choices, runners, folder)
    if choices.fine_pairs:
        likelihood = _with_grid_errors(events, likelihood, counted, choices.fine_pairs, runners, folder)
    posterior = sampled_posterior(likelihood)
    record = _record(events, joint, likelihood, counted, posterior, choices)
    state(record, write(folder, posterior, record, choices.rows, _tables(joint)))
    return max(codes, default=ExitCode.OK)


def _named(studies: Sequence[Study]) -> dict[str, Study]:
    """Studies by the names of their sites; ConfigError if two have the same."""
    by_name: dict[str, Study] = {}
    for study in studies:
        name = study.site.name
        if name in by_name:
            raise ConfigError(f"{study.site.file}: name: {by_name[name].site.file} is named {name} as well; give one another name")
        by_name[name] = study
    return by_name


def _state_errors(events: Mapping[str, Event], choices: CalibrationChoices) -> None:
    """Apply ``--error`` and ``--without`` to the events that have the observation; ConfigError if none has it."""
    every = [one for event in events.values() for one in event.scalars]
    for option, texts in (("--error", choices.errors), ("--without", choices.without)):
        for text in texts:
            if not concerns(text, every):
                known = ", ".join(dict.fromkeys(one.name for one in every))
                raise ConfigError(f"{option} {text}: no observation of any site has this name; the sites have {known}")
    for name, event in events.items():
        errors, without = ([text for text in texts if concerns(text, event.scalars)] for texts in (choices.errors, choices.without))
        try:
            event.scalars = with_errors(event.scalars, errors, without)
        except ConfigError as fault:
            raise ConfigError(f"{name}: {fault}") from None


def _likelihood(events: Mapping[str, Event], joint: JointPrior) -> tuple[JointLikelihood, Counted]:
    """Likelihood of all events, and the scalars of each that count."""
    parts = {name: event.likelihood() for name, event in events.items()}
    likelihoods = {name: one for name, (one, _) in parts.items()}
    return JointLikelihood(joint.prior, likelihoods, joint.axes), {name: scalars for name, (_, scalars) in parts.items()}


def _refined(
    events: Mapping[str, Event], joint: JointPrior, choices: CalibrationChoices, runners: Mapping[str, Runner], folder: Path
) -> tuple[JointLikelihood, Counted]:
    """Likelihood after rounds of further runs in the joint posterior; the points of a round are recorded before they run."""
    of_events = [[name, [m.key for m in event.members], [asdict(one) for one in event.scalars]] for name, event in events.items()]
    key = checksum([source_code.checksums().products, of_events, list(joint.prior.names)])
    stored = read_json(folder / ROUNDS)
    rounds = stored.get("rounds", []) if stored.get("key") == [key, choices.points] else []
    likelihood, counted = _likelihood(events, joint)
    for number in range(choices.rounds):
        if number >= len(rounds):
            rounds = [*rounds, sampled_posterior(likelihood).spread_points(choices.points).tolist()]
            write_json({"key": [key, choices.points], "rounds": rounds}, folder / ROUNDS)
        for name, event in events.items():
            LOGGER.info("round %d of %d, %s: %d members in the posterior", number + 1, choices.rounds, name, choices.points)
            event.run_further(np.array(rounds[number])[:, joint.axes[name]], number, runners[name], folder / name)
        likelihood, counted = _likelihood(events, joint)
    return likelihood, counted


def _with_grid_errors(
    events: Mapping[str, Event],
    likelihood: JointLikelihood,
    counted: Counted,
    pairs: int,
    runners: Mapping[str, Runner],
    folder: Path,
) -> JointLikelihood:
    """The likelihood with the error of the grid of each event, from its own pairs."""
    corrected = {}
    for name, own in likelihood.events.items():
        error = grid_error_of(events[name], own, counted[name], pairs, runners[name], folder / name / FINE)
        corrected[name] = replace(own, grid_error=error)
    return replace(likelihood, events=corrected)


def _tables(joint: JointPrior) -> dict[str, dict[str, int]]:
    """Columns of ``posterior.csv``, the shared parameters, and of a table for each event that has parameters of its own."""
    names = list(joint.prior.names)
    tables = {TABLE: {name: names.index(name) for name in joint.shared}}
    for event, axes in joint.axes.items():
        if any(OF_EVENT in names[axis] for axis in axes):
            tables[f"{Path(TABLE).stem}_{event}.csv"] = {names[axis].removeprefix(event + OF_EVENT): axis for axis in axes}
    return tables


def _record(
    events: Mapping[str, Event],
    joint: JointPrior,
    likelihood: JointLikelihood,
    counted: Counted,
    posterior: Posterior,
    choices: CalibrationChoices,
) -> dict[str, Any]:
    """Content of ``calibration.json``; an event is validated by the posterior of all others."""
    of_events = {}
    for name, event in events.items():
        own, axes = likelihood.events[name], joint.axes[name]
        others = sampled_posterior(likelihood.without(name), most_steps=STEPS)
        mean, spread = own.prediction(others.points[::8][:, axes])
        of_events[name] = {
            **event_record(event, own, counted[name], posterior.points[:, axes]),
            "validation": compared(counted[name], mean, spread),
        }
    return {"events": of_events, **posterior_record(posterior, choices)}
