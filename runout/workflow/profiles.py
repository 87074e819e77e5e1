"""Profiles along lines, of one member or of the ensemble, from the maps of members that are done."""

import logging
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runout.errors import ConfigError
from runout.workflow.probe_products import PICTURES, PROFILES, attributes_of, write_profiles
from runout.workflow.probes import ProbeChoices, finished, member_of
from runout.workflow.study import Study

if TYPE_CHECKING:
    from collections.abc import Mapping

    import xarray as xr

    from runout.config.site import Site
    from runout.model.probes import CrossSection

LOGGER = logging.getLogger("runout.profiles")


def run(
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

    if picture not in PICTURES:
        raise ConfigError(f"--picture is {picture!r}; choose one of {', '.join(PICTURES)}")
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
