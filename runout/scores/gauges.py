"""Points at which a flow was observed."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

POINT_UNITS = {"arrival_time": "s", "thickness": "m", "speed": "m s-1"}


@dataclass(frozen=True)
class Gauges:
    """Points with observed values."""

    # easting, northing (n,): map coordinates [m]
    easting: np.ndarray
    northing: np.ndarray
    # ``arrival_time`` [s], ``thickness`` [m, vertical] and ``speed`` [m/s], as far as observed; NaN where unknown
    values: Mapping[str, np.ndarray]

    def label(self, index: int) -> str:
        """What was observed at a point, for maps."""
        known = {name: float(values[index]) for name, values in self.values.items() if np.isfinite(values[index])}
        return ", ".join(f"{value:.3g} {POINT_UNITS[name].replace('m s-1', 'm/s')}" for name, value in known.items())
