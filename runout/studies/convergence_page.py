"""Convergence study of a site as terminal lines and as a page."""

from collections.abc import Iterator, Mapping
from typing import Any

from runout.studies.study_page import markdown

METHOD = (
    "Three grids; the coarser two were also shifted against the terrain, with other positions of the particles. The error is the "
    "whole range of the three grids or the grid convergence index (Roache 1994, safety factor 1.25), whichever is more, plus "
    "twice the spread of the shifts. The index takes the observed order where the grids go one way with an order of 0.5 to 2, "
    "beyond twice the spread; else the order 0.5 and the larger difference. Areas count fractions of cells. The error says "
    "nothing about the model, the release or the friction."
)
QUANTITIES = ("quantity", "unit", "coarse", "middle", "fine", "spread of shifts", "error", "relative", "from")


def _verdict(found: Mapping[str, Any]) -> str:
    if found["converging"]:
        return f"order {found['order']:.1f}"
    return "no order seen"


def as_lines(content: Mapping[str, Any]) -> Iterator[str]:
    """Lines for the terminal: the error bar of each quantity."""
    finest = content["levels"][-1]
    yield f"{content['site']}: numerical error of the median scenario with cells of {finest['cell_size'][0]:g} m"
    for found in content["quantities"].values():
        yield (
            f"  {found['title']}: {found['fine']:.4g} +- {found['error']:.2g} {found['unit']} "
            f"({100 * found['relative_error']:.1f} %, {_verdict(found)})"
        )


def as_markdown(content: Mapping[str, Any]) -> str:
    """The whole study as a page."""
    block = content["block_of_cells"]
    sizes = {level["level"]: level["cell_size"][0] for level in content["levels"]}
    outlined = [field for field in content["fields"] if field.get("critical_success_index")]
    scenario = ", ".join(f"{name} {value:.4g}" for name, value in content["scenario"].items()) or "as in site.yaml"
    lines = [
        f"# Numerical error of {content['site']}",
        "",
        f"Scenario: the median of every sampled parameter ({scenario}). {METHOD}",
        "",
        markdown(("cells [m]", "runs", "particles", "seconds"), map(_level, content["levels"])),
        "",
        markdown(QUANTITIES, map(_quantity, content["quantities"].values())),
        "",
        f"Maps against those of the finest grid, as means over blocks of {block} x {block} cells of the DEM:",
        "",
        markdown(("cells [m]", "map", "relative L1", "critical success index"), (_map(f, sizes) for f in outlined)),
    ]
    return "\n".join(lines) + "\n"


def _level(level: Mapping[str, Any]) -> tuple[str, ...]:
    size = " x ".join(f"{x:.4g}" for x in level["cell_size"])
    return size, f"{level['runs']}", f"{level['particles']}", f"{level['seconds']:.1f}"


def _quantity(found: Mapping[str, Any]) -> tuple[str, ...]:
    values = [f"{found[key]:.4g}" for key in ("coarse", "middle", "fine")]
    errors = f"{found['spread']:.2g}", f"{found['error']:.2g}", f"{100 * found['relative_error']:.1f} %"
    return found["title"], found["unit"], *values, *errors, _verdict(found)


def _map(field: Mapping[str, Any], sizes: Mapping[int, float]) -> tuple[str, ...]:
    index = ", ".join(f"{value:.2f} at {threshold} m" for threshold, value in field["critical_success_index"].items())
    return f"{sizes[field['level']]:.4g}", field["map"].replace("_", " "), f"{field['relative_l1']:.3f}", index
