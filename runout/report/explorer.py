"""The explorer of the report: one interactive map of all layers, drawn by BokehJS from data inside the page.

Python packs the values, the ground and the marks; ``explorer.js`` draws them. The browser unpacks them with
``DecompressionStream`` and asks no other host.
"""

import base64
import gzip
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from runout.quantities import QUANTITIES
from runout.report import explorer_layers, explorer_marks
from runout.report.explorer_layers import MOST_VALUES, Family, Grid
from runout.report.explorer_members import MemberLayers, member_layers
from runout.report.relief import jpeg_address, relief_picture
from runout.report.study import Study
from runout.report.values import Window

TEMPLATE = "explorer.html.jinja"
WIDEST_SHADE, WIDEST_VIEW = 900, 1400  # pixels of the hillshade of the whole raster, and of that of the map
DARKEST = 90  # grey of the relief; colours lie over it
BUNDLES = ("bokeh.min.js", "bokeh-api.min.js")


@dataclass(frozen=True)
class Explorer:
    """Parts of a page."""

    head: str  # scripts and styles, for the end of ``<head>`` or of ``<body>``
    body: str  # what stands where the map is


def explorer(study: Study, settings: Mapping[str, Any], folder: Path | None = None) -> Explorer:
    """The interactive map of a study.

    Parameters
    ----------
    study : Study
        Maps, members and marks.
    settings : mapping
        Resolved site.yaml.
    folder : Path, optional
        Folder of site.yaml, to which the orthophoto is relative; default: the one that holds the results.

    Raises
    ------
    InputError
        If the orthophoto cannot be read, or does not touch the map.
    StorageError
        If a file of the results cannot be read.
    """
    from runout.report.html import render

    window = study.basemap.window(np.nan_to_num(study.hazard["members_reached"].values) > 0)
    grid = _grid_of(study, window)
    products = list(explorer_layers.families(study.hazard, grid))
    members = member_layers(study, grid)
    packed = _Pack()
    packed.add("products", products)
    packed.add("members", members.families)
    content = {
        "families": packed.families,
        "grids": {"products": _placed(study, grid), "members": _placed(study, members.grid)},
        "ground": _ground(study, window),
        "orthophoto": _orthophoto(study, window, settings, folder or study.results.parent),
        "marks": explorer_marks.marks(study, settings),
        "members": members.parameters,
        "view": _extent(study, window),
        "axes": ["Easting", "Northing"] if "crs" in study.hazard else ["x", "y"],
        "attribution": attribution(study, settings),
        "first": _first(study, products),
    }
    script = files("runout.report").joinpath("explorer.js").read_text(encoding="utf-8")
    style = files("runout.report").joinpath("explorer.css").read_text(encoding="utf-8")
    head = f"<style>\n{style}</style>\n{_text('explorer-bokeh', _bokeh())}{_text('explorer-content', packed.bytes(content))}"
    body = render({"notes": _notes(grid, members)}, TEMPLATE)
    return Explorer(f"{head}<script>\n{script}</script>\n", body)


class _Pack:
    """Codes of families one behind another, and where each begins."""

    def __init__(self) -> None:
        self.families: list[dict[str, Any]] = []
        self.codes: list[bytes] = []

    def add(self, grid: str, families: list[Family]) -> None:
        """Append the codes of families on a grid."""
        for family in families:
            self.families.append(family.described(grid, sum(map(len, self.codes))))
            self.codes.append(explorer_layers.bytes_of(family.codes()))

    def bytes(self, content: dict[str, Any]) -> bytes:
        """Length of the JSON text [4 bytes, little endian], JSON text, codes."""
        text = json.dumps(content, allow_nan=False, separators=(",", ":")).encode()
        return len(text).to_bytes(4, "little") + text + b"".join(self.codes)


def _text(name: str, content: bytes) -> str:
    """A script element that holds compressed content; base64 has no character that HTML reads."""
    return (
        f'<script type="text/plain" id="{name}">{base64.b64encode(gzip.compress(content, 6, mtime=0)).decode("ascii")}</script>\n'
    )


