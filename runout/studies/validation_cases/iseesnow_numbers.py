"""Numbers in the text of the pages of ISeeSnow."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from runout.studies.validation_cases.drawing import along
from runout.studies.validation_cases.iseesnow_terms import term_numbers

NEAREST = 4  # tools whose fronts are nearest to that of runout
SLOPE = math.radians(34.0)  # of IdealizedTopo


def coulomb_numbers(results: Mapping[str, Any]) -> dict[str, Any]:
    """Of CoulombOnly."""
    by_default = _run(results, "5 m, 2 x 2 x 12 particles, 30 deg, raster")
    one, coarse = (_run(results, f"{cells} m, 2 x 2 x 4 particles, 30 deg, raster") for cells in (5, 10))
    finest = _run(results, "2.5 m, 30 deg, raster")
    light, heavy = (_run(results, f"5 m, 2 x 2 x 12 particles, 30 deg, polygon{mass}") for mass in ("", ", mass of the raster"))
    tools, front = results["tools"], by_default["front"]
    near = sorted(tools, key=lambda tool: abs(tool["front"] - front))[:NEAREST]
    *names, last = (tool["tool"].removeprefix("AvaFrame-") for tool in near)
    left, left_fine = (float(np.median([t["area"] for t in tools])) - run["area"] for run in (by_default, finest))
    thickness = {name: along(values) for name, values in results["profile"]["thickness"].items()}
    above = thickness["runout"] - thickness["median"]
    return {
        "pressure": by_default["rim_pressure"], "one_pressure": one["rim_pressure"], "coarse_pressure": coarse["rim_pressure"],
        "less_mass": 100.0 * (1.0 - light["volume"] / by_default["volume"]), "csi": by_default["csi_0.1"],
        "heavy_csi": heavy["csi_0.1"], "tools_csi": float(np.median([tool["csi_0.1"] for tool in tools])),
        "more_area": by_default["area"] - one["area"], "cost": by_default["seconds"] / one["seconds"],
        "left": left, "left_fine": left_fine,
        "behind": float(np.median([t["front"] for t in tools])) - front,
        "near": f"{', '.join(names)} and {last}",
        "near_least": min(tool["front"] for tool in near), "near_most": max(tool["front"] for tool in near),
        "spread": max(t["front"] for t in tools) - min(t["front"] for t in tools),
        "thicker": float(np.nanmax(above)), "thinner": -float(np.nanmin(above)),
    }  # fmt: skip


def topo_numbers(results: Mapping[str, Any]) -> dict[str, Any]:
    """Of IdealizedTopo."""
    names = "30 deg, raster, drag: column", "30 deg, polygon, drag: column", "40 deg, raster, drag: column"
    raster, polygon, strong = (_run(results, f"5 m, 2 x 2 x 12 particles, {name}") for name in names)
    base = _run(results, "5 m, 2 x 2 x 12 particles, 30 deg, raster, drag: base")
    tools = results["tools"]
    middle = {key: float(np.median([tool[key] for tool in tools])) for key in ("front", "speed", "csi_0.1")}
    own = (raster, polygon)
    return {
        "load": math.tan(SLOPE), "plan": 1.0 / math.cos(SLOPE) ** 2,
        "base_speed": base["speed"], "fastest": max(tool["speed"] for tool in tools),
        "polygon_beyond": polygon["front"] - middle["front"], "raster_beyond": raster["front"] - middle["front"],
        "speed_error": 100.0 * max(abs(run["speed"] / middle["speed"] - 1.0) for run in own),
        "csi_least": min(run["csi_0.1"] for run in own), "csi_most": max(run["csi_0.1"] for run in own),
        "csi_median": middle["csi_0.1"],
        "farther": strong["front"] - raster["front"], "grown": strong["area"] - raster["area"],
        "fallen": raster["csi_0.1"] - strong["csi_0.1"],
    } | _surges(results) | term_numbers(results)  # fmt: skip


def _surges(results: Mapping[str, Any]) -> dict[str, Any]:
    """Of the runs that end on the slope; the first is that by default."""
    first, *others = results["surges"]
    weak = min(others, key=lambda row: row["friction_angle_deg"])
    cells = [row for row in (first, *others) if row is not weak]
    sections = [f"{row['section']:.0f} m² ({' x '.join(f'{size:g}' for size in row['cells'])} m)" for row in cells]
    return {
        "sections": ", ".join(sections), "slab": results["slab"], "median": first["way"],
        "front_pressure": first["front_pressure"], "rear_pressure": first["rear_pressure"],
        "weak": weak["friction_angle_deg"], "weak_section": weak["section"],
        "weak_front": weak["front_pressure"], "weak_rear": weak["rear_pressure"],
    }  # fmt: skip


def _run(results: Mapping[str, Any], what: str) -> Mapping[str, Any]:
    """The run of a name; see :attr:`runout.studies.validation_cases.iseesnow.Variant.name`."""
    (found,) = (run for run in results["runs"] if run["tool"] == f"runout, {what}")
    return found  # type: ignore[no-any-return]
