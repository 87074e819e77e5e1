"""Renders figures as PNG; the maps of one window share the rendering of their ground."""

from io import BytesIO
from typing import Any

import numpy as np

from runout.report.maps import BAR, Basemap, blank_map
from runout.report.values import VALUES, MapStyle, Window, draw_colour_bar, paint_values

DPI = 200
RIM = 0.02  # [inch] above a colour bar, for its frame
COMPRESSION = 4  # of zlib: 8 % larger files than with 6, in half the time


def png(figure: Any, dpi: int = DPI) -> bytes:
    """PNG of a figure; equal figures give equal bytes."""
    canvas = _canvas(figure, dpi)
    canvas.draw()
    return encoded(_colours(canvas))


class MapPictures:
    """Pictures of several maps of one window. Ground and contour lines are rendered once, and so are colour bars of stated steps.

    Parameters
    ----------
    basemap : Basemap
    window : Window
        Rows and columns that the maps show.
    """

    def __init__(self, basemap: Basemap, window: Window):
        from matplotlib.transforms import Bbox

        self.window, self.extent = window, basemap.extent(window)
        self.axes, bar = blank_map(basemap, window)
        self.bar_place = bar.get_position()
        bar.remove()
        self.bars: dict[MapStyle, Any] = {}
        self.canvas = _canvas(self.axes.figure, DPI)
        self.strip = Bbox.from_bounds(0, 0, self.axes.figure.bbox.width, DPI * (sum(BAR) + RIM))
        outside = (self.axes.xaxis, self.axes.yaxis)  # ticks and numbers, which no value covers
        drawn = [artist for artist in self.axes.get_children() if artist.get_visible() and artist not in outside]
        shown = [artist for artist in drawn if artist.zorder >= VALUES]
        self.above = sorted(shown, key=lambda artist: artist.zorder)
        for artist in self.above:
            artist.set_visible(False)
        self.canvas.draw()
        for artist in self.above:
            artist.set_visible(True)
        self.ground = self.canvas.copy_from_bbox(self.axes.figure.bbox)

    def png(self, values: np.ndarray, style: MapStyle) -> bytes:
        """PNG of ``values`` (rows, columns) of the whole raster, equal to that of :func:`runout.report.maps.draw_map`."""
        return encoded(self.pixels(values, style))

    def pixels(self, values: np.ndarray, style: MapStyle) -> np.ndarray:
        """The picture of :meth:`png` for :func:`encoded`: red, green and blue (rows, columns, 3)."""
        painted, shown = paint_values(self.axes, self.extent, values[self.window], style)
        self.canvas.restore_region(self.ground)
        for artist in (painted, *self.above):
            self.axes.draw_artist(artist)
        self._place_bar(painted, shown, style)
        painted.remove()
        return _colours(self.canvas)

    def _place_bar(self, painted: Any, shown: np.ma.MaskedArray, style: MapStyle) -> None:
        """Draw the colour bar, or copy that of an earlier map; bars of stated steps are the same on all maps."""
        if style in self.bars:
            self.canvas.restore_region(self.bars[style])
            return
        bar = self.axes.figure.add_axes(self.bar_place)
        draw_colour_bar(painted, bar, shown, style)
        self.axes.draw_artist(bar)
        bar.remove()
        if style.steps:
            self.bars[style] = self.canvas.copy_from_bbox(self.strip)


def _canvas(figure: Any, dpi: int) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(dpi)
    return FigureCanvasAgg(figure)


def _colours(canvas: Any) -> np.ndarray:
    """Copy of what is drawn (rows, columns, 3), without transparency."""
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])


def encoded(pixels: np.ndarray) -> bytes:
    """PNG of red, green and blue (rows, columns, 3) of eight bits; other threads go on meanwhile."""
    from PIL import Image

    buffer = BytesIO()
    Image.fromarray(pixels).save(buffer, "png", compress_level=COMPRESSION)
    return buffer.getvalue()
