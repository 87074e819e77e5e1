"""QGIS styles of the maps: classes at the thresholds of the site that span the values, transparent where nothing happens."""

from collections.abc import Iterator, Sequence
from itertools import count
from typing import Any
from xml.etree import ElementTree

import numpy as np

from runout.io.vector import PROBABILITY_LEVELS

PROLOGUE = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
DIVERGING = "RdBu_r"
_SIGNED = ("difference", "change", "distance_mean")  # symmetric about 0
_RAMPS = dict.fromkeys(_SIGNED, DIVERGING)
_RAMPS |= {
    "standard_error": "Purples",
    "probability": "YlOrRd",
    "annual": "YlOrRd",
    "share": "YlOrBr",
    "arrival": "viridis_r",
    "members": "YlOrRd",
}
_RAMPS |= {"elevation": "cividis", "slope": "YlOrBr", "safety": "RdYlBu", "drainage": "YlGnBu", "sink": "Blues"}
_DEFAULT_RAMP = "plasma_r"
_GROUND = ("elevation", "slope")
_SMOOTH = (*_GROUND, *_SIGNED)  # coloured without steps
_OPAQUE = ("arrival", *_GROUND)  # their least value is one like any other
_LEGEND_UNITS = {"1": "", "m s-1": " m/s", "m3 s-2": " m³/s²", "degree": "°"}
_CLASSES = 8
ANNUAL_RATES = (1 / 5000, 1 / 1000, 1 / 300, 1 / 100, 1 / 30, 1 / 10)  # [1/a], rates at which land use and protection are decided
_MOST_STEPS = 8  # above the last threshold
_LINEAR = 4.0  # ratio of the largest value to the last threshold from which steps grow like 1, 2, 5


def class_edges(name: str, thresholds: Sequence[float], smallest: float, largest: float) -> list[float]:
    """Lower edges of the coloured classes of a map; a value on an edge belongs to the class above it.

    Parameters
    ----------
    name : str
        Name of the map.
    thresholds : sequence of float
        Thresholds of its quantity, if it has some. Round numbers follow above the last one that is reached.
    smallest, largest : float
        Range of the values, in the unit of the thresholds.
    """
    if any(word in name for word in _SIGNED):
        top = max(_ticks(0.0, max(-smallest, largest), classes=4))
        return [-top, -0.5 * top, 0.0, 0.5 * top, top]
    if "standard_error" in name:
        return _ticks(0.0, largest)
    if "probability" in name or "share" in name:
        return [0.0, *PROBABILITY_LEVELS]
    if "annual" in name:
        return [0.0, *ANNUAL_RATES]
    if name == "elevation":
        return _ticks(smallest, largest)
    if "members" in name:
        return _counts(largest)
    reached = [limit for limit in sorted(thresholds) if limit <= largest]
    if not reached:
        return _ticks(0.0, largest)
    return [0.0, *reached, *_beyond(reached[-1], largest)]


def _ticks(low: float, high: float, classes: int = _CLASSES) -> list[float]:
    """Round numbers from ``low`` or below it to below ``high``."""
    from matplotlib.ticker import MaxNLocator

    locator = MaxNLocator(classes, steps=[1, 2, 2.5, 5, 10])
    ticks = [float(f"{tick:.9g}") for tick in locator.tick_values(low, high if high > low else low + 1.0)]
    return [tick for tick in ticks if tick < high] or ticks[:1]


def _counts(largest: float) -> list[float]:
    """Whole numbers from 1 to at most ``largest``."""
    if largest > _CLASSES:
        return [1.0, *_ticks(0.0, largest)[1:]]
    return [float(number) for number in range(1, max(1, int(largest)) + 1)]


def _beyond(last: float, largest: float) -> list[float]:
    """Round numbers above the last threshold, up to the largest value."""
    if largest < _LINEAR * last:
        return [tick for tick in _ticks(last, largest, classes=3) if tick > 1.1 * last]
    steps = list(_series(last, largest, (1.0, 2.0, 5.0)))
    return steps if len(steps) <= _MOST_STEPS else list(_series(last, largest, (1.0,)))


def _series(last: float, largest: float, digits: Sequence[float]) -> Iterator[float]:
    """Digits times powers of ten from half as much again as ``last`` to ``largest``."""
    for power in count(int(np.floor(np.log10(last)))):
        for digit in digits:
            step = float(f"{digit:g}e{power}")
            if step > largest:
                return
            if step >= 1.5 * last:
                yield step


def below(edge: float) -> float:
    """Number between ``edge`` as float32 and the next smaller float32: what is not above it lies below the edge."""
    stored = np.float32(edge)
    return 0.5 * (float(stored) + float(np.nextafter(stored, np.float32(-np.inf))))