def _bokeh() -> bytes:
    """BokehJS with its interface for scripts."""
    import bokeh

    folder = Path(bokeh.__file__).parent / "server" / "static" / "js"
    return b"\n".join((folder / name).read_bytes() for name in BUNDLES)


def _grid_of(study: Study, window: Window) -> Grid:
    """Cells of the products: those of the raster, or coarser ones where there are too many."""
    layers = sum(math.prod(a.shape[:-2]) for a in study.hazard.data_vars.values() if a.dims[-2:] == ("y", "x"))
    cells = math.prod(part.stop - part.start for part in window)
    return Grid(window, max(1, math.ceil(math.sqrt(layers * cells / MOST_VALUES))))


def _placed(study: Study, grid: Grid) -> dict[str, float]:
    """Place of a grid: west and north edge and size of its cells [m]."""
    west, _, _, north = study.basemap.extent(grid.window)
    dx, dy = study.basemap.cell_size
    rows, columns = grid.shape
    return {
        "west": float(west),
        "north": float(north),
        "dx": dx * grid.factor,
        "dy": dy * grid.factor,
        "rows": rows,
        "columns": columns,
    }


def _extent(study: Study, window: Window) -> list[float]:
    return [float(edge) for edge in study.basemap.extent(window)]


def _ground(study: Study, window: Window) -> list[dict[str, Any]]:
    """Pictures of the ground with their extents: the whole raster, and the window of the map where that has finer cells."""
    whole = study.basemap.whole
    pictures = [(whole, WIDEST_SHADE)]
    if max(part.stop for part in whole) > WIDEST_SHADE:
        pictures.append((window, WIDEST_VIEW))
    ground = study.basemap
    reliefs = [(part, relief_picture(ground.elevation[part], ground.cell_size, widest, DARKEST)) for part, widest in pictures]
    return [{"extent": _extent(study, part), "image": jpeg_address(relief)} for part, relief in reliefs]


def _orthophoto(study: Study, window: Window, settings: Mapping[str, Any], folder: Path) -> dict[str, Any] | None:
    """Picture of the ground in the window, with its extent; None where site.yaml states none."""
    from PIL import Image

    from runout.io.draped_image import draped_image

    name = (settings.get("report") or {}).get("orthophoto")
    if not name:
        return None
    west, east, south, north = _extent(study, window)
    crs = study.hazard["crs"].attrs.get("crs_wkt") if "crs" in study.hazard else None
    colours = draped_image(folder / name, (west, south, east, north), crs, WIDEST_VIEW)
    return {"extent": [west, east, south, north], "image": jpeg_address(Image.fromarray(colours))}


def _first(study: Study, products: list[Family]) -> list[int]:
    """Family and level that the map shows first: the probability of the thickness, or that of a single member."""
    names = [family.name for family in products]
    thickness = QUANTITIES["thickness"]
    if study.is_single and thickness.peak in names:
        return [names.index(thickness.peak), 0]
    if thickness.exceedance("probability") not in names:
        return [0, 0]
    levels = study.hazard[thickness.threshold].values
    return [names.index(thickness.exceedance("probability")), int(np.abs(levels - study.threshold).argmin())]


def attribution(study: Study, settings: Mapping[str, Any]) -> str:
    """Who is named as the source of the inputs, and the raster of elevations."""
    stated = (settings.get("metadata") or {}).get("acknowledgement") or study.hazard.attrs.get("acknowledgement") or ""
    dem = (settings.get("terrain") or {}).get("dem") or ""
    crs = study.hazard["crs"].attrs.get("long_name", "") if "crs" in study.hazard else "local coordinates"
    return " · ".join(part for part in (f"Elevation: {dem}" if dem else "", stated, crs) if part)


def _notes(grid: Grid, members: MemberLayers) -> list[str]:
    """Sentences on the precision and the cells of the map."""
    rule = "the largest value (of arrival: the earliest) of {0} x {0} cells of the raster"
    notes = ["Values are rounded to the step that the legend states; hazard.nc holds the product."]
    if grid.factor > 1:
        notes.append(f"Each cell of the map shows {rule.format(grid.factor)}.")
    if members.families and members.grid.factor > grid.factor:
        notes.append(f"Each cell of the maps of members shows {rule.format(members.grid.factor)}.")
    return notes
