"""Classes of maps and their QGIS styles: at the thresholds of the site, over all values, transparent where nothing happens."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from runout.hazard.round_numbers import round_edges, round_series
from runout.palettes import palette_of
from runout.variables import VARIABLES

PROLOGUE = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
NUMBERS, STEPS, MIXED = "paletted", "DISCRETE", "INTERPOLATED"  # kinds of classes, as QGIS calls them
OPACITY = 0.8
_LEGEND_UNITS = {"1": "", "m s-1": " m/s", "m3 s-2": " m³/s²", "m2 s-1": " m²/s", "degree": "°"}
_MEMBERS = 8  # classes of a count
_MOST_STEPS = 8  # above the last threshold
_LINEAR = 4.0  # ratio of the largest value to the last threshold from which steps grow like 1, 2, 5


@dataclass(frozen=True)
class MapClasses:
    """Classes of a map as a legend has them."""

    # lower edge of each class, ascending, in the printed unit; a value on an edge belongs to the class above it
    edges: tuple[float, ...]
    # colours, labels: hexadecimal colour and words of each class
    colours: tuple[str, ...]
    labels: tuple[str, ...]
    # NUMBERS, where each edge is the number of a class; STEPS; or MIXED, where colours are mixed between the edges
    kind: str = STEPS
    nothing: str = ""  # words of the value 0, which is transparent; empty if 0 is a value like any other

    @classmethod
    def of(cls, edges: Sequence[float], unit: str, name: str) -> "MapClasses":
        """Classes of the map ``name`` from their lower edges (:func:`class_edges`), in a ``unit``."""
        palette, units = palette_of(name), legend_unit(unit)
        colours = tuple(palette.hexadecimal(len(edges)))
        if palette.smooth:
            return cls(tuple(edges), colours, tuple(f"{edge:g}{units}" for edge in edges), MIXED)
        upper = [*edges[1:], None]
        labels = [
            _label(edge, top, units, not palette.opaque) + (f": {meaning}" if (meaning := palette.meaning(edge)) else "")
            for edge, top in zip(edges, upper, strict=True)
        ]
        return cls(tuple(edges), colours, tuple(labels), STEPS, "" if palette.opaque else f"0{units}")

    @classmethod
    def over(cls, name: str, maps: Iterable[np.ndarray], thresholds: Sequence[float] = ()) -> "MapClasses":
        """Classes over all values of the ``maps`` [unit of :data:`VARIABLES`] of one variable; thresholds in the printed unit."""
        units, divisor = VARIABLES[name].printed
        finite = [values[np.isfinite(values)] / divisor for values in maps]
        ends = [float(end) for values in finite if values.size for end in (values.min(), values.max())] or [0.0]
        return cls.of(class_edges(name, thresholds, min(ends), max(ends)), units, name)

    @classmethod
    def numbered(cls, entries: Sequence[tuple[int, str, str]]) -> "MapClasses":
        """Classes of a map of numbers from the number, colour and words of each; other values are transparent."""
        numbers, colours, labels = zip(*entries, strict=True)
        return cls(tuple(map(float, numbers)), colours, labels, NUMBERS, "none")

    def painted(self, values: np.ndarray) -> np.ndarray:
        """Colours (rows, columns, 4) of uint8 for values in the printed unit; transparent where nothing happens or is known."""
        from matplotlib.colors import to_rgba_array

        table = np.vstack([np.zeros((1, 4)), to_rgba_array(self.colours) * (1.0, 1.0, 1.0, OPACITY)])
        place = np.digitize(np.nan_to_num(values, nan=-np.inf).astype(np.float32), np.array(self.edges, np.float32))
        shown = np.isfinite(values) & ((values > 0) | (not self.nothing))
        return np.round(255 * table[np.where(shown, place, 0)]).astype(np.uint8)

    def qml(self) -> str:
        """Text of a QGIS style of a raster."""
        root = ElementTree.Element("qgis", version="3.22.0", styleCategories="Symbology")
        renderer = ElementTree.SubElement(
            ElementTree.SubElement(root, "pipe"), "rasterrenderer", band="1", alphaBand="-1", opacity=f"{OPACITY}", nodataColor=""
        )
        if self.kind == NUMBERS:
            self._add_numbers(renderer)
        else:
            self._add_shader(renderer)
        ElementTree.indent(root)
        return PROLOGUE + ElementTree.tostring(root, encoding="unicode") + "\n"

    def _add_numbers(self, renderer: ElementTree.Element) -> None:
        renderer.set("type", NUMBERS)
        colours = ElementTree.SubElement(renderer, "colorPalette")
        for number, colour, words in zip(self.edges, self.colours, self.labels, strict=True):
            ElementTree.SubElement(colours, "paletteEntry", value=f"{number:g}", color=colour, alpha="255", label=words)

    def _add_shader(self, renderer: ElementTree.Element) -> None:
        """Items of the shader: in steps QGIS gives a value the colour of the first item whose value it does not pass."""
        bounds = {"classificationMin": f"{self.edges[0]:g}", "classificationMax": f"{self.edges[-1]:g}"}
        renderer.attrib |= {"type": "singlebandpseudocolor", **bounds}
        shader = ElementTree.SubElement(
            ElementTree.SubElement(renderer, "rastershader"),
            "colorrampshader",
            colorRampType=self.kind,
            classificationMode="1",
            clip="0",
            minimumValue=f"{self.edges[0]:g}",
            maximumValue="inf",
        )
        if self.nothing:
            ElementTree.SubElement(shader, "item", value="0", color="#ffffff", alpha="0", label=self.nothing)
        tops = [f"{edge:g}" for edge in self.edges] if self.kind == MIXED else [*(repr(below(e)) for e in self.edges[1:]), "inf"]
        for value, colour, label in zip(tops, self.colours, self.labels, strict=True):
            ElementTree.SubElement(shader, "item", value=value, color=colour, alpha="255", label=label)


def class_edges(name: str, thresholds: Sequence[float], smallest: float, largest: float) -> list[float]:
    """Lower edges of the coloured classes of a map; a value on an edge belongs to the class above it.

    Parameters
    ----------
    name : str
        Name of the map.
    thresholds : sequence of float
        Thresholds of its quantity, if it has some. Round numbers follow above the last one that is reached. The edges of a palette
        with classes are the same for all values; thresholds come between classes that have a meaning.
    smallest, largest : float
        Range of the values, in the unit of the thresholds.
    """
    palette = palette_of(name)
    if palette.signed:
        top = max(round_edges(0.0, max(-smallest, largest), classes=4))
        return [-top, -0.5 * top, 0.0, 0.5 * top, top]
    if palette.classes:
        return [0.0, *sorted({*palette.classes, *(thresholds if palette.meanings else ())})]
    if "members" in name:
        return _counts(largest)
    reached = [limit for limit in sorted(thresholds) if limit <= largest]
    if not reached:
        return round_edges(smallest if name == "elevation" else 0.0, largest)
    return [0.0, *reached, *_beyond(reached[-1], largest)]


def _counts(largest: float) -> list[float]:
    """Whole numbers from 1 to at most ``largest``."""
    if largest > _MEMBERS:
        return [1.0, *round_edges(0.0, largest)[1:]]
    return [float(number) for number in range(1, max(1, int(largest)) + 1)]


def _beyond(last: float, largest: float) -> list[float]:
    """Round numbers above the last threshold, up to the largest value."""
    if largest < _LINEAR * last:
        return [tick for tick in round_edges(last, largest, classes=3) if tick > 1.1 * last]
    return round_series(1.5 * last, largest, _MOST_STEPS)


def below(edge: float) -> float:
    """Number between ``edge`` as float32 and the next smaller float32: what is not above it lies below the edge."""
    stored = np.float32(edge)
    return 0.5 * (float(stored) + float(np.nextafter(stored, np.float32(-np.inf))))


def legend_unit(unit: str) -> str:
    """A unit after a number in a legend."""
    return _LEGEND_UNITS.get(unit, f" {unit}")


def _label(lower: float, upper: float | None, unit: str, transparent: bool) -> str:
    """Words of a class from ``lower`` to below ``upper``; 0 itself is not in it where that is transparent."""
    least = "above 0" if transparent and lower == 0 else f"{lower:g}"
    if upper is not None:
        return f"{least} to {upper:g}{unit}"
    return f"{least}{unit}" if least.startswith("above") else f"{least}{unit} or more"
