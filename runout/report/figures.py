"""Figures over time and over the members: the ledger of mass and energy, and runout against the sampled parameters."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.parameter_variables import parameter_variable
from runout.hazard.order import weighted_percentiles
from runout.report.maps import WIDE
from runout.report.marks import INK
from runout.report.members import FIGURES, Ledger, representative
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


def budget_figure(ledgers: Mapping[int, Ledger], members: "pd.DataFrame") -> Any:
    """Figure of the energy budget of the representative member."""
    figure, axes = _panel(4.2)
    draw_budget(axes, ledgers[representative(members)])
    return figure


def kinetic_figure(ledgers: Mapping[int, Ledger], members: "pd.DataFrame") -> Any:
    """Figure of the kinetic energy of all members; the representative one is coloured."""
    figure, axes = _panel(3.2)
    draw_kinetic(axes, ledgers, representative(members))
    return figure


def _panel(height: float) -> Any:
    """Figure and axes with the width of a map and a given height [inch]."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDE, height), layout="constrained")
    return figure, figure.subplots()


def energy_budget(ledger: Ledger) -> dict[str, np.ndarray]:
    """Parts of :data:`BUDGET` in the ledger, each (time,) [J], relative to the first time; less the energy of mass that enters."""
    entered = {"potential_energy": ledger["entered_energy"]} if "entered_energy" in ledger else {}
    return {name: ledger[name] - entered.get(name, 0.0) - ledger[name][0] for name in BUDGET if name in ledger}


def draw_budget(axes: Any, ledger: Ledger) -> None:
    """Stacked shares of the released potential energy against time; the dashed line is the energy released so far.

    It includes the potential energy of mass from a bed.
    """
    time, released = ledger["time"], ledger["potential_energy"]
    released = released[0] - released + ledger.get("entrained_energy", 0.0)
    scale, prefix = energy_unit(float(np.abs(released).max()))
    parts = {name: values for name, values in energy_budget(ledger).items() if name not in AT_TIMES or values.any()}
    stacked = [np.maximum(values, 0.0) / scale for values in parts.values()]
    axes.stackplot(
        time, stacked, colors=[BUDGET[n][1] for n in parts], labels=[BUDGET[n][0] for n in parts], linewidth=0.3, edgecolor="white"
    )
    axes.plot(time, released / scale, color=INK, linewidth=1.3, linestyle=(0, (4, 2)), label="potential energy released")
    handles, labels = (part[::-1] for part in axes.get_legend_handles_labels())
    axes.figure.legend(
        handles, labels, fontsize=SMALL, frameon=False, loc="outside upper left", ncols=2, columnspacing=1.0, handlelength=1.4
    )
    axes.set(xlim=(time[0], time[-1]), ylabel=f"energy [{prefix}]")
    axes.set_ylim(0, 1.05 * max(released.max() / scale, 1e-9))
    tidy(axes)


def draw_kinetic(axes: Any, ledgers: Mapping[int, Ledger], chosen: int) -> None:
    """Kinetic energy of every member against time; the chosen one is coloured."""
    peak = max(float(ledger["kinetic_energy"].max()) for ledger in ledgers.values())
    scale, prefix = energy_unit(peak)
    for member, ledger in ledgers.items():
        if member != chosen:
            axes.plot(ledger["time"], ledger["kinetic_energy"] / scale, color="#8a939d", linewidth=0.8, alpha=0.8)
    own = ledgers[chosen]
    axes.plot(own["time"], own["kinetic_energy"] / scale, color="#1f6f8b", linewidth=2.0, label=f"member {chosen}")
    axes.plot([], [], color="#8a939d", linewidth=0.8, label="the others")
    axes.legend(fontsize=SMALL, frameon=False, loc="upper right")
    axes.set(xlim=(0, None), ylim=(0, None), ylabel=f"kinetic energy [{prefix}]")
    tidy(axes)


def energy_unit(largest: float) -> tuple[float, str]:
    """Factor [J] and unit in which ``largest`` [J] is a number of one to three digits."""
    for factor, prefix in ENERGY_PREFIXES:
        if largest >= factor:
            return factor, prefix
    return 1.0, "J"


def parameter_figure(members: "pd.DataFrame", parameter: str) -> Any:
    """Figure of the runout distance of the valid members against a sampled parameter."""
    figure, axes = _panel(3.0)
    column, distance = FIGURES["runout_distance"], members["runout_distance"]
    axes.scatter(members[parameter], distance, s=34, color="#1f6f8b", edgecolor="white", linewidth=0.7, zorder=3)
    axes.set_ylabel(f"{column.heading.lower()} [{column.units}]")
    axes.set_ylim(0, 1.12 * max(float(distance.max()), 1e-9))
    tidy(axes, parameter_label(parameter))
    return figure


def parameter_label(name: str) -> str:
    """Words and unit of a sampled parameter, e.g. ``basal friction angle [°]``."""
    variable = parameter_variable(name)
    units = unit(variable.units)
    return f"{variable.long_name} [{units}]" if units else variable.long_name


def tidy(axes: Any, across: str = "time since release [s]") -> None:
    """Light grid, no frame above and right, ``across`` as the label of the horizontal axis."""
    axes.set_xlabel(across)
    for axis in (axes.xaxis, axes.yaxis):
        axis.label.set(fontsize=NORMAL, color=INK)
    axes.grid(color="#dfe3e8", linewidth=0.6, zorder=0)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=SMALL, colors=INK, length=3, width=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set(linewidth=0.6, color=INK)


def reach_figure(hazard: "xr.Dataset", weights: np.ndarray) -> Any:
    """Figure of the volumes by reach: median and 90 % range of the valid members (weights of sum 1), and observed."""
    figure, axes = _panel(3.4)
    volumes = weighted_percentiles(hazard["reach_volume"].values, weights, (5.0, 50.0, 95.0))
    places = np.arange(hazard.sizes["reach"])
    axes.bar(places, volumes[1], 0.62, color="#c9d6df", label="median of the members", zorder=2)
    reach = np.stack([volumes[1] - volumes[0], volumes[2] - volumes[1]])
    axes.errorbar(places, volumes[1], reach, fmt="none", ecolor="#1f6f8b", capsize=4, label="90 % of the members", zorder=3)
    axes.plot(places, hazard["observed_reach_volume"].values, "o", color=INK, markersize=5, label="observed", zorder=4)
    ends = zip(hazard["reach_start"].values, hazard["reach_end"].values, strict=True)
    axes.set_xticks(places, [f"{start:g} to {end:g}" for start, end in ends], rotation=30 if len(places) > 4 else 0)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.set_ylabel("net change of volume [m³]")
    axes.legend(fontsize=SMALL, frameon=False)
    tidy(axes, "reach along the thalweg [m]")
    return figure
