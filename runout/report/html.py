"""The report of a study: one self-contained HTML file."""

from base64 import b64encode
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.report import confidence, figures, probe_figures, sheets, tables
from runout.report.danger import danger_section
from runout.report.elsewhere import Helpers
from runout.report.maps import Basemap
from runout.report.members import representative
from runout.report.picture import MapPictures, encoded, png
from runout.report.scores import counts_in_words, range_table, reach_tables, score_tables
from runout.report.structures import LoadError, structure_section
from runout.report.study import Study, read_study
from runout.report.values import STYLES, Window
from runout.report.wording import MINUS

if TYPE_CHECKING:
    import pandas as pd

    from runout.report.stills import Stills

Cells = tuple[np.ndarray, str, float]  # values of a map (rows, columns), its key in STYLES, and the end of a shared scale
REPORT = "report.html"
TEMPLATE = "report.html.jinja"


def write_report(
    site: Any, results: Path, stills: "Callable[[pd.DataFrame], Stills] | None" = None, helpers: Helpers | None = None
) -> Path:
    """Write the report ``results/report.html``, completely or not at all; returns its path.

    Parameters
    ----------
    site : runout.Site
        The study's site: name, title, and the resolved configuration.
    results : Path
        Folder with ``hazard.nc``, ``members.nc``, ``members/``, ``outlines.gpkg`` and ``run.json``.
    stills : callable, optional
        Draws valid members in three dimensions.
    helpers : Helpers, optional
        Processes that draw a part of the pictures.

    Raises
    ------
    StorageError
        If one of these files is missing, or the report cannot be written.
    """
    from runout.io.atomic import write_text

    study = read_study(Path(results))
    content = page(site, study, helpers or Helpers())
    drawn = stills(study.valid).content() if stills else None
    return write_text(render({**content, "stills": drawn}), Path(results) / REPORT)


def page(site: Any, study: Study, helpers: Helpers) -> dict[str, Any]:
    """Content of the template, by name."""
    settings = site.resolved()
    window, sure = sheets.reached_window(study), confidence.parts(study, settings)
    error = LoadError.of(study.convergence, tables.cells_through(study, settings))
    drawn = helpers.do(partial(_figures, study.for_figures(), window, error))
    headline = sheets.headline_sheets(study)
    further = sheets.further_sheets(study, headline)
    observed = sheets.observed_sheets(study) if study.run.get("observations") else []
    printed = _printed([*headline, *further, *observed], study.basemap, window, helpers)
    return {
        "title": settings.get("title") or site.name,
        "name": site.name,
        "description": settings.get("description") or "",
        "heading": tables.heading(study),
        "sure": sure and {"statement": confidence.statement(sure, study), "rows": [part.row() for part in sure]},
        "cards": tables.key_figures(study),
        "warnings": tables.warnings(study, settings),
        "releases": tables.release_statements(study),
        "headline": printed[: len(headline)],
        "further": printed[len(headline) : len(headline) + len(further)],
        "legend": _legend(study),
        "danger": _danger(study, window),
        "observed": _observed(study, printed[len(headline) + len(further) :]),
        "crs": study.hazard["crs"].attrs.get("long_name", "") if "crs" in study.hazard else "local coordinates",
        "error": tables.numerical_error(study, settings),
        "bed": settings.get("bed"),
        "scenarios": study.hazard.attrs.get("scenarios", ""),
        "members": tables.members(study),
        "sensitivity": tables.sensitivity(study.sensitivity),
        "balance": tables.balance(study),
        "settings": tables.settings(settings),
        "provenance": tables.provenance(study.run),
        **drawn(),
    }


def _danger(study: Study, window: Window) -> dict[str, Any] | None:
    """Classes and levels of danger; None for a site without a scheme."""
    section = danger_section(study, window)
    return section and {**section, "figures": [(title, embedded(picture)) for title, picture in section["figures"]]}


def _figures(study: Study, window: Window, error: LoadError) -> dict[str, Any]:
    """Content with pictures other than maps of results; needs :meth:`Study.for_figures` only."""
    location = embedded(sheets.location(study.basemap, window))
    return {"structures": _structures(study, error), "probes": _probed(study), "location": location, **_plots(study)}


def _legend(study: Study) -> str:
    """Sentence that explains the lines on the maps."""
    lines = ["a red line is the outline of a release"]
    if any(mark.label[:1] in f"+{MINUS}" for mark in study.basemap.obstacles):
        lines.append("hatched areas are obstacles, with what they add to the ground")
    if study.loads:
        lines.append("hatched areas with a name are structures")
    if study.basemap.observed:
        lines.append("blue is what was observed: outline, gauges (triangles) and thalweg (dotted)")
    if study.basemap.probes:
        lines.append("purple are probes: points and cross-sections")
    if study.basemap.zones:
        lines.append("dashed lines are those of friction zones, with their factor or angle of friction")
    return "; ".join(lines).capitalize()


