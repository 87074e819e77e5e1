"""The main workflow: terrain -> release -> ensemble -> hazard -> report; stages that are up to date are skipped."""

import logging
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runout import log
from runout.config.hazard import require_outlines, written_alone
from runout.errors import ConfigError, ExitCode, PartialEnsembleError
from runout.io.lock import exclusive
from runout.io.part import remove_stale
from runout.model.facts import as_html, as_text
from runout.processes.imports import imported_meanwhile
from runout.processes.interrupt import at_end
from runout.processes.lifetime import end_workers
from runout.workflow.compilation import compile_ahead
from runout.workflow.stages import Stage
from runout.workflow.study import PLAN, STAGES, Study

if TYPE_CHECKING:
    import pandas as pd

    from runout.config.site import Site
    from runout.ensemble.cluster import Cluster

LOGGER = logging.getLogger("runout.hazard_map")
OF_PRODUCTS = (
    *("netCDF4", "xarray", "rasterio", "geopandas", "scipy.stats", "pystac"),
    *("matplotlib.figure", "matplotlib.backends.backend_agg", "jinja2"),
    *("runout.hazard.products", "runout.report.html"),
)  # modules of the stages hazard and report


@dataclass(frozen=True)
class Outcome:
    """Result of a run: stages done and skipped, and failed members with their reasons."""

    done: tuple[str, ...]
    skipped: tuple[str, ...]
    failed: dict[int, str] = field(default_factory=dict)

    @property
    def exit_code(self) -> ExitCode:
        """PARTIAL_ENSEMBLE if members failed, else OK."""
        return ExitCode.PARTIAL_ENSEMBLE if self.failed else ExitCode.OK

    def _facts(self) -> dict[str, str]:
        stages = {"done": ", ".join(self.done) or "none", "up to date": ", ".join(self.skipped) or "none"}
        return {**stages, "failed members": str(len(self.failed))} | {f"member {n} failed": why for n, why in self.failed.items()}

    def __repr__(self) -> str:
        return as_text("Outcome", self._facts())

    def _repr_html_(self) -> str:
        return as_html("Outcome", self._facts())


def run(
    site_path: Path | str,
    out: Path | None = None,
    stages: Sequence[str] = STAGES,
    *,
    workers: int | None = None,
    threads: int | None = None,
    force: bool = False,
    retry_failed: bool = False,
    device: str | None = None,
    members: str | None = None,
    cluster: "Cluster | None" = None,
    changes: Sequence[str] = (),
    budget: str | None = None,
) -> Outcome:
    """Run the stages of a site that are not up to date, in their order.

    Parameters
    ----------
    site_path, out : Path or str
        Site folder or its site.yaml; results folder, ``results`` of the site when None.
    stages : sequence of str
        Names from :data:`STAGES`.
    workers : int or None
        Members that run at the same time; one per core if None.
    threads : int or None
        Threads of each member; if None those of site.yaml, else the cores divided by the members at the same time.
    force : bool
        Run the stages even if they are up to date; finished members are not run again.
    retry_failed : bool
        Also repeat members whose failure is permanent.
    device : str or None
        "cpu", "cuda:N" or "auto" instead of what site.yaml says.
    members : str or None
        Range of members such as ``0:100``: the stage ``ensemble`` runs only these (see :mod:`runout.ensemble.member`).
    cluster : Cluster or None
        Dask cluster that computes the members. The budget of the site is for this machine and does not count then.
    changes : sequence of str
        Settings in the place of those of site.yaml, each ``KEY=VALUE``; they need ``out``, so that other results stay.
    budget : str or None
        Time such as "30min" for which cells and number of members are chosen (:mod:`runout.workflow.time_budget`).

    Raises
    ------
    InputError, DeviceError, BudgetError, PartialEnsembleError
        If an input cannot be used, the device does not exist, the remaining members exceed the budget, or no member is done.
    """
    if changes and out is None:
        raise ConfigError("--set is given without --out; name a folder for these results, so that those of site.yaml stay")
    try:
        if cluster:  # other machines have other working folders
            site_path, out = Path(site_path).absolute(), Path(out).absolute() if out else None
        opened = partial(Study.open, site_path, out, workers, retry_failed, device, threads)
        study = replace(opened(changes), cluster=cluster or None)
    except ConfigError:
        if "ensemble" in stages:
            _inspected(Path(site_path), changes)  # its message lists the problems of the inputs as well
        raise
    if budget is not None:
        study = opened([*changes, *_fitting(study, budget, changes)])
    if members is not None:
        return _run_part(study, members)
    return run_study(study, stages, force)


def _fitting(study: Study, budget: str, changes: Sequence[str]) -> tuple[str, ...]:
    """Settings of cells and members that fit into a time."""
    from runout.workflow.time_budget import TimeBudget

    if study.cluster:
        raise ConfigError("--budget is a time on this machine, and a cluster is given too; remove one of the two")
    limit = TimeBudget.of(study.site, budget, study.results, changes, workers=study.workers)
    _inspected(study.site)
    with log.to_file(study.results / "run.log"):
        return limit.chosen()


