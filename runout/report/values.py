"""Draws the values of a map: colours, classes and scales of each quantity, and the colour bar."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from runout.hazard.round_numbers import round_edges, round_series, round_ticks
from runout.model.arrays import window_of
from runout.palettes import ANNUAL_RATES, Palette, palette_of
from runout.quantities import ALL_QUANTITIES, MapQuantity
from runout.report.marks import INK
from runout.report.wording import unit
from runout.variables import VARIABLES

Window = tuple[slice, slice]  # rows and columns of the raster
Extent = tuple[float, float, float, float]  # outer edges west, east, south, north [m]

SMALL, NORMAL = 9.0, 9.5  # [pt]
MOST_TICKS = 7  # of a logarithmic scale
VALUES = 2  # order of drawing: the values lie above the ground, and below outlines, labels and frame


@dataclass(frozen=True)
class MapStyle:
    """Colours of a quantity."""

    label: str  # text of the colour bar, with the unit
    colours: str  # the colour map of matplotlib of a palette (:mod:`runout.palettes`)
    # bounds of colour classes, in the printed unit; if empty, the scale is continuous from 0 to the 99th percentile
    steps: tuple[float, ...] = ()
    beyond: bool = False  # whether values above the last step have a colour of their own
    meanings: tuple[str, ...] = ()  # what values of each class do, if that is known; empty for a class without a meaning
    classes: int = 0  # approximate number of colour classes with round bounds; 0 for a continuous scale
    logarithmic: bool = False  # a logarithmic continuous scale over at most three decades
    faintest: float = 0.0  # values at or below it are transparent
    scale: float = 1.0  # factor from the stored unit to the printed one
    diverging: bool = False  # a continuous scale that is symmetric about 0
    top: float = 0.0  # largest value of a continuous scale, in the printed unit; 0: the 99th percentile


def _style(name: str, label: str, **choices: Any) -> MapStyle:
    """Style of a kind of map with the palette of its name."""
    palette = palette_of(name)
    return MapStyle(label, palette.colours, faintest=-math.inf if palette.opaque or palette.signed else 0.0, **choices)


def _bounds(*edges: float) -> tuple[float, ...]:
    """Bounds of classes from 0 as files hold them in float32; a value on a bound is in the class above."""
    return tuple(float(np.float32(edge)) for edge in (0.0, *edges))


def _style_of(quantity: MapQuantity) -> MapStyle:
    units, divisor = VARIABLES[quantity.peak].printed
    palette = palette_of(quantity.name)
    choices: dict[str, Any] = {"scale": 1.0 / divisor, "logarithmic": quantity.logarithmic}
    if palette.classes:
        meanings = tuple(palette.meaning(edge) for edge in (0.0, *palette.classes))
        choices |= {"steps": _bounds(*palette.classes), "beyond": True, "meanings": meanings}
    return _style(quantity.name, f"{quantity.symbol} [{unit(units)}]", **choices)


STYLES = {
    "probability": _style("probability", "conditional probability [1]", steps=_bounds(*palette_of("probability").classes, 1.0)),
    "annual_rate": _style("annual", "annual rate [1/a]", steps=(0.0, *ANNUAL_RATES, 1.0)),
    "time": _style("arrival", "time since release [s]", classes=9),
    "share": _style("share", "share of the bed [1]", steps=_bounds(*palette_of("share").classes, 1.0)),
    **{name: _style_of(quantity) for name, quantity in ALL_QUANTITIES.items()},
    "distance": replace(_style("distance", "standard deviation [m]"), faintest=-math.inf),
    "difference": _style("difference", "change or difference [m]", diverging=True),
}


def draw_values(axes: Any, bar: Any, extent: Extent, values: np.ndarray, style: MapStyle) -> Any:
    """Image of ``values`` (rows, columns) on the extent of a map, with their colour bar in the axes ``bar``."""
    painted, shown = paint_values(axes, extent, values, style)
    draw_colour_bar(painted, bar, shown, style)
    return painted


def paint_values(axes: Any, extent: Extent, values: np.ndarray, style: MapStyle) -> tuple[Any, np.ma.MaskedArray]:
    """Image of ``values`` (rows, columns) on the extent of a map, and what it shows, in printed units."""
    shown = np.ma.masked_invalid(np.asarray(values, np.float64))
    shown = np.ma.masked_less_equal(shown, style.faintest) * style.scale
    scale, box = colour_scale(shown, style), window_of(~np.ma.getmaskarray(shown))
    part = _extent_of(box, shown.shape, extent)
    return axes.imshow(shown[box], extent=part, interpolation="nearest", alpha=0.86, zorder=VALUES, **scale), shown


def _extent_of(box: Window, shape: tuple[int, ...], extent: Extent) -> Extent:
    """Outer edges of rows and columns of cells (rows, columns) with an extent."""
    west, east, south, north = extent
    dx, dy = (east - west) / shape[1], (north - south) / shape[0]
    return west + box[1].start * dx, west + box[1].stop * dx, north - box[0].stop * dy, north - box[0].start * dy


def colour_scale(shown: np.ma.MaskedArray, style: MapStyle) -> dict[str, Any]:
    """``cmap`` and ``norm`` of the cells of a map in printed units."""
    from matplotlib.colors import BoundaryNorm, LogNorm, Normalize

    palette = Palette(style.colours, signed=style.diverging)
    colours = palette.listed()
    if style.steps:
        count = len(style.steps) - 1 + style.beyond
        return {
            "cmap": palette.listed(count),
            "norm": BoundaryNorm(style.steps, count, extend="max" if style.beyond else "neither"),
        }
    values = shown.compressed()
    if values.size == 0:
        return {"cmap": colours, "norm": Normalize(0.0, 1.0)}
    if style.diverging:
        top = style.top or float(np.percentile(np.abs(values), 99)) or 1.0
        return {"cmap": colours, "norm": Normalize(-top, top, clip=True)}
    if style.classes:
        edges = round_edges(0.0, max(float(values.max()), 1e-9), style.classes)
        top = edges[-1] + (edges[1] if len(edges) > 1 else 1.0)
        return {"cmap": palette.listed(len(edges)), "norm": BoundaryNorm([*edges, top], len(edges))}
    top = style.top or float(np.percentile(values, 99)) or 1.0
    if style.logarithmic:
        return {"cmap": colours, "norm": LogNorm(max(float(values.min()), top * 1e-3, 1e-9), max(top, 2e-9), clip=True)}
    return {"cmap": colours, "norm": Normalize(0.0, top, clip=True)}


def draw_colour_bar(painted: Any, below: Any, shown: np.ma.MaskedArray, style: MapStyle) -> None:
    """Colour bar of an image in the axes ``below``; the numbers of one with stated steps do not depend on the values."""
    above = shown.count() > 0 and not (style.steps or style.classes) and float(np.abs(shown).max()) > painted.norm.vmax
    extend = "max" if style.beyond else ("both" if style.diverging else "max") if above else "neither"
    bar = below.figure.colorbar(painted, cax=below, orientation="horizontal", extend=extend, extendfrac=0.03)
    bar.solids.set_alpha(1.0)
    largest = f", largest {_short(float(np.abs(shown).max()))}" if above else ""
    bar.set_label(style.label + largest, fontsize=NORMAL, color=INK)
    if style.label == STYLES["annual_rate"].label:
        bar.set_ticks(ANNUAL_RATES, labels=[f"1/{1.0 / rate:.0f}" for rate in ANNUAL_RATES])
    elif style.steps:
        bar.set_ticks(style.steps, labels=[f"{step:.4g}" for step in style.steps])
    if style.logarithmic and shown.count():
        ticks = round_series(painted.norm.vmin, painted.norm.vmax, MOST_TICKS)
        bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
        bar.minorticks_off()
    bar.ax.tick_params(labelsize=NORMAL, colors=INK, length=3)
    bar.outline.set_linewidth(0.5)


def scale_ticks(norm: Any, style: MapStyle) -> list[tuple[float, str]]:
    """Numbers along a colour bar: bound of the class from 0 on, or value of a continuous scale, and the label."""
    bounds = getattr(norm, "boundaries", None)
    if style.label == STYLES["annual_rate"].label and bounds is not None:
        return [(k, f"1/{1.0 / bound:.0f}") for k, bound in enumerate(bounds) if 0.0 < bound < 1.0]
    if bounds is not None:
        return [(k, f"{round(float(bound), 6):g}") for k, bound in enumerate(bounds)]
    if style.logarithmic and norm.vmin > 0.0:
        values = round_series(norm.vmin, norm.vmax, MOST_TICKS)
    else:
        values = round_ticks(norm.vmin, norm.vmax, 5)
    return [(value, f"{value:g}") for value in values]


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
