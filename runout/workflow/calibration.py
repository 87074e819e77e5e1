"""Command ``runout calibrate``: the sampled parameters that agree with the observations of a site, with their spread."""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout import log
from runout.calibration.emulator import Emulator, varies
from runout.calibration.figures import posterior_figure
from runout.calibration.observed_scalars import Measure, ObservedScalar, Scalars, observed_scalars, with_errors
from runout.calibration.posterior import GridError, Likelihood, Posterior, grid_error, left_out, sampled_posterior
from runout.calibration.prior import Prior
from runout.calibration.sobol_indices import LEAST_Q2
from runout.config.member_arguments import grid_spacing
from runout.config.overrides import with_cell_size
from runout.config.stated_at import stated_place
from runout.ensemble.design import Design, member_seed
from runout.ensemble.member import Member, plan_members
from runout.ensemble.run import run_ensemble
from runout.errors import ConfigError, InputError
from runout.hazard.observed import member_flow
from runout.io import source_code
from runout.io.atomic import read_json, write_json, write_text
from runout.io.provenance import checksum
from runout.model.release import thickness_of
from runout.workflow import hazard_map
from runout.workflow.check_observations import SCORED
from runout.workflow.plan import require_budget
from runout.workflow.probe_products import write_figure
from runout.workflow.sensitivity import finished_members
from runout.workflow.study import Study

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.scores.observations import Observations

LOGGER = logging.getLogger("runout.calibration")
FOLDER, FINE = "calibration", "fine"
TABLE, RECORD, ROUNDS, FIGURE = "posterior.csv", "calibration.json", "rounds.json", "posterior.png"
FEWEST = 16  # members of the first design
FEWEST_PAIRS = 8  # of coarse and fine runs; fewer do not give a covariance
FAR = 2.0  # standard deviations by which a prediction misses what was observed


@dataclass(frozen=True)
class CalibrationChoices:
    """What ``runout calibrate`` was asked for.

    Attributes
    ----------
    errors, without : tuple of str
        Stated standard errors and scalars left out, see :func:`runout.calibration.observed_scalars.with_errors`.
    rounds, points : int
        Rounds of further runs in the posterior, and runs of each.
    fine_pairs : int
        Members that are repeated on cells of half the size; 0 for none.
    rows : int
        Rows of the table of the posterior.
    """

    errors: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    rounds: int = 2
    points: int = 16
    fine_pairs: int = 0
    rows: int = 256


@dataclass(frozen=True)
class Runner:
    """How further members are run."""

    workers: int | None = None
    threads: int | None = None
    retry_failed: bool = False

    def run(self, site: "Site", design: Design, results: Path) -> "list[Member]":
        """Members of a design with a result, after running those that have none; failed ones are named in the log."""
        members = plan_members(site, design)
        planned = range(min(len(members), site.settings.ensemble.members))
        remaining = list(planned) if any(not member.file(results).is_file() for member in members) else []
        workers = require_budget(site, remaining, workers=self.workers)
        with log.progress("calibration") as bar:
            report = run_ensemble(
                site, results, workers=workers, threads=self.threads, retry_failed=self.retry_failed, design=design,
                progress=lambda state: state.show(bar),
            )  # fmt: skip
        valid = set(report.valid)
        return [member for member in members if member.number in valid]


