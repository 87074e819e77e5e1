"""``SITE.qgz``: all maps and outlines in QGIS 3.22 or newer, in groups with styles, a layout for print and arrival over time.

It is read-only, since each run writes it anew: save your changes under another name, in this folder.
"""

import math
import numbers
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from runout import __version__
from runout.config.parameter_variables import parameter_variable
from runout.hazard.archives import earlier_archives, filled, write_archive
from runout.hazard.maps import GROUPS, headline, map_layers
from runout.hazard.round_numbers import round_length
from runout.hazard.style import legend_unit
from runout.hazard.writers import Products
from runout.hazard.writers.member_snapshots import snapshots
from runout.hazard.writers.outlines import ARRIVAL_LAYER, ARRIVAL_START, arrival_edges, moment
from runout.io.grid import horizontal_crs
from runout.io.member_maps import SNAPSHOTS
from runout.quantities import QUANTITIES
from runout.scores.members import BOOKKEEPING

if TYPE_CHECKING:
    import xarray as xr

    from runout.model.terrain import Terrain

Box = tuple[float, float, float, float]  # west, south, east, north [m]

OUTLINES = {  # layers of outlines.gpkg: group, words, whether they are shown at first
    "release": ("outlines", "Release", True),
    "inundation": ("outlines", "Outlines of the probability of inundation", False),
    "inflow_lines": ("outlines", "Inflow", True),
    "inflow_areas": ("outlines", "Inflow areas", True),
    "obstacles": ("outlines", "Obstacles", True),
    "friction_zones": ("outlines", "Friction zones", False),
    "observed_outline": ("outlines", "Observed outline", True),
    "gauges": ("outlines", "Gauges", True),
    "thalweg": ("outlines", "Thalweg", False),
    "facades": ("structures", "Pressure on facades", True),
    "structures": ("structures", "Structures", True),
    "probes": ("probes", "Probes", True),
    "cross_sections": ("probes", "Cross-sections", True),
    "return_periods": ("return_periods", "Outlines by return period", False),
    "danger_level": ("danger", "Areas of the levels of danger", False),
    "intensity_class": ("danger", "Areas of the classes of intensity", False),
    ARRIVAL_LAYER: ("arrival", "Arrival over time (temporal controller)", False),
}
OPEN_GROUPS = {  # above those of the maps
    **{"outlines": "Outlines and release", "structures": "Structures", "probes": "Probes"},
    SNAPSHOTS: "Snapshots of the member with the median run-out (temporal controller)",
}
MEMBERS, MEMBERS_FILE = "members", "members.nc"
MOST_MEMBERS = 20  # with a layer of their own; of more, some at equal distances
HILLSHADE = (
    '<pipe><rasterrenderer type="hillshade" band="1" azimuth="315" angle="45" zfactor="1" multidirection="0" opacity="1" '
    'alphaBand="-1" nodataColor=""/><brightnesscontrast brightness="35" contrast="-20" gamma="1"/>'
    '<rasterresampler maxOversampling="2" zoomedInResampler="bilinear" zoomedOutResampler="bilinear"/></pipe>'
)
MARGIN = 0.15  # of the view around what is reached
SHEET = 195 / 175  # width over height of the map of the layout
READ_ONLY = 0o444  # QGIS then asks for another name instead of changing a product


@dataclass(frozen=True)
class Layer:
    """A layer of the project: XML of its style, and place in the tree."""

    id: str
    title: str
    source: str
    group: str
    style: str
    visible: bool = False
    geometry: str = ""
    labels: int = 0
    start: str = ""
    legend: bool = True
    shown_classes: str = ""
    span: tuple[str, str] | None = None

    @property
    def type(self) -> str:
        """Type of layer in QGIS."""
        return "vector" if self.geometry else "raster"

    @property
    def provider(self) -> str:
        """Library that reads it."""
        return "ogr" if self.geometry else "gdal"


def write(products: Products) -> list[Path]:
    """Path of the project. It follows the rasters, their styles and ``outlines.gpkg``, which are written before it."""
    name = products.site.name
    text = filled("project.qgs", project_content(products))
    return [write_archive(products.results / f"{name}.qgz", {f"{name}.qgs": text.encode()}, READ_ONLY)]


def earlier(results: Path) -> set[Path]:
    """The project of the run before."""
    return earlier_archives(results, ".qgz")


