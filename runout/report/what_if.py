"""Page of ``runout what-if``: the map of each run with a slider, and area, run-out and volumes against the parameters."""

import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout import __version__
from runout.ensemble.sweep import Sweep
from runout.report.explorer import explorer
from runout.report.figures import parameter_label, tidy
from runout.report.html import render
from runout.report.marks import INK
from runout.report.study import read_study
from runout.report.values import NORMAL, SMALL
from runout.report.wording import number

if TYPE_CHECKING:
    import pandas as pd

    from runout.config.site import Site

TEMPLATE = "what_if.html.jinja"
GROUND = ("elevation", "ground_slope", "release_thickness", "members_reached")  # maps that say nothing of a probability
PANEL, COLUMNS, DPI = (3.7, 2.9), 3, 72.0  # inch, panels in a row, points of SVG in an inch
DISTINCT = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")  # of Okabe and Ito
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


def drawn(panels: Sequence[Curve], outcomes: "pd.DataFrame") -> tuple[str, list[list[list[float]]]]:
    """SVG of the panels, and for each run in the order of the table the places [pixel of the SVG] of its points."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    columns = min(COLUMNS, len(panels))
    rows = math.ceil(len(panels) / columns)
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "what-if"}):
        figure = Figure(figsize=(PANEL[0] * columns, PANEL[1] * rows), layout="constrained", dpi=DPI)
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for one, curve in zip(axes, panels, strict=False):
            _draw(one, curve, outcomes)
        for one in axes[len(panels) :]:
            one.set_axis_off()
        if len(panels[0].lines) > 1:
            figure.legend(*axes[0].get_legend_handles_labels(), fontsize=SMALL, frameon=False, loc="outside upper left", ncols=4)
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    height = figure.bbox.height
    places: dict[int, list[list[float]]] = {member: [] for member in outcomes.index}
    for one, curve in zip(axes, panels, strict=False):
        for member in (member for line in curve.lines.values() for member in line):
            value = outcomes.at[member, curve.outcome] / _divisor(curve, outcomes)
            x, y = one.transData.transform([outcomes.at[member, curve.parameter], value])
            places[member].append([round(float(x), 1), round(float(height - y), 1)])
    content = text.getvalue()
    return content[content.index("<svg") :], list(places.values())


def _draw(axes: Any, curve: Curve, outcomes: "pd.DataFrame") -> None:
    units = _divisor(curve, outcomes)
    for (label, members), colour in zip(curve.lines.items(), _colours(len(curve.lines)), strict=True):
        x, y = outcomes.loc[members, [curve.parameter, curve.outcome]].to_numpy().T
        axes.plot(x, y / units, "o-", markersize=4, color=colour, label=label or None)
    tidy(axes, parameter_label(curve.parameter))
    words = _heading(curve.outcome).replace("[m³]", "[10⁶ m³]") if units > 1.0 else _heading(curve.outcome)
    axes.set_ylabel(words, fontsize=NORMAL, color=INK, parse_math=False)
    axes.set_ylim(0.0, 1.1 * max(float(outcomes[curve.outcome].max()) / units, 1e-6))


def _divisor(curve: Curve, outcomes: "pd.DataFrame") -> float:
    """1e6 for volumes of millions of cubic metres, else 1."""
    return 1e6 if curve.outcome.startswith(PASSED) and outcomes[curve.outcome].max() >= 1e6 else 1.0


def _colours(lines: int) -> list[Any]:
    """Colours of lines that differ for all readers."""
    from matplotlib import colormaps

    return list(DISTINCT[:lines]) if lines <= len(DISTINCT) else list(colormaps["viridis"](np.linspace(0.0, 0.85, lines)))


def _heading(name: str) -> str:
    """Words and unit of a column."""
    others: Mapping[str, str] = {"deposit_volume": "deposit beyond the release [m³]", "escaped_fraction": "left the raster [%]"}
    if name in (known := {**TITLES, **others}):
        return known[name]
    return f"volume past {name.removeprefix(PASSED)} [m³]" if name.startswith(PASSED) else parameter_label(name)