@dataclass
class Event:
    """An observed event, and the runs that model it.

    Attributes
    ----------
    site : Site
    prior : Prior
    observed : Observations
    measure : Measure
    scalars : list of ObservedScalar
        What counts of the observations.
    members : list of Member
        Runs so far.
    modelled : list of dict of str to float
        Scalars of each.
    left_out : dict of str to str
        Scalars that do not count, and why.
    """

    site: "Site"
    prior: Prior
    observed: "Observations"
    measure: Measure
    scalars: list[ObservedScalar]
    members: "list[Member]" = field(default_factory=list)
    modelled: list[Scalars] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, site: "Site", choices: CalibrationChoices) -> "Event":
        """The event of a site.

        Raises
        ------
        ConfigError, InputError
            If the site samples no parameter, has fewer than 16 members or no observation, or one cannot be used.
        """
        _require(site)
        prior, observed = Prior.of(site), site.files.observations().require()
        assert observed is not None
        terrain, masses = site.terrain(), site.masses()
        threshold = min(site.settings.hazard.thickness_thresholds)
        measure = Measure.of(observed, terrain, thickness_of(masses, terrain), threshold)
        cell = max(*terrain.cell_size, *grid_spacing(site.settings, masses)[:2])
        scalars = with_errors(observed_scalars(measure.of_event(), cell), choices.errors, choices.without)
        return cls(site, prior, observed, measure, scalars)

    def scalars_of(self, member: Member, results: Path) -> Scalars:
        """Scalars of a member in a results folder."""
        file, releases = member.file(results), self.site.releases()
        return self.measure.of_member(*member_flow(file, self.observed, releases, member.parameters))

    def add(self, members: "Sequence[Member]", results: Path) -> None:
        """Add runs."""
        self.members += members
        self.modelled += [self.scalars_of(member, results) for member in members]

    @property
    def points(self) -> np.ndarray:
        """Points (members, parameters) of the runs in the cube."""
        return self.points_of(self.members)

    def points_of(self, members: "Sequence[Member]") -> np.ndarray:
        """Points (members, parameters) of members in the cube."""
        return self.prior.coordinates(np.array([[one.parameters[name] for name in self.prior.names] for one in members]))

    def likelihood(self) -> tuple[Likelihood, list[ObservedScalar]]:
        """Likelihood of the scalars whose emulators predict members that they have not seen, and these scalars.

        Raises
        ------
        InputError
            If there is none.
        """
        chosen: list[ObservedScalar] = []
        emulators: list[Emulator] = []
        self.left_out.clear()
        for one in self.scalars:
            values = np.array([scalars.get(one.name, np.nan) for scalars in self.modelled])
            emulator = Emulator.fit(self.points, values) if np.isfinite(values).all() and varies(values) else None
            if reason := _why_left_out(one, values, emulator):
                self.left_out[one.name] = reason
            elif emulator is not None:
                chosen.append(one)
                emulators.append(emulator)
        if not chosen:
            raise InputError("\n".join(f"{name}: {reason}" for name, reason in self.left_out.items()))
        observed, errors = (np.array([getattr(one, part) for one in chosen]) for part in ("value", "error"))
        return Likelihood(self.prior, tuple(emulators), observed, errors), chosen


def _require(site: "Site") -> None:
    """Raise ConfigError with all that keeps a site from a calibration."""
    ensemble, observations = site.settings.ensemble, site.settings.observations
    problems = []
    if observations is None or not any(getattr(observations, name) for name in SCORED):
        problems.append(f"{stated_place(site.file, 'observations')}: nothing was observed; state one of {', '.join(SCORED)}")
    if not ensemble.parameters:
        example = "basal_friction_angle_deg: {distribution: uniform, low: 12, high: 25}"
        problems.append(f"{stated_place(site.file, 'ensemble', 'parameters')}: no parameter is sampled; add one, such as {example}")
    if ensemble.members < FEWEST:
        where = stated_place(site.file, "ensemble", "members")
        problems.append(f"{where}: {ensemble.members} members; a calibration needs {FEWEST}, better 32: set it to 32")
    if problems:
        raise ConfigError("\n".join(problems))


def _why_left_out(scalar: ObservedScalar, values: np.ndarray, emulator: Emulator | None) -> str:
    """Why a scalar does not count, with the remedy; empty if it does."""
    if not np.isfinite(values).all():
        return "members have no value there: it lies outside of the DEM, or on a cell without elevation; move it, or leave it out"
    if emulator is None:
        return f"it is {values[0]:.4g} {scalar.units} in all members, {scalar.value:.4g} observed; no sampled parameter changes it"
    if emulator.q2 < LEAST_Q2:
        return (
            f"its emulator predicts {max(emulator.q2, 0.0):.2f} of the variance of members that it has not seen, {LEAST_Q2:g} is "
            f"needed; double ensemble.members from {len(values)}, or narrow the ranges of the parameters"
        )
    return ""


def run(
    site_path: Path,
    out: Path | None,
    choices: CalibrationChoices,
    *,
    workers: int | None = None,
    threads: int | None = None,
    device: str | None = None,
    retry_failed: bool = False,
) -> int:
    """Calibrate a site; prints the posterior and writes ``results/calibration/``. Finished runs are not run again.

    The exit code is 3 if members of the ensemble failed.

    Raises
    ------
    ConfigError, InputError, PartialEnsembleError, BudgetError
        See :class:`Event`; if no member has run, or further members exceed the budget.
    """
    if choices.fine_pairs and choices.fine_pairs < FEWEST_PAIRS:
        raise ConfigError(f"--fine-pairs {choices.fine_pairs}: their covariance needs {FEWEST_PAIRS}; write 16, or 0 for none")
    study = Study.open(site_path, out, workers, retry_failed, device, threads)
    event, folder = Event.of(study.site, choices), study.results / FOLDER
    how = {"workers": workers, "threads": threads, "device": device, "retry_failed": retry_failed}
    outcome = hazard_map.run(site_path, out, ("ensemble",), **how)  # type: ignore[arg-type]
    study.refresh()
    event.add(finished_members(study), study.results)
    if len(event.members) < FEWEST:
        raise InputError(f"{study.results / 'members'}: {len(event.members)} members have a result; {FEWEST} are needed")
    runner = Runner(workers, study.threads, retry_failed)
    likelihood, scalars = _refined(event, choices, runner, folder)
    if choices.fine_pairs:
        error = _pairs(event, likelihood, scalars, choices.fine_pairs, runner, folder / FINE)
        likelihood = replace(likelihood, grid_error=error)
    posterior = sampled_posterior(likelihood)
    record = _record(event, likelihood, scalars, posterior, choices)
    for line in lines(record):
        log.output().print(line, markup=False, highlight=False, soft_wrap=True)
    for path in _write(folder, posterior, record, choices.rows):
        LOGGER.info("wrote %s", path)
    return outcome.exit_code


