"""Time series at the probes of one run."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from runout.model.probes import Probes
from runout.model.terrain import Terrain


@dataclass(frozen=True)
class ProbeSeries:
    """Time series at the probes of one run.

    Attributes
    ----------
    probes : Probes
        Points and lines in map coordinates; positive discharge crosses a line to its left, which is its lower side.
    terrain : Terrain
        The ground under them.
    time : ndarray (times,)
        [s] since the release. After the end of the run thickness and volumes stay, speeds and discharge are 0.
    points : mapping of str to ndarray (points, times)
        ``flow_thickness`` [m], ``speed`` [m s-1], ``pressure`` [Pa], ``momentum_flux`` [m3 s-2].
    cross_sections : mapping of str to ndarray (cross-sections, times)
        ``discharge`` [m3 s-1], the mean of the interval that ends then; ``passed_volume`` [m3]; ``flow_width`` [m] that the
        flow covers with at least the arrival threshold; ``largest_thickness`` [m] along the line.
    peaks : mapping of str to ndarray (points,)
        Values of the maps of the run at the points: ``max_flow_thickness`` and so on, ``arrival_time`` [s] (NaN: never),
        ``deposit_thickness``.
    section_peaks : mapping of str to ndarray (cross-sections,)
        ``max_discharge`` [m3 s-1] of an interval, ``max_flow_thickness`` [m] and first ``arrival_time`` [s] along the line.
    """

    probes: Probes
    terrain: Terrain
    time: np.ndarray
    points: Mapping[str, np.ndarray]
    cross_sections: Mapping[str, np.ndarray]
    peaks: Mapping[str, np.ndarray]
    section_peaks: Mapping[str, np.ndarray]
