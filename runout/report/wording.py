"""Formats numbers for the report: significant digits, thin spaces, unit."""

import math
import re

MOST_DIGITS = 3
THIN = "\u202f"
MINUS = "\u2212"
UNKNOWN = "\u2013"
PRINTED_UNITS = {"1": "", "degree": "°", "degrees": "°", "deg": "°"}
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float, digits: int = 3) -> str:
    """``value`` with ``digits`` significant digits and thin spaces between thousands; a dash for unknown values."""
    if value is None or not math.isfinite(value):
        return UNKNOWN
    if value == 0:
        return "0"
    decimals = digits - 1 - math.floor(math.log10(abs(value)))
    text = f"{round(value, decimals):,.{max(decimals, 0)}f}"
    if "." in text:
        text = text.rstrip("0").rstrip(".")
    return text.replace(",", THIN).replace("-", MINUS)


def digits_within(value: float, share: float | None) -> int:
    """Significant digits of a value whose relative error is ``share`` [1]: the last one is of the size of the error.

    One digit where the error is not known; at most :data:`MOST_DIGITS`.
    """
    if share is None or not share > 0 or not math.isfinite(value) or value == 0:
        return 1 if share is None else MOST_DIGITS
    size = abs(value)
    leading = math.floor(math.log10(size)) - math.floor(math.log10(share * size))
    return min(max(1 + leading, 1), MOST_DIGITS)


def number_within(value: float, share: float | None) -> str:
    """``value`` with the significant digits that a relative error leaves."""
    return number(value, digits_within(value, share))


def unit(units: str) -> str:
    """Unit as it is printed: ``m s-1`` becomes ``m s⁻¹``."""
    if units in PRINTED_UNITS:
        return PRINTED_UNITS[units]
    return re.sub(r"(?<=[A-Za-z])-?\d+", lambda power: power[0].translate(RAISED), units)


def quantity(value: float, units: str, digits: int = 3) -> str:
    """Number with its unit."""
    shown, printed = number(value, digits), unit(units)
    if shown == UNKNOWN or not printed:
        return shown
    return f"{shown}{'' if printed == '°' else THIN}{printed}"


def percent(share: float, digits: int = 2) -> str:
    """Share [1] in percent."""
    return quantity(100.0 * share, "%", digits)


def volume(value: float, digits: int = 3) -> str:
    """Volume in m³, in millions of them above 10⁶."""
    return f"{number(value / 1e6, digits)}{THIN}million m³" if abs(value) >= 1e6 else quantity(value, "m3", digits)


def area(value: float) -> str:
    """Area of ``value`` km², in m² below 0.1 km²."""
    return quantity(value, "km²") if value == 0 or abs(value) >= 0.1 or not math.isfinite(value) else quantity(1e6 * value, "m2")


def span(values: list[float], printed: str = "") -> str:
    """Range of finite values; one number if all are equal."""
    known = [v for v in values if v is not None and math.isfinite(v)]
    if not known:
        return UNKNOWN
    low, high = number(min(known)), number(max(known))
    text = low if low == high else f"{low} to {high}"
    return f"{text}{THIN}{printed}" if printed and printed != "°" else f"{text}{printed}"
