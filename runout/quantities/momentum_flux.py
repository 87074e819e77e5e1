"""Momentum flux: the intensity index of Jakob et al. (2012), Nat. Hazards 60:241."""

from typing import Any

from runout.quantities import MapQuantity


def momentum_flux(depth: Any, speed: Any, density: Any):
    """Flux of momentum h v^2 [m3/s2] through a width of 1 m, over the density."""
    return depth * speed * speed


QUANTITY = MapQuantity(
    "momentum_flux", "m3 s-2", "momentum flux", "momentum flux (thickness times speed squared)", momentum_flux, (1.0, 10.0, 100.0),
    symbol="momentum flux hv²", colours="inferno_r", logarithmic=True,
    remark="It is the largest product of thickness and squared speed at one time, not the product of their maxima.", place=3,
)  # fmt: skip
