"""Numbers of a raster band in SI units: packed numbers and stated units."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import InputError

METRES = {
    "": 1.0, "m": 1.0, "1": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "unknown": 1.0,
    "ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "international foot": 0.3048, "international feet": 0.3048,
    "us-ft": 1200 / 3937, "ussft": 1200 / 3937, "ftus": 1200 / 3937, "us survey foot": 1200 / 3937,
    "us survey feet": 1200 / 3937, "survey foot": 1200 / 3937, "foot us": 1200 / 3937,
    "cm": 0.01, "centimetre": 0.01, "dm": 0.1, "decimetre": 0.1, "km": 1000.0, "kilometre": 1000.0,
}  # fmt: skip
UNITS: Mapping[str, Mapping[str, float]] = {  # of each quantity, in lower case, and the factor to SI
    **dict.fromkeys(("thickness", "deposit", "change"), METRES),
    "speed": {"": 1.0, "m/s": 1.0, "m s-1": 1.0, "m s**-1": 1.0, "km/h": 1 / 3.6, "km h-1": 1 / 3.6},
    "pressure": {"": 1.0, "pa": 1.0, "kpa": 1e3, "mpa": 1e6, "n/m2": 1.0, "kn/m2": 1e3},
    "arrival": {"": 1.0, "s": 1.0, "sec": 1.0, "seconds": 1.0, "min": 60.0, "h": 3600.0},
}


def word_of(unit: str | None) -> str:
    """A stated unit as a key of :data:`UNITS`."""
    return (unit or "").strip().lower().replace("_", " ")


def unpacked(
    raster: Any, values: np.ndarray, path: Path | str, quantity: str, error: type[InputError]
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Values of the first band of an open raster as its scale, offset and unit mean them, and sentences on changes.

    Parameters
    ----------
    raster : rasterio.DatasetReader
    values : ndarray (rows, columns)
        Stored numbers, float64; a mask is kept.
    path : path or str
        For messages.
    quantity : str
        A name of :data:`UNITS`; the unit of another quantity does not count.

    Raises
    ------
    InputError
        ``error``, if the stated unit is not one of the quantity.
    """
    said: tuple[str, ...] = ()
    scale, offset = raster.scales[0], raster.offsets[0]
    if (scale, offset) != (1.0, 0.0):
        values = values * scale + offset
        said = (f"{path}: the file stores packed numbers; {quantity} = {scale:g} x number + {offset:g}.",)
    known, unit = UNITS.get(quantity), raster.units[0]
    if known is None or known.get(word_of(unit)) == 1.0:
        return values, said
    if word_of(unit) not in known:
        words = ", ".join(sorted(word for word in known if word))
        remedy = f"convert the values, or state their unit with `gdal_edit.py -units`: {words}"
        raise error(f"{path}: values of {quantity} are in {unit!r}; {remedy}")
    factor = known[word_of(unit)]
    return values * factor, (*said, f"{path}: values were in {unit}; multiplied by {factor:.10g}.")
