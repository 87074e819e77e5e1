"""The report of a study: one self-contained HTML file."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup, escape

from runout.report import confidence, figures, first_screen, probe_figures, sheets, tables
from runout.report.calibration import calibration_section
from runout.report.danger import danger_section
from runout.report.explorer import explorer
from runout.report.scores import counts_in_words, range_table, reach_tables, score_tables
from runout.report.structures import LoadError, structure_section
from runout.report.study import Study, read_study
from runout.report.values import STYLES
from runout.report.vector_map import VectorMaps
from runout.report.wording import MINUS, quantity

if TYPE_CHECKING:
    import pandas as pd

REPORT = "report.html"
TEMPLATE = "report.html.jinja"
LOCAL = "local coordinates"
FEWEST_POINTS = 3  # members from which a chart of the run-out over a parameter is drawn


def write_report(site: Any, results: Path, stills: "Callable[[pd.DataFrame], dict[str, Any]] | None" = None) -> Path:
    """Write the report ``results/report.html``, completely or not at all; returns its path.

    Parameters
    ----------
    site : runout.Site
        The study's site: name, folder and the block ``report``; all other settings are those of the maps, from ``run.json``.
    results : Path
        Folder with ``hazard.nc``, ``members.nc``, ``members/``, ``outlines.gpkg`` and ``run.json``.
    stills : callable, optional
        Draws valid members in three dimensions; returns the content of the section.

    Raises
    ------
    StorageError
        If one of these files is missing, or the report cannot be written.
    """
    from runout.io.atomic import write_text

    study = read_study(Path(results))
    content = page(site, study, sha256((Path(results) / "hazard.nc").read_bytes()).hexdigest())
    drawn = stills(study.valid) if stills else None
    return write_text(render({**content, "stills": drawn}), Path(results) / REPORT)


def page(site: Any, study: Study, checksum: str) -> dict[str, Any]:
    """Content of the template, by name; ``checksum`` is that of ``hazard.nc``."""
    settings = study.run["configuration"] | _report_block(site)
    maps, sure = VectorMaps(study.basemap, sheets.reached_window(study)), confidence.parts(study, settings)
    error = LoadError.of(study.convergence, tables.cells_through(study, settings))
    danger, statement = danger_section(study, maps), confidence.statement(sure, study)
    crs, head = _reference_system(study), tables.heading(study)
    return {
        "title": settings.get("title") or site.name,
        "name": site.name,
        "description": settings.get("description") or "",
        "heading": head,
        "explorer": explorer(study, settings),
        "definitions": maps.definitions(),
        "threshold": quantity(study.threshold, "m"),
        "assumed": first_screen.assumed(study, settings),
        "outcome": first_screen.outcome(study),
        "unsupported": first_screen.unsupported(study, settings),
        "questions": first_screen.questions(study, settings, statement),
        "sure": sure and {"statement": statement, "rows": [part.row() for part in sure]},
        "cards": tables.key_figures(study),
        "warnings": tables.warnings(study, settings),
        "releases": tables.release_statements(study),
        "sheets": [*_classes_sheet(danger), *_drawn(maps, sheets.printed_sheets(study))],
        "block": [("Site", site.name), *head, ("Coordinates", crs), ("SHA-256 of hazard.nc", checksum)],
        "legend": _legend(study),
        "danger": danger,
        "structures": structure_section(study.loads, error),
        "probes": _probed(study),
        "calibration": calibration_section(study, _table_of(site, settings)),
        "observed": _observed(study, maps) if study.run.get("observations") else None,
        "crs": crs,
        "error": tables.numerical_error(study, settings),
        "bed": settings.get("bed"),
        "scenarios": study.hazard.attrs.get("scenarios", ""),
        "members": tables.members(study),
        "sensitivity": tables.sensitivity(study.sensitivity),
        "balance": tables.balance(study),
        "settings": tables.settings(settings),
        "provenance": tables.provenance(study.run),
        **_charts(study),
    }


def _report_block(site: Any) -> dict[str, Any]:
    """The block ``report`` of site.yaml, on which no map depends."""
    block = site.settings.report
    return {} if block is None else {"report": block.model_dump(mode="json", exclude_none=True)}


def _table_of(site: Any, settings: dict[str, Any]) -> Path | None:
    """Table of members of a site; None without."""
    table = settings.get("ensemble", {}).get("table")
    return Path(site.folder) / table if table else None


def _reference_system(study: Study) -> str:
    """Name of the coordinate reference system."""
    if "crs" not in study.hazard:
        return LOCAL
    return str(study.hazard["crs"].attrs.get("long_name", "")).removeprefix("coordinate reference system: ")


def _classes_sheet(danger: dict[str, Any] | None) -> Iterator[dict[str, Any]]:
    """The first map of classes as a sheet; none without a scheme."""
    if danger:
        title, drawn = danger["figures"][0]
        caption = f"{danger['title']}. No colour means that no simulated event reaches the cell."
        yield {"title": title, "caption": caption, "map": drawn}


def _drawn(maps: VectorMaps, shown: Iterable[sheets.Sheet]) -> Iterator[dict[str, Any]]:
    """Title, caption and map of sheets."""
    for sheet in shown:
        style = replace(STYLES[sheet.style], top=sheet.top or STYLES[sheet.style].top)
        yield {"title": sheet.title, "caption": sheet.caption, "map": maps.drawn(sheet.values, style, f"Map: {sheet.title}")}


def _legend(study: Study) -> str:
    """Sentence that explains the lines on the maps."""
    lines = ["a red line is the outline of a release" + (" or an inflow" if study.run.get("inflows") else "")]
    if any(mark.label[:1] in f"+{MINUS}" for mark in study.basemap.obstacles):
        lines.append("hatched areas are obstacles, with what they add to the ground")
    if study.loads:
        lines.append("hatched areas with a name are structures")
    if study.basemap.observed:
        lines.append("blue is what was observed: outline, gauges and thalweg")
    if study.basemap.probes:
        lines.append("purple are probes: points and cross-sections")
    if study.basemap.zones:
        lines.append("dashed lines are those of friction zones, with their factor or angle of friction")
    if np.isnan(study.basemap.elevation).any():
        lines.append("striped ground has no elevation")
    return "; ".join(lines).capitalize()


def _observed(study: Study, maps: VectorMaps) -> dict[str, Any]:
    """Scores against the observations, and maps of both."""
    observations = study.run["observations"]
    whole, members = observations["ensemble"], observations["members"]
    return {
        "statement": observations["statement"][:1].upper() + observations["statement"][1:],
        "scores": score_tables(whole["scores"]),
        "reaches": reach_tables(whole.get("reaches"), study.hazard.get("reach_volume")),
        "reach_figure": _reach_chart(study),
        "counts": [(of, counts_in_words(counts)) for of, counts in whole["counts"].items()],
        "members": range_table(whole["scores"], members, _parameters(study, members)) if len(members) > 1 else [],
        "sheets": list(_drawn(maps, sheets.observed_sheets(study))),
    }


def _reach_chart(study: Study) -> Markup | None:
    """Chart of the volumes by reach; None for a site without reaches."""
    if "reach_volume" not in study.hazard:
        return None
    weights = study.valid.loc[study.hazard["realization"].values, "weight"].to_numpy(np.float64)
    return figures.reach_chart(study.hazard, weights / weights.sum())


def _parameters(study: Study, members: Iterable[str]) -> dict[str, dict[str, float]]:
    """Sampled parameters of members by their numbers as text."""
    names = tables.sampled_parameters(study)
    return {member: {name: float(study.members.loc[int(member), name]) for name in names} for member in members}


def _probed(study: Study) -> dict[str, Any] | None:
    """Tables of peaks at the probes; None for a site without probes."""
    if not study.probes:
        return None
    return {"tables": [probe_figures.peak_table(dataset, group) for group, dataset in study.probes.items()]}


def _charts(study: Study) -> dict[str, Any]:
    valid, ledgers, sampled = study.valid, study.ledgers, tables.sampled_parameters(study)
    if not len(valid):
        return {"budget": None, "kinetic": None, "representative": None, "dependence": []}
    return {
        "budget": figures.budget_chart(ledgers, valid),
        "kinetic": figures.kinetic_chart(ledgers, valid),
        "representative": figures.representative(valid),
        "dependence": [figures.parameter_chart(valid, name) for name in sampled] if len(valid) >= FEWEST_POINTS else [],
    }


def render(content: dict[str, Any], template: str = TEMPLATE) -> str:
    """HTML text from the content of a template of this package."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, loader=FunctionLoader(_template)
    )
    environment.filters |= {"css_string": _css_string, "commands": _commands}
    return environment.get_template(template).render(**content)


def _css_string(text: str) -> Markup:
    """A string of CSS, in which all signs but letters and digits are escaped."""
    return Markup('"' + "".join(c if c.isalnum() or c in " ,.-" else f"\\{ord(c):x} " for c in text) + '"')


def _commands(text: str) -> Markup:
    """A sentence in which what stands between backquotes is a command."""
    parts = (Markup("<code>{}</code>").format(part) if k % 2 else escape(part) for k, part in enumerate(text.split("`")))
    return Markup("").join(parts)


def _template(name: str) -> str:
    return files("runout.report").joinpath(name).read_text(encoding="utf-8")