def qml(edges: Sequence[float], unit: str, name: str) -> str:
    """Text of a QGIS style with one colour a class; 0 is transparent where it means that nothing happens.

    Ground and differences have colours between the edges, without steps.

    Parameters
    ----------
    edges : sequence of float
        Lower edges of the classes, ascending, in the unit of the map.
    unit : str
        Unit for the legend.
    name : str
        Name of the map; chooses the colours.
    """
    root = ElementTree.Element("qgis", version="3.22.0", styleCategories="Symbology")
    pipe = ElementTree.SubElement(root, "pipe")
    renderer = ElementTree.SubElement(
        pipe,
        "rasterrenderer",
        type="singlebandpseudocolor",
        band="1",
        alphaBand="-1",
        opacity="0.8",
        nodataColor="",
        classificationMin=f"{edges[0]:g}",
        classificationMax=f"{edges[-1]:g}",
    )
    shader = ElementTree.SubElement(
        ElementTree.SubElement(renderer, "rastershader"),
        "colorrampshader",
        colorRampType="INTERPOLATED" if any(word in name for word in _SMOOTH) else "DISCRETE",
        classificationMode="1",
        clip="0",
        minimumValue=f"{edges[0]:g}",
        maximumValue="inf",
    )
    legend_unit = _LEGEND_UNITS.get(unit, f" {unit}")
    if shader.get("colorRampType") == "INTERPOLATED":
        _add_stops(shader, edges, legend_unit, _ramp(name))
    else:
        _add_classes(shader, list(edges), legend_unit, _ramp(name), transparent=not any(word in name for word in _OPAQUE))
    ElementTree.indent(root)
    return PROLOGUE + ElementTree.tostring(root, encoding="unicode") + "\n"


def palette(entries: Sequence[tuple[int, str, str]]) -> str:
    """Text of a QGIS style of a map of classes: number, colour and words of each; other values are transparent."""
    root = ElementTree.Element("qgis", version="3.22.0", styleCategories="Symbology")
    renderer: Any = {"type": "paletted", "band": "1", "alphaBand": "-1", "opacity": "0.8", "nodataColor": ""}
    shown = ElementTree.SubElement(ElementTree.SubElement(root, "pipe"), "rasterrenderer", renderer)
    colours = ElementTree.SubElement(shown, "colorPalette")
    for number, colour, words in entries:
        ElementTree.SubElement(colours, "paletteEntry", value=str(number), color=colour, alpha="255", label=words)
    ElementTree.indent(root)
    return PROLOGUE + ElementTree.tostring(root, encoding="unicode") + "\n"


def _add_classes(shader: ElementTree.Element, edges: list[float], unit: str, ramp: str, transparent: bool) -> None:
    """Items of the shader: QGIS gives a value the colour of the first item whose value it does not pass."""
    if transparent:
        ElementTree.SubElement(shader, "item", value="0", color="#ffffff", alpha="0", label=f"0{unit}")
    colours = class_colours(ramp, len(edges))
    for k, (lower, colour) in enumerate(zip(edges, colours, strict=True)):
        upper = edges[k + 1] if k + 1 < len(edges) else None
        value = "inf" if upper is None else repr(below(upper))
        label = _label(lower, upper, unit, transparent)
        ElementTree.SubElement(shader, "item", value=value, color=colour, alpha="255", label=label)


def _add_stops(shader: ElementTree.Element, edges: Sequence[float], unit: str, ramp: str) -> None:
    """Items of the shader between which QGIS mixes colours."""
    for value, colour in zip(edges, class_colours(ramp, len(edges)), strict=True):
        ElementTree.SubElement(shader, "item", value=f"{value:g}", color=colour, alpha="255", label=f"{value:g}{unit}")


def _label(lower: float, upper: float | None, unit: str, transparent: bool) -> str:
    """Words of a class from ``lower`` to below ``upper``; 0 itself is not in it where that is transparent."""
    least = "above 0" if transparent and lower == 0 else f"{lower:g}"
    if upper is not None:
        return f"{least} to {upper:g}{unit}"
    return f"{least}{unit}" if least.startswith("above") else f"{least}{unit} or more"


def class_colours(ramp: str, classes: int) -> list[str]:
    """Colours of classes as hexadecimal numbers, from light to dark or as the ramp of matplotlib goes, light in its middle."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    first = 0.0 if ramp == DIVERGING else 0.15  # other ramps begin too light
    colours = colormaps[ramp](first + (1.0 - first) * np.arange(classes) / max(1, classes - 1))
    return [to_hex(colour) for colour in colours]


def _ramp(name: str) -> str:
    return next((ramp for word, ramp in _RAMPS.items() if word in name), _DEFAULT_RAMP)
