"""Chain of calls for the share of several thresholds that a column reaches, one link for each of :mod:`runout.quantities`.

Compiled code cannot loop over functions; each link holds one formula and the next link. The last one compares the pressure with the
strength of a house, whose force and height are the last two columns of the thresholds.
"""

import math
from typing import Any

from runout.quantities.pressure import dynamic_pressure, share_of_house_strength

PLACE = 0  # of the threshold of a link


def formula(depth: Any, speed: Any, density: Any):
    """Quantity of a column; each link has that of its own place."""
    return depth


def others(limits: Any, condition: int, depth: float, speed: float, density: float):
    """End of the chain: share of the strength of a house; without one no threshold limits. Each link has the next one."""
    force, height = limits[condition, -2], limits[condition, -1]
    if force > 0.0:
        return share_of_house_strength(dynamic_pressure(depth, speed, density), depth, force, height)
    return math.inf


def least_share(limits: Any, condition: int, depth: float, speed: float, density: float):
    """Smallest quantity over its threshold in ``limits`` (conditions, quantities + 2), 0 for none: 1 where all are reached."""
    share, limit = others(limits, condition, depth, speed, density), limits[condition, PLACE]
    if limit > 0.0:
        share = min(share, formula(depth, speed, density) / limit)
    return share