def project_content(products: Products) -> dict[str, Any]:
    """What the template of the project shows."""
    hazard, terrain = products.hazard, products.terrain
    results, first = products.results, headline(hazard).name
    layers = [*_vector_layers(results, first), *_raster_layers(hazard, results), *_snapshot_layers(products), _hillshade(hazard)]
    layers[-1:-1] = _member_layers(products)
    groups: list[dict[str, Any]] = [
        {"title": title, "layers": own, "open": any(layer.visible for layer in own)}
        for name, title in (OPEN_GROUPS | {MEMBERS: _members_title(products)} | GROUPS).items()
        if (own := [layer for layer in layers if layer.group == name])
    ]
    view = reached_box(hazard)
    sheet = _fitted(view, SHEET)
    title = str(hazard.attrs.get("title", products.site.name)).removesuffix(": hazard maps")
    return {
        "title": title,
        "groups": groups,
        "layers": [layer for group in groups for layer in group["layers"]],
        "crs": _system(terrain),
        "view": view,
        "sheet": sheet,
        "bar": round_length(sheet[2] - sheet[0], 0.125),
        "labels": _labels(products, title),
        **_times(products),
    }


def _raster_layers(hazard: "xr.Dataset", results: Path) -> Iterator[Layer]:
    """Layers of the rasters; the first map that answers is shown."""
    first = headline(hazard).name
    for layer in map_layers(hazard):
        root = ElementTree.fromstring((results / f"{layer.path}.qml").read_text(encoding="utf-8").split("\n", 1)[1])
        yield Layer(
            f"map_{layer.stem}",
            layer.title,
            f"./{layer.path}.tif",
            layer.group,
            _inner(root),
            visible=layer.name == first,
            shown_classes=_with_meaning(root),
        )


def _snapshot_layers(products: Products) -> Iterator[Layer]:
    """Layers of the snapshots of one member, each for its span of time."""
    for one in snapshots(products):
        text = (products.results / f"{one.path}.qml").read_text(encoding="utf-8")
        root = ElementTree.fromstring(text.split("\n", 1)[1])
        title = f"Flow thickness at {one.start:.4g} s, member {one.member} (median run-out)"
        yield Layer(
            f"snapshot_{one.start:g}",
            title,
            f"./{one.path.as_posix()}.tif",
            SNAPSHOTS,
            _inner(root),
            legend=False,
            shown_classes=_with_meaning(root),
            span=(f"{moment(one.start).isoformat()}Z", f"{moment(one.end).isoformat()}Z"),
        )


def shown_members(products: Products) -> list[int]:
    """Members with a layer of their own: all valid ones, or of many the representative one and others at equal distances."""
    valid = list(products.ensemble.files)
    step = math.ceil(len(valid) / MOST_MEMBERS)
    return sorted({*valid[::step], products.representative})


def _members_title(products: Products) -> str:
    shown, valid = len(shown_members(products)), len(products.ensemble.files)
    return f"Members: largest flow thickness ({shown if shown == valid else f'{shown} of {valid}'})"


def _member_layers(products: Products) -> Iterator[Layer]:
    """Layers of single members, bands of ``members.nc`` in the colours of the largest thickness of all members."""
    table, mapped = products.ensemble.table, QUANTITIES["thickness"]
    path = next(layer.path for layer in map_layers(products.hazard) if layer.name == mapped.peak)
    root = ElementTree.fromstring((products.results / f"{path}.qml").read_text(encoding="utf-8").split("\n", 1)[1])
    for number in shown_members(products):
        renderer = next(root.iter("rasterrenderer"))
        renderer.set("band", str(table.index.get_loc(number) + 1))
        yield Layer(
            f"member_{number}",
            _member_title(products, number),
            f'NETCDF:"./{MEMBERS_FILE}":{mapped.member_map}',
            MEMBERS,
            _inner(root),
            legend=False,
            shown_classes=_with_meaning(root),
        )


def _member_title(products: Products, number: int) -> str:
    """Number of a member and its sampled parameters."""
    row = products.ensemble.table.loc[number]
    parts = ["median run-out"] if number == products.representative else []
    for name in row.index.difference(BOOKKEEPING, sort=False):
        variable = parameter_variable(str(name))
        shown = f"{row[name]:.4g}{legend_unit(variable.units)}" if isinstance(row[name], numbers.Real) else str(row[name])
        parts.append(f"{variable.long_name} {shown}")
    return f"Member {number}{': ' if parts else ''}{', '.join(parts)}"


def _with_meaning(root: ElementTree.Element) -> str:
    """Places of the classes in a legend of QGIS: without the name of the band and the class of nothing."""
    items = [*root.iter("item"), *root.iter("paletteEntry")]
    return ",".join(str(k) for k, item in enumerate(items, 1) if item.get("alpha") != "0")


