"""A column of the flow over a cell of a map: sums over its particles, and what passes between two times."""

import math
from typing import Any


def column_speed(mass: Any, px: Any, py: Any, pz: Any):
    """Speed [m/s] of a column as a whole: its momentum [kg m/s] over its mass [kg]."""
    return math.sqrt(px * px + py * py + pz * pz) / mass


def time_of_passing(level: Any, before: Any, now: Any, start: Any, end: Any):
    """Time [s] at which a number, ``before`` at ``start`` and ``now`` at ``end``, passed ``level`` at a steady rate."""
    return start + (level - before) / (now - before) * (end - start)
