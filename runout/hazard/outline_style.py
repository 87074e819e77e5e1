"""QGIS styles of the layers of outlines.gpkg: lines and labels that leave the maps below them visible."""

from collections.abc import Iterable
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from runout.hazard.style import PROLOGUE, class_colours
from runout.io.vector import PROBABILITY_LEVELS

_RELEASE = "#d7263d"
_OBSTACLE = "#6b4a2b"
_ZONE = "#22282f"
_OBSERVED = "#0b4fae"
_PROBABILITY_RAMP = "YlOrRd"
_OBSTACLE_LABEL = "if(\"height_m\" < 0, '', '+') || \"height_m\" || ' m'"
_REPLACED = "coalesce(round(\"basal_friction_angle_deg\", 1) || '°', attribute(@feature, 'parameters'))"
_ZONE_LABEL = f'if("factor" is null, {_REPLACED}, \'friction times \' || "factor")'


def outline_styles() -> dict[str, str]:
    """Text of the QGIS style of each layer."""
    return {
        "release": _one_symbol({"outline_color": _RELEASE, "outline_width": "0.7", "style": "no"}, '"name"', _RELEASE),
        "inundation": _levels(PROBABILITY_LEVELS),
        "obstacles": _one_symbol(
            {"color": _OBSTACLE, "style": "b_diagonal", "outline_color": _OBSTACLE, "outline_width": "0.5"},
            _OBSTACLE_LABEL,
            _OBSTACLE,
        ),
        "friction_zones": _one_symbol(
            {"outline_color": _ZONE, "outline_width": "0.4", "outline_style": "dash", "style": "no"}, _ZONE_LABEL, _ZONE
        ),
        "observed_outline": _one_symbol(
            {"outline_color": _OBSERVED, "outline_width": "0.7", "style": "no"}, "'observed ' || \"shows\"", _OBSERVED
        ),
    }


def _one_symbol(fill: dict[str, str], label: str, colour: str) -> str:
    root = _root()
    renderer = SubElement(root, "renderer-v2", type="singleSymbol", symbollevels="0", enableorderby="0", forceraster="0")
    _symbol(SubElement(renderer, "symbols"), "0", fill)
    _labels(root, label, colour)
    return _text(root)


def _levels(levels: Iterable[float]) -> str:
    """A line for each level of probability, darker and wider the higher it is."""
    root, sorted_levels = _root(), sorted(levels)
    renderer = SubElement(
        root, "renderer-v2", type="categorizedSymbol", attr="probability", symbollevels="0", enableorderby="0", forceraster="0"
    )
    categories, symbols = SubElement(renderer, "categories"), SubElement(renderer, "symbols")
    for k, (level, colour) in enumerate(zip(sorted_levels, class_colours(_PROBABILITY_RAMP, len(sorted_levels)), strict=True)):
        label = f"probability {100 * level:g} % or more"
        SubElement(categories, "category", value=f"{level:g}", symbol=str(k), label=label, render="true", type="double")
        _symbol(symbols, str(k), {"outline_color": colour, "outline_width": f"{0.4 + 0.1 * k:.1f}", "style": "no"})
    return _text(root)


def _root() -> Element:
    return Element("qgis", version="3.22.0", styleCategories="Symbology|Labeling", labelsEnabled="1")


def _symbol(parent: Element, name: str, fill: dict[str, str]) -> None:
    symbol = SubElement(parent, "symbol", type="fill", name=name, alpha="1", clip_to_extent="1", force_rhr="0")
    layer = SubElement(symbol, "layer", {"class": "SimpleFill", "enabled": "1", "locked": "0", "pass": "0"})
    options = SubElement(layer, "Option", type="Map")
    for key, value in ({"outline_style": "solid", "outline_width_unit": "MM"} | fill).items():
        shown = _rgb(value) if "color" in key else value
        SubElement(options, "Option", type="QString", name=key, value=shown)


def _labels(root: Element, expression: str, colour: str) -> None:
    settings = SubElement(SubElement(root, "labeling", type="simple"), "settings", calloutType="simple")
    text = SubElement(
        settings, "text-style", fieldName=expression, isExpression="1", fontSize="9", fontSizeUnit="Point", textColor=_rgb(colour)
    )
    SubElement(text, "text-buffer", bufferDraw="1", bufferSize="0.8", bufferSizeUnits="MM", bufferColor="255,255,255,255")
    SubElement(settings, "placement", placement="0", centroidInside="1", layerType="PolygonGeometry")
    SubElement(settings, "rendering", drawLabels="1", obstacle="0", displayAll="1")


def _rgb(colour: str) -> str:
    """Hexadecimal colour as QGIS writes it: red,green,blue,opacity."""
    return ",".join(str(int(colour[k : k + 2], 16)) for k in (1, 3, 5)) + ",255"


def _text(root: Element) -> str:
    ElementTree.indent(root)
    return PROLOGUE + ElementTree.tostring(root, encoding="unicode") + "\n"
