"""Figures over time and over the members: the ledger of mass and energy, and runout against the sampled parameters."""

from typing import TYPE_CHECKING, Any

import numpy as np

from runout.report.maps import INK
from runout.report.members import FIGURES, representative
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

BUDGET = {  # where the released potential energy goes: label and colour, bottom of the stack first
    "basal_dissipation": ("friction at the ground", "#7a5c3e"),
    "plastic_dissipation": ("plastic flow", "#c98b4b"),
    "numerical_dissipation": ("numerical loss", "#b9bec5"),
    "escaped_energy": ("carried over the edge", "#4d4d57"),
    "elastic_energy": ("elastic", "#7fb7be"),
    "kinetic_energy": ("kinetic", "#1f6f8b"),
}
ACCENT = "#d7263d"
ENERGY_PREFIXES = ((1e15, "PJ"), (1e12, "TJ"), (1e9, "GJ"), (1e6, "MJ"), (1e3, "kJ"))


def ledger_figure(ledgers: "dict[int, xr.Dataset]", members: "pd.DataFrame") -> Any:
    """Figure of two panels: the energy budget of the representative member, and kinetic energy of all members."""
    from matplotlib.figure import Figure

    chosen = representative(members)
    figure = Figure(figsize=(11.2, 4.1), layout="constrained")
    left, right = figure.subplots(1, 2)
    draw_budget(left, ledgers[chosen])
    left.set_title(f"Where the energy goes: member {chosen} (median runout)", loc="left", fontsize=10, color=INK)
    draw_kinetic(right, ledgers, chosen)
    right.set_title("Kinetic energy of every member", loc="left", fontsize=10, color=INK)
    return figure


def energy_budget(ledger: "xr.Dataset") -> dict[str, np.ndarray]:
    """Parts of :data:`BUDGET` that the ledger holds, each (time,) [J], counted from the first time."""
    return {name: ledger[name].values - ledger[name].values[0] for name in BUDGET if name in ledger}


def draw_budget(axes: Any, ledger: "xr.Dataset") -> None:
    """Stacked shares of the released potential energy over time; the dashed line is the energy released so far."""
    time, released = ledger["time"].values, ledger["potential_energy"].values
    released = released[0] - released
    scale, prefix = energy_unit(float(np.abs(released).max()))
    parts = {name: values for name, values in energy_budget(ledger).items() if name != "escaped_energy" or values.any()}
    stacked = [np.maximum(values, 0.0) / scale for values in parts.values()]
    axes.stackplot(
        time, stacked, colors=[BUDGET[n][1] for n in parts], labels=[BUDGET[n][0] for n in parts], linewidth=0.3, edgecolor="white"
    )
    axes.plot(time, released / scale, color=INK, linewidth=1.3, linestyle=(0, (4, 2)), label="potential energy released")
    axes.legend(*(reversed(part) for part in axes.get_legend_handles_labels()), fontsize=7.5, frameon=False, loc="upper left")
    axes.set(xlim=(time[0], time[-1]), ylabel=f"energy [{prefix}]")
    axes.set_ylim(0, 1.45 * max(released.max() / scale, 1e-9))
    tidy(axes)


def draw_kinetic(axes: Any, ledgers: "dict[int, xr.Dataset]", chosen: int) -> None:
    """Kinetic energy of every member over time, the chosen one in colour."""
    peak = max(float(ledger["kinetic_energy"].max()) for ledger in ledgers.values())
    scale, prefix = energy_unit(peak)
    for member, ledger in ledgers.items():
        if member != chosen:
            axes.plot(ledger["time"], ledger["kinetic_energy"] / scale, color="#8a939d", linewidth=0.8, alpha=0.8)
    own = ledgers[chosen]
    axes.plot(own["time"], own["kinetic_energy"] / scale, color="#1f6f8b", linewidth=2.0, label=f"member {chosen}")
    axes.plot([], [], color="#8a939d", linewidth=0.8, label="the others")
    axes.legend(fontsize=7.5, frameon=False, loc="upper right")
    axes.set(xlim=(0, None), ylim=(0, None), ylabel=f"kinetic energy [{prefix}]")
    tidy(axes)


def energy_unit(largest: float) -> tuple[float, str]:
    """Factor [J] and unit in which ``largest`` [J] is a number of one to three digits."""
    for factor, prefix in ENERGY_PREFIXES:
        if largest >= factor:
            return factor, prefix
    return 1.0, "J"


def parameter_figure(members: "pd.DataFrame", parameters: list[str], figure_name: str = "runout_distance") -> Any:
    """Figure of one panel a parameter: a result figure of the valid members against the sampled value."""
    from matplotlib.figure import Figure

    columns = min(3, len(parameters))
    rows = -(-len(parameters) // columns)
    figure = Figure(figsize=(11.2, 3.1 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True)
    column = FIGURES[figure_name]
    for axes, name in zip(panels.flat, parameters, strict=False):
        axes.scatter(members[name], members[figure_name], s=34, color="#1f6f8b", edgecolor="white", linewidth=0.7, zorder=3)
        axes.set_xlabel(parameter_label(name), fontsize=9, color=INK)
        tidy(axes, time=False)
    for axes in panels.flat[len(parameters) :]:
        axes.set_visible(False)
    for axes in panels[:, 0]:
        axes.set_ylabel(f"{column.heading.lower()} [{column.units}]", fontsize=9, color=INK)
        axes.set_ylim(0, 1.12 * max(float(members[figure_name].max()), 1e-9))
    return figure


def parameter_label(name: str) -> str:
    """Words and unit of a sampled parameter, e.g. ``basal friction angle [°]``."""
    variable = VARIABLES.get(name)
    words = variable.long_name if variable else name.replace("_", " ")
    units = {"degree": "°", "kg m-3": "kg m⁻³"}.get(variable.units, variable.units) if variable else ""
    return words if units in ("", "1") else f"{words} [{units}]"


def tidy(axes: Any, time: bool = True) -> None:
    """Light grid, small ticks, no frame above and right."""
    if time:
        axes.set_xlabel("time since release [s]", fontsize=9, color=INK)
    axes.yaxis.label.set(fontsize=9, color=INK)
    axes.grid(color="#dfe3e8", linewidth=0.6, zorder=0)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, colors=INK, length=3, width=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set(linewidth=0.6, color=INK)
