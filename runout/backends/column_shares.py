"""Chain of calls for the share of several thresholds that a column reaches, one link for each of :mod:`runout.quantities`.

Compiled code cannot loop over functions; each link holds one formula and the next link.
"""

import math
from typing import Any

PLACE = 0  # of the threshold of a link


def formula(depth: Any, speed: Any, density: Any):
    """Quantity of a column; each link has that of its own place."""
    return depth


def others(limits: Any, condition: int, depth: float, speed: float, density: float):
    """End of the chain, which no threshold limits; each link has the next one."""
    return math.inf


def least_share(limits: Any, condition: int, depth: float, speed: float, density: float):
    """Smallest quantity over its threshold in ``limits`` (conditions, quantities), 0 for none: 1 where all are reached at once."""
    share, limit = others(limits, condition, depth, speed, density), limits[condition, PLACE]
    if limit > 0.0:
        share = min(share, formula(depth, speed, density) / limit)
    return share