def _structures(study: Study, error: LoadError) -> dict[str, Any] | None:
    """Forces on structures; None for a site without any."""
    section = structure_section(study.loads, error)
    return section and {**section, "figure": embedded(png(section["figure"]) if section["figure"] else None)}


def _observed(study: Study, printed: list[dict[str, str | None]]) -> dict[str, Any] | None:
    """Scores against the observations, and maps of both; None for a site without observations."""
    stated = study.run.get("observations")
    if not stated:
        return None
    whole, members = stated["ensemble"], stated["members"]
    return {
        "statement": stated["statement"][:1].upper() + stated["statement"][1:],
        "scores": score_tables(whole["scores"]),
        "reaches": reach_tables(whole.get("reaches"), study.hazard.get("reach_volume")),
        "reach_figure": _reach_figure(study),
        "counts": [(of, counts_in_words(counts)) for of, counts in whole["counts"].items()],
        "members": range_table(whole["scores"], members, _parameters(study, members)) if len(members) > 1 else [],
        "sheets": printed,
    }


def _reach_figure(study: Study) -> str | None:
    """Picture of the volumes by reach; None for a site without reaches."""
    if "reach_volume" not in study.hazard:
        return None
    weights = study.valid.loc[study.hazard["realization"].values, "weight"].to_numpy(np.float64)
    return embedded(png(figures.reach_figure(study.hazard, weights / weights.sum())))


def _parameters(study: Study, members: Iterable[str]) -> dict[str, dict[str, float]]:
    """Sampled parameters of members by their numbers as text."""
    names = tables.sampled_parameters(study)
    return {member: {name: float(study.members.loc[int(member), name]) for name in names} for member in members}


def _probed(study: Study) -> dict[str, Any] | None:
    """Tables of peaks and a figure for each probe; None for a site without probes."""
    if not study.probes:
        return None
    tables_of = [probe_figures.peak_table(dataset, group) for group, dataset in study.probes.items()]
    shown = [
        (f"{probe_figures.WORDS[group].capitalize()} {dataset['station_name'].values[k]}", group, dataset, k)
        for group, dataset in study.probes.items()
        for k in range(dataset.sizes["station"])
    ]
    figures_of = [(title, embedded(png(probe_figures.station_figure(d, group, k, " ")))) for title, group, d, k in shown]
    return {"tables": tables_of, "figures": figures_of}


def _plots(study: Study) -> dict[str, Any]:
    valid, ledgers = study.valid, study.ledgers
    if not len(valid):
        return {"budget": None, "kinetic": None, "representative": None, "dependence": []}
    return {
        "budget": embedded(png(figures.budget_figure(ledgers, valid))),
        "kinetic": embedded(png(figures.kinetic_figure(ledgers, valid))),
        "representative": representative(valid),
        "dependence": [
            (figures.parameter_label(name), embedded(png(figures.parameter_figure(valid, name))))
            for name in tables.sampled_parameters(study)
        ],
    }


def _printed(drawn: list[sheets.Sheet], basemap: Basemap, window: Window, helpers: Helpers) -> list[dict[str, str | None]]:
    """Title, caption and picture of maps, of which each free helper draws a share."""
    ground = basemap.cropped(window)
    cells = [(sheet.values[window], sheet.style, sheet.top) for sheet in drawn]
    count = len(helpers.free) + 1
    shares = [cells[part[0] : part[-1] + 1] for part in np.array_split(np.arange(len(cells)), count) if part.size]
    elsewhere = [helpers.do(partial(_pictures, ground, share)) for share in shares[1:]]
    images = [*_pictures(ground, shares[0]), *(image for answer in elsewhere for image in answer())]
    texts = ({"title": sheet.title, "caption": sheet.caption} for sheet in drawn)
    return [{**text, "image": image} for text, image in zip(texts, images, strict=True)]


def _pictures(ground: Basemap, cells: list[Cells]) -> list[str | None]:
    """Pictures of maps; each is compressed while the next is drawn."""
    pictures = MapPictures(ground, ground.whole)
    with ThreadPoolExecutor(1) as pool:
        styles = [replace(STYLES[style], top=top or STYLES[style].top) for _, style, top in cells]
        images = [pool.submit(encoded, pictures.pixels(c[0], style)) for c, style in zip(cells, styles, strict=True)]
        return [embedded(image.result()) for image in images]


def embedded(picture: bytes | None) -> str | None:
    """A PNG as the address of an image; None for none."""
    return None if picture is None else "data:image/png;base64," + b64encode(picture).decode("ascii")


def render(content: dict[str, Any], template: str = TEMPLATE) -> str:
    """HTML text from the content of a template of this package."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, loader=FunctionLoader(_template)
    )
    return environment.get_template(template).render(**content)


def _template(name: str) -> str:
    return files("runout.report").joinpath(name).read_text(encoding="utf-8")
