"""How fast a mass may become against friction that grows with the speed."""

import math
from collections.abc import Sequence

import numpy as np

from runout.model.column_resistance import ColumnResistance, resting_resistance
from runout.model.ground_friction import GroundFriction
from runout.model.release import Release
from runout.terrain.sliding_points import slide

GATHERED = 2.5  # thickness of the fastest part of a flow over the mean of its release: channels and fronts gather mass
BRIDGED = 8  # bumps shorter than this part of a release do not change the speed of a mass
POINTS = 40  # of all releases together


def speeds_with_drag(
    releases: Sequence[Release], grounds: Sequence[GroundFriction], limits: np.ndarray, points: int = POINTS
) -> np.ndarray:
    """Estimates (members,) of the largest speed [m/s] of masses, each at most its ``limits`` (members,) [m/s].

    Points slide from where the releases lie against the law of friction, under the load of a column :data:`GATHERED` times as
    thick as the mean of its release, and once more against the coefficients at rest alone. Where the latter stay slower than the
    limit, since they lose speed at kinks of the path, the estimate grows by that ratio. Without drag it is the limit.

    Parameters
    ----------
    releases : sequence of Release
        On one terrain.
    grounds : sequence of GroundFriction
        Of members.
    limits : ndarray (members,)
        Speeds without drag, of :func:`runout.terrain.energy_line.largest_speed`.
    points : int
    """
    thickness = [GATHERED * float(r.thickness[r.thickness > 0].mean()) for r in releases]
    laws = ColumnResistance(grounds, thickness, float(limits.max())), resting_resistance(grounds)
    length = math.sqrt(sum(r.area for r in releases)) / BRIDGED
    slid, free = (slide(releases, r, len(grounds), (length, length), points=points).fastest.max(0) for r in laws)
    hindered = np.maximum(1.0, limits / np.maximum(free, 1e-9))
    return np.where(free > 0, np.minimum(limits, slid * hindered), limits)  # type: ignore[no-any-return]
