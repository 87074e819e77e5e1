"""Charts over time and over the members: the ledger of mass and energy, and runout against the sampled parameters."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from runout.config.parameter_variables import parameter_variable
from runout.hazard.figures import FIGURES, Ledger
from runout.hazard.order import weighted_percentiles
from runout.hazard.reach import representative
from runout.report.chart import Chart
from runout.report.marks import INK
from runout.report.values import NORMAL, SMALL
from runout.report.wording import unit

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

BUDGET = {  # shares of the released potential energy: label and colour, from the bottom of the stack
    "basal_dissipation": ("friction at the ground", "#7a5c3e"),
    "structure_dissipation": ("structures", "#8f3b3b"),
    "plastic_dissipation": ("plastic flow", "#c98b4b"),
    "entrainment_dissipation": ("taking up the bed", "#5e8c61"),
    "numerical_dissipation": ("numerical loss", "#b9bec5"),
    "escaped_energy": ("carried over the edge", "#4d4d57"),
    "elastic_energy": ("elastic", "#7fb7be"),
    "kinetic_energy": ("kinetic", "#1f6f8b"),
}
AT_TIMES = ("structure_dissipation", "escaped_energy")  # not drawn where they are zero
ENERGY_PREFIXES = ((1e15, "PJ"), (1e12, "TJ"), (1e9, "GJ"), (1e6, "MJ"), (1e3, "kJ"))
COLOUR, OTHERS = "#1f7fa3", "#8a939d"
MOST_OTHERS = 60  # members in grey
TIME = "time since release [s]"


def budget_chart(ledgers: Mapping[int, Ledger], members: "pd.DataFrame") -> Markup:
    """Stacked shares of the potential energy that the representative member has released; the dashed line is all of it."""
    ledger = ledgers[representative(members)]
    time, released = ledger["time"], released_energy(ledger)
    scale, prefix = energy_unit(float(np.abs(released).max()))
    most = 1.05 * max(float(released.max()) / scale, 1e-9)
    chart = Chart(TIME, f"energy [{prefix}]", (float(time[0]), float(time[-1])), (0.0, most))
    below = np.zeros(len(time))
    for name, values in energy_budget(ledger).items():
        if name not in AT_TIMES or values.any():
            label, colour = BUDGET[name]
            above = below + np.maximum(values, 0.0) / scale
            chart.area(time, below, np.minimum(above, most), colour, label)
            below = above
    chart.line(time, released / scale, "currentColor", "potential energy released (dashed)", 1.3, 'stroke-dasharray="4 2"')
    return chart.svg("Energy budget over time")


def released_energy(ledger: Ledger) -> np.ndarray:
    """Potential energy (time,) [J] that the mass has released so far, with that which entered later or from a bed."""
    later = ledger.get("entered_energy", 0.0) + ledger.get("entrained_energy", 0.0)
    released: np.ndarray = ledger["potential_energy"][0] - ledger["potential_energy"] + later
    return released


def energy_budget(ledger: Ledger) -> dict[str, np.ndarray]:
    """Parts of :data:`BUDGET` in the ledger, each (time,) [J], relative to the first time."""
    return {name: ledger[name] - ledger[name][0] for name in BUDGET if name in ledger}


def kinetic_chart(ledgers: Mapping[int, Ledger], members: "pd.DataFrame") -> Markup:
    """Kinetic energy of the members over time; the representative one is coloured."""
    chosen = representative(members)
    peak = max(float(ledger["kinetic_energy"].max()) for ledger in ledgers.values())
    scale, prefix = energy_unit(peak)
    last = max(float(ledger["time"][-1]) for ledger in ledgers.values())
    chart = Chart(TIME, f"kinetic energy [{prefix}]", (0.0, last), (0.0, 1.05 * max(peak / scale, 1e-9)))
    others = [ledger for member, ledger in ledgers.items() if member != chosen]
    shown = others[:: max(1, -(-len(others) // MOST_OTHERS))]
    for number, ledger in enumerate(shown):
        label = ("the others" if len(shown) == len(others) else f"{len(shown)} of {len(others)} others") if number == 0 else ""
        chart.line(ledger["time"], ledger["kinetic_energy"] / scale, OTHERS, label, 0.8)
    chart.line(ledgers[chosen]["time"], ledgers[chosen]["kinetic_energy"] / scale, COLOUR, f"member {chosen}", 2.0)
    return chart.svg("Kinetic energy over time")


def energy_unit(largest: float) -> tuple[float, str]:
    """Factor [J] and unit in which ``largest`` [J] is a number of one to three digits."""
    for factor, prefix in ENERGY_PREFIXES:
        if largest >= factor:
            return factor, prefix
    return 1.0, "J"


def parameter_chart(members: "pd.DataFrame", parameter: str) -> Markup:
    """Runout distance of the valid members against a sampled parameter."""
    column, distance, values = FIGURES["runout_distance"], members["runout_distance"], members[parameter].astype(float)
    low, high = float(values.min()), float(values.max())
    margin = 0.05 * (high - low) or 0.5 * abs(low) or 1.0
    label, most = f"{column.heading.lower()} [{column.units}]", 1.12 * max(float(distance.max()), 1e-9)
    chart = Chart(parameter_label(parameter), label, (low - margin, high + margin), (0.0, most), 200.0)
    chart.points(values, distance, COLOUR)
    return chart.svg(f"Runout distance against {parameter_label(parameter)}")


def parameter_label(name: str) -> str:
    """Words and unit of a sampled parameter, e.g. ``basal friction angle [°]``."""
    variable = parameter_variable(name)
    units = unit(variable.units)
    return f"{variable.long_name} [{units}]" if units else variable.long_name


def reach_chart(hazard: "xr.Dataset", weights: np.ndarray) -> Markup:
    """Volumes by reach: median and 90 % range of the valid members (weights of sum 1), and observed."""
    volumes = weighted_percentiles(hazard["reach_volume"].values, weights, (5.0, 50.0, 95.0))
    observed, count = hazard["observed_reach_volume"].values, hazard.sizes["reach"]
    ends = zip(hazard["reach_start"].values, hazard["reach_end"].values, strict=True)
    known = np.concatenate([volumes.ravel(), observed, [0.0]])
    margin = 0.06 * float(np.nanmax(known) - np.nanmin(known)) or 1.0
    names = [(place, f"{start:g} to {end:g}") for place, (start, end) in enumerate(ends)]
    spread = (float(np.nanmin(known)) - margin, float(np.nanmax(known)) + margin)
    chart = Chart("reach along the thalweg [m]", "net change of volume [m³]", (-0.6, count - 0.4), spread, names=names)
    for place, (low, middle, high) in enumerate(volumes.T):
        label = ("median of the members", "90 % of the members") if place == 0 else ("", "")
        chart.area([place - 0.3, place + 0.3], [0.0, 0.0], [middle, middle], "#a9c1cf", label[0])
        chart.line([place, place], [low, high], COLOUR, label[1])
    chart.points(np.arange(count), observed, "#c0392b", "observed")
    return chart.svg("Volumes by reach")


def tidy(axes: Any, across: str = TIME) -> None:
    """Light grid, no frame above and right, ``across`` as the label of the horizontal axis; for figures of matplotlib."""
    axes.set_xlabel(across)
    for axis in (axes.xaxis, axes.yaxis):
        axis.label.set(fontsize=NORMAL, color=INK)
    axes.grid(color="#dfe3e8", linewidth=0.6, zorder=0)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=SMALL, colors=INK, length=3, width=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set(linewidth=0.6, color=INK)
