"""QGIS styles (QML) of vector layers: one symbol, categories or classes of fills, lines or markers, with labels."""

from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from runout.hazard.style import PROLOGUE

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
    for k, (lower, upper, label, symbol) in enumerate(shown):
        SubElement(ranges, "range", lower=f"{lower:.9g}", upper=f"{upper:.9g}", symbol=str(k), label=label, render="true")
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