def _refined(event: Event, choices: CalibrationChoices, runner: Runner, folder: Path) -> tuple[Likelihood, list[ObservedScalar]]:
    """Likelihood and its scalars after rounds of further runs in the posterior.

    The points of a round are recorded before they run, so that a command that was broken off goes on with the same members.
    """
    key = checksum([source_code.checksums().products, [m.key for m in event.members], [asdict(one) for one in event.scalars]])
    stored = read_json(folder / ROUNDS)
    known = stored.get("rounds", []) if stored.get("key") == [key, choices.points] else []
    likelihood, scalars = event.likelihood()
    for number in range(choices.rounds):
        if number >= len(known):
            known = [*known, sampled_posterior(likelihood).spread_points(choices.points).tolist()]
            write_json({"key": [key, choices.points], "rounds": known}, folder / ROUNDS)
        LOGGER.info("round %d of %d: %d members in the posterior", number + 1, choices.rounds, choices.points)
        event.add(runner.run(event.site, _design(event, np.array(known[number]), number), folder), folder)
        likelihood, scalars = event.likelihood()
    return likelihood, scalars


def _design(event: Event, points: np.ndarray, number: int) -> Design:
    """Members at points (n, parameters) of the cube, with seeds that no other round has."""
    ensemble, values = event.site.settings.ensemble, event.prior.values(points)
    first = ensemble.members + number * len(points)
    seeds = [member_seed(ensemble.seed, first + k) for k in range(len(points))]
    return Design({name: values[:, k].tolist() for k, name in enumerate(event.prior.names)}, seeds)


def _pairs(
    event: Event, likelihood: Likelihood, scalars: Sequence[ObservedScalar], count: int, runner: Runner, results: Path
) -> GridError:
    """Error of the grid from the most likely members, repeated on cells of half the size.

    Raises
    ------
    InputError
        If fewer than 8 of them have a result.
    """
    order = np.argsort(-likelihood.log_density(event.points.clip(1e-6, 1.0 - 1e-6)))[:count]
    chosen = [event.members[k] for k in order]
    spacing = grid_spacing(event.site.settings, event.site.masses())
    halved = with_cell_size(event.site.settings.simulation, [0.5 * size for size in spacing])
    site = event.site.with_settings(simulation=halved)
    design = Design({n: [m.parameters[n] for m in chosen] for n in event.prior.names}, [m.seed for m in chosen])
    LOGGER.info("%d members on cells of half the size", len(chosen))
    fine = runner.run(site, design, results)
    if len(fine) < FEWEST_PAIRS:
        raise InputError(f"{results}: {len(fine)} of {len(chosen)} members on fine cells have a result; {FEWEST_PAIRS} are needed")

    def table(rows: Sequence[Scalars]) -> np.ndarray:
        return np.array([[row[one.name] for one in scalars] for row in rows])

    coarse = table([event.modelled[order[member.number]] for member in fine])
    fine_values = table([event.scalars_of(member, results) for member in fine])
    return grid_error(likelihood, event.points_of(fine), coarse, fine_values)


def _record(
    event: Event, likelihood: Likelihood, scalars: Sequence[ObservedScalar], posterior: Posterior, choices: CalibrationChoices
) -> dict[str, Any]:
    """Content of ``calibration.json``."""
    mean, covariance = likelihood.predicted(posterior.points[::8])
    spread = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2).mean(axis=0) + mean.var(axis=0) + np.square(likelihood.errors))
    deviations, axes = posterior.directions()
    return {
        "members": len(event.members),
        "choices": asdict(choices),
        "observations": _compared(scalars, mean.mean(axis=0), spread, [one.q2 for one in likelihood.emulators]),
        "left_out_of_the_likelihood": dict(event.left_out),
        "parameters": posterior.summary(),
        "correlation": posterior.correlation.tolist(),
        "principal_axes": {"standard_deviation_over_prior": deviations.tolist(), "axes": axes.tolist()},
        "statements": [*posterior.statements(), *_misfits(event, likelihood, scalars)],
        "grid_error": _grid_error(likelihood, posterior),
        "validation": _validated(likelihood, scalars),
        "chain": {"independent_points": posterior.effective, "converged": posterior.converged},
    }