def _vector_layers(results: Path, first: str) -> Iterator[Layer]:
    """Layers of ``outlines.gpkg`` with the styles that it holds; outlines of the probability lie on the map of it alone."""
    import pyogrio

    path = results / "outlines.gpkg"
    kinds = {str(name): str(kind) for name, kind in pyogrio.list_layers(path) if kind}
    stored = pyogrio.read_dataframe(path, layer="layer_styles").set_index("f_table_name")["styleQML"]
    for name, (group, title, visible) in OUTLINES.items():
        if name not in kinds:
            continue
        root = ElementTree.fromstring(stored[name].split("\n", 1)[1])
        geometry = next(word for word in ("Polygon", "Line", "Point") if word in kinds[name])
        yield Layer(
            f"outlines_{name}",
            title,
            f"./outlines.gpkg|layername={name}",
            group,
            _inner(root),
            visible or (name, first) == ("inundation", "inundation_probability"),
            geometry=geometry,
            labels=int(root.get("labelsEnabled", "0")),
            start=ARRIVAL_START if name == ARRIVAL_LAYER else "",
            legend=name != "inundation",
        )


def _hillshade(hazard: "xr.Dataset") -> Layer:
    """The elevation in shades, below all others."""
    elevation = next(layer for layer in map_layers(hazard) if layer.name == "elevation")
    return Layer("map_hillshade", "Hillshade", f"./{elevation.path}.tif", "terrain", HILLSHADE, True, legend=False)


def _inner(root: ElementTree.Element) -> str:
    """XML of the children of a style."""
    return "".join(ElementTree.tostring(child, encoding="unicode") for child in root)


def reached_box(hazard: "xr.Dataset") -> Box:
    """Bounds of the cells that members reach or that are released, with a margin; of all cells if there are none."""
    reached = (hazard["members_reached"].values > 0) | (hazard["release_thickness"].values > 0)
    rows, columns = np.nonzero(reached if reached.any() else np.ones_like(reached))
    x, y = hazard["x"].values, hazard["y"].values
    dx, dy = abs(x[1] - x[0]), abs(y[1] - y[0])
    west, east = x[columns.min()] - dx / 2, x[columns.max()] + dx / 2
    south, north = y[rows.max()] - dy / 2, y[rows.min()] + dy / 2
    margin = MARGIN * max(east - west, north - south)
    return float(west - margin), float(south - margin), float(east + margin), float(north + margin)


def _fitted(box: Box, ratio: float) -> Box:
    """A box around another with a ratio of width to height."""
    x, y = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    height = max(box[3] - box[1], (box[2] - box[0]) / ratio)
    return x - ratio * height / 2, y - height / 2, x + ratio * height / 2, y + height / 2


def _system(terrain: "Terrain") -> dict[str, str]:
    """Coordinate reference system as QGIS reads it; empty for local coordinates, for which QGIS then asks nothing."""
    if terrain.crs is None:
        return {"wkt": "", "authority": "", "name": ""}
    crs = horizontal_crs(terrain.crs)
    authority = crs.to_authority(min_confidence=100)
    return {"wkt": crs.to_wkt(), "authority": ":".join(authority) if authority else "", "name": crs.name}


def _labels(products: Products, title: str) -> list[tuple[str, str, Box, int, bool]]:
    """Texts of the layout: name, words, place [mm], size [pt], bold."""
    attrs, crs = products.hazard.attrs, _system(products.terrain)["name"] or "local coordinates"
    author = ", ".join(str(attrs[key]) for key in ("creator_name", "institution", "project") if key in attrs)
    block = [
        *([author] if author else []),
        str(attrs.get("ensemble", "")),
        "Probabilities are conditional on the release, not annual." if "scenarios" not in attrs else str(attrs["scenarios"]),
        f"{crs} · runout {__version__} · settings {str(attrs.get('configuration_sha256', ''))[:12]}",
    ]
    literal = [text.replace("[%", "[ %") for text in (title, "\n".join(filter(None, block)))]  # QGIS computes what stands in [% %]
    return [
        ("title", literal[0], (10, 7, 277, 11), 14, True),
        ("block", literal[1], (209, 168, 80, 24), 7, False),
        ("foot", "Printed [% format_date(now(), 'yyyy-MM-dd') %]", (209, 192, 80, 5), 7, False),
    ]


def _times(products: Products) -> dict[str, Any]:
    """End and step [s] of the time of the project."""
    edges, ends = arrival_edges(products.hazard), [one.end for one in snapshots(products)]
    if not edges and not ends:
        return {"end": "", "step": 0}
    step = edges[1] - edges[0] if edges else ends[-1] / len(ends)
    return {"end": moment(max(edges[-1:] + ends)).isoformat() + "Z", "step": step}
