"""Command ``runout calibrate``: the sampled parameters that agree with the observations of a site, with their spread."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout import log
from runout.calibration.emulator import Emulator, varies
from runout.calibration.observed_scalars import Measure, ObservedScalar, Scalars, kind_of, observed_scalars, with_errors
from runout.calibration.posterior import GridError, Likelihood, grid_error, sampled_posterior
from runout.calibration.prior import Prior
from runout.config.member_arguments import grid_spacing
from runout.config.stated_at import stated_place
from runout.ensemble.design import Design, member_seed
from runout.ensemble.member import Member, plan_members
from runout.ensemble.run import run_ensemble
from runout.errors import ConfigError, InputError
from runout.hazard.observed import member_flow
from runout.io import source_code
from runout.io.atomic import read_json, write_json
from runout.io.provenance import checksum
from runout.model.release import thickness_of
from runout.workflow import hazard_map
from runout.workflow.calibration_record import TABLE, event_record, lines, posterior_record, validated, write
from runout.workflow.check_observations import SCORED
from runout.workflow.plan import require_budget
from runout.workflow.sensitivity import finished_members
from runout.workflow.study import Study

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.scores.observations import Observations

LOGGER = logging.getLogger("runout.calibration")
FOLDER, FINE = "calibration", "fine"
ROUNDS = "rounds.json"
FEWEST = 16  # members of the first design
FEWEST_PAIRS = 8  # of coarse and fine runs; fewer do not give a covariance


@dataclass(frozen=True)
class CalibrationChoices:
    """What ``runout calibrate`` was asked for."""

    # errors, without: stated standard errors and scalars left out, see :func:`runout.calibration.observed_scalars.with_errors`
    errors: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    # rounds, points: rounds of further runs in the posterior, and runs of each
    rounds: int = 2
    points: int = 16
    fine_pairs: int = 0  # members that are repeated on cells of half the size; 0 for none
    rows: int = 256  # rows of the table of the posterior
    # "area", or "boundary" for the distances of the modelled boundary from the parts of the outline in place of the area
    outline: str = "area"

    def require(self) -> None:
        """Raise ConfigError if the pairs are too few for a covariance."""
        if self.fine_pairs and self.fine_pairs < FEWEST_PAIRS:
            raise ConfigError(f"--fine-pairs {self.fine_pairs}: their covariance needs {FEWEST_PAIRS}; write 16, or 0 for none")


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
    """An observed event, and the runs that model it."""

    site: "Site"
    prior: Prior
    observed: "Observations"
    measure: Measure
    scalars: list[ObservedScalar]  # what counts of the observations
    members: "list[Member]" = field(default_factory=list)  # runs so far
    modelled: list[Scalars] = field(default_factory=list)  # scalars of each
    left_out: dict[str, str] = field(default_factory=dict)  # scalars that do not count, and why

    @classmethod
    def of(cls, site: "Site", choices: CalibrationChoices) -> "Event":
        """The event of a site, with the standard errors and without the scalars that the choices state.

        Raises ConfigError or InputError if the site samples no parameter, has fewer than 16 members or no observation, or one
        cannot be used.
        """
        event = cls.measured(site, choices.outline)
        event.scalars = with_errors(event.scalars, choices.errors, choices.without)
        return event

    @classmethod
    def measured(cls, site: "Site", outline: str = "area") -> "Event":
        """The event of a site with the default standard errors; see :attr:`CalibrationChoices.outline`."""
        _require(site)
        prior, observed = Prior.of(site), site.files.observations().require()
        assert observed is not None
        terrain, masses = site.terrain(), site.masses()
        threshold = min(site.settings.hazard.thickness_thresholds)
        measure = Measure.of(observed, terrain, thickness_of(masses, terrain), threshold, outline == "boundary")
        cell = max(*terrain.cell_size, *grid_spacing(site.settings, masses)[:2])
        return cls(site, prior, observed, measure, observed_scalars(measure.of_event(), cell))

    def scalars_of(self, member: Member, results: Path) -> Scalars:
        """Scalars of a member in a results folder."""
        file, releases = member.file(results), self.site.releases()
        return self.measure.of_member(*member_flow(file, self.observed, releases, member.parameters))

    def add(self, members: "Sequence[Member]", results: Path) -> None:
        """Add runs."""
        self.members += members
        self.modelled += [self.scalars_of(member, results) for member in members]

    def run_ensemble(self, study: Study, **how: Any) -> int:
        """Run the members of the ensemble of the site that have no result, and add all; returns the exit code.

        Raises
        ------
        InputError, PartialEnsembleError
            If fewer than 16 have a result.
        """
        outcome = hazard_map.run(study.site.file, study.results, ("ensemble",), **how)
        study.refresh()
        self.add(finished_members(study), study.results)
        if len(self.members) < FEWEST:
            raise InputError(f"{study.results / 'members'}: {len(self.members)} members have a result; {FEWEST} are needed")
        return outcome.exit_code

    def run_further(self, points: np.ndarray, number: int, runner: Runner, folder: Path) -> None:
        """Run and add members at points (n, parameters) of the cube, in the round of a number."""
        self.add(runner.run(self.site, _design(self, points, number), folder), folder)

    @property
    def points(self) -> np.ndarray:
        """Points (members, parameters) of the runs in the cube."""
        return self.points_of(self.members)

    def points_of(self, members: "Sequence[Member]") -> np.ndarray:
        """Points (members, parameters) of members in the cube."""
        return self.prior.coordinates(np.array([[one.parameters[name] for name in self.prior.names] for one in members]))

    def likelihood(self) -> tuple[Likelihood, list[ObservedScalar]]:
        """Likelihood of the scalars whose emulators predict members that they have not seen, and these scalars.

        Raises InputError if there is none.
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
    if emulator.q2 < (least := kind_of(scalar.name).least_q2):
        return (
            f"its emulator predicts {max(emulator.q2, 0.0):.2f} of the variance of members that it has not seen, {least:g} is "
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

    Raises ConfigError, InputError, PartialEnsembleError or BudgetError: see :class:`Event`; if no member has run, or further
    members exceed the budget.
    """
    choices.require()
    study = Study.open(site_path, out, workers, retry_failed, device, threads)
    event, folder = Event.of(study.site, choices), study.results / FOLDER
    how = {"workers": workers, "threads": threads, "device": device, "retry_failed": retry_failed}
    code = event.run_ensemble(study, **how)
    runner, files = Runner(workers, study.threads, retry_failed), [one.file(study.results).name for one in event.members]
    likelihood, scalars = _refined(event, choices, runner, folder)
    if choices.fine_pairs:
        error = grid_error_of(event, likelihood, scalars, choices.fine_pairs, runner, folder / FINE)
        likelihood = replace(likelihood, grid_error=error)
    posterior = sampled_posterior(likelihood)
    record = {
        **event_record(event, likelihood, scalars, posterior.points),
        "validation": validated(likelihood, scalars),
        **posterior_record(posterior, choices),
        "files_of_the_ensemble": files,
    }
    columns = {name: k for k, name in enumerate(posterior.prior.names)}
    state(record, write(folder, posterior, record, choices.rows, {TABLE: columns}))
    return code


def state(record: Mapping[str, Any], paths: Sequence[Path]) -> None:
    """Print the lines of a record, and log what was written."""
    for line in lines(dict(record)):
        log.output().print(line, markup=False, highlight=False, soft_wrap=True)
    for path in paths:
        LOGGER.info("wrote %s", path)


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
        event.run_further(np.array(known[number]), number, runner, folder)
        likelihood, scalars = event.likelihood()
    return likelihood, scalars


def _design(event: Event, points: np.ndarray, number: int) -> Design:
    """Members at points (n, parameters) of the cube, with seeds that no other round has."""
    ensemble, values = event.site.settings.ensemble, event.prior.values(points)
    first = ensemble.members + number * len(points)
    seeds = [member_seed(ensemble.seed, first + k) for k in range(len(points))]
    return Design({name: values[:, k].tolist() for k, name in enumerate(event.prior.names)}, seeds)


def grid_error_of(
    event: Event, likelihood: Likelihood, scalars: Sequence[ObservedScalar], count: int, runner: Runner, results: Path
) -> GridError:
    """Error of the grid from the most likely members, repeated on cells of half the size.

    Raises InputError if fewer than 8 of them have a result.
    """
    order = np.argsort(-likelihood.log_density(event.points.clip(1e-6, 1.0 - 1e-6)))[:count]
    chosen = [event.members[k] for k in order]
    spacing = grid_spacing(event.site.settings, event.site.masses())
    halved = event.site.settings.simulation.with_cell_size([0.5 * size for size in spacing])
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
