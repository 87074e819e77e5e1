"""Draws one map: cells over hillshade, north up, with colour bar, scale, releases, obstacles and zones.

Text is at least 9 pt on a sheet of 4.2 inch, which is 10 pixels high on a phone that is 350 pixels wide.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from runout.hazard.round_numbers import round_length, round_ticks
from runout.palettes import palette_of
from runout.report.marks import INK, Mark, draw_marks, draw_unknown
from runout.report.relief import hillshade
from runout.report.values import NORMAL, SMALL, Extent, MapStyle, Window, draw_values

FEWEST_CELLS = 24  # smallest width of a window
WIDTH_TO_HEIGHT = 1.0
WIDE, HIGHEST = 4.2, 3.7  # [inch] width of the sheet and of the map on it
MARGINS = (0.5, 0.46, 0.14, 0.1)  # [inch] left, bottom, right, top of the map
BAR = (0.14, 0.5)  # [inch] height of the colour bar, and of the numbers and the label below it
DPI = 200
COMPRESSION = 4  # of zlib: 8 % larger files than with 6, in half the time
TITLE_HEIGHT = 0.2  # [inch] outside the margin


@dataclass(frozen=True)
class Basemap:
    """Terrain under the maps."""

    # easting, northing (columns,), (rows,): map coordinates of the cell centres [m]; northing descends
    easting: np.ndarray
    northing: np.ndarray
    elevation: np.ndarray  # (rows, columns): elevation [m], NaN where unknown
    # outlines of the releases, and lines and areas of the inflows, in map coordinates
    outlines: list[Any] = field(default_factory=list)
    # obstacles, zones: obstacles and friction zones, with their labels
    obstacles: list[Mark] = field(default_factory=list)
    zones: list[Mark] = field(default_factory=list)
    observed: list[Mark] = field(default_factory=list)  # what was observed: outlines, points with labels, a thalweg
    probes: list[Mark] = field(default_factory=list)  # points and cross-sections at which series were recorded

    @property
    def cell_size(self) -> tuple[float, float]:
        """Size of a cell east-west and north-south [m]."""
        return float(self.easting[1] - self.easting[0]), float(self.northing[0] - self.northing[1])

    def extent(self, window: Window) -> Extent:
        """Outer edges of a window."""
        dx, dy = self.cell_size
        x, y = self.easting[window[1]], self.northing[window[0]]
        return x[0] - dx / 2, x[-1] + dx / 2, y[-1] - dy / 2, y[0] + dy / 2

    @property
    def whole(self) -> Window:
        """The window of the whole raster."""
        return slice(0, len(self.northing)), slice(0, len(self.easting))

    def cropped(self, window: Window) -> "Basemap":
        """The terrain of a window alone."""
        rows, columns = window
        return replace(self, easting=self.easting[columns], northing=self.northing[rows], elevation=self.elevation[window])

    def window(self, reached: np.ndarray, margin: float = 0.18) -> Window:
        """Window (rows, columns) around what was reached, released and observed, with a margin and a common aspect ratio."""
        west, east, south, north = self._bounds(reached)
        dx, dy = self.cell_size
        width = max((east - west) * (1 + 2 * margin), FEWEST_CELLS * dx)
        height = max((north - south) * (1 + 2 * margin), FEWEST_CELLS * dy)
        width, height = max(width, WIDTH_TO_HEIGHT * height), max(height, width / WIDTH_TO_HEIGHT)
        columns = _centred((0.5 * (west + east) - self.easting[0]) / dx, width / dx, len(self.easting))
        rows = _centred((self.northing[0] - 0.5 * (south + north)) / dy, height / dy, len(self.northing))
        return rows, columns

    def _bounds(self, reached: np.ndarray) -> tuple[float, float, float, float]:
        boxes = [o.bounds for o in self.outlines] + self._observed_boxes()
        if reached.any():
            x, y = self.easting[reached.any(axis=0)], self.northing[reached.any(axis=1)]
            boxes.append((x.min(), y.min(), x.max(), y.max()))
        if not boxes:
            west, east, south, north = self.extent(self.whole)
            return west, east, south, north
        low, high = np.min(boxes, axis=0), np.max(boxes, axis=0)
        return float(low[0]), float(high[2]), float(low[1]), float(high[3])

    def _observed_boxes(self) -> list[tuple[float, float, float, float]]:
        """Bounds of observed outlines and points on the raster; a thalweg may go on far beyond the flow."""
        from shapely import box

        west, east, south, north = self.extent(self.whole)
        seen = [mark.geometry.intersection(box(west, south, east, north)) for mark in self.observed]
        return [shape.bounds for shape in seen if not shape.is_empty and "Line" not in shape.geom_type]


def png(figure: Any, dpi: int = DPI) -> bytes:
    """PNG of a figure; equal figures give equal bytes."""
    from io import BytesIO

    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None}, pil_kwargs={"compress_level": COMPRESSION})
    return buffer.getvalue()


def _centred(middle: float, length: float, available: int) -> slice:
    n = min(math.ceil(length), available)
    start = min(max(round(middle - n / 2 + 0.5), 0), available - n)
    return slice(start, start + n)


def draw_map(basemap: Basemap, values: np.ndarray, style: MapStyle, window: Window | None = None, title: str = "") -> Any:
    """Figure of ``values`` (rows, columns) over hillshade; cells that are NaN or at most ``style.faintest`` are transparent."""
    window = window or basemap.whole
    axes, bar = blank_map(basemap, window, title)
    draw_values(axes, bar, basemap.extent(window), values[window], style)
    return axes.figure


def blank_map(basemap: Basemap, window: Window, title: str = "", new_figure: Callable[..., Any] | None = None) -> tuple[Any, Any]:
    """Axes of a map with everything but its values, and axes for the colour bar, on a figure that ``new_figure`` makes."""
    axes, bar = _sheet(basemap.extent(window), TITLE_HEIGHT if title else 0.0, new_figure)
    axes.set_title(title, loc="left", fontsize=NORMAL, color=INK, pad=6)
    draw_ground(axes, basemap, window)
    draw_frame(axes, basemap, window)
    return axes, bar


def _sheet(extent: Extent, above: float = 0.0, new_figure: Callable[..., Any] | None = None) -> tuple[Any, Any]:
    """Axes in the shape of the extent with room [inch] above, and axes of the colour bar below, on a new figure."""
    from matplotlib.figure import Figure

    left, bottom, right, top = MARGINS
    bar, words = BAR
    ratio = (extent[1] - extent[0]) / (extent[3] - extent[2])
    width = min(WIDE - left - right, HIGHEST * ratio)
    height = width / ratio
    high = height + bottom + top + above + bar + words
    figure = (new_figure or Figure)(figsize=(WIDE, high))
    middle = left + (WIDE - left - right - width) / 2
    axes = figure.add_axes((middle / WIDE, (bottom + bar + words) / high, width / WIDE, height / high))
    below = figure.add_axes((left / WIDE, words / high, (WIDE - left - right) / WIDE, bar / high))
    return axes, below


def draw_ground(axes: Any, basemap: Basemap, window: Window) -> None:
    """Hillshade and contour lines of a window."""
    z = basemap.elevation[window]
    known = np.where(np.isfinite(z), z, np.nanmin(basemap.elevation))
    shade = np.ma.masked_where(~np.isfinite(z), hillshade(known, basemap.cell_size))
    extent = basemap.extent(window)
    axes.set_facecolor("#e9ebee")
    axes.imshow(shade, cmap="gray", vmin=-1.5, vmax=1.05, extent=extent, interpolation="bicubic", zorder=0)
    draw_unknown(axes, ~np.isfinite(z), extent)
    if np.ptp(known) > 0:
        _contours(axes, basemap, window)


def _contours(axes: Any, basemap: Basemap, window: Window) -> None:
    z = basemap.elevation[window]
    levels = round_ticks(float(np.nanmin(z)), float(np.nanmax(z)), 9)
    x, y = basemap.easting[window[1]], basemap.northing[window[0]]
    lines = axes.contour(x, y, z, levels=levels, colors="#4a5560", linewidths=0.4, alpha=0.55, zorder=1)
    axes.clabel(lines, levels[::3], fontsize=SMALL, fmt=lambda v: f"{v:.0f} m", inline_spacing=2)


def draw_frame(axes: Any, basemap: Basemap, window: Window) -> None:
    """Outlines of releases, obstacles and friction zones, their labels, coordinates in km, scale bar and north arrow."""
    west, east, south, north = basemap.extent(window)
    axes.set(xlim=(west, east), ylim=(south, north), aspect="equal")
    draw_marks(axes, basemap)
    _coordinates(axes, max(east - west, north - south))
    _scale_bar(axes, east - west)
    _north_arrow(axes)


def _coordinates(axes: Any, width: float) -> None:
    from matplotlib.ticker import MaxNLocator

    decimals = max(0, min(3, 3 - math.floor(math.log10(width / 4))))
    for axis, name in ((axes.xaxis, "Easting [km]"), (axes.yaxis, "Northing [km]")):
        axis.set_major_locator(MaxNLocator(3, steps=[1, 2, 5, 10], prune="both"))
        axis.set_major_formatter(lambda v, _: f"{v / 1e3:.{decimals}f}")
        axis.set_label_text(name, fontsize=SMALL, color=INK)
        axis.labelpad = 1
    axes.tick_params(labelsize=SMALL, pad=2, colors=INK, length=3, width=0.6)
    for label in axes.get_yticklabels():
        label.set(rotation=90, va="center")
    for spine in axes.spines.values():
        spine.set(linewidth=0.6, color=INK)


def _scale_bar(axes: Any, width: float) -> None:
    from matplotlib.font_manager import FontProperties
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

    bar = round_length(width)
    label = f"{bar / 1e3:g} km" if bar >= 1000 else f"{bar:g} m"
    artist = AnchoredSizeBar(
        axes.transData, bar, label, "lower left", pad=0.35, borderpad=0.6, sep=3, color=INK,
        size_vertical=width * 0.004, fontproperties=FontProperties(size=SMALL),
    )  # fmt: skip
    artist.patch.set(alpha=0.8, linewidth=0)
    artist.set_zorder(5)
    axes.add_artist(artist)


def _north_arrow(axes: Any) -> None:
    box = {"boxstyle": "round,pad=0.2", "facecolor": "white", "alpha": 0.8, "linewidth": 0}
    axes.annotate(
        "N", xy=(0.962, 0.86), xytext=(0.962, 0.955), xycoords="axes fraction", ha="center", va="center", fontsize=SMALL,
        color=INK, bbox=box, zorder=5, arrowprops={"arrowstyle": "<|-", "color": INK, "linewidth": 1.3, "shrinkA": 1},
    )  # fmt: skip


def tint_by_elevation(axes: Any, below: Any, basemap: Basemap) -> None:
    """Colour the whole terrain by its elevation, with a colour bar in the axes ``below``."""
    z = np.ma.masked_invalid(basemap.elevation)
    tint = axes.imshow(z, cmap=palette_of("elevation").listed(), extent=basemap.extent(basemap.whole), alpha=0.45, zorder=1)
    bar = axes.figure.colorbar(tint, cax=below, orientation="horizontal")
    bar.set_label("elevation [m]", fontsize=NORMAL, color=INK)
    bar.ax.tick_params(labelsize=NORMAL, colors=INK, length=3)
