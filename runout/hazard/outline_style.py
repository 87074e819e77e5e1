"""QGIS styles (QML) of the layers of outlines.gpkg, slopes/ and screen/: lines and labels that leave the maps below them visible.

A style has one symbol, categories or classes, of fills, lines or markers.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from runout.hazard.danger import INTENSITY, LEVEL, entries_of, label
from runout.hazard.style import PROLOGUE
from runout.palettes import OBSERVED, OBSTACLE, PROBABILITY_LEVELS, PROBE, RELEASE, palette_of

if TYPE_CHECKING:
    import xarray as xr

_ZONE = "#22282f"
_STRUCTURE = "#3f4750"
_RATE = "#8c1a4b"
_WATER = "#1f78b4"
_BASELINE = "#b8460e"
_STEP = "#d7263d"
_HIGHEST = 1e12  # [Pa] that stands for no limit
_OBSTACLE_LABEL = "if(\"height_m\" < 0, '', '+') || \"height_m\" || ' m'"
_REPLACED = "coalesce(round(\"basal_friction_angle_deg\", 1) || '°', attribute(@feature, 'parameters'))"
_ZONE_LABEL = f'if("factor" is null, {_REPLACED}, \'friction times \' || "factor")'
_BASELINE_LABEL = "'baseline: ' || \"thickness_m\" || ' m or more'"
_PLACE_LABEL = 'coalesce(nullif("name", \'\'), "kind")'
_PROPOSED_LABEL = "\"rank\" || ': ' || format_number(\"volume_m3\", 0) || ' m³'"
FILL, LINE, MARKER = "fill", "line", "marker"  # kinds of symbols
_LAYERS = {FILL: "SimpleFill", LINE: "SimpleLine", MARKER: "SimpleMarker"}
_DEFAULTS = {
    FILL: {"outline_style": "solid", "outline_width_unit": "MM"},
    LINE: {"line_style": "solid", "line_width_unit": "MM", "capstyle": "round", "joinstyle": "round"},
    MARKER: {"name": "circle", "size": "2.6", "size_unit": "MM", "outline_color": "#ffffff", "outline_width": "0.4"},
}
_GEOMETRIES = {FILL: "PolygonGeometry", LINE: "LineGeometry", MARKER: "PointGeometry"}
_PLACEMENTS = {FILL: "0", LINE: "2", MARKER: "0"}  # of labels: around, along, around
_RENDERER: Any = {"symbollevels": "0", "enableorderby": "0", "forceraster": "0"}


def outline_styles() -> dict[str, str]:
    """Text of the QGIS style of each layer of ``outlines.gpkg``."""
    return {
        "release": one_symbol(FILL, _outline(RELEASE, "0.7") | {"casing": "1.5"}, '"name"', RELEASE),
        "inundation": _levels(PROBABILITY_LEVELS),
        "obstacles": one_symbol(FILL, _hatched(OBSTACLE), _OBSTACLE_LABEL, OBSTACLE),
        "friction_zones": one_symbol(FILL, _outline(_ZONE, "0.4") | {"outline_style": "dash"}, _ZONE_LABEL, _ZONE),
        "structures": one_symbol(FILL, _filled("#b9c0c7", _STRUCTURE), '"name"', _STRUCTURE),
        "facades": classes(LINE, "max_pressure_pa", list(_pressures())),
        "observed_outline": one_symbol(FILL, _outline(OBSERVED, "0.7"), "'observed ' || \"shows\"", OBSERVED),
        "gauges": one_symbol(MARKER, {"color": OBSERVED, "name": "triangle", "size": "3"}, '"label"', OBSERVED),
        "thalweg": one_symbol(LINE, {"line_color": OBSERVED, "line_width": "0.5", "line_style": "dash"}),
        "return_periods": one_symbol(FILL, _outline(_RATE, "0.5"), "\"return_period_a\" || ' a'", _RATE),
        "probes": one_symbol(MARKER, {"color": PROBE, "name": "circle"}, '"name"', PROBE),
        "inflow_lines": one_symbol(LINE, {"line_color": RELEASE, "line_width": "1.2"}, '"name"', RELEASE),
        "inflow_areas": one_symbol(FILL, _outline(RELEASE, "0.7") | {"outline_style": "dash"}, '"name"', RELEASE),
        "cross_sections": one_symbol(LINE, {"line_color": PROBE, "line_width": "0.7"}, '"name"', PROBE),
    }


def danger_styles(hazard: "xr.Dataset") -> dict[str, str]:
    """Text of the QGIS style of the layers of classes and levels of danger; none without a scheme."""
    layers = {"danger_level": (LEVEL, "level"), "intensity_class": (INTENSITY, "class")}
    return {
        layer: categories(FILL, column, [(e["name"], label(e), _filled(e["colour"], "#6b6b6b")) for e in entries_of(hazard, name)])
        for layer, (name, column) in layers.items()
        if name in hazard
    }


def arrival_style(edges: Sequence[float]) -> dict[str, str]:
    """Text of the QGIS style of the layer ``arrival`` from the bounds of its times [s]; none without times."""
    colours = palette_of("arrival").hexadecimal(max(1, len(edges) - 1))
    shown = [
        (low, high, f"{low:g} to {high:g} s", _filled(colour, colour) | {"outline_width": "0.1"})
        for low, high, colour in zip(edges, edges[1:], colours, strict=False)
    ]
    return {"arrival": classes(FILL, '("from_s" + "to_s") / 2', shown)} if shown else {}


def slope_styles() -> dict[str, str]:
    """Text of the QGIS style of each layer that ``runout suggest-release`` writes."""
    return {
        "release": one_symbol(FILL, _outline(RELEASE, "0.7"), _PROPOSED_LABEL, RELEASE),
        "sinks": one_symbol(FILL, _filled("#a6cee3", _WATER)),
        "flow_paths": one_symbol(LINE, {"line_color": _WATER, "line_width": "0.4"}),
    }


def screen_styles() -> dict[str, str]:
    """Text of the QGIS style of each layer that ``runout screen`` writes."""
    markers = {
        "steep step": {"color": _STEP, "name": "triangle"},
        "leaves a channel": {"color": _WATER, "name": "diamond"},
        "structure": {"color": _STRUCTURE, "name": "square"},
        "obstacle": {"color": OBSTACLE, "name": "square"},
    }
    shown = [(kind, kind, {"size": "3.2", **marker}) for kind, marker in markers.items()]
    return {
        "extent": one_symbol(FILL, _outline(_BASELINE, "0.6") | {"outline_style": "dash"}, _BASELINE_LABEL, _BASELINE),
        "flow_path": one_symbol(LINE, {"line_color": _WATER, "line_width": "0.5"}),
        "places": categories(MARKER, "kind", shown, _PLACE_LABEL, _STRUCTURE),
    }


def _outline(colour: str, width: str) -> dict[str, str]:
    """A polygon without a fill."""
    return {"outline_color": colour, "outline_width": width, "style": "no"}


def _filled(colour: str, outline: str) -> dict[str, str]:
    return {"color": colour, "outline_color": outline, "outline_width": "0.3"}


def _hatched(colour: str) -> dict[str, str]:
    return {"color": colour, "style": "b_diagonal", "outline_color": colour, "outline_width": "0.5"}


def _levels(levels: Iterable[float]) -> str:
    """A line for each level of probability, darker and wider the higher it is."""
    sorted_levels = sorted(levels)
    colours = palette_of("probability").hexadecimal(len(sorted_levels) + 1)[1:]  # those of the classes of the map
    shown = [
        (level, f"probability {100 * level:g} % or more", _outline(colour, f"{0.4 + 0.1 * k:.1f}"))
        for k, (level, colour) in enumerate(zip(sorted_levels, colours, strict=True))
    ]
    return categories(FILL, "probability", shown)


def _pressures() -> Iterator[tuple[float, float, str, dict[str, str]]]:
    """A line for each class of pressure on facades, darker and wider the higher it is."""
    palette = palette_of("pressure")
    edges = (0.0, *palette.classes)
    for k, (low, high) in enumerate(zip(edges, (*edges[1:], math.inf), strict=True)):
        label = f"{low:g} to {high:g} kPa" if math.isfinite(high) else f"more than {low:g} kPa"
        meaning = f": {palette.meaning(low)}" if palette.meaning(low) else ""
        symbol = {"line_color": palette.hexadecimal(len(edges))[k], "line_width": f"{0.5 + 0.2 * k:.1f}"}
        yield 1e3 * low, min(1e3 * high, _HIGHEST), label + meaning, symbol


def one_symbol(kind: str, symbol: dict[str, str], label: str = "", colour: str = "#000000") -> str:
    """Style with one symbol, and the QGIS expression ``label`` in a ``colour``."""
    root = _root(labels=bool(label))
    renderer = SubElement(root, "renderer-v2", type="singleSymbol", **_RENDERER)
    _symbol(SubElement(renderer, "symbols"), "0", kind, symbol)
    if label:
        _labels(root, label, colour, kind)
    return _text(root)


def categories(
    kind: str, attribute: str, shown: Sequence[tuple[float | str, str, dict[str, str]]], label: str = "", colour: str = "#000000"
) -> str:
    """Style with a symbol for each value of an attribute (value, words and symbol), and the QGIS expression ``label``."""
    root = _root(labels=bool(label))
    renderer = SubElement(root, "renderer-v2", type="categorizedSymbol", attr=attribute, **_RENDERER)
    listed, symbols = SubElement(renderer, "categories"), SubElement(renderer, "symbols")
    for k, (value, words, symbol) in enumerate(shown):
        text, form = (value, "string") if isinstance(value, str) else (f"{value:g}", "double")
        SubElement(listed, "category", value=text, symbol=str(k), label=words, render="true", type=form)
        _symbol(symbols, str(k), kind, symbol)
    if label:
        _labels(root, label, colour, kind)
    return _text(root)


def classes(kind: str, attribute: str, shown: Sequence[tuple[float, float, str, dict[str, str]]]) -> str:
    """Style with a symbol for each class of an attribute: lower and upper bound, label and symbol."""
    root = _root(labels=False)
    method: Any = {"type": "graduatedSymbol", "graduatedMethod": "GraduatedColor"}
    renderer = SubElement(root, "renderer-v2", attr=attribute, **method, **_RENDERER)
    ranges, symbols = SubElement(renderer, "ranges"), SubElement(renderer, "symbols")
    for k, (lower, upper, words, symbol) in enumerate(shown):
        SubElement(ranges, "range", lower=f"{lower:.9g}", upper=f"{upper:.9g}", symbol=str(k), label=words, render="true")
        _symbol(symbols, str(k), kind, symbol)
    return _text(root)


def _root(labels: bool) -> Element:
    return Element("qgis", version="3.22.0", styleCategories="Symbology|Labeling", labelsEnabled=str(int(labels)))


def _symbol(parent: Element, name: str, kind: str, own: dict[str, str]) -> None:
    """A symbol; ``casing`` is the width of a white line below its outline, so that it shows on any colour."""
    symbol = SubElement(parent, "symbol", type=kind, name=name, alpha="1", clip_to_extent="1", force_rhr="0")
    own, casing = {key: value for key, value in own.items() if key != "casing"}, own.get("casing")
    if casing:
        _symbol_layer(symbol, kind, own | {"outline_color": "#ffffff", "outline_width": casing})
    _symbol_layer(symbol, kind, own)


def _symbol_layer(symbol: Element, kind: str, own: dict[str, str]) -> None:
    layer = SubElement(symbol, "layer", {"class": _LAYERS[kind], "enabled": "1", "locked": "0", "pass": "0"})
    options = SubElement(layer, "Option", type="Map")
    for key, value in (_DEFAULTS[kind] | own).items():
        shown = _rgb(value) if "color" in key else value
        SubElement(options, "Option", type="QString", name=key, value=shown)


def _labels(root: Element, expression: str, colour: str, kind: str) -> None:
    settings = SubElement(SubElement(root, "labeling", type="simple"), "settings", calloutType="simple")
    text = SubElement(
        settings,
        "text-style",
        fieldName=expression,
        isExpression="1",
        fontSize="9",
        fontSizeUnit="Point",
        fontWeight="75",
        textColor=_rgb(colour),
    )
    SubElement(text, "text-buffer", bufferDraw="1", bufferSize="1", bufferSizeUnits="MM", bufferColor="255,255,255,255")
    near: Any = {"dist": "1", "distUnits": "MM"} if kind == MARKER else {}
    SubElement(settings, "placement", placement=_PLACEMENTS[kind], centroidInside="1", layerType=_GEOMETRIES[kind], **near)
    SubElement(settings, "rendering", drawLabels="1", obstacle="0", displayAll="1")


def _rgb(colour: str) -> str:
    """Hexadecimal colour as QGIS writes it: red,green,blue,opacity."""
    return ",".join(str(int(colour[k : k + 2], 16)) for k in (1, 3, 5)) + ",255"


def _text(root: Element) -> str:
    ElementTree.indent(root)
    return PROLOGUE + ElementTree.tostring(root, encoding="unicode") + "\n"
