"""Figures of a terrain in numbers: slope classes, sinks, flow paths."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.slopes.sinks import LEAST_DEPTH, Sink, flow_paths, hidden_share, path_area, sinks

if TYPE_CHECKING:
    from runout.slopes.drainage import Drainage

SLOPE_CLASSES_DEG = (0.0, 5.0, 15.0, 25.0, 35.0, 45.0, 90.0)
LISTED = 10  # sinks of the page and the record


@dataclass(frozen=True)
class TerrainFigures:
    """What an elevation raster holds and hides.

    Attributes
    ----------
    sinks : list of Sink
        The largest volume first.
    totals : dict of str to float
        ``number``, ``area_m2``, ``volume_m3`` and ``deepest_m`` of all sinks.
    through_sinks : float
        Share of the known area whose water passes through a sink [1].
    paths : list of dict
        Flow paths as rows with ``geometry``.
    path_area : float
        Drainage area from which on a cell belongs to a flow path [m2].
    classes : dict of str to float
        Share of the known area [1] by class of slope.
    steepest_deg : float
    unknown : int
        Cells without an elevation.
    """

    sinks: list[Sink]
    totals: dict[str, float]
    through_sinks: float
    paths: list[dict[str, Any]]
    path_area: float
    classes: dict[str, float]
    steepest_deg: float
    unknown: int

    def record(self) -> dict[str, Any]:
        """Values for the JSON record."""
        return {
            "sinks": self.totals | {"share_of_area_through_sinks": self.through_sinks, "deeper_than_m": LEAST_DEPTH},
            "largest_sinks": [sink.attributes() for sink in self.sinks[:LISTED]],
            "slope_classes": self.classes,
            "steepest_slope_deg": self.steepest_deg,
            "cells_without_elevation": self.unknown,
            "flow_paths": {"number": len(self.paths), "drainage_area_from_m2": self.path_area},
        }

    def lines(self) -> Iterator[str]:
        """One line for each subject."""
        t = self.totals
        if t["number"]:
            of = f"{t['area_m2']:.4g} m2, {t['volume_m3']:.4g} m3, up to {t['deepest_m']:.3g} m deep"
            share = f"{self.through_sinks:.0%} of the area drains through one"
            yield f"sinks: {t['number']:g} deeper than {LEAST_DEPTH:g} m, {of}; {share}"
        else:
            yield f"sinks: none deeper than {LEAST_DEPTH:g} m"
        yield f"flow paths: {len(self.paths)} from {self.path_area:.3g} m2 of drainage area on"
        shares = ", ".join(f"{share:.0%} {name}" for name, share in self.classes.items() if share >= 0.005)
        yield f"slope: {shares}; steepest {self.steepest_deg:.1f} deg"


def terrain_figures(drained: "Drainage", slope: np.ndarray) -> TerrainFigures:
    """Figures of a drained terrain with its slope (rows, columns) [rad]."""
    found, totals = sinks(drained)
    least = path_area(drained)
    degrees = np.degrees(slope[np.isfinite(slope)])
    counts = np.histogram(degrees, SLOPE_CLASSES_DEG)[0] / max(degrees.size, 1)
    names = [f"{low:g} to {high:g} deg" for low, high in pairwise(SLOPE_CLASSES_DEG)]
    unknown = int(np.isnan(drained.terrain.elevation).sum())
    classes = {name: float(share) for name, share in zip(names, counts, strict=True)}
    paths = flow_paths(drained, least)
    return TerrainFigures(found, totals, hidden_share(drained), paths, least, classes, float(degrees.max(initial=0.0)), unknown)