def run_second_grid(site_path: Path, out: Path | None = None, device: str | None = None) -> Outcome:
    """Run a site, then its members on the cells of the second grid, and make the maps again, with their numerical errors.

    What is up to date is not run again. Errors as of :func:`run`; StorageError if a member has no result on the second grid.
    """
    study = Study.open(site_path, out, device=device)
    run_study(study, ("terrain", "release", "ensemble"))
    cells = study.second.site.resolved()["simulation"]["cell_size"]
    LOGGER.info("second grid: %d members on cells of %s m", len(study.standings), cells)
    run_study(study.second, ("ensemble",))
    failed = {number: why for number, why in study.second.failed.items() if number not in study.failed}
    if failed:
        number, why = next(iter(failed.items()))
        raise PartialEnsembleError(f"member {number} failed on the second grid, so that no cell has a numerical error: {why}")
    return run_study(study)


def run_study(study: Study, stages: Sequence[str] = STAGES, force: bool = False) -> Outcome:
    """Run the stages of a study that are not up to date; arguments and errors as of :func:`run`."""
    with log.to_file(study.results / "run.log"), at_end(partial(remove_stale, study.results)), at_end(end_workers):
        remove_stale(study.results)
        return _run(study, [stage for stage in PLAN if stage.name in stages], force)


def _run_part(study: Study, members: str) -> Outcome:
    """Run a range of members; other jobs may run other ranges in the same results folder at the same time."""
    from runout.ensemble.member import member_range

    study = replace(study, part=member_range(members, study.site.settings.ensemble.size))
    with log.to_file(study.results / f"run_{members.replace(':', '_')}.log"), at_end(end_workers):
        return _run(study, [stage for stage in PLAN if stage.name == "ensemble"], force=False)


def _run(study: Study, planned: Sequence[Stage], force: bool) -> Outcome:
    stages = _possible(study, planned)
    with ExitStack() as processes:
        if "ensemble" in [stage.name for stage in stages] and study.left and not study.cluster:
            _start_ahead(study, processes)
        _require_sound(study, stages)
        with log.progress_of_stages() as begin:
            done = _run_stages(study, stages, force, begin)
    if not done:
        LOGGER.info("nothing to do: %s up to date in %s", ", ".join(stage.name for stage in stages), study.results)
    study.keep()
    if "report" in done:
        LOGGER.info("open the report in a browser: %s", study.results / "report.html")
    return _outcome(study, stages, done)


def _possible(study: Study, stages: Sequence[Stage]) -> Sequence[Stage]:
    """The stages without the report where the site asks for ``hazard.nc`` alone; ConfigError if only the report is asked for."""
    if not written_alone(study.site) or "report" not in [stage.name for stage in stages]:
        return stages
    if len(stages) == 1:
        require_outlines(study.site)
    LOGGER.info("no report: hazard.formats is netcdf, without the outlines and rasters that it shows")
    return [stage for stage in stages if stage.name != "report"]


def _start_ahead(study: Study, processes: ExitStack) -> None:
    """Start to compile the kernels of the members, or the processes that compute them, while this one reads the inputs."""
    from runout.ensemble.workers import Standby, share_of

    study.compilation = compile_ahead(study.site)
    stated = study.site.settings.simulation
    if study.compilation or stated.backend != "scan":
        return
    share = share_of(stated.device, len(study.left), study.workers, study.threads)
    if not share.in_process:
        study.standby = processes.enter_context(Standby(share.workers, share.threads))


def _run_stages(study: Study, stages: Sequence[Stage], force: bool, begin: Callable[[str], None]) -> tuple[str, ...]:
    """Names of the stages that were not up to date, after running them; ``begin`` is called with the name of each."""
    done = []
    for number, stage in enumerate(stages, 1):
        reason = study.why_stale(stage) or ("asked for by --force" if force and stage.name != "ensemble" else None)
        if reason is None:
            LOGGER.debug("%s: up to date", stage.name)
            continue
        LOGGER.info("%s: %s (%s)", stage.name, stage.purpose, reason)
        begin(f"stage {number} of {len(stages)}, {stage.name}" if len(stages) > 1 else stage.name)
        started = time.perf_counter()
        with imported_meanwhile(OF_PRODUCTS) if stage.name == "ensemble" and _waits_for_workers(study, stages) else nullcontext():
            _make(study, stage)
        LOGGER.info("%s: done in %.1f s", stage.name, time.perf_counter() - started, extra={"stage": stage.name})
        done.append(stage.name)
    return tuple(done)


def _waits_for_workers(study: Study, stages: Sequence[Stage]) -> bool:
    """Whether other processes compute the members and the stages of the products follow."""
    from runout.ensemble.workers import share_of

    if study.part is not None or not study.left or "hazard" not in [stage.name for stage in stages]:
        return False
    device = study.site.settings.simulation.device
    return bool(study.cluster) or not share_of(device, len(study.left), study.workers, study.threads).in_process


