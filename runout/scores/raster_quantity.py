"""What a raster shows: by its name, else by its unit."""

import re
from pathlib import Path

from runout.errors import ObservationError
from runout.io.opening import open_raster
from runout.io.units import OTHER_UNITS, factor_to, is_stated
from runout.quantities import QUANTITIES
from runout.scores.flow import IN_FILES, TITLES

NAMED = {name: name for name in (*QUANTITIES, "arrival", "change") if name != "thickness"}  # by words of the names of files
NAMED |= {"deposits": "deposit", "deposition": "deposit", "velocity": "speed", "dod": "change"}
THICK = {"thickness", "depth", "flow"}  # a flow's, unless another word is there
OTHER = {"probability", "exceedance", "error", "difference"}  # maps of which no score is made


def raster_quantity(path: Path) -> tuple[str, tuple[str, ...]]:
    """Name in :data:`runout.scores.flow.UNITS` of what a raster shows, and a sentence where neither name nor unit says it.

    Raises
    ------
    ObservationError
        If its name says several quantities, or a map of which no score is made.
    """
    words = set(re.split(r"[^a-z]+", path.stem.lower()))
    named = {quantity for name, quantity in NAMED.items() if words.issuperset(name.split("_"))}
    if len(named) > 1 or words & OTHER:
        shown = " and ".join(sorted(named if len(named) > 1 else words & OTHER))
        raise ObservationError(f"{path}: its name says {shown}; state what it shows with --quantity")
    found = next(iter(named), "thickness" if words & THICK else _by_unit(path))
    if found is not None:
        return found, ()
    said = f"{path}: taken as {TITLES['thickness']}, since neither name nor unit says what it shows; --quantity states it."
    return "thickness", (said,)


def _by_unit(path: Path) -> str | None:
    """The one quantity that has the unit of a raster; None without a unit, or if several have it."""
    with open_raster(path, ObservationError) as file:
        unit = file.units[0] if file.units else None
    fitting = [name for name, si in IN_FILES.items() if si in OTHER_UNITS and is_stated(unit) and factor_to(si, unit)]
    return fitting[0] if len(fitting) == 1 else None
