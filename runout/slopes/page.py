"""Page on a terrain and its stability: maps over hillshade, sinks, slope classes, proposed releases."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from runout import __version__
from runout.palettes import palette_of
from runout.report.html import render
from runout.report.maps import Basemap
from runout.report.marks import Mark
from runout.report.values import STYLES, MapStyle
from runout.report.vector_map import VectorMaps
from runout.report.wording import number, quantity
from runout.slopes.infinite_slope import LARGEST_FACTOR
from runout.slopes.terrain_figures import LISTED

if TYPE_CHECKING:
    from runout.model.terrain import Terrain
    from runout.slopes.patches import Patch
    from runout.slopes.sinks import Sink
    from runout.slopes.terrain_figures import TerrainFigures

TEMPLATE = "slopes.html.jinja"
MARKED = 100  # sinks with an outline on the map, the largest
MOST_CELLS = 500_000  # of a picture; larger maps are thinned out
SLOPE_STEPS_DEG = (0.0, 5.0, 15.0, 25.0, 35.0, 45.0, 60.0, 90.0)
FACTOR_STEPS = (0.0, 0.8, 1.0, 1.2, 1.5, 2.0, 3.0, LARGEST_FACTOR + 1e-6)
SHEETS = {
    "sink_depth": (
        "Closed sinks",
        MapStyle("depth below the spill [m]", palette_of("sink").colours),
        "Water stays here. Real ponds, or errors and dams of the elevation raster such as bridges, road fills and tree tops. Blue "
        "lines: the largest.",
    ),
    "drainage_area": (
        "Drainage area",
        MapStyle("drainage area [m²]", palette_of("drainage").colours, logarithmic=True),
        "Area that drains through the cell, over filled sinks: the flow paths.",
    ),
    "ground_slope": (
        "Slope",
        MapStyle("slope [°]", palette_of("slope").colours, steps=SLOPE_STEPS_DEG, faintest=-1.0),
        "Of the ground, by central differences.",
    ),
    "factor_of_safety": (
        "Factor of safety",
        MapStyle("median factor of safety [1]", palette_of("safety").colours, steps=FACTOR_STEPS, faintest=-1.0),
        "Infinite slope, median over the samples. Red lines: proposed releases.",
    ),
    "failure_probability": (
        "Probability of failure",
        replace(STYLES["probability"], label="share of the samples [1]"),
        "Share of the samples with a factor of safety of at most 1. Not an annual probability.",
    ),
}


def slopes_page(
    name: str,
    terrain: "Terrain",
    maps: Mapping[str, np.ndarray],
    figures: "TerrainFigures",
    patches: "Sequence[Patch]",
    lines: Sequence[str],
) -> str:
    """HTML text of one self-contained page; ``maps`` are those of the NetCDF file by name."""
    (rows, columns), (dx, dy) = terrain.shape, terrain.cell_size
    ground, step = basemap(terrain, patches, figures.sinks[:MARKED])
    drawn = VectorMaps(ground, ground.whole)
    return render(
        {
            "title": name,
            "heading": [
                ("Elevation", terrain.source),
                ("Grid", f"{rows} x {columns} cells of {dx:.4g} x {dy:.4g} m"),
                ("Made by", f"runout {__version__}, landlab"),
            ],
            "lines": [line for line in lines if not line.startswith("release ")],
            "patches": [_patch_cells(patch) for patch in patches],
            "sinks": [_sink_cells(sink) for sink in figures.sinks[:LISTED]],
            "definitions": drawn.definitions(),
            "sheets": list(_sheets(drawn, maps, step)),
            "changes": terrain.changes,
        },
        TEMPLATE,
    )


def _patch_cells(patch: "Patch") -> list[str]:
    a = patch.attributes
    return [
        f"{a['rank']:g}",
        quantity(a["volume_m3"], "m3"),
        quantity(a["area_m2"], "m2"),
        quantity(a["thickness_m"], "m"),
        number(a["probability"], 2),
        number(a["factor_of_safety"]),
        f"{a['slope_deg']:.0f}°",
    ]


def _sink_cells(sink: "Sink") -> list[str]:
    place = f"{sink.easting:.0f}, {sink.northing:.0f}"
    return [place, quantity(sink.depth, "m"), quantity(sink.area, "m2"), quantity(sink.volume, "m3")]


def basemap(terrain: "Terrain", patches: "Sequence[Patch]" = (), sinks: "Sequence[Sink]" = ()) -> tuple[Basemap, int]:
    """Ground and outlines under the maps, and the step by which rows and columns are thinned out."""
    step = max(1, math.ceil(math.sqrt(terrain.elevation.size / MOST_CELLS)))
    ground = terrain.easting[::step], terrain.northing[::step], terrain.elevation[::step, ::step]
    outlines = [patch.outline for patch in patches]
    return Basemap(*ground, outlines, observed=[Mark(sink.outline, "") for sink in sinks]), step


def _sheets(maps: VectorMaps, values: Mapping[str, np.ndarray], step: int) -> Iterator[dict[str, Any]]:
    for name, (title, style, caption) in SHEETS.items():
        if name in values:
            drawn = maps.drawn(values[name][::step, ::step], style, f"Map: {title}")
            yield {"title": title, "caption": caption, "map": drawn}