def _compared(
    scalars: Sequence[ObservedScalar], mean: np.ndarray, spread: np.ndarray, quality: Sequence[float] = ()
) -> dict[str, dict[str, Any]]:
    """Observed and predicted scalars by name; ``spread`` holds the standard error of the observation as well."""
    compared = {
        one.name: {
            "units": one.units, "observed": one.value, "standard_error": one.error, "predicted": float(mean[k]),
            "standard_deviation": float(spread[k]), "deviation": float((one.value - mean[k]) / spread[k]),
        }
        for k, one in enumerate(scalars)
    }  # fmt: skip
    for one, q2 in zip(scalars, quality, strict=False):
        compared[one.name]["held_out_q2"] = q2
    return compared


def _misfits(event: Event, likelihood: Likelihood, scalars: Sequence[ObservedScalar]) -> Iterator[str]:
    """Sentences on observed values that no member comes near."""
    for one, emulator in zip(scalars, likelihood.emulators, strict=True):
        low, high = emulator.values.min(), emulator.values.max()
        if not low - FAR * one.error <= one.value <= high + FAR * one.error:
            yield (
                f"{one.name}: observed {one.value:.4g} {one.units}, all {len(event.members)} members lie between {low:.4g} and "
                f"{high:.4g}; widen the ranges of ensemble.parameters, or look for what the model lacks"
            )


def _grid_error(likelihood: Likelihood, posterior: Posterior) -> dict[str, Any] | None:
    """Offset by parameter in its unit, and the standard error that remains by scalar; None without pairs."""
    error = likelihood.grid_error
    if error is None:
        return None
    moved = posterior.prior.values(posterior.points + error.offset) - posterior.values
    offsets = {name: float(moved[:, k].mean()) for k, name in enumerate(posterior.prior.names)}
    remaining = np.sqrt(np.diag(error.covariance)).tolist()
    return {"pairs": error.pairs, "offset": offsets, "remaining_standard_errors": remaining}


def _validated(likelihood: Likelihood, scalars: Sequence[ObservedScalar]) -> dict[str, Any]:
    """Scalars of each observation predicted from all others; of each scalar where there is one observation only."""
    groups = [one.group for one in scalars]
    if len(set(groups)) == 1:
        groups = [one.name for one in scalars]
    if len(set(groups)) == 1:
        return {}
    validated: dict[str, Any] = {}
    for group, (mean, spread) in left_out(likelihood, groups).items():
        of_group = [one for one, own in zip(scalars, groups, strict=True) if own == group]
        validated |= _compared(of_group, mean, spread)
    return validated


def lines(record: dict[str, Any]) -> Iterator[str]:
    """What the terminal prints of ``calibration.json``."""
    yield f"{record['members']} members, {len(record['observations'])} observed scalars"
    yield f"  {'parameter':36}{'mean':>10}{'sd':>10}{'5 %':>10}{'50 %':>10}{'95 %':>10}{'sd/prior':>10}"
    for name, one in record["parameters"].items():
        columns = ("mean", "standard_deviation", "p5", "p50", "p95", "standard_deviation_over_prior")
        yield f"  {name:36}" + "".join(f"{one[column]:10.4g}" for column in columns)
    yield from _comparison_lines("fitted", record["observations"])
    yield from record["statements"]
    yield from (f"{name}: left out: {reason}" for name, reason in record["left_out_of_the_likelihood"].items())
    if record["validation"]:
        yield from _comparison_lines("validation, each predicted from the other observations", record["validation"])
    else:
        yield "validation: none, since one scalar was observed only"
    yield _grid_line(record["grid_error"])
    if not record["chain"]["converged"]:
        points = record["chain"]["independent_points"]
        yield f"the chain is shorter than 20 autocorrelation times ({points:.0f} independent points): its percentiles are rough"


def _comparison_lines(heading: str, compared: dict[str, dict[str, Any]]) -> Iterator[str]:
    yield f"{heading}:"
    for name, one in compared.items():
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


def _write(folder: Path, posterior: Posterior, record: dict[str, Any], rows: int) -> list[Path]:
    """Paths of table, record and figure, after writing each as a whole."""
    import pandas as pd

    table = pd.DataFrame(posterior.subset(rows), columns=list(posterior.prior.names))
    return [
        write_text(str(table.to_csv(index=False)), folder / TABLE),
        write_json(record, folder / RECORD),
        write_figure(posterior_figure(posterior), folder / FIGURE),
    ]