def _require_sound(study: Study, stages: Sequence[Stage]) -> None:
    """Raise ConfigError with all problems that `runout check` lists, if the run is to simulate any member."""
    if "ensemble" not in [stage.name for stage in stages] or not any(study.why_stale(stage) for stage in PLAN[:3]):
        return
    _inspected(study.site)


def _inspected(site: "Site | Path", changes: Sequence[str] = ()) -> None:
    from runout.workflow.check import require_sound

    with log.muted():
        require_sound(site, changes)


def _make(study: Study, stage: Stage) -> None:
    """Run a stage. It is not in the record while it runs, nor after it was killed; a range of members never is."""
    if study.part is not None:
        make_members(study)
        study.require_inputs()
        return
    with exclusive(study.results, f".locks/{stage.name}"):
        study.record.withdraw(stage.name)
        files = MAKERS[stage.name](study)
        study.require_inputs()
        study.record.finished(stage.name, study.key(stage), files)


def _outcome(study: Study, stages: Sequence[Stage], done: tuple[str, ...]) -> Outcome:
    concerns_members = any(stage.name not in ("terrain", "release") for stage in stages)
    failed = study.failed if concerns_members else {}
    for member, reason in failed.items():
        LOGGER.warning("member %d of %d failed: %s", member, len(study.standings), reason)
    return Outcome(done, tuple(stage.name for stage in stages if stage.name not in done), failed)


def make_terrain(study: Study) -> Iterable[Path]:
    """Write the prepared elevation to ``terrain.nc``."""
    from runout.io import netcdf

    maps = netcdf.map_dataset(study.terrain, {"elevation": study.terrain.elevation}, title=f"{study.site.name}: terrain")
    return [netcdf.write(maps, study.results / "terrain.nc")]


def make_release(study: Study) -> Iterable[Path]:
    """Write the thickness of all releases together to ``release.nc``."""
    from runout.io import netcdf
    from runout.model.release import thickness_of
    from runout.release.statements import start_sentences, statement

    releases = study.site.data().releases
    for said in [*map(statement, releases), *start_sentences(releases, study.site.settings.ensemble.fail_apart)]:
        LOGGER.info("%s", said)
    thickness = study.terrain.where_known(thickness_of(releases, study.terrain))
    maps = netcdf.map_dataset(study.terrain, {"release_thickness": thickness}, title=f"{study.site.name}: release")
    return [netcdf.write(maps, study.results / "release.nc")]


def make_members(study: Study) -> Iterable[Path]:
    """Run the remaining members; results go to ``members/``."""
    from runout.ensemble.run import EnsembleReport, run_ensemble
    from runout.workflow.growth import grow
    from runout.workflow.plan import member_bytes, require_budget
    from runout.workflow.probes import other_members

    workers = study.workers
    if said := other_members(study):
        LOGGER.warning("%s", said)
    if study.compilation and study.compilation.is_running:
        with log.progress("compiling the kernels") as bar:
            study.compilation.wait(bar)
    if study.cluster is None:
        workers = require_budget(study.site, study.left_at_most, workers=workers)
    with log.progress("") as bar:

        def run(part: range | None) -> EnsembleReport:
            return run_ensemble(
                study.site,
                study.results,
                workers=workers,
                threads=study.threads,
                progress=lambda state: state.show(bar),
                retry_failed=study.retry_failed,
                part=part,
                cluster=study.cluster,
                member_bytes=member_bytes(study.site, study.left_at_most) if study.cluster else 0.0,
                standby=study.standby,
            )

        if study.part is None:
            grow(study.site, study.results, run)
        else:
            run(study.part)
    study.refresh()
    return []


def make_maps(study: Study) -> Iterable[Path]:
    """Aggregate finished members into hazard.nc, members.nc, maps/, outlines.gpkg and run.json, and series into probes/."""
    from runout.hazard.products import write_products
    from runout.workflow.probes import write_of_site

    paths = write_products(study.site, study.results, study.members, study.ensemble_report)
    return [*paths, *write_of_site(study)]


def make_report(study: Study) -> Iterable[Path]:
    """Write report.html."""
    from runout.report.html import write_report

    study.require_maps()
    return [write_report(study.site, study.results, _stills(study))]


def _stills(study: Study) -> "Callable[[pd.DataFrame], dict[str, Any]] | None":
    """What draws members in three dimensions; None unless site.yaml asks for it."""
    stated = study.site.settings.report
    if stated is None or stated.stills == "none":
        return None
    from runout.workflow.stills import member_stills

    return partial(member_stills, study, chosen=stated.stills)


MAKERS: dict[str, Callable[[Study], Iterable[Path]]] = {
    "terrain": make_terrain,
    "release": make_release,
    "ensemble": make_members,
    "hazard": make_maps,
    "report": make_report,
}
