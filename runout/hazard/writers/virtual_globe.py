"""``SITE.kmz``: the first map over the ground, outlines and legend, for Google Earth and other globes.

It is absent where the elevation has no coordinate reference system.
"""

import html
import io
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.hazard.archives import earlier_archives, filled, write_archive
from runout.hazard.maps import classes_of, headline
from runout.hazard.style import MapClasses
from runout.hazard.writers import Products
from runout.io.geotiff import raster_crs, raster_transform
from runout.model.arrays import window_of
from runout.palettes import OBSERVED, RELEASE
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

LOGGER = logging.getLogger(__name__)
GLOBE = "EPSG:4326"
FINER = 3  # pixels a cell, so that the turn to the north of the globe moves no edge by more than half of that
MOST_PIXELS = 4096  # in a direction
LINES = {  # layers of outlines.gpkg: words, colour, width [pixel], column of the names
    "release": ("Release", RELEASE, 2.5, "name"),
    "observed_outline": ("Observed outline", OBSERVED, 2.5, "shows"),
    "inundation": ("Outlines of the probability", "#22282f", 1.0, "probability"),
}


def write(products: Products) -> list[Path]:
    """Path of the file; none for local coordinates, with a message."""
    hazard, name = products.hazard, products.site.name
    if raster_crs(hazard) is None:
        LOGGER.info("%s.kmz is not written: the elevation has no coordinate reference system and so no place on a globe", name)
        return []
    layer = headline(hazard)
    classes = classes_of(hazard, layer.name)
    picture, box = overlay(hazard, layer.name, classes)
    content = {
        "title": str(hazard.attrs.get("title", name)),
        "description": html.escape(str(hazard.attrs.get("summary", ""))),  # globes read it as HTML
        "map_title": layer.title,
        "box": box,
        "look": ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2, 1.3 * 111_000.0 * max(box[3] - box[1], box[2] - box[0])),
        "folders": list(_folders(products.results / "outlines.gpkg")),
    }
    files = {"doc.kml": filled("globe.kml", content).encode(), "map.png": _png(picture), "legend.png": legend(layer.title, classes)}
    return [write_archive(products.results / f"{name}.kmz", files)]


def earlier(results: Path) -> set[Path]:
    """The file of the run before."""
    return earlier_archives(results, ".kmz")


def overlay(hazard: "xr.Dataset", name: str, classes: MapClasses) -> tuple[np.ndarray, tuple[float, float, float, float]]:
    """Picture (rows, columns, 4) of uint8 of a map in degrees, north up, and its west, south, east and north [degree].

    It holds the cells with a colour. Each pixel has the colour of the cell that its centre lies in.
    """
    from rasterio.transform import array_bounds
    from rasterio.warp import Resampling, calculate_default_transform, reproject

    painted = classes.painted(hazard[name].values / VARIABLES[name].printed[1])
    rows, columns = window_of(painted[..., 3], margin=(1, 1))
    painted = painted[rows, columns]
    source = {"src_crs": raster_crs(hazard), "src_transform": raster_transform(hazard.isel(y=rows, x=columns))}
    height, width = painted.shape[:2]
    bounds, size = array_bounds(height, width, source["src_transform"]), [min(MOST_PIXELS, FINER * n) for n in (width, height)]
    transform, wide, high = calculate_default_transform(
        source["src_crs"], GLOBE, width, height, *bounds, dst_width=size[0], dst_height=size[1]
    )
    bands = np.zeros((4, high, wide), np.uint8)
    target = {"dst_crs": GLOBE, "dst_transform": transform, "resampling": Resampling.nearest}
    reproject(np.ascontiguousarray(np.moveaxis(painted, 2, 0)), bands, **source, **target)
    return np.moveaxis(bands, 0, 2), array_bounds(high, wide, transform)


def _folders(path: Path) -> Iterator[dict[str, Any]]:
    """Outlines in degrees, by layer: name and rings of each feature."""
    import geopandas
    import pyogrio

    layers = {str(name) for name, _ in pyogrio.list_layers(path)}
    for layer, (title, colour, width, column) in LINES.items():
        if layer not in layers:
            continue
        frame = geopandas.read_file(path, layer=layer).to_crs(GLOBE)
        names = [f"{100 * value:g} % or more" if layer == "inundation" else str(value or title) for value in frame[column]]
        features = [(name, list(_rings(geometry))) for name, geometry in zip(names, frame.geometry, strict=True)]
        yield {"id": layer, "title": title, "colour": _of_globe(colour), "width": width, "features": features}


def _rings(geometry: Any) -> Iterator[tuple[str, list[str]]]:
    """Coordinates of the outer ring and the holes of each polygon."""

    def text(ring: Any) -> str:
        return " ".join(f"{x:.7f},{y:.7f}" for x, y in ring.coords)

    for polygon in getattr(geometry, "geoms", [geometry]):
        if polygon.geom_type == "Polygon":
            yield text(polygon.exterior), [text(hole) for hole in polygon.interiors]


def _of_globe(colour: str) -> str:
    """Hexadecimal colour in the order of KML: opacity, blue, green, red."""
    return f"ff{colour[5:7]}{colour[3:5]}{colour[1:3]}"


def legend(title: str, classes: MapClasses) -> bytes:
    """PNG of the colours and words of the classes, the largest on top."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    figure = Figure(dpi=100)
    FigureCanvasAgg(figure)
    pairs = list(zip(classes.colours, classes.labels, strict=True))
    patches = [Patch(facecolor=colour, edgecolor="#6b6b6b", linewidth=0.5, label=_plain(words)) for colour, words in pairs[::-1]]
    sizes = {"fontsize": 9, "title_fontsize": 9}
    box = figure.legend(handles=patches, title=_plain(title), loc="center", framealpha=1.0, fancybox=False, **sizes)
    figure.canvas.draw()
    inches = box.get_window_extent().transformed(figure.dpi_scale_trans.inverted())
    buffer = io.BytesIO()
    figure.savefig(buffer, bbox_inches=inches, metadata={"Software": None})
    return buffer.getvalue()


def _plain(words: str) -> str:
    """Words in which matplotlib finds no formula."""
    return words.replace("$", r"\$")


def _png(picture: np.ndarray) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture, "RGBA").save(buffer, "PNG", optimize=True)
    return buffer.getvalue()
