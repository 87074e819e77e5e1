"""Series at probes of one member or of the ensemble; members without them are run."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runout import log
from runout.errors import ConfigError
from runout.io.probe_files import SITE_FILES, SITE_STEM
from runout.processes.interrupt import at_end
from runout.processes.lifetime import end_workers
from runout.workflow.probe_products import PICTURES, PROBES, attributes_of, remove_others, write_pictures, write_series
from runout.workflow.study import PLAN, Study

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.hazard.members import Ensemble

OF_SITE, OF_ENSEMBLE = SITE_STEM.split("_")  # beginnings of the names of files
HAZARD = next(stage for stage in PLAN if stage.name == "hazard")  # writes the percentiles at the probes of site.yaml
LOGGER = logging.getLogger("runout.probes")
ALL = "all"


@dataclass(frozen=True)
class ProbeChoices:
    """What ``runout probe`` was asked for."""

    # points, cross_sections: vector files; without both the probes of site.yaml count
    points: Path | None = None
    cross_sections: Path | None = None
    # points_layer, cross_sections_layer: their layers
    points_layer: str | None = None
    cross_sections_layer: str | None = None
    interval: float | None = None  # time between two values of a series [s]
    member: int | None = None  # number of a member
    members: str | None = None  # "all": run the members that have no series at these probes
    picture: str = "png"  # "png" or "svg"

    @property
    def has_files(self) -> bool:
        """Whether the probes are not those of site.yaml."""
        return self.points is not None or self.cross_sections is not None

    @property
    def stem(self) -> str:
        """Beginning of the names of the files."""
        named = [path.stem for path in (self.points, self.cross_sections) if path is not None]
        return "_".join(dict.fromkeys(named)) or OF_SITE

    def require_consistent(self) -> None:
        """Raise ConfigError for choices that contradict each other."""
        if self.members not in (None, ALL):
            raise ConfigError(f"--members is {self.members!r}; write all, or --member N for one")
        if self.members and self.member is not None:
            raise ConfigError(f"--member {self.member} and --members all are both given; remove one of them")
        if self.picture not in PICTURES:
            raise ConfigError(f"--picture is {self.picture!r}; choose one of {', '.join(PICTURES)}")


def run(site_path: Path | str, out: Path | None, choices: ProbeChoices, **how: Any) -> list[Path]:
    """Write series at probes of a site to ``results/probes``; returns the paths.

    Parameters
    ----------
    site_path, out : Path or str
        Site folder or its site.yaml; results folder.
    choices : ProbeChoices
    how
        ``workers``, ``threads`` and ``device`` of :meth:`runout.workflow.study.Study.open`.

    Raises
    ------
    ConfigError, PartialEnsembleError, StorageError
        If probes cannot be used (all problems at once), no member has series, or a file cannot be read or written.
    """
    choices.require_consistent()
    study = with_probes(Study.open(site_path, out, **how), choices)
    probes = study.site.files.probes()
    for change in probes.changes if probes else ():
        LOGGER.warning("%s", change)
    single = member_of(study.site, choices)
    study = replace(study, part=None if single is None else range(single, single + 1))
    if choices.has_files or choices.members or single is not None:
        run_missing(study)
    elif study.why_stale(HAZARD) is None:
        LOGGER.info("up to date: %s*", study.results / PROBES / SITE_STEM)
        return _present(study.results, choices.picture)
    ensemble = finished(study)
    label = OF_ENSEMBLE if single is None else f"member_{single:04d}"
    return write_products(study.site, study.results, ensemble, f"{choices.stem}_{label}", single, choices.picture)


def _present(results: Path, picture: str) -> list[Path]:
    """Files of the percentiles at the probes of site.yaml, after writing figures if they are to be of another format."""
    from runout.io import netcdf

    if picture != "png":
        datasets = {group: netcdf.read(results / name) for group, name in SITE_FILES.items() if (results / name).is_file()}
        write_pictures(datasets, results / PROBES, SITE_STEM, picture)
    return sorted(path for path in (results / PROBES).iterdir() if path.name.startswith(f"{SITE_STEM}_"))


def with_probes(study: Study, choices: ProbeChoices) -> Study:
    """The study with the probes that are asked for; ConfigError if there are none."""
    from runout.config.probes import probe_settings

    site = study.site
    if choices.has_files:
        layers = {"points_layer": choices.points_layer, "cross_sections_layer": choices.cross_sections_layer}
        wanted = probe_settings(site.folder, choices.points, choices.cross_sections, **layers, interval=choices.interval)
        return replace(study, site=site.with_settings(probes=wanted))
    if site.settings.probes is None:
        raise ConfigError(f"{site.file}: states no probes; add probes: to it, or give --points or --cross-sections")
    if choices.interval is not None:
        raise ConfigError(f"--interval {choices.interval:g} without a file; state probes.interval in {site.file}")
    return study


def member_of(site: "Site", choices: ProbeChoices) -> int | None:
    """Number of the member that is asked for; None for the ensemble."""
    from runout.ensemble.member import plan_members

    if choices.members or (choices.member is None and not choices.has_files):
        return None
    number, count = choices.member or 0, len(plan_members(site))
    if not 0 <= number < count:
        raise ConfigError(f"member is {number}; the site has members 0 to {count - 1}, see `runout status`")
    return number


def run_missing(study: Study) -> None:
    """Run the members that have no series at these probes."""
    from runout.workflow.check import require_sound
    from runout.workflow.hazard_map import make_members

    if not study.left:
        return
    with log.muted():
        require_sound(study.site)
    left, count = study.left, len(study.standings)
    which = f"member {left[0]} has" if study.part else f"{len(left)} of {count} members have"
    LOGGER.info("%s no series at these probes and will be run; other members stay as they are", which)
    with log.to_file(study.results / "run.log"), at_end(end_workers):
        make_members(study)
        study.require_inputs()
        study.keep()


def other_members(study: Study) -> str:
    """Sentence on members that are done but lack the series of the probes of site.yaml; empty if there are none."""
    if study.site.settings.probes is None or not study.left:
        return ""
    without = replace(study, site=study.site.with_settings(probes=None))
    count = sum(standing.state == "done" for standing in without.standings)
    if not count:
        return ""
    text = f"{count} members are done without these probes; they are kept, and run again to record series"
    return f"{text} (`runout profile` needs no new run)"


def finished(study: Study) -> "Ensemble":
    """The members with series; a warning names those without."""
    from runout.hazard.members import Ensemble

    report = study.ensemble_report
    states = dict.fromkeys(report.valid, "done") | dict.fromkeys(report.failed, "failed")
    ensemble = Ensemble.of(study.results, study.members, states)
    if study.part is None and len(ensemble.files) < len(ensemble.table):
        LOGGER.warning("%s", ensemble.statement())
    return ensemble


def write_products(
    site: "Site", results: Path, ensemble: "Ensemble", stem: str, member: int | None, picture: str = "png"
) -> list[Path]:
    """Write the files of the series of a member, or of the percentiles over all; returns the paths."""
    from runout.hazard.probe_series import ensemble_series, member_series

    files = list(ensemble.files.values())
    attributes = attributes_of(site)
    if member is None:
        datasets, of = ensemble_series(files, ensemble.weights), ensemble.statement()
    else:
        datasets, of = member_series(files[0]), f"member {member}"
        attributes["realization"] = member
    attributes["ensemble"] = of
    paths = write_series(datasets, results / PROBES, stem, attributes, f"{site.name}: series at probes, {of}", picture)
    LOGGER.info("wrote %d files: %s*", len(paths), results / PROBES / stem)
    return paths


def write_of_site(study: Study) -> Sequence[Path]:
    """Files of the percentiles at the probes of site.yaml, in the stage hazard; without probes earlier ones are removed."""
    if study.site.settings.probes is None:
        remove_others(study.results / PROBES, SITE_STEM)
        return ()
    return write_products(study.site, study.results, finished(study), SITE_STEM, None)
