"""IdealizedTopo with one term changed, in com1DFA and in runout: why the surge of runout stretches less.

`idealized_topo_com1dfa.json` holds the numbers; `tests/benchmarks/idealized_topo_com1dfa.py` makes it.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from docs.pages.study_page import along, markdown
from runout.scores import Grid, values_at
from runout.studies.validation_cases.iseesnow import STATION, Inputs

OTHER = Path(__file__).parents[2] / "tests" / "benchmarks" / "records" / "idealized_topo_com1dfa.json"
NARROWING, LOWER = (400.0, 800.0), (1000.0, 2100.0)  # along the thalweg [m]: where the channel narrows, lower half of the slope
HELD = 0.05, 0.95  # shares of the volume between which its length counts
STANDARD, CUT, FLUID, WHOLE = "standard", "pressure x 0.6", "whole column, 5 deg", "whole column, 30 deg"
HEADS = (
    *("run", "section 20 s [m²]", "40 s [m²]", "60 s [m²]", "length 60 s [m]"),
    *("speed, narrowing [m/s]", "lower half [m/s]", "thickness, narrowing [m]", "lower half [m]", "front [m]", "area [ha]"),
)


def stretch(thickness: np.ndarray, easting: np.ndarray) -> float:
    """Length in plan [m] that holds the middle of the volume, between the shares :data:`HELD`; ``thickness`` (rows, columns)."""
    volume = np.cumsum(thickness.sum(axis=0))
    rear, front = np.interp(HELD, volume / volume[-1], easting)
    return float(front - rear)


def means_along(inputs: Inputs, values: np.ndarray) -> list[float]:
    """Means of a map (rows, columns) along the thalweg over :data:`NARROWING` and :data:`LOWER`."""
    grid = Grid.of(inputs.terrain)
    lines = (inputs.thalweg.at(np.arange(*part, STATION)).T for part in (NARROWING, LOWER))
    return [float(np.mean(values_at(grid, values, *line))) for line in lines]


def term_numbers(results: Mapping[str, Any]) -> dict[str, Any]:
    """Table and numbers of the text; ``results`` are those of the case, with the profiles of the tools."""
    found = json.loads(OTHER.read_text(encoding="utf-8"))
    other, own = found["com1dfa"], found["runout"]
    last = {f"{code}{name}": row["sections"][-1] for code, rows in (("c:", other), ("r:", own)) for name, row in rows.items()}
    standard, reference, fluid = last[f"r:{STANDARD}"], last[f"c:{STANDARD}"], last[f"r:{FLUID}"]
    rows = [_row(f"{code}, {name}", row) for code, runs in (("runout", own), ("com1DFA", other)) for name, row in runs.items()]
    tools = _tools(results)
    return {
        "terms": markdown(HEADS, [*rows, ("median of the tools", "", "", "", "", *_peaks(*tools))]),
        "avaframe": found["avaframe"], "com1dfa_section": reference, "fluid_section": fluid,
        "share": 100.0 * (standard - fluid) / (standard - reference),
        "whole_section": last[f"r:{WHOLE}"], "weak_pressure": last[f"c:{CUT}"], "cut_lower": other[CUT]["thickness"][1],
        "com1dfa_lower": other[STANDARD]["thickness"][1], "com1dfa_speed": other[STANDARD]["speed"][1],
        "across_section": last["c:pressure across x 2"], "inviscid": last["c:no artificial viscosity"],
        "plug_speed": other["plug"]["speed"][1],
        **_named("narrow", own[STANDARD]), **_named("fluid", own[FLUID]),
        **_named("tools", {"speed": tools[0], "thickness": tools[1]}),
    }  # fmt: skip


def _named(prefix: str, row: Mapping[str, Any]) -> dict[str, float]:
    """Peak speed and thickness of a row where the channel narrows, and its thickness in the lower half."""
    return {f"{prefix}_speed": row["speed"][0], f"{prefix}_thickness": row["thickness"][0], f"{prefix}_lower": row["thickness"][1]}


def _row(name: str, row: Mapping[str, Any]) -> tuple[str, ...]:
    sections = [f"{section:.0f}" for section in row["sections"]]
    return name, *sections, f"{row['length']:.0f}", *_peaks(row["speed"], row["thickness"], row["front"], row["area"])


def _peaks(speeds: Sequence[float], thicknesses: Sequence[float], front: float, area: float) -> tuple[str, ...]:
    return *(f"{v:.1f}" for v in speeds), *(f"{h:.2f}" for h in thicknesses), f"{front:.0f}", f"{area:.1f}"


def _tools(results: Mapping[str, Any]) -> tuple[list[float], list[float], float, float]:
    """Medians of the tools, which state peaks only: speeds and thicknesses along the thalweg, front and area."""
    station = along(results["profile"]["station"])
    parts = [(station >= start) & (station < end) for start, end in (NARROWING, LOWER)]
    speed, thickness = (along(results["profile"][key]["median"]) for key in ("speed", "thickness"))
    front, area = (float(np.median([tool[key] for tool in results["tools"]])) for key in ("front", "area"))
    return [float(speed[part].mean()) for part in parts], [float(thickness[part].mean()) for part in parts], front, area
