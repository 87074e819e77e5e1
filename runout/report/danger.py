"""Section of the report on classes of intensity and levels of danger: maps in the colours of the scheme, legend, matrix."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from runout.config.scheme import CHECKED
from runout.hazard.danger import INTENSITY, LEVEL, PERIOD, entries_of, label, scheme_record
from runout.report.maps import Basemap, blank_map
from runout.report.picture import png
from runout.report.study import Study
from runout.report.values import SMALL, VALUES, Window
from runout.report.wording import number

LINE = 0.19  # [inch] of a legend
LINES_OF_A_BAR = 3  # that the place of a colour bar holds


def danger_section(study: Study, window: Window) -> dict[str, Any] | None:
    """Content of the section, pictures as PNG; None for a site without a scheme."""
    record = scheme_record(study.hazard)
    if record is None:
        return None
    years = [number(one, 6) for one in record["return_periods"]["years"]]
    matrix = record["matrix"]
    return {
        **record,
        "source": " · ".join(record["source"].values()),
        "periods": f"{', '.join(years)} years (checked: {record['return_periods']['checked']})",
        "risk": risk_statement(record["risk"]),
        "words": CHECKED,
        "headings": years,
        "rows": [(one["name"], matrix["rows"][one["name"]]) for one in reversed(record["classes"])] if matrix else [],
        "colour_of": {one["name"]: one["colour"] for one in record["levels"]},
        "matrix_checked": matrix["checked"] if matrix else "",
        "figures": [(title, png(figure)) for title, figure in _figures(study, window)],
    }


def risk_statement(risk: dict[str, Any] | None) -> str:
    """Sentence on the person for whom an individual risk was computed; empty for schemes of return periods."""
    if risk is None:
        return ""
    levels = ", ".join(f"{level:g}" for level in risk["annual"])
    return (
        f"Individual risk is the annual rate of being reached, times presence ({risk['presence']:g}), times vulnerability "
        f"({risk['vulnerability']:g}); both are stated in the scheme. Levels: {levels} a year."
    )


def _figures(study: Study, window: Window) -> list[tuple[str, Any]]:
    """Title and figure of each map: the level of danger, then the class at each return period."""
    hazard, ground = study.hazard, study.basemap
    record = scheme_record(hazard)
    assert record
    periods, figures = f"return periods: {record['return_periods']['checked']}", []
    if LEVEL in hazard:
        states = ", ".join(dict.fromkeys(one["checked"] for one in record["classes"]))
        title = f"checked: classes: {states};\n{periods}; matrix: {record['matrix']['checked']}"
        figures.append(("Level of danger", class_map(ground, hazard[LEVEL].values, entries_of(hazard, LEVEL), window, title)))
    for years in hazard[PERIOD].values:
        values = hazard[INTENSITY].sel({PERIOD: years}).values
        title = f"Intensity at a return period of {number(float(years), 6)} years"
        figures.append((title, class_map(ground, values, entries_of(hazard, INTENSITY), window, f"checked: {periods}")))
    return figures


def class_map(basemap: Basemap, values: np.ndarray, entries: Sequence[dict[str, Any]], window: Window, checked: str) -> Any:
    """Figure of classes (rows, columns) in their colours, with a legend that states how each was checked; 0 has no colour."""
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch

    axes, bar = blank_map(basemap, window)
    _make_room(axes, bar, LINE * max(0, len(entries) + len(checked.splitlines()) - LINES_OF_A_BAR))
    shown = np.ma.masked_less(np.nan_to_num(values[window]), 1)
    norm = BoundaryNorm(np.arange(len(entries) + 1) + 0.5, max(len(entries), 1))
    colours = ListedColormap([entry["colour"] for entry in entries])
    extent = basemap.extent(window)
    axes.imshow(shown, cmap=colours, norm=norm, extent=extent, interpolation="nearest", alpha=0.86, zorder=VALUES)
    patches = [Patch(facecolor=e["colour"], edgecolor="#6b6b6b", linewidth=0.5, label=label(e)) for e in reversed(entries)]
    axes.figure.legend(
        handles=patches, title=checked, loc="lower center", fontsize=SMALL, title_fontsize=SMALL, frameon=False, borderaxespad=0.1,
        labelspacing=0.25,
    )  # fmt: skip
    return axes.figure


def _make_room(axes: Any, bar: Any, height: float) -> None:
    """Enlarge a figure at its foot by a height [inch], and remove the axes of the colour bar."""
    figure = axes.figure
    width, before = figure.get_size_inches()
    place, after = axes.get_position(), before + height
    bar.remove()
    figure.set_size_inches(width, after)
    axes.set_position((place.x0, (place.y0 * before + height) / after, place.width, place.height * before / after))
