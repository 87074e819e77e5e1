"""Maps of a page as SVG: cells over one hillshade that all maps of the page share, with coordinates, scale, north and legend.

The hillshade, the contour lines, the outlines and the frame are written once, as definitions; each map adds its cells, an image
with one pixel a cell. Letters are those of the page, so that maps are sharp in print and follow its dark mode.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from runout.hazard.round_numbers import round_length, round_ticks
from runout.report.maps import Basemap
from runout.report.marks import INK, LINE, OBSERVED, OBSTACLE, PROBE, RELEASE, Box, Mark, label_places
from runout.report.relief import address, relief_picture
from runout.report.values import MapStyle, Window, colour_scale, scale_ticks

WIDTH, TALLEST = 440.0, 470.0  # of a map with its coordinates, and height of the map [units of the picture]
LEFT, BELOW, EDGE = 20.0, 20.0, 6.0  # room for the coordinates, and at the other sides
MOST_PIXELS = 1400  # a side of an image; larger windows are thinned out
SHADE_PIXELS = 900  # about the longer side of the relief, as a PDF shows each pixel as a square
DARKEST = 148  # grey of the relief, light enough for print
BROAD = 0.7  # height over width of maps that are printed in landscape
CONTOURS = 8
TRANSPARENT = 255  # index of cells without a colour
BAR_PARTS = 48  # of a continuous colour bar


@dataclass(frozen=True)
class DrawnMap:
    """A map for a template: the picture, and its legend below it."""

    svg: Markup
    legend: Markup
    broad: bool = False  # a sheet in landscape shows it larger


class VectorMaps:
    """Maps of one window of a terrain, with its outlines and marks.

    Parameters
    ----------
    basemap : Basemap
        Terrain, outlines and marks in map coordinates.
    window : Window
        Rows and columns that the maps show.
    name : str
        Start of the names of the definitions; another one for each window of a page.
    """

    def __init__(self, basemap: Basemap, window: Window, name: str = "map"):
        self.ground, self.window, self.name = basemap.cropped(window), window, name
        west, east, south, north = self.extent = self.ground.extent(self.ground.whole)
        ratio = (north - south) / (east - west)
        self.width = min(WIDTH - LEFT - EDGE, TALLEST / ratio)
        self.height, self.broad = self.width * ratio, ratio < BROAD
        self.step = max(1, math.ceil(max(self.ground.elevation.shape) / MOST_PIXELS))

    def definitions(self) -> Markup:
        """What all maps share; it stands once in a page, before them."""
        relief = relief_picture(self.ground.elevation, self.ground.cell_size, MOST_PIXELS, DARKEST, SHADE_PIXELS)
        parts = [
            '<pattern id="hatch" width="5" height="5" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">'
            f'<rect width="5" height="5" fill="#ffffff59"/><path d="M0 0V5" stroke="{OBSTACLE}" stroke-width="1.4"/></pattern>',
            f'<g id="{self.name}-ground">{self._image(address(relief), smooth=True)}{self._contours()}</g>',
            f'<g id="{self.name}-marks">{"".join(self._marks())}</g>',
            f'<g id="{self.name}-frame">{"".join(self._frame())}</g>',
        ]
        return Markup(f'<svg width="0" height="0" class="shared" aria-hidden="true"><defs>{"".join(parts)}</defs></svg>')

    def drawn(self, values: np.ndarray, style: MapStyle, alt: str) -> DrawnMap:
        """A map of ``values`` (rows, columns) of the whole raster; NaN and at most ``style.faintest`` have no colour."""
        shown = np.ma.masked_invalid(np.asarray(values[self.window][:: self.step, :: self.step], np.float64))
        shown = np.ma.masked_less_equal(shown, style.faintest) * style.scale
        scale = colour_scale(shown, style)
        place = np.ma.asarray(scale["norm"](shown))
        whole = np.issubdtype(place.dtype, np.integer)
        index = np.clip(place.filled(0) if whole else place.filled(0.0) * TRANSPARENT, 0, TRANSPARENT - 1).astype(np.uint8)
        index[np.ma.getmaskarray(shown)] = TRANSPARENT
        colours = scale["cmap"](np.arange(256) if whole else np.linspace(0, 1, TRANSPARENT), bytes=True)[:, :3]
        return DrawnMap(self._map(_indexed(index, colours), alt), self._bar(shown, scale, style), self.broad)

    def classes(self, values: np.ndarray, entries: Sequence[Mapping[str, Any]], alt: str) -> DrawnMap:
        """A map of classes (rows, columns) in the colours of their entries, the first for 1; 0 has no colour."""
        numbers = np.nan_to_num(values[self.window][:: self.step, :: self.step]).astype(np.uint8)
        index = np.where(numbers > 0, numbers - 1, TRANSPARENT).astype(np.uint8)
        colours = np.array([[int(entry["colour"].lstrip("#")[k : k + 2], 16) for k in (0, 2, 4)] for entry in entries], np.uint8)
        legend = "".join(
            f'<li><i style="background:{escape(e["colour"])}"></i><b>{escape(e["name"])}</b> {escape(e["text"])} '
            f"<small>checked: {escape(e['checked'])}</small></li>"
            for e in reversed(entries)
        )
        return DrawnMap(self._map(_indexed(index, colours), alt), Markup(f'<ul class="classes">{legend}</ul>'), self.broad)

    def _map(self, image: str, alt: str) -> Markup:
        whole_width, whole_height = self.width + LEFT + EDGE, self.height + BELOW + EDGE
        return Markup(
            f'<svg class="map" viewBox="0 0 {whole_width:.1f} {whole_height:.1f}" role="img" aria-label="{escape(alt)}">'
            f'<svg x="{LEFT}" y="{EDGE}" width="{self.width:.1f}" height="{self.height:.1f}">'
            f'<use href="#{self.name}-ground"/>{self._image(image)}<use href="#{self.name}-marks"/></svg>'
            f'<use href="#{self.name}-frame"/></svg>'
        )

    def _image(self, source: str, smooth: bool = False) -> str:
        look = "" if smooth else ' class="v-cells"'
        size = f'width="{self.width:.1f}" height="{self.height:.1f}"'
        return f'<image href="{source}" {size} preserveAspectRatio="none"{look}/>'

    def _contours(self) -> str:
        """Contour lines of round elevations; every other one has its elevation."""
        from contourpy import contour_generator
        from shapely import LineString

        step = max(1, math.ceil(max(self.ground.elevation.shape) / 300))
        z = np.ma.masked_invalid(np.pad(self.ground.elevation[::step, ::step], 1, mode="edge"))
        if z.count() == 0 or np.ptp(z.compressed()) == 0:
            return ""
        west, east, south, north = self.extent
        inner = self.ground.easting[::step], self.ground.northing[::step]
        places = self._to_picture(np.concatenate([[west], inner[0], [east]]), np.concatenate([[north], inner[1], [south]]))
        lines, labels = [], []
        generator = contour_generator(*places, z)
        for number, level in enumerate(round_ticks(float(z.min()), float(z.max()), CONTOURS)):
            parts = [LineString(line).simplify(0.7) for line in generator.lines(level) if len(line) > 3]
            lines += [self._path(part, placed=True) for part in parts]
            if parts and number % 2 == 0:
                longest = max(parts, key=lambda part: part.length)
                x, y = longest.interpolate(0.5, normalized=True).coords[0]
                labels.append(text(x, y, f"{level:g} m", "contour"))
        return f'<path d="{"".join(lines)}" class="v-contours"/>{"".join(labels)}'

    def _to_picture(self, easting: Any, northing: Any) -> tuple[np.ndarray, np.ndarray]:
        west, east, _, north = self.extent
        scale = self.width / (east - west)
        return (np.asarray(easting, np.float64) - west) * scale, (north - np.asarray(northing, np.float64)) * scale

    def _path(self, geometry: Any, placed: bool = False) -> str:
        """Commands of a path for the lines and rings of a geometry, in map coordinates or ``placed`` in the picture."""
        if hasattr(geometry, "geoms"):
            return "".join(self._path(part, placed) for part in geometry.geoms)
        if geometry.geom_type == "Polygon":
            return "".join(self._path(ring, placed) + "Z" for ring in (geometry.exterior, *geometry.interiors))
        if geometry.is_empty or geometry.geom_type == "Point":
            return ""
        x, y = np.asarray(geometry.coords)[:, :2].T
        x, y = (x, y) if placed else self._to_picture(x, y)
        return "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True))

    def _marks(self) -> Iterator[str]:
        """Outlines and points, then their labels, which do not cover each other."""
        ground = self.ground
        for zone in ground.zones:
            yield f'<path d="{self._path(zone.geometry)}" class="v-line" stroke="{INK}" stroke-dasharray="5 3"/>'
        for obstacle in ground.obstacles:
            yield f'<path d="{self._path(obstacle.geometry)}" fill="url(#hatch)" stroke="{OBSTACLE}"/>'
        for marks, colour in ((ground.observed, OBSERVED), (ground.probes, PROBE)):
            for mark in marks:
                yield self._symbol(mark, colour)
        for outline in ground.outlines:
            yield self._cased(self._path(outline), RELEASE)
        for x, y, label, colour in label_places(ground, self.extent, self._box, (self.width, self.height)):
            yield text(x, y, label, "label", f' fill="{colour}"')

    def _symbol(self, mark: Mark, colour: str) -> str:
        if mark.geometry.geom_type != "Point":
            return self._cased(self._path(mark.geometry), colour)
        x, y = self._to_picture(mark.geometry.x, mark.geometry.y)
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}" stroke="white"/>'

    def _cased(self, path: str, colour: str) -> str:
        return f'<path d="{path}" class="v-line" stroke="white" stroke-width="2.6" opacity=".8"/>' + (
            f'<path d="{path}" class="v-line" stroke="{colour}"/>'
        )

    def _box(self, geometry: Any) -> Box:
        (left, right), (bottom, top) = self._to_picture(geometry.bounds[0::2], geometry.bounds[1::2])
        return left, top, right, bottom

    def _frame(self) -> Iterator[str]:
        """Frame, coordinates in km, scale bar and north arrow."""
        west, east, south, north = self.extent
        yield f'<rect x="{LEFT}" y="{EDGE}" width="{self.width:.1f}" height="{self.height:.1f}" class="v-frame"/>'
        decimals = max(0, min(3, 3 - math.floor(math.log10(max(east - west, north - south) / 4))))
        for value in round_ticks(west, east, 5):
            x = LEFT + float(self._to_picture(value, north)[0])
            yield f'<path d="M{x:.1f} {EDGE + self.height:.1f}v3" class="v-frame"/>'
            yield text(x, EDGE + self.height + 11, f"{value / 1e3:.{decimals}f}", "coordinate")
        for value in round_ticks(south, north, 5):
            y = EDGE + float(self._to_picture(west, value)[1])
            if y > EDGE + self.height - LINE:  # the corner belongs to the easting
                continue
            yield f'<path d="M{LEFT} {y:.1f}h-3" class="v-frame"/>'
            yield text(LEFT - 10, y, f"{value / 1e3:.{decimals}f}", "coordinate", f' transform="rotate(-90 {LEFT - 10} {y:.1f})"')
        length = round_length(east - west)
        bar = length * self.width / (east - west)
        x, y = LEFT + 10, EDGE + self.height - 10
        words = f"{length / 1e3:g} km" if length >= 1000 else f"{length:g} m"
        box = f'<rect x="{x - 5:.1f}" y="{y - 18:.1f}" width="{max(bar, 30) + 10:.1f}" height="24" class="v-plate"/>'
        yield f'{box}<path d="M{x:.1f} {y - 3:.1f}v3h{bar:.1f}v-3" class="v-scale"/>'
        yield text(x + bar / 2, y - 9, words, "onmap")
        x, y = LEFT + self.width - 16, EDGE + 8
        yield f'<rect x="{x - 9:.1f}" y="{y - 3:.1f}" width="18" height="34" class="v-plate"/>'
        yield f'<path d="M{x:.1f} {y:.1f}l5 14h-10z" fill="{INK}"/>' + text(x, y + 22, "N", "onmap")

    def _bar(self, shown: np.ma.MaskedArray, scale: Mapping[str, Any], style: MapStyle) -> Markup:
        """Colour bar with the numbers and the unit below it."""
        norm, colours = scale["norm"], scale["cmap"]
        bounds = getattr(norm, "boundaries", None)
        parts = len(bounds) - 1 + style.beyond if bounds is not None else BAR_PARTS
        if bounds is None:
            painted = colours((np.arange(parts) + 0.5) / parts, bytes=True)[:, :3]
        else:
            middles = [*(0.5 * (bounds[1:] + bounds[:-1])), 2.0 * bounds[-1]][:parts]
            painted = colours(norm(np.array(middles)), bytes=True)[:, :3]
        width = self.width / parts
        rects = "".join(
            f'<rect x="{LEFT + k * width:.1f}" width="{width + 0.3:.1f}" height="9" fill="#{r:02x}{g:02x}{b:02x}"/>'
            for k, (r, g, b) in enumerate(painted)
        )
        if bounds is not None:
            ticks = [(k / parts, label) for k, label in scale_ticks(norm, style)]
        else:
            ticks = [(float(norm(value)), label) for value, label in scale_ticks(norm, style)]
        numbers = "".join(text(LEFT + place * self.width, 18, label, "coordinate") for place, label in ticks)
        above = shown.count() > 0 and bounds is None and float(np.abs(shown).max()) > norm.vmax
        most = f"; largest {_short(float(np.abs(shown).max()))}" if above else ""
        return Markup(
            f'<svg class="bar" viewBox="0 0 {self.width + LEFT + EDGE:.1f} 26" aria-hidden="true">{rects}{numbers}</svg>'
            f'<p class="unit">{escape(style.label)}{most}{_meanings(style)}</p>'
        )


def _meanings(style: MapStyle) -> str:
    """What values from each bound on do, where the style says so."""
    words = [f"from {step:g}: {escape(words)}" for step, words in zip(style.steps, style.meanings, strict=False) if words]
    return "".join(f"; {part}" for part in words)


def _indexed(index: np.ndarray, colours: np.ndarray) -> str:
    """Address of a PNG of colours by their index (rows, columns); :data:`TRANSPARENT` has none."""
    from PIL import Image

    picture = Image.fromarray(index)
    palette = np.zeros((256, 3), np.uint8)
    palette[: len(colours)] = colours
    picture.putpalette(palette.tobytes())
    return address(picture, "png", transparency=TRANSPARENT, optimize=False)


def text(x: float, y: float, words: str, kind: str = "number", more: str = "") -> str:
    """Text of SVG about a place of the picture; ``more`` are further attributes."""
    return f'<text x="{x:.1f}" y="{y:.1f}" class="v-text v-{kind}"{more}>{escape(words)}</text>'


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
