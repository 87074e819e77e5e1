"""QGIS styles of the maps: classes at the thresholds of the site, transparent where nothing happens."""

from collections.abc import Sequence
from xml.etree import ElementTree

from runout.io.vector import PROBABILITY_LEVELS

_RAMPS = {"probability": "YlOrRd", "arrival": "viridis_r", "members": "YlOrRd"}
_DEFAULT_RAMP = "plasma_r"
_PROLOGUE = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"


def class_edges(name: str, thresholds: Sequence[float], largest: float) -> list[float]:
    """Lower edges of the coloured classes of a map.

    Parameters
    ----------
    name : str
        Name of the map.
    thresholds : sequence of float
        Thresholds of its quantity; used for thickness, speed and pressure.
    largest : float
        Largest value of the map.
    """
    from matplotlib.ticker import MaxNLocator

    if "probability" in name:
        return [0.0, *PROBABILITY_LEVELS]
    if thresholds:
        return [0.0, *sorted(thresholds)]
    ticks = MaxNLocator(6, integer="members" in name).tick_values(0.0, largest)
    return [float(tick) for tick in ticks[:-1]]


def qml(edges: Sequence[float], unit: str, name: str) -> str:
    """Text of a QGIS style with one colour a class; values up to the first edge are transparent, save times of arrival.

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
        colorRampType="DISCRETE",
        classificationMode="1",
        clip="0",
        minimumValue=f"{edges[0]:g}",
        maximumValue="inf",
    )
    _add_classes(shader, list(edges), "" if unit == "1" else f" {unit}", _ramp(name), transparent="arrival" not in name)
    ElementTree.indent(root)
    return _PROLOGUE + ElementTree.tostring(root, encoding="unicode") + "\n"


def _add_classes(shader: ElementTree.Element, edges: list[float], unit: str, ramp: str, transparent: bool) -> None:
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    if transparent:
        ElementTree.SubElement(
            shader, "item", value=f"{edges[0]:.9g}", color="#ffffff", alpha="0", label=f"up to {edges[0]:g}{unit}"
        )
    for k, lower in enumerate(edges):
        last = k == len(edges) - 1
        colour = to_hex(colormaps[ramp](0.15 + 0.85 * k / max(1, len(edges) - 1)))
        label = f"above {lower:g}{unit}" if last else f"{lower:g} to {edges[k + 1]:g}{unit}"
        value = "inf" if last else f"{edges[k + 1]:.9g}"
        ElementTree.SubElement(shader, "item", value=value, color=colour, alpha="255", label=label)


def _ramp(name: str) -> str:
    return next((ramp for word, ramp in _RAMPS.items() if word in name), _DEFAULT_RAMP)
