"""The explorer of the report: one interactive map of all layers, drawn by BokehJS from data inside the page.

Python packs the values, the ground and the marks; ``explorer.js`` draws them. The browser unpacks them with
``DecompressionStream`` and asks no other host.
"""

import base64
import gzip
import json
import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from runout.ensemble.member import members_folder
from runout.hazard.maps import classes_of
from runout.hazard.reach import representative
from runout.hazard.style import MapClasses
from runout.io import netcdf
from runout.io.member_maps import MemberMaps, MembersFile
from runout.quantities import ALL_QUANTITIES, ARRIVAL, CHANGE, QUANTITIES, UNTIL_ARRIVAL
from runout.report import explorer_layers, explorer_marks
from runout.report.explorer_layers import MEMBER_STEPS, MOST_VALUES, STEPS, Family, Grid, bytes_of, step_of
from runout.report.figures import parameter_label
from runout.report.relief import address, relief_picture
from runout.report.study import Study
from runout.report.tables import sampled_parameters
from runout.report.values import Window
from runout.report.wording import number, unit
from runout.variables import VARIABLES

SHOWN = ("max_flow_thickness", "max_speed", "max_pressure", ARRIVAL, "deposit_thickness", "eroded_depth", CHANGE)
SNAPSHOTS = {"flow_thickness": "max_flow_thickness", "speed": "max_speed"}  # of a file: map with the same classes
BUDGET = 1_500_000  # bytes of all maps of the members, compressed
MOST_FINE = 50  # members whose values have as many steps as the products
SAMPLE = 8  # members from which the size of all is estimated
TRIALS = 6
TEMPLATE = "explorer.html.jinja"
WIDEST_SHADE, WIDEST_VIEW = 900, 1400  # pixels of the hillshade of the whole raster, and of that of the map
DARKEST = 90  # grey of the relief; colours lie over it
BUNDLES = ("bokeh.min.js", "bokeh-api.min.js")


@dataclass(frozen=True)
class MemberLayers:
    """Maps of the members."""

    families: list[Family]  # levels are the valid members, or the snapshots of one
    grid: Grid  # the finest whose maps fit in :data:`BUDGET`
    parameters: list[str]  # sampled parameters of each valid member


def member_layers(study: Study, grid: Grid) -> MemberLayers:
    """Maps of the valid members on ``grid``, or on coarser cells where they are too many."""
    numbers = [int(member) for member in study.valid.index]
    if not numbers:
        return MemberLayers([], grid, [])
    steps = STEPS if len(numbers) <= MOST_FINE else MEMBER_STEPS
    some = numbers[:: max(1, len(numbers) // SAMPLE)]
    families: list[Family] = []
    with MembersFile(study.results / "members.nc") as stack:
        for _ in range(TRIALS):
            families = _families(study, stacked(stack, some, grid), some, steps)
            size = sum(len(zlib.compress(bytes_of(family.codes()), 6)) for family in families) * len(numbers) / len(some)
            if size <= BUDGET:
                break
            grid = Grid(grid.window, max(grid.factor + 1, math.ceil(grid.factor * math.sqrt(size / BUDGET))))
        else:
            families = []
        if len(some) < len(numbers) or not families:
            families = _families(study, stacked(stack, numbers, grid), numbers, steps)
    return MemberLayers([*families, *_snapshots(study, grid)], grid, [_parameters(study, member) for member in numbers])


def stacked(stack: MembersFile, numbers: list[int], grid: Grid) -> dict[str, np.ndarray]:
    """Maps (members, rows, columns) by name, in units of files."""
    of = {name: np.fmin if name in UNTIL_ARRIVAL else np.fmax for name in SHOWN if name in stack.maps}
    members = [stack.member(number) for number in numbers]
    return {
        name: np.stack([grid.reduce(member.within(name, grid.window), ufunc) for member in members]) for name, ufunc in of.items()
    }


def _families(study: Study, stacks: dict[str, np.ndarray], numbers: list[int], steps: int) -> list[Family]:
    levels = [str(member) for member in numbers]
    return [_family(study, name, "One member", f"Member: {_words(name)}", levels, values, steps) for name, values in stacks.items()]


def _family(study: Study, name: str, group: str, title: str, levels: list[str], values: np.ndarray, steps: int) -> Family:
    """A family with the classes that the largest of all members has."""
    alike = SNAPSHOTS.get(name, name)
    units, divisor = VARIABLES[alike].printed
    printed = values / np.float32(divisor)
    mapped = next((q for q in ALL_QUANTITIES.values() if q.member_map == alike and not q.part_of), None)
    if mapped and mapped.peak in study.hazard:
        classes = classes_of(study.hazard, mapped.peak)
    else:
        classes = MapClasses.over(alike, [values])
    choice = "Snapshot" if name in SNAPSHOTS else "Member"
    step = step_of(mapped.peak if mapped else alike, printed, classes, steps)
    return Family(name, group, title[:1].upper() + title[1:], unit(units), choice, levels, printed, classes, step)


def _words(name: str) -> str:
    mapped = next((q for q in ALL_QUANTITIES.values() if q.member_map == name and not q.part_of), None)
    return (f"maximum {mapped.words}" if mapped.formula else mapped.words) if mapped else VARIABLES[name].long_name


def _snapshots(study: Study, grid: Grid) -> list[Family]:
    """Thickness and speed of one member at the times that its file holds; none where the site keeps no snapshots."""
    member = representative(study.valid)
    path = members_folder(study.results) / study.members["file"][member]
    with MemberMaps(path) as file:
        if "snapshots" not in file.file.groups:
            return []
    rows, columns = grid.window
    dataset = netcdf.read(path, "snapshots")
    near = 0.1 * min(study.basemap.cell_size)
    whole = dataset.reindex(
        y=study.basemap.northing[rows], x=study.basemap.easting[columns], method="nearest", tolerance=near, fill_value=0.0
    )
    levels = [f"{number(float(time))} s" for time in dataset["time"].values]
    title = "{} at one time, member " + str(member)
    return [
        _family(study, name, "Snapshots of one member", title.format(words), levels, grid.reduce(whole[name].values), STEPS)
        for name, words in {"flow_thickness": "Flow thickness", "speed": "Flow speed"}.items()
        if name in whole
    ]


def _parameters(study: Study, member: int) -> str:
    names = sampled_parameters(study)
    return ", ".join(f"{parameter_label(name)}: {number(float(study.members.loc[member, name]))}" for name in names)


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
    return [{"extent": _extent(study, part), "image": address(relief)} for part, relief in reliefs]


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
    return {"extent": [west, east, south, north], "image": address(Image.fromarray(colours))}


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
