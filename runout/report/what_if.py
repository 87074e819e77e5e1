"""Page of ``runout what-if``: the map of each run with a slider, and area, run-out and volumes against the parameters."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from runout import __version__
from runout.ensemble.sweep import Sweep
from runout.palettes import Palette
from runout.report.chart import Chart
from runout.report.explorer import explorer
from runout.report.figures import parameter_label
from runout.report.html import render
from runout.report.study import read_study
from runout.report.wording import number

if TYPE_CHECKING:
    import pandas as pd

    from runout.config.site import Site

TEMPLATE = "what_if.html.jinja"
GROUND = ("elevation", "ground_slope", "release_thickness", "members_reached")  # maps that say nothing of a probability
DISTINCT = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#6b737c")  # of Okabe and Ito, grey for black
TITLES = {"reached_area": "area reached [km²]", "runout_distance": "run-out [m]"}
PASSED = "passed "  # before the name of a cross-section


@dataclass(frozen=True)
class Curve:
    """A panel: an outcome against a parameter."""

    parameter: str  # on the horizontal axis
    outcome: str  # column of the table of outcomes
    lines: dict[str, list[int]]  # members of each line in the order of the parameter, by what the line has in common


def page(site: "Site", results: Path, sweep: Sweep, outcomes: "pd.DataFrame", notes: Sequence[str]) -> str:
    """HTML text of one self-contained page.

    Parameters
    ----------
    site : Site
        The site with the cells of the sweep.
    results : Path
        Folder with the maps of the runs.
    sweep : Sweep
    outcomes : DataFrame
        Parameters and outcomes of each run with a result, indexed by its number; area [km2], lengths [m], volumes [m3].
    notes : sequence of str
        What is varied, and what the cells cost.
    """
    study = read_study(results)
    kept = [name for name in study.hazard.data_vars if name in (*GROUND, "crs")]
    settings = site.resolved()
    chosen = replace(study, hazard=study.hazard[kept], probes={}, loads=None)  # no percentiles: the values are not sampled
    parts = explorer(chosen, settings, site.folder)
    drawing, places = drawn(curves(sweep, outcomes), outcomes)
    content = {
        "title": settings.get("title") or site.name,
        "heading": _heading_of_page(sweep, outcomes),
        "notes": notes,
        "failed": len(sweep.rows()) - len(outcomes),
        "head": parts.head,
        "map": parts.body,
        "curves": drawing,
        "script": json.dumps({"places": places}),
        "columns": [_heading(name) for name in outcomes.columns],
        "rows": [[number(float(value), 4) for value in row] for row in outcomes.to_numpy()],
    }
    return render(content, TEMPLATE)


def _heading_of_page(sweep: Sweep, outcomes: "pd.DataFrame") -> list[tuple[str, str]]:
    varied = ", ".join(map(parameter_label, sweep.varied))
    return [("Varied", varied), ("Runs", str(len(outcomes))), ("Made by", f"runout {__version__}")]


def curves(sweep: Sweep, outcomes: "pd.DataFrame") -> list[Curve]:
    """The panels: every outcome against each parameter that is varied alone, or against the first one."""
    shown = [name for name in outcomes.columns if name in TITLES or str(name).startswith(PASSED)]
    axes = list(sweep.varied) if sweep.one_at_a_time else list(sweep.varied)[:1]
    lines = {name: _lines(sweep, outcomes, name) for name in axes}
    return [Curve(parameter, str(outcome), lines[parameter]) for parameter in axes for outcome in shown]


def _lines(sweep: Sweep, outcomes: "pd.DataFrame", parameter: str) -> dict[str, list[int]]:
    """Members by the values of the other varied parameters; of one at a time those that differ in the parameter alone."""
    lines: dict[str, list[int]] = {}
    rows = sweep.rows()
    for member in outcomes.index:
        row = rows[member]
        others = {name: value for name, value in row.items() if name in sweep.varied and name != parameter}
        if sweep.one_at_a_time:
            if parameter in row and all(value == sweep.constant.get(name) for name, value in others.items()):
                lines.setdefault("", []).append(member)
        else:
            lines.setdefault(", ".join(f"{parameter_label(name)} {value:g}" for name, value in others.items()), []).append(member)
    return {label: sorted(members, key=lambda one: rows[one][parameter]) for label, members in lines.items()}


def drawn(panels: Sequence[Curve], outcomes: "pd.DataFrame") -> tuple[list[Markup], list[list[list[float]]]]:
    """SVG of the panels, and for each run in the order of the table the places of its points: x, y and number of the panel."""
    charts, places = [], {member: list[list[float]]() for member in outcomes.index}
    for panel_number, curve in enumerate(panels):
        chart, divisor = _chart(curve, outcomes), _divisor(curve, outcomes)
        several = len(curve.lines)
        colours = DISTINCT if several <= len(DISTINCT) else Palette("viridis").hexadecimal(several)
        for colour, (label, members) in zip(colours, curve.lines.items(), strict=False):
            x, y = outcomes.loc[members, [curve.parameter, curve.outcome]].to_numpy().T
            chart.line(x, y / divisor, colour)
            chart.points(x, y / divisor, colour, label)
            for member, *place in zip(members, *chart.place(x, y / divisor), strict=True):
                places[member].append([*(round(float(part), 1) for part in place), panel_number])
        charts.append(chart.svg(f"{_heading(curve.outcome)} against {parameter_label(curve.parameter)}"))
    return charts, list(places.values())


def _chart(curve: Curve, outcomes: "pd.DataFrame") -> Chart:
    """The axes of a panel."""
    divisor, values = _divisor(curve, outcomes), outcomes[curve.parameter]
    words = _heading(curve.outcome).replace("[m³]", "[10⁶ m³]") if divisor > 1.0 else _heading(curve.outcome)
    margin = 0.05 * float(values.max() - values.min())
    x = float(values.min()) - margin, float(values.max()) + margin
    return Chart(parameter_label(curve.parameter), words, x, (0.0, 1.1 * max(float(outcomes[curve.outcome].max()) / divisor, 1e-6)))


def _divisor(curve: Curve, outcomes: "pd.DataFrame") -> float:
    """1e6 for volumes of millions of cubic metres, else 1."""
    return 1e6 if curve.outcome.startswith(PASSED) and outcomes[curve.outcome].max() >= 1e6 else 1.0


def _heading(name: str) -> str:
    """Words and unit of a column."""
    others: Mapping[str, str] = {"deposit_volume": "deposit beyond the release [m³]", "escaped_fraction": "left the raster [%]"}
    if name in (known := {**TITLES, **others}):
        return known[name]
    return f"volume past {name.removeprefix(PASSED)} [m³]" if name.startswith(PASSED) else parameter_label(name)
