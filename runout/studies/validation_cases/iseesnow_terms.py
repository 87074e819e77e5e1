"""IdealizedTopo with one term changed, in com1DFA and in runout: why the surge of runout stretches less.

`idealized_topo_com1dfa.json` holds the numbers; `tests/benchmarks/idealized_topo_com1dfa.py` makes it.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from runout.scores import Grid, values_at
from runout.studies.study_page import markdown
from runout.studies.validation_cases.drawing import along
from runout.studies.validation_cases.iseesnow import STATION, Inputs

OTHER = Path(__file__).with_name("idealized_topo_com1dfa.json")
LOWER = 1000.0, 2100.0  # along the thalweg [m], the lower half of the slope
HELD = 0.05, 0.95  # shares of the volume between which its length counts
STANDARD, FLUID, WHOLE = "standard", "whole column, 5 deg", "whole column, 30 deg"
HEADS = (
    *("run", "section 20 s [m²]", "40 s [m²]", "60 s [m²]", "length 60 s [m]"),
    *("thickness [m]", "speed [m/s]", "front [m]", "area [ha]"),
)


def stretch(thickness: np.ndarray, easting: np.ndarray) -> float:
    """Length in plan [m] that holds the middle of the volume, between the shares :data:`HELD`; ``thickness`` (rows, columns)."""
    volume = np.cumsum(thickness.sum(axis=0))
    rear, front = np.interp(HELD, volume / volume[-1], easting)
    return float(front - rear)


def lower_half(inputs: Inputs, values: np.ndarray) -> float:
    """Mean of a map (rows, columns) along the thalweg over :data:`LOWER`."""
    stations = np.arange(*LOWER, STATION)
    return float(np.mean(values_at(Grid.of(inputs.terrain), values, *inputs.thalweg.at(stations).T)))


def term_numbers(results: Mapping[str, Any]) -> dict[str, Any]:
    """Table and numbers of the text; ``results`` are those of the case, with the profiles of the tools."""
    found = json.loads(OTHER.read_text(encoding="utf-8"))
    other, own = found["com1dfa"], found["runout"]
    last = {f"{code}{name}": row["sections"][-1] for code, rows in (("c:", other), ("r:", own)) for name, row in rows.items()}
    standard, reference, fluid = last[f"r:{STANDARD}"], last[f"c:{STANDARD}"], last[f"r:{FLUID}"]
    rows = [_row(f"{code}, {name}", row) for code, runs in (("runout", own), ("com1DFA", other)) for name, row in runs.items()]
    return {
        "terms": markdown(HEADS, [*rows, _tools(results)]), "avaframe": found["avaframe"],
        "own_section": standard, "com1dfa_section": reference, "fluid_section": fluid, "whole_section": last[f"r:{WHOLE}"],
        "share": 100.0 * (standard - fluid) / (standard - reference),
        "plug_section": last["c:plug"], "free_section": last["c:no pressure"], "weak_pressure": last["c:pressure x 0.6"],
        "inviscid": last["c:no artificial viscosity"], "across_section": last["c:pressure across x 2"],
    }  # fmt: skip


def _row(name: str, row: Mapping[str, Any]) -> tuple[str, ...]:
    sections = (f"{section:.0f}" for section in row["sections"])
    numbers = f"{row['thickness']:.2f}", f"{row['speed']:.1f}", f"{row['front']:.0f}", f"{row['area']:.1f}"
    return name, *sections, f"{row['length']:.0f}", *numbers


def _tools(results: Mapping[str, Any]) -> tuple[str, ...]:
    """Row of the medians of the tools, which state peaks only."""
    profile = results["profile"]
    station = along(profile["station"])
    inside = (station >= LOWER[0]) & (station < LOWER[1])
    thickness, speed = (float(along(profile[key]["median"])[inside].mean()) for key in ("thickness", "speed"))
    front, area = (float(np.median([tool[key] for tool in results["tools"]])) for key in ("front", "area"))
    return "median of the tools", "", "", "", "", f"{thickness:.2f}", f"{speed:.1f}", f"{front:.0f}", f"{area:.1f}"
