"""Round numbers, which are 1, 2 or 5 times a power of ten: of scale bars, axes, classes and steps of values."""

import math
from collections.abc import Sequence

DIGITS = (1.0, 2.0, 5.0)
SPARSER = (DIGITS, (1.0, 3.0), (1.0,))  # digits of a series, from many numbers to few
_ROUNDING = 1e-9  # by which a number may be above a limit that it equals


def round_below(value: float) -> float:
    """Largest round number that is at most ``value``, which is above 0."""
    power = math.floor(math.log10(value))
    digit = max((digit for digit in DIGITS if digit * 10.0**power <= value * (1.0 + _ROUNDING)), default=1.0)
    return float(f"{digit:g}e{power}")


def round_above(value: float) -> float:
    """Smallest round number that is at least ``value``, which is above 0."""
    power = math.floor(math.log10(value))
    digit = next((digit for digit in DIGITS if digit * 10.0**power >= value * (1.0 - _ROUNDING)), 10.0)
    return float(f"{digit:g}e{power}")


def round_length(width: float, part: float = 0.25) -> float:
    """Length of a scale bar that takes at most ``part`` of ``width``, in its unit."""
    return round_below(part * width)


def round_ticks(low: float, high: float, count: int) -> list[float]:
    """At most ``count`` + 1 multiples of a round number from ``low`` to ``high``; ``low`` alone if the range is empty."""
    if not high > low:
        return [low]
    step = round_above((high - low) / max(count, 1))
    first, last = math.ceil(low / step - _ROUNDING), math.floor(high / step + _ROUNDING)
    return [float(f"{number * step:.10g}") for number in range(first, last + 1)]


def round_edges(low: float, high: float, classes: int = 8) -> list[float]:
    """Lower edges of about ``classes`` equal classes: multiples of a round number from ``low`` or below it to below ``high``."""
    top = high if high > low else low + 1.0
    step = round_above((top - low) / classes)
    edges = [float(f"{number * step:.9g}") for number in range(math.floor(low / step + _ROUNDING), math.ceil(top / step))]
    return [edge for edge in edges if edge < top]


def round_series(low: float, high: float, most: int) -> list[float]:
    """Digits times powers of ten from ``low``, which is above 0, to ``high``: the densest series of at most ``most`` numbers."""
    powers = range(math.floor(math.log10(low)), math.floor(math.log10(high)) + 1) if high >= low else range(0)
    series: list[float] = []
    for digits in SPARSER:
        series = [number for number in _products(digits, powers) if low <= number <= high]
        if len(series) <= most:
            break
    return series


def _products(digits: Sequence[float], powers: range) -> list[float]:
    return [float(f"{digit:g}e{power}") for power in powers for digit in digits]
