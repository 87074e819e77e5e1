"""Convergence study of a site as a page."""

from collections.abc import Mapping
from typing import Any

from runout.accuracy import BOUNDS
from runout.numerical_error import ORDER, SAFETY, SCATTERS, SHARE
from runout.studies.study_page import markdown

METHOD = (
    "Each coarser grid was shifted against the terrain, with other positions of the particles. A fit through all runs, of order "
    f"{ORDER:g} in the cell size, gives the trend, which is the difference from a grid of vanishing cells, and the scatter of the "
    f"runs about it. The error is {SAFETY:g} times the root of the sum of squares of the trend, of {SCATTERS:g} scatters, and of "
    f"{SHARE:g} of the error of the map. Run-out is the horizontal distance from the centre of the released mass. Areas count "
    "fractions of cells."
)
QUANTITIES = ("quantity", "unit", "value", "trend", "scatter", "error", "relative")


def as_markdown(content: Mapping[str, Any]) -> str:
    """The whole study as a page."""
    outlined = [field for field in content["fields"] if field.get("critical_success_index")]
    scenario = ", ".join(f"{name} {value:.4g}" for name, value in content["scenario"].items()) or "as in site.yaml"
    lines = [
        f"# Numerical error of {content['site']}",
        "",
        f"Scenario: the median of every sampled parameter ({scenario}). {METHOD} {BOUNDS}",
        "",
        markdown(QUANTITIES, map(_quantity, content["quantities"].values())),
        "",
        markdown(("cells [m]", "particles", "seconds"), map(_level, content["levels"])),
        "",
        f"Maps against those of cells {content['fields'][0]['ratio']:g} times as large:",
        "",
        markdown(("map", "relative L1", "critical success index"), map(_map, outlined)),
    ]
    return "\n".join(lines) + "\n"


def _level(level: Mapping[str, Any]) -> tuple[str, ...]:
    size = " x ".join(f"{x:.4g}" for x in level["cell_size"])
    return size, f"{level['particles']}", f"{level['seconds']:.1f}"


def _quantity(found: Mapping[str, Any]) -> tuple[str, ...]:
    value = "" if found["fine"] is None else f"{found['fine']:.4g}"
    relative = "" if found["relative_error"] is None else f"{100 * found['relative_error']:.2g} %"
    return found["title"], found["unit"], value, *(f"{found[key]:.2g}" for key in ("trend", "scatter", "error")), relative


def _map(field: Mapping[str, Any]) -> tuple[str, ...]:
    index = ", ".join(f"{value:.2f} at {threshold} m" for threshold, value in field["critical_success_index"].items())
    return field["map"].replace("_", " "), f"{field['relative_l1']:.3f}", index
