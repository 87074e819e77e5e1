"""Palettes of maps: colours, direction, classes and what classes mean, one for each kind of map.

Report, QGIS styles, plots, pictures in 3D and the file for Google Earth take colours from here. Dark stands for more, faster, more
probable, earlier. All palettes change steadily in lightness, so that they can be read without red and green and in grey; the signed
ones are light in the middle. Quantities state their colours and classes in :mod:`runout.quantities`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.quantities import ALL_QUANTITIES, quantity_of
from runout.variables import VARIABLES

PROBABILITY_LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
ANNUAL_RATES = (1 / 5000, 1 / 1000, 1 / 300, 1 / 100, 1 / 30, 1 / 10)  # [1/a], rates at which land use and protection are decided
RELEASE, OBSTACLE, OBSERVED, PROBE = "#d7263d", "#6b3f16", "#0b4fae", "#6a1b9a"  # lines and points on maps
FAINTEST = 0.12  # part of a palette that is not used, as too light on the ground


@dataclass(frozen=True)
class Palette:
    """Colours of a kind of map."""

    colours: str  # colour map of matplotlib, from the smallest to the largest value
    # lower edges of classes above 0, in the unit of the map; empty: classes follow from thresholds and values
    classes: tuple[float, ...] = ()
    meanings: tuple[str, ...] = ()  # what the values from each class on do
    signed: bool = False  # symmetric about 0, light there
    smooth: bool = False  # mixed between the edges, without steps
    opaque: bool = False  # 0 is a value like any other, and not "nothing happens"

    def hexadecimal(self, count: int) -> list[str]:
        """Colours of ``count`` classes, from the smallest to the largest values."""
        parts = np.rint(255 * self.rgba(count)[:, :3]).astype(np.uint8)
        return [f"#{part.tobytes().hex()}" for part in parts]

    def rgba(self, count: int) -> np.ndarray:
        """Colours (count, 4), 0 to 1, at equal distances from the first to the last."""
        from matplotlib import colormaps

        ramp = colormaps[self.colours]
        light_first = sum(ramp(0.0)[:3]) > sum(ramp(1.0)[:3])
        low, high = (0.0, 1.0) if self.signed else (FAINTEST, 1.0) if light_first else (0.0, 1.0 - FAINTEST)
        return np.asarray(ramp(low + (high - low) * np.arange(count) / max(1, count - 1)))

    def listed(self, count: int = 256) -> Any:
        """Colour map of matplotlib with ``count`` of the colours."""
        from matplotlib.colors import ListedColormap

        return ListedColormap(self.rgba(count))

    def meaning(self, value: float) -> str:
        """What values from ``value`` on do; empty where that is not known."""
        reached = [words for edge, words in zip(self.classes, self.meanings, strict=False) if edge <= value]
        return reached[-1] if reached else ""


_SIGNED = Palette("RdBu_r", signed=True, smooth=True)
PALETTES = {  # by a word in the name of a map; the first that fits
    "difference": _SIGNED,
    "change": _SIGNED,
    "distance_mean": _SIGNED,
    "distance": Palette("PuBuGn"),
    "_error": Palette("Purples"),
    "deviation": Palette("Purples"),
    "probability": Palette("YlOrRd", PROBABILITY_LEVELS),
    "share": Palette("YlOrBr", PROBABILITY_LEVELS),
    "annual": Palette("YlOrRd", ANNUAL_RATES),
    "intensity": Palette("YlOrRd"),
    "members": Palette("YlOrRd"),
    "arrival": Palette("YlGnBu_r", opaque=True),
    "elevation": Palette("cividis", smooth=True, opaque=True),
    "slope": Palette("YlOrBr", smooth=True, opaque=True),
    "safety": Palette("YlOrBr_r"),
    "drainage": Palette("YlGnBu"),
    "sink": Palette("Blues"),
}


def palette_of(name: str) -> Palette:
    """Palette of a map, or of a quantity, by its name; classes are in the printed unit (kPa).

    Other maps in metres, such as the thickness of a release, have the palette of the thickness.
    """
    for word, palette in PALETTES.items():
        if word in name:
            return palette
    quantity = ALL_QUANTITIES.get(name) or quantity_of(name) or ALL_QUANTITIES["thickness"]
    divisor = VARIABLES[quantity.peak].printed[1]
    return Palette(quantity.colours, tuple(edge / divisor for edge in quantity.classes), quantity.meanings)
