"""Checks that the georeference and the coordinate system of a raster can be used in computations."""

import math
import re
from collections.abc import Sequence
from pathlib import Path

from runout.errors import InputError

SMALLEST_CELL, LARGEST_CELL = 1e-7, 1e6  # in map units: a centimetre in degrees, and more than any map sheet
GRIDS = re.compile(r'(?:grids|init)=([^\s"\]]*)|PARAMETERFILE\["[^"]*",\s*"([^"]*)"', re.IGNORECASE)  # in PROJ text, in WKT
FARTHEST = 1e9  # map units from the origin of the map
DIGITS = 2.0**44  # cells from the origin; farther out, double precision hardly resolves a cell


def require_usable(transform: Sequence[float], source: Path | str, error: type[InputError]) -> None:
    """Raise an error unless an affine map ``(a, b, c, d, e, f)`` is finite, with plausible cell sizes and coordinates."""
    if not all(math.isfinite(number) for number in transform):
        raise error(f"{source}: its georeference holds {_listed(transform)}, which are no finite numbers; {_remedy(source)}")
    a, b, c, d, e, f = transform
    cells, place = (math.hypot(a, d), math.hypot(b, e)), max(abs(c), abs(f))
    if not all(SMALLEST_CELL <= cell <= LARGEST_CELL for cell in cells):
        sizes = f"cells of {cells[0]:g} x {cells[1]:g}"
        raise error(f"{source}: has {sizes} map units; {SMALLEST_CELL:g} to {LARGEST_CELL:g} can be used; {_remedy(source)}")
    if place > min(FARTHEST, DIGITS * min(cells)):
        raise error(f"{source}: its corner lies at {c:g}, {f:g}, farther from the origin than a map reaches; {_remedy(source)}")


def file_named_by(text: str) -> str | None:
    """File or address that a coordinate system (PROJ or WKT text) names, apart from the grids of PROJ; None if there is none."""
    named = [name for match in GRIDS.findall(text) for part in match for name in part.split(",")]
    return next((name for name in named if re.search(r"[/\\]|:.*:", name)), None)


def require_own_grids(text: str, source: Path | str, error: type[InputError]) -> None:
    """Raise an error if a coordinate system (PROJ or WKT text) names files other than the grids of PROJ."""
    other = file_named_by(text)
    if other:
        raise error(
            f"{source}: its coordinate system names the grid file {other!r}, which is not read; write a code such as EPSG:32632"
        )


def _listed(transform: Sequence[float]) -> str:
    return ", ".join(f"{number:g}" for number in transform if not math.isfinite(number))


def _remedy(source: Path | str) -> str:
    return f"state it anew: `gdal_edit.py -a_ullr WEST NORTH EAST SOUTH {source}`"
