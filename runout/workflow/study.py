"""One site with its results folder: state of members and stages."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

from runout.errors import PartialEnsembleError, StorageError
from runout.io.fingerprint import Unchanged
from runout.io.places import SECOND_GRID, require_own_results
from runout.io.provenance import checksum
from runout.workflow.stages import Stage, StageRecord, digest_files, stage_key

if TYPE_CHECKING:
    import pandas as pd

    from runout.backends.protocol import Compilation
    from runout.config.site import Site
    from runout.ensemble.cluster import Cluster
    from runout.ensemble.run import EnsembleReport
    from runout.ensemble.status import Standing
    from runout.ensemble.workers import Standby
    from runout.ensemble.written import Written
    from runout.model.terrain import Terrain
    from runout.workflow.growth import Growth

HEAD = ("name", "title", "description", "metadata")
FLOW = (
    *("terrain", "structures", "release", "material", "basal_friction_angle_deg", "basal_friction", "simulation", "ensemble"),
    "probes",
)
PLAN = (
    Stage("terrain", "read and prepare the DEM", ("name", "terrain")),
    Stage("release", "read and check the release", ("name", "terrain", "release")),
    Stage("ensemble", "run the members", FLOW),
    Stage("hazard", "aggregate the members into maps", (*HEAD, *FLOW, "hazard", "observations")),
    Stage("report", "write the report", (*HEAD, *FLOW, "hazard", "observations", "report", "budget")),  # sections that it prints
)
STAGES = tuple(stage.name for stage in PLAN)


@dataclass
class Study:
    """A site and its results folder; ``part`` restricts it to a range of its members, which a ``cluster`` may compute."""

    site: "Site"
    results: Path
    workers: int | None = None
    retry_failed: bool = False
    threads: int | None = None
    part: range | None = None
    cluster: "Cluster | None" = None
    compilation: "Compilation | None" = field(default=None, repr=False)
    standby: "Standby | None" = field(default=None, repr=False)
    _watched: Unchanged | None = field(default=None, init=False, repr=False)
    _watched_observations: Unchanged | None = field(default=None, init=False, repr=False)

    @classmethod
    def open(
        cls,
        site_path: Path | str,
        out: Path | None = None,
        workers: int | None = None,
        retry_failed: bool = False,
        device: str | None = None,
        threads: int | None = None,
        changes: Sequence[str] = (),
    ) -> "Study":
        """Study of a site folder or site.yaml; results go to ``out``, by default to ``results`` in the site folder.

        ``device`` overrides that of site.yaml (see :meth:`runout.config.site.Site.on_device`), and ``changes`` its settings
        (:func:`runout.config.site.read_site`).
        """
        from runout.config.site import read_site

        site = read_site(Path(site_path), changes)
        study = cls.of(site if device is None else site.on_device(device), out)
        return replace(study, workers=workers, retry_failed=retry_failed, threads=threads or site.settings.simulation.threads)

    @classmethod
    def of(cls, site: "Site", out: Path | None = None) -> "Study":
        """The study of a site; its results go to ``out``, or to ``results`` of the site."""
        results = Path(out) if out else site.folder / "results"
        require_own_results(results)
        return cls(replace(site, files=site.files.recorded_in(results / "inputs.json")), results)

    @cached_property
    def record(self) -> StageRecord:
        """Keys of the finished stages."""
        return StageRecord(self.results)

    @cached_property
    def inputs(self) -> str:
        """Checksum of all input files at the first access."""
        self._watched = Unchanged(self.site.inputs())
        names = (path.name for path in self._watched.seen)
        return checksum([list(zip(names, self.site.files.checksums(), strict=True))])

    @cached_property
    def observations(self) -> list[tuple[str, str]]:
        """Names and checksums of the files of the observations at the first access; maps and scores depend on them."""
        from runout.config.site_files import OF_PRODUCTS

        paths = self.site.files.paths(*OF_PRODUCTS)
        self._watched_observations = Unchanged(paths)
        return list(zip((path.name for path in paths), self.site.files.checksums(*OF_PRODUCTS), strict=True))

    def require_inputs(self) -> None:
        """Raise InputError if an input has changed since the first access to :attr:`inputs` or :attr:`observations`."""
        for watched in (self._watched, self._watched_observations):
            if watched:
                watched.require()

    @cached_property
    def terrain(self) -> "Terrain":
        """The prepared terrain."""
        return self.site.terrain()

    @cached_property
    def members(self) -> "pd.DataFrame":
        """Table of the members that count: parameters, weights, seeds, files."""
        from runout.ensemble.member import planned_table

        return planned_table(self.site, self.growth.members if self.growth else None)

    @cached_property
    def standings(self) -> "list[Standing]":
        """State and reason of every member that counts at the first access; :meth:`refresh` updates it."""
        if self.part is not None:
            return [one for one in self.possible if one.member.number in self.part]
        return self.possible[: self.growth.members] if self.growth else self.possible

    @cached_property
    def possible(self) -> "list[Standing]":
        """State and reason of every member, also of those that an ensemble with a tolerance may not need."""
        from runout.ensemble.status import standings

        return standings(self.site, self.results)

    @cached_property
    def growth(self) -> "Growth | None":
        """Growth of an ensemble with a tolerance; None for others."""
        if getattr(self.site.settings.ensemble, "tolerance", None) is None:  # most sites; the import takes a while
            return None
        from runout.workflow.growth import asked, known_growth

        start = asked(self.site)
        assert start is not None
        failed = [one.member.number for one in self.possible if one.state == "failed"]
        return known_growth(start, self.site, self.results, [one.member for one in self.possible], failed)

    def refresh(self) -> None:
        """Read the state of the members again."""
        for name in ("standings", "possible", "growth", "members", "written", "second"):
            self.__dict__.pop(name, None)

    @cached_property
    def written(self) -> "Written":
        """Record of the checksums of the files of the members."""
        from runout.ensemble.written import Written

        return Written(self.results)

    @property
    def unused(self) -> list[Path]:
        """Files of members that the present settings do not use."""
        from runout.ensemble.member import plan_members
        from runout.ensemble.written import unused_files

        return unused_files(self.results, plan_members(self.site))

    def member_files(self, state: str) -> list[Path]:
        """Files of the members of a state."""
        return [standing.member.file(self.results) for standing in self.standings if standing.state == state]

    @property
    def failed(self) -> dict[int, str]:
        """Members that failed, with the reason."""
        return {standing.member.number: standing.reason for standing in self.standings if standing.state == "failed"}

    @property
    def left(self) -> list[int]:
        """Members to simulate: not run yet, changed, or failed for a temporary reason."""
        return [standing.member.number for standing in self.standings if self._is_left(standing)]

    @property
    def left_at_most(self) -> list[int]:
        """Members to simulate if an ensemble with a tolerance grows to its largest size."""
        if self.growth is None or self.growth.finished or self.part is not None:
            return self.left
        return [standing.member.number for standing in self.possible if self._is_left(standing)]

    def _is_left(self, standing: "Standing") -> bool:
        from runout.ensemble.status import Failure

        if standing.state != "failed" or self.retry_failed:
            return standing.state != "done"
        failure = Failure.read(standing.member.failure_file(self.results))
        return not (failure and failure.lasting)

    @cached_property
    def second(self) -> "Study":
        """The study of the same members on the second grid (:mod:`runout.hazard.second_grid`)."""
        from runout.hazard.second_grid import on_second_grid

        study = Study.of(on_second_grid(self.site, len(self.standings)), self.results / SECOND_GRID)
        return replace(study, workers=self.workers, threads=self.threads, retry_failed=self.retry_failed)

    def _on_second_grid(self) -> list[str]:
        """Checksums of the members that are done on the second grid; the maps depend on them."""
        if self.part is not None or not (self.results / SECOND_GRID / "members").is_dir():
            return []
        return [self.second.written.checksum(file) for file in self.second.member_files("done")]

    @property
    def ensemble_report(self) -> "EnsembleReport":
        """Report of an ensemble with nothing to simulate; raises PartialEnsembleError if no member is done."""
        from runout.ensemble.run import EnsembleReport

        done = tuple(standing.member.number for standing in self.standings if standing.state == "done")
        if not done:
            first = next(iter(self.failed.items()), None)
            unfinished = f"no member is done ({self.standings[0].reason})"
            why = f"all {len(self.failed)} members failed; member {first[0]}: {first[1]}" if first else unfinished
            remedy = "mend the cause" if first else f"run `runout ensemble {quote(str(self.site.folder))}` first"
            raise PartialEnsembleError(f"{self.results / 'members'}: {why}; {remedy}")
        return EnsembleReport(skipped=done, failed=self.failed, growth=self.growth.statement() if self.growth else "")

    def require_maps(self) -> None:
        """Raise StorageError unless the hazard stage is up to date, so that maps and settings of a report agree."""
        reason = self.why_stale(next(stage for stage in PLAN if stage.name == "hazard"))
        if reason:
            raise StorageError(f"{self.results / 'hazard.nc'}: {reason}; run `runout hazard {quote(str(self.site.folder))}` first")

    def keep(self) -> None:
        """Keep for the next run what this one found out about inputs."""
        self.site.files.known.save()

    def key(self, stage: Stage) -> str:
        """Key of a stage for the present state of the site and its members."""
        return stage_key(stage, self.site.computed(), self.inputs, self._start(stage.name))

    def _start(self, stage: str) -> Any:
        """State that a stage depends on besides inputs and configuration: the members, and the files of the report."""
        if stage not in ("hazard", "report"):
            return None
        states = {standing.member.number: standing.state for standing in self.standings}
        members = [states, [self.written.checksum(file) for file in self.member_files("done")]]
        if second := self._on_second_grid():
            members.append(second)
        error = self.results / "convergence.json"
        bars = digest_files([error] if error.is_file() else [])
        observed = [self.observations] if self.observations else []
        if stage == "hazard":  # scores have error bars
            return [*members, observed, bars] if observed else members
        own = [self.results / "sensitivity" / "sensitivity.json", self.results / "calibration" / "calibration.json"]
        beside = [path.with_name("calibration.json") for path in self.site.files.paths("design")]
        shown = [path for path in (*own, *beside) if path.is_file()]
        return [
            members,
            self.record.checksums("hazard"),
            bars,
            *observed,
            *([digest_files(shown)] if shown else []),
        ]

    def why_stale(self, stage: Stage) -> str | None:
        """Reason why a stage has to be run; None if it is up to date."""
        if stage.name != "ensemble":
            return self.record.why_stale(stage.name, self.key(stage))
        left = len(self.left)
        if left:
            return f"{left} of {len(self.standings)} members to simulate"
        if self.growth and not self.growth.finished and self.part is None:
            return f"the sampling error of {self.growth.members} members is not known yet"
        unknown = sum(not self.written.has(file) for file in self.member_files("done"))
        return f"{unknown} of {len(self.standings)} members to enter into the record" if unknown else None
