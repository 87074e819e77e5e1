"""Thickness and speed at one time: what criteria such as "h > 1 m and v > 1 m/s" ask for."""

from collections.abc import Mapping
from typing import Any

from runout.quantities import MapQuantity


def thickness_and_speed(depth: Any, speed: Any, density: Any):
    """Smaller number of thickness [m] and speed [m/s]: it reaches x where the flow is x m thick and x m/s fast at one time."""
    return min(depth, speed)


QUANTITY = MapQuantity(
    "thickness_and_speed", "1", "thickness and speed at one time", "smaller number of thickness in m and speed in m/s at one time",
    thickness_and_speed, (), symbol="thickness [m] and speed [m/s]", colours="plasma_r",
    remark="A value x says that the flow was at least x m thick and x m/s fast at one time.", place=5,
)  # fmt: skip

ROUNDING = 1.0 - 1e-6  # of products of two thresholds, against values in single precision


def at_one_time(thresholds: Mapping[str, float]) -> dict[str, float]:
    """Thresholds by quantity that the maxima of a flow reach if it reaches those of thickness [m] and speed [m/s] at one time.

    A flow of a thickness h of at least a and a speed v of at least b at one time has maxima of min(h, v), h v and h v^2 of at
    least min(a, b), a b and a b^2. If a and b are the same number, min(h, v) decides alone, and the condition is exact. Else its
    area is too large rather than too small, and never larger than that of both maxima. Other thresholds stay as they are.
    """
    if not {"thickness", "speed"} <= thresholds.keys():
        return dict(thresholds)
    a, b = thresholds["thickness"], thresholds["speed"]
    others = {name: limit for name, limit in thresholds.items() if name not in ("thickness", "speed")}
    if a == b:
        bounds = {QUANTITY.name: a}
    else:
        products = {"unit_discharge": a * b * ROUNDING, "momentum_flux": a * b**2 * ROUNDING}
        bounds = {"thickness": a, "speed": b, QUANTITY.name: min(a, b), **products}
    return bounds | {name: max(limit, bounds.get(name, 0.0)) for name, limit in others.items()}
