"""Page of a comparison: scores, and maps of both products and of their difference."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from runout import __version__
from runout.io.vector import outline
from runout.quantities import SHARE
from runout.report.html import render
from runout.report.maps import Basemap
from runout.report.marks import Mark
from runout.report.scores import ScoreTable, counts_in_words, range_table, score_tables
from runout.report.values import STYLES, MapStyle
from runout.report.vector_map import VectorMaps
from runout.report.wording import number, unit
from runout.scores.comparison import Comparison
from runout.scores.flow import DEPTHS, PEAKS, THICKNESSES, TITLES, UNITS
from runout.variables import PRINTED

TEMPLATE = "comparison.html.jinja"


def comparison_page(comparison: Comparison) -> str:
    """HTML text of one self-contained page."""
    stored = comparison.assessment.stored()
    a, b = names(comparison)
    shown_a, shown_b = _shown_names(comparison)
    heading = [("Scored", str(comparison.a.path)), ("Against", str(comparison.b.path)), ("Grid", _grid(comparison))]
    maps = _maps(comparison)
    return render(
        {
            "title": f"{a} against {b}",
            "definitions": maps.definitions(),
            "heading": [*heading, ("Made by", f"runout {__version__}")],
            "lead": _lead(comparison),
            "scores": score_tables(stored["scores"]),
            "best": _best(comparison),
            "members": _members(comparison),
            "counts": [(of, counts_in_words(counts)) for of, counts in stored["counts"].items()],
            "legend": _legend(comparison, shown_a, shown_b),
            "sheets": list(_sheets(comparison, maps, shown_a, shown_b)),
            "changes": comparison.changes,
        },
        TEMPLATE,
    )


def names(comparison: Comparison) -> tuple[str, str]:
    """Short names of the two; their folders are added where the last parts are equal."""
    a, b = comparison.a.name, comparison.b.name
    if a != b:
        return a, b
    return "/".join(comparison.a.path.absolute().parts[-3:]), "/".join(comparison.b.path.absolute().parts[-3:])


def _shown_names(comparison: Comparison) -> list[str]:
    """Names of what the maps show: in place of an ensemble its best member, or the area of a probability."""
    shown = list(names(comparison))
    if comparison.of_ensemble is not None:
        of = (
            f"member {comparison.members[0].number}"
            if comparison.members
            else f"P ≥ {comparison.flows[comparison.of_ensemble].probability:g}"
        )
        shown[comparison.of_ensemble] += f", {of}"
    return shown


def _best(comparison: Comparison) -> dict[str, Any] | None:
    """The best member: words, and tables of its scores; None without members."""
    if not comparison.members:
        return None
    best = comparison.members[0]
    words = f"Member {best.number} is the best of {len(comparison.members)} by {comparison.ranked_by}. The maps show this member"
    return {"words": f"{words}.", "scores": score_tables([score.stored() for score in best.scores])}


def _members(comparison: Comparison) -> list[ScoreTable]:
    """Table of all members, from the best to the worst: sampled parameters and the scores of the headlines."""
    stored = {str(one.number): [score.stored() for score in one.scores] for one in comparison.members}
    parameters = {str(one.number): one.parameters for one in comparison.members}
    return range_table(next(iter(stored.values()), []), stored, parameters)


def _grid(comparison: Comparison) -> str:
    (rows, columns), (dx, dy) = comparison.grid.shape, comparison.grid.cell_size
    return f"{rows} x {columns} cells of {dx:.4g} x {dy:.4g} m"


def _lead(comparison: Comparison) -> str:
    known = any(score.numerical_error is not None for score in comparison.assessment.scores)
    bars = "± is the numerical error bar of the first." if known else "The numerical error of the first is not known."
    if comparison.of_ensemble is not None:
        bars += (
            f" Of the ensemble, the area is scored that members of a summed weight of {comparison.flows[0].probability:g} or more "
            "reach (P); its members are scored below, each by itself."
        )
    return (
        "Differences are the first minus the second. Cells that one of the two does not know are in no score; they are counted "
        f"below. {bars}"
    )


def _legend(comparison: Comparison, a: str, b: str) -> str:
    lines = ["Cells without colour are below the lowest threshold in both, or unknown"]
    if comparison.thresholds or comparison.vector:
        least = f" (from {number(min(comparison.thresholds))} m on)" if comparison.thresholds else ""
        lines.append(f"the dashed line is the outline of {a}{least}")
        lines.append(f"blue is what was observed: {b}" if comparison.vector else f"the blue line is that of {b}")
    if comparison.setting.thalweg:
        lines.append("the dotted line is the thalweg")
    return "; ".join(lines) + "."


def basemap(comparison: Comparison) -> Basemap:
    """Ground, outlines and observations under the maps; level ground where no elevation is known."""
    from shapely import LineString

    grid, ground = comparison.grid, comparison.elevation
    if ground is None or not np.isfinite(ground).any():
        ground = np.zeros(grid.shape)
    released = [] if comparison.release is None else [outline(np.nan_to_num(comparison.release) > 0, grid.terrain())]
    observed = list(_observed(comparison))
    if comparison.setting.thalweg:
        observed.append(Mark(LineString(comparison.setting.thalweg.points), ""))
    zones = [Mark(shape, "") for shape in [_outline_of(comparison, 0)] if shape is not None]
    return Basemap(grid.easting, grid.northing, ground, [r for r in released if not r.is_empty], [], zones, observed)


def _observed(comparison: Comparison) -> Iterator[Mark]:
    from shapely import Point

    if comparison.vector is None:
        shape = _outline_of(comparison, 1)
        if shape is not None:
            yield Mark(shape, "")
    elif comparison.vector.gauges is None:
        yield Mark(comparison.vector.outline, "")
    else:
        gauges = comparison.vector.gauges
        for k, (x, y) in enumerate(zip(gauges.easting, gauges.northing, strict=True)):
            yield Mark(Point(x, y), gauges.label(k))


def _outline_of(comparison: Comparison, place: int) -> Any:
    """Outline of a flow at the lowest threshold; None if it has none."""
    flow = comparison.flows[place]
    quantity = next((name for name in (*THICKNESSES, *PEAKS) if name in flow.maps), None)
    if quantity is None or not comparison.thresholds:
        return None
    shape = outline(flow.area(quantity, min(comparison.thresholds)) >= 0.5, comparison.grid.terrain())
    return None if shape.is_empty else shape


def _sheets(comparison: Comparison, maps: VectorMaps, a: str, b: str) -> Iterator[dict[str, Any]]:
    both = comparison.quantities or [name for name in ("thickness", "deposit") if name in comparison.flows[0].maps][:1]
    for name in both:
        style = _style(comparison, name)
        for flow, label in zip(comparison.flows, (a, b), strict=True):
            if name in flow.maps:
                values, title = np.where(np.isfinite(flow.maps[name]), flow.maps[name], np.nan), f"{_title(name)}: {label}"
                yield {"title": title, "caption": "", "map": maps.drawn(values, style, f"Map: {title}")}
        if name in comparison.quantities:
            title = f"{_title(name)}: difference"
            drawn = maps.drawn(_shown_difference(comparison, name), difference_style(name), f"Map: {title}")
            yield {"title": title, "caption": f"{a} minus {b}", "map": drawn}


def _maps(comparison: Comparison) -> VectorMaps:
    """Maps of the window around both flows."""
    base = basemap(comparison)
    shown = [np.nan_to_num(flow.maps[name], posinf=0.0) != 0 for flow in comparison.flows for name in flow.maps]
    return VectorMaps(base, base.window(np.any(shown, axis=0)))


def _title(name: str) -> str:
    return TITLES[name][:1].upper() + TITLES[name][1:]


def _style(comparison: Comparison, name: str) -> MapStyle:
    """Colours of a quantity, on one scale for both."""
    if name == "change":
        return replace(STYLES["difference"], label="change of elevation [m]")
    if name == SHARE:
        return STYLES["share"]
    style = STYLES["time" if name == "arrival" else name]
    known = np.concatenate([flow.maps[name].ravel() for flow in comparison.flows if name in flow.maps])
    known = known[np.isfinite(known) & (known > 0)] * style.scale
    top = float(np.percentile(known, 99)) if known.size else 0.0
    label = "thickness normal to the slope [m]" if name in DEPTHS and comparison.slope_normal else style.label
    return replace(style, top=top, label=label)


def difference_style(name: str) -> MapStyle:
    """Colours of a difference of maps of a quantity: blue where the first is less, red where it is more."""
    units, divisor = PRINTED.get(UNITS[name], (UNITS[name], 1.0))
    return replace(STYLES["difference"], label=f"difference [{unit(units)}]", scale=1.0 / divisor)


def _shown_difference(comparison: Comparison, name: str) -> np.ndarray:
    """Difference without the cells that neither flow reaches."""
    either = np.any([np.nan_to_num(flow.maps[name], posinf=0.0) != 0 for flow in comparison.flows], axis=0)
    return np.where(either, comparison.difference(name), np.nan)
