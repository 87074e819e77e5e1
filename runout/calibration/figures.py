"""Figures of Sobol indices and of a posterior."""

from collections.abc import Mapping
from itertools import product
from textwrap import fill
from typing import Any

import numpy as np

from runout.calibration.posterior import OF_EVENT, Posterior
from runout.calibration.sobol_indices import SobolIndices
from runout.report.figures import parameter_label, tidy
from runout.report.maps import WIDE
from runout.report.marks import INK
from runout.report.values import NORMAL, SMALL

BLUE, GREY = "#1f6f8b", "#c9d6df"
MOST_DRAWN = 6  # parameters in the figure of a posterior
CELL = 2.1  # inch


def tornado_figure(indices: Mapping[str, SobolIndices]) -> Any:
    """Figure of the total and first-order indices by quantity, the largest on top, with their intervals."""
    from matplotlib.figure import Figure

    bars = len(next(iter(indices.values())).names)
    figure = Figure(figsize=(WIDE, (0.7 + 0.42 * bars) * len(indices) + 0.8), layout="constrained")
    panels = figure.subplots(len(indices), 1, squeeze=False, sharex=True)[:, 0]
    for axes, (title, one) in zip(panels, indices.items(), strict=True):
        _draw_tornado(axes, one)
        axes.set_title(title, fontsize=NORMAL, color=INK, loc="left")
    panels[-1].set_xlabel("share of the variance", fontsize=NORMAL, color=INK)
    figure.legend(*panels[0].get_legend_handles_labels(), fontsize=SMALL, frameon=False, loc="outside upper center", ncols=3)
    return figure


def _draw_tornado(axes: Any, indices: SobolIndices) -> None:
    order, places = np.argsort(indices.total), np.arange(len(indices.names))
    total, first = indices.total[order], indices.first[order]
    reach = np.abs(indices.total_interval[:, order] - total)
    axes.barh(places, total, 0.62, color=GREY, label="with interactions", zorder=2)
    axes.barh(places, first, 0.3, color=BLUE, label="alone", zorder=3)
    bars = {"fmt": "none", "ecolor": INK, "capsize": 3, "elinewidth": 0.9}
    axes.errorbar(total, places, xerr=reach, label="5 to 95 % of the total", zorder=4, **bars)
    tidy(axes, "")
    axes.set_yticks(places, [_label(indices.names[k]) for k in order])
    axes.set_xlim(0.0, 1.02)


def _label(name: str) -> str:
    """Words and unit of a parameter on lines of a few words, after the name of its event if it is that of one."""
    event, of_event, own = name.rpartition(OF_EVENT)
    return fill(event + of_event + parameter_label(own), 22)


def posterior_figure(posterior: Posterior) -> Any:
    """Figure of prior and posterior of each parameter, and of each pair, within 98 % of the prior; the first six parameters."""
    from matplotlib.figure import Figure

    names, values, marginals = posterior.prior.names[:MOST_DRAWN], posterior.values, posterior.marginals()
    edges = posterior.prior.values(np.tile([[0.01], [0.99]], len(posterior.prior.names)))
    size = CELL * len(names) + 1.0
    figure = Figure(figsize=(size, size), layout="constrained")
    panels = figure.subplots(len(names), len(names), squeeze=False)
    for row, column in product(range(len(names)), repeat=2):
        axes = panels[row, column]
        if column > row:
            axes.set_axis_off()
            continue
        tidy(axes, _label(names[column]) if row == len(names) - 1 else "")
        axes.set_xlim(edges[:, column])
        if row == column:
            one = marginals[names[row]]
            axes.stairs(one["posterior"], one["edges"], fill=True, color=BLUE, label="posterior")
            axes.stairs(one["prior"], one["edges"], color=INK, label="prior")
            axes.set_yticks([])
        else:
            axes.plot(values[::4, column], values[::4, row], ".", color=BLUE, markersize=2, alpha=0.35)
            axes.set_ylim(edges[:, row])
            axes.set_ylabel(_label(names[row]) if column == 0 else "", fontsize=NORMAL, color=INK)
    panels[0, 0].legend(fontsize=SMALL, frameon=False)
    return figure
