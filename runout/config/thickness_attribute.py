"""Finds the attribute of release polygons that holds their thickness, by its usual names in several languages."""

import logging
import unicodedata
from pathlib import Path
from typing import Any

from runout.errors import InputError
from runout.model.limits import LIMITS, is_number

LOGGER = logging.getLogger(__name__)

ASSUMED = 10.0  # [m], written if no attribute is found
NAMES = (  # lower case, without accents and signs; includes those of AvaFrame and RAMMS
    "thickness", "depth", "height", "thick", "thk", "h", "h0", "d", "d0", "relth", "relthickness", "releasethickness",
    "releasedepth", "releaseheight", "meanthickness", "meandepth", "depthm", "thicknessm", "heightm", "maechtigkeit",
    "machtigkeit", "tiefe", "dicke", "hoehe", "hohe", "anrissmachtigkeit", "anrissmaechtigkeit", "anrisshohe",
    "anrisshoehe", "epaisseur", "profondeur", "hauteur", "spessore", "profondita", "altezza", "espesor", "profundidad",
    "altura", "potencia", "espessura", "profundidade",
)  # fmt: skip
LONGEST = 10  # longest name of an attribute in a shapefile


def thickness_of(path: Path, table: Any, choice: str | None = None) -> float | str:
    """Thickness of release polygons for a new site.yaml: name of an attribute or a number [m]. The choice is logged.

    Parameters
    ----------
    path : Path
        Vector file, for messages.
    table : pandas.DataFrame
        Attributes of its polygons, one row a polygon.
    stated : str, optional
        Attribute or number [m] that the user states; it overrides the search.

    Raises
    ------
    InputError
        If there is no such attribute, or there are several that may be the thickness.
    """
    if choice is not None:
        return _stated(path, table, choice)
    named = [name for name in table.columns if _is_thickness(str(name))]
    usable = [name for name in named if _usable(table[name])]
    for name in named:
        if name not in usable:
            LOGGER.warning("%s: attribute %r is not taken for the thickness: not every value is a thickness in m", path, name)
    if not usable:
        known = ", ".join(map(repr, table.columns)) or "none"
        LOGGER.warning(
            "%s: no attribute is taken for the thickness (attributes: %s); site.yaml states %g m: edit it, or make the site anew "
            "with --thickness", path, known, ASSUMED,
        )  # fmt: skip
        return ASSUMED
    if len(usable) > 1 and "thickness" not in usable:
        raise InputError(
            f"{path}: {len(usable)} attributes may hold the thickness: {', '.join(map(repr, usable))}; name the one that does, for "
            f"example --thickness {usable[0]}, or give a number in m"
        )
    attribute = "thickness" if "thickness" in usable else str(usable[0])
    values = table[attribute].astype(float)
    LOGGER.info("%s: thickness from the attribute %r, %g to %g m", path, attribute, values.min(), values.max())
    return attribute


def _stated(path: Path, table: Any, choice: str) -> float | str:
    if choice in table:
        return choice
    valid = LIMITS["thickness"]
    try:
        number = float(choice)
    except ValueError:
        known = ", ".join(map(repr, table.columns)) or "none"
        raise InputError(f"{path}: no attribute {choice!r} for the thickness; attributes: {known}; or give a number in m") from None
    if not valid.holds(number):
        raise InputError(f"thickness is {number:g} m; {valid.allowed()}; {valid.hint}")
    return number


def _is_thickness(name: str) -> bool:
    plain = unicodedata.normalize("NFKD", name.casefold())
    letters = "".join(letter for letter in plain if letter.isascii() and letter.isalnum())
    cut = len(name) >= LONGEST - 1 and any(known.startswith(letters) for known in NAMES)
    return letters in NAMES or cut


def _usable(values: Any) -> bool:
    """Whether every value is a valid thickness; numbers stored as text are accepted."""

    def number(value: Any) -> float:
        try:
            return float(value) if is_number(value) or isinstance(value, str) else float("nan")
        except ValueError:
            return float("nan")

    return len(values) > 0 and all(LIMITS["thickness"].holds(number(value)) for value in values)
