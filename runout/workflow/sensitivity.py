"""Command ``runout sensitivity``: which sampled parameters decide area, run-out and volumes, from the members that have run."""

import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import numpy as np

from runout import log
from runout.calibration.emulator import Emulator, varies
from runout.calibration.figures import tornado_figure
from runout.calibration.prior import Prior
from runout.calibration.sobol_indices import FEWEST, SobolIndices, sobol_indices, why_refused
from runout.errors import ExitCode, InputError, PartialEnsembleError
from runout.hazard.figures import member_figures
from runout.hazard.probe_series import member_series
from runout.hazard.reach import Reach
from runout.io.atomic import write_json, write_text
from runout.io.member_maps import MemberMaps
from runout.io.probe_files import SECTIONS
from runout.model.release import thickness_of
from runout.workflow.probe_products import write_figure
from runout.workflow.study import Study

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.ensemble.member import Member

LOGGER = logging.getLogger("runout.sensitivity")
FOLDER, RECORD, TABLE, FIGURE = "sensitivity", "sensitivity.json", "sensitivity.csv", "tornado.png"
QUANTITIES = {"reached_area": "area reached", "runout_distance": "run-out", "deposit_volume": "deposit beyond the release"}
CENSORED = 1.0  # percent of the mass that left the raster, from which a member is cut by it


def run(site_path: Path, out: Path | None = None) -> int:
    """Print and write the Sobol indices of a site.

    Raises ConfigError, InputError or PartialEnsembleError if no parameter is sampled, every quantity is refused, or no member has
    run.
    """
    study = Study.open(site_path, out)
    prior, members = Prior.of(study.site), finished_members(study)
    scalars = member_scalars(study.site, study.results, members)
    for warning in _warnings(scalars.pop("escaped_fraction")):
        LOGGER.warning("%s", warning)
    points = prior.coordinates(np.array([[member.parameters[name] for name in prior.names] for member in members]))
    indices, refused = analysed(scalars, points, prior)
    if not indices:
        raise InputError("\n".join(f"{title(name)}: {reason}" for name, reason in refused.items()))
    record = {
        "members": [member.file(study.results).name for member in members],
        "quantities": {name: {"title": title(name), "held_out_q2": q2, **one.stored()} for name, (one, q2) in indices.items()},
        "refused": {title(name): reason for name, reason in refused.items()},
    }
    for line in lines(record):
        log.output().print(line, markup=False, highlight=False, soft_wrap=True)
    for path in _write(study.results / FOLDER, record, {title(name): one for name, (one, _) in indices.items()}):
        LOGGER.info("wrote %s", path)
    return ExitCode.OK


def analysed(
    scalars: Mapping[str, np.ndarray], points: np.ndarray, prior: Prior
) -> tuple[dict[str, tuple[SobolIndices, float]], dict[str, str]]:
    """Indices and held-out Q2 of scalars (members,) by name, and the reason for each that is refused.

    ``points`` (members, parameters) lie in the cube of the prior.
    """
    indices, refused = {}, {}
    for name, values in scalars.items():
        emulator = Emulator.fit(points, values) if len(values) >= FEWEST and varies(values) else None
        if reason := why_refused(len(values), values, emulator):
            refused[name] = reason
        elif emulator is not None:
            indices[name] = sobol_indices(emulator, prior), emulator.q2
    return indices, refused


def finished_members(study: Study) -> "list[Member]":
    """Members of the ensemble of a site that have a result.

    Raises PartialEnsembleError if there is none.
    """
    done = [standing.member for standing in study.standings if standing.state == "done"]
    if not done:
        site = quote(str(study.site.folder))
        folder, remedy = study.results / "members", f"run `runout ensemble {site}` first"
        raise PartialEnsembleError(f"{folder}: no member has run with these settings; {remedy}")
    return done


def reach_of(site: "Site") -> Reach:
    """Distances from the masses of a site on its terrain."""
    terrain = site.terrain()
    released = thickness_of(site.masses(), terrain) > 0
    return Reach.on(released, terrain.easting, terrain.northing, terrain.elevation)


def member_scalars(site: "Site", results: Path, members: "list[Member]") -> dict[str, np.ndarray]:
    """Area, run-out, deposit and escaped share of members, and the volume past each cross-section of the site, each (members,)."""
    reach = reach_of(site)
    has_sections = site.files.probes() is not None
    rows: list[dict[str, float]] = []
    for member in members:
        path = member.file(results)
        with MemberMaps(path) as maps:
            of_maps = member_figures(maps, maps.ledger(), reach)
        row = {name: of_maps[name] for name in (*QUANTITIES, "escaped_fraction")}
        rows.append(row | (_passed(path) if has_sections else {}))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _passed(path: Path) -> dict[str, float]:
    """Volume [m3] that has passed each cross-section at the end of a member, by ``passed NAME``."""
    series = member_series(path).get(SECTIONS)
    if series is None:
        return {}
    names, volumes = series["station_name"].values, series["passed_volume"].values[:, -1]
    return {f"passed {name}": float(volume) for name, volume in zip(names, volumes, strict=True)}


def title(name: str) -> str:
    """A quantity in words."""
    return QUANTITIES.get(name) or f"volume past cross-section {name.removeprefix('passed ')}"


def _warnings(escaped: np.ndarray) -> Iterator[str]:
    cut = int((escaped > CENSORED).sum())
    if cut:
        yield (
            f"{cut} of {len(escaped)} members lost more than {CENSORED:g} % of their mass over the edge of the raster: area and "
            "run-out end there, and their indices count this; use a larger raster or extent"
        )


def lines(record: Mapping[str, Any]) -> Iterator[str]:
    """What the terminal prints of ``sensitivity.json``: a line for each parameter, the largest total index first."""
    for one in record["quantities"].values():
        quality = f"{len(record['members'])} members, held-out Q2 {one['held_out_q2']:.3f}"
        yield f"{one['title']}: {quality}, {one['unexplained']:.1%} of the variance by no parameter"
        yield f"  {'parameter':36}{'alone':>8}{'5-95 %':>14}{'total':>8}{'5-95 %':>14}"
        for name, values in sorted(one["parameters"].items(), key=lambda row: -row[1]["total"]):
            first, total = ("{:.2f}-{:.2f}".format(*values[f"{kind}_5_95"]) for kind in ("first", "total"))
            yield f"  {name:36}{values['first']:8.2f}{first:>14}{values['total']:8.2f}{total:>14}"
    for name, reason in record["refused"].items():
        yield f"{name}: refused: {reason}"


def _write(folder: Path, record: Mapping[str, Any], indices: Mapping[str, SobolIndices]) -> list[Path]:
    """Paths of record, table and figure, after writing each as a whole."""
    import pandas as pd

    rows = [
        {"quantity": name, "parameter": parameter, **_flat(values)}
        for name, one in record["quantities"].items()
        for parameter, values in one["parameters"].items()
    ]
    return [
        write_json(record, folder / RECORD),
        write_text(str(pd.DataFrame(rows).to_csv(index=False)), folder / TABLE),
        write_figure(tornado_figure(indices), folder / FIGURE),
    ]


def _flat(values: Mapping[str, Any]) -> dict[str, float]:
    """Indices of a parameter with a column for each end of an interval."""
    ends = {f"{name}_{end}": values[f"{name}_5_95"][k] for name in ("first", "total") for k, end in enumerate(("p5", "p95"))}
    return {"first": values["first"], "total": values["total"], **ends}
