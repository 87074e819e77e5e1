"""Series at probes and profiles along lines, of one member or of the ensemble; members without series at the probes are run."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout import log
from runout.errors import ConfigError
from runout.io.probe_files import SITE_FILES, SITE_STEM
from runout.processes.interrupt import at_end
from runout.processes.lifetime import end_workers
from runout.workflow.probe_products import (
    PICTURES,
    PROBES,
    PROFILES,
    attributes_of,
    remove_others,
    write_pictures,
    write_profiles,
    write_series,
)
from runout.workflow.single_member import chosen_member
from runout.workflow.study import PLAN, Study

if TYPE_CHECKING:
    from collections.abc import Mapping

    import xarray as xr

    from runout.config.site import Site
    from runout.hazard.members import Ensemble
    from runout.model.probes import CrossSection

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
        require_picture(self.picture)


def require_picture(picture: str) -> None:
    """Raise ConfigError for a format of figures that there is not."""
    if picture not in PICTURES:
        raise ConfigError(f"--picture is {picture!r}; choose one of {', '.join(PICTURES)}")


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
    if choices.members or (choices.member is None and not choices.has_files):
        return None
    return chosen_member(site, choices.member or 0).number


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


def run_profiles(
    site_path: Path | str,
    out: Path | None,
    line: Path,
    *,
    layer: str | None = None,
    member: int | None = None,
    picture: str = "png",
) -> list[Path]:
    """Write profiles of a site to ``results/profiles``; returns the paths.

    Parameters
    ----------
    site_path, out : Path or str
        Site folder or its site.yaml; results folder.
    line : Path
        Vector file of one or several lines.
    layer : str or None
        Its layer.
    member : int or None
        Number of a member; None for the percentiles over all members that are done.
    picture : str
        "png" or "svg".

    Raises
    ------
    ConfigError, PartialEnsembleError, StorageError
        If a line cannot be used (all problems at once), no member is done, or a file cannot be read or written.
    """
    from runout.hazard.profiles import ensemble_profiles, member_profiles
    from runout.io.probe_layers import read_lines

    require_picture(picture)
    study = Study.open(site_path, out)
    number = None if member is None else member_of(study.site, ProbeChoices(member=member))
    lines, changes = read_lines(line, study.terrain, layer)
    for change in changes:
        LOGGER.warning("%s", change)
    study = replace(study, part=None if number is None else range(number, number + 1))
    ensemble = finished(study)
    files = list(ensemble.files.values())
    excavated = excavation(study.site, study.standings[0].member.parameters if number is not None else {})
    shown = None
    if number is None:
        datasets, of = ensemble_profiles(files, ensemble.weights, lines, study.terrain, excavated), ensemble.statement()
        shown = [_shown_member(study, ensemble.files, one, line) for one, line in zip(datasets, lines, strict=True)]
    else:
        datasets, of = member_profiles(files[0], lines, study.terrain, excavated), f"member {number}"
    attributes = attributes_of(study.site, [line]) | {"ensemble": of}
    label = "ensemble" if number is None else f"member_{number:04d}"
    folder, title = study.results / PROFILES, f"{study.site.name}, {of.partition(';')[0]}"
    paths = write_profiles(datasets, folder, f"{line.stem}_{label}", attributes, title, picture, shown)
    LOGGER.info("wrote %d files: %s*", len(paths), folder / f"{line.stem}_{label}")
    return paths


def _shown_member(study: Study, files: "Mapping[int, Path]", dataset: "xr.Dataset", line: "CrossSection") -> "xr.Dataset":
    """Profile of the member whose front along a line is the median; its number replaces its position in the dataset."""
    from runout.hazard.profiles import member_profiles

    number, path = list(files.items())[dataset.attrs["median_front"]]
    dataset.attrs["median_front"] = number
    parameters = next(one.member.parameters for one in study.standings if one.member.number == number)
    (profile,) = member_profiles(path, [line], study.terrain, excavation(study.site, parameters))
    return profile


def excavation(site: "Site", sample: dict[str, float]) -> np.ndarray:
    """Depth [m] (rows, columns) of what the releases of a member take away from the ground."""
    terrain = site.terrain()
    return np.sum([np.zeros(terrain.shape), *(release.excavation for release in site.releases(sample=sample))], axis=0)  # type: ignore[no-any-return]
