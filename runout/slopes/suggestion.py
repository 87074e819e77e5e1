"""Command ``runout suggest-release``: what the terrain hides, where it may fail, and release polygons, as files and as a page.

The release polygons are outlines of patches of cells that may fail.
"""

import logging
import math
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout import __version__, log
from runout.config.stability import StabilitySettings
from runout.errors import ExitCode
from runout.forecast.accuracy import FEWEST_MEASURED, preset
from runout.hazard.maps import write_own_maps
from runout.hazard.outline_style import slope_styles
from runout.io.atomic import write_json, write_text
from runout.io.netcdf import map_dataset
from runout.io.netcdf import write as write_netcdf
from runout.io.polygon_coverage import covered_part
from runout.io.vector import outline, write_layers
from runout.model.limits import PARTICLES_PER_CELL
from runout.model.numerics import Scheme
from runout.palettes import palette_of
from runout.report.html import render
from runout.report.maps import Basemap
from runout.report.marks import Mark
from runout.report.values import STYLES, MapStyle
from runout.report.vector_map import VectorMaps
from runout.report.wording import number, quantity
from runout.scores.slope_normal import terrain_slope
from runout.slopes.choices import PatchChoices, Strength
from runout.slopes.drainage import Drainage, drainage, landlab_components, manageable
from runout.slopes.infinite_slope import LARGEST_FACTOR, Stability, assumptions, resolved, stability
from runout.slopes.infinite_slope import record as record_of
from runout.slopes.place import Place, read_place
from runout.slopes.sinks import LISTED, Sink, TerrainFigures, terrain_figures

if TYPE_CHECKING:
    from runout.model.terrain import Terrain
    from runout.slopes.drainage import Drainage
    from runout.slopes.infinite_slope import Stability

PER_BLOCK = 16 * math.prod(PARTICLES_PER_CELL)  # particles of a layer one cell thick in a block of 4 x 4 x 4 cells
SMOOTHED = 0.75  # of a cell: largest distance of an outline from the cell edges that it follows
LOGGER = logging.getLogger("runout.slopes")
FOLDER, PAGE, RECORD, MAPS, TERRAIN_LAYERS, RELEASE = (
    "slopes", "slopes.html", "slopes.json", "slopes.nc", "terrain.gpkg", "release.gpkg"
)  # fmt: skip
THRESHOLDS = {"drainage_area": (1e3, 1e4, 1e5, 1e6, 1e7, 1e8), "factor_of_safety": (0.8, 1.0, 1.2, 1.5, 2.0)}
OWN_MAPS = ("sink_depth", "drainage_area", "ground_slope", "factor_of_safety", "failure_probability", "failure_thickness")
ATTRIBUTES = {
    "summary": "Drainage of an elevation raster and stability of an infinite slope",
    "source": f"runout {__version__}, landlab",
    "keywords": "landslide, slope stability, drainage",
    "comment": "thicknesses are vertical; y descends from north to south",
}
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


@dataclass(frozen=True)
class Patch:
    """A proposed release."""

    outline: Any  # shapely Polygon: in map coordinates
    # `rank` from 1; `thickness_m`, `probability`, `factor_of_safety` (of the medians) and `slope_deg`: means over the covered area;
    # `volume_m3`, `area_m2`; `drainage_area_m2`: the largest of its cells; `cell_size_m`: largest spacing of a grid with one cell
    # through the thickness, and `particles` on it
    attributes: dict[str, float]

    @property
    def expected_volume(self) -> float:
        """Probability of failure times volume [m3]."""
        return self.attributes["probability"] * self.attributes["volume_m3"]


@dataclass(frozen=True)
class Suggestion:
    """Proposed releases, and how many cells each condition left."""

    patches: list[Patch]  # by rank: the largest product of probability and volume first
    proposed: int  # number of releases before the limit on their number
    # number of cells that meet each condition and those before it, and the option that sets it
    left: dict[str, tuple[int, str]] = field(default_factory=dict)
    too_large: int = 0  # number of these that need more memory than the machine has free, and that are left out


def suggest(drained: "Drainage", stable: "Stability", choices: StabilitySettings) -> Suggestion:
    """Releases on the cells that fail often enough, drain little, and hang together over the least area.

    A morphological opening by a cell and its four neighbours removes what is narrower than three cells. Enclosed stable parts
    smaller than the least area are included.
    """
    from scipy import ndimage

    terrain = drained.terrain
    likely = stable.probability >= choices.probability  # false where unknown
    slope_cells = likely & (drained.area <= choices.largest_drainage)
    opened = ndimage.binary_opening(slope_cells, ndimage.generate_binary_structure(2, 1))
    label, count = ndimage.label(_without_small_holes(opened, terrain, choices.least_area))
    cells = np.bincount(label.ravel(), minlength=count + 1)
    large = [k for k in range(1, count + 1) if cells[k] * terrain.cell_area >= choices.least_area]
    patches = sorted(_patches(label, large, drained, stable), key=lambda one: -one.expected_volume)
    affordable = [one for one in patches if fits_memory(one.attributes["particles"], terrain)]
    ranked = [Patch(one.outline, {"rank": k, **one.attributes}) for k, one in enumerate(affordable[: choices.most], 1)]
    left = {
        f"has a probability of failure of {choices.probability:g} or more": (int(likely.sum()), "--probability"),
        f"of these drains {choices.largest_drainage:g} m2 or less": (int(slope_cells.sum()), "--largest-drainage"),
        "of these lies in a strip of three cells or wider": (int(opened.sum()), "--probability"),
        f"of these lies in a patch of {choices.least_area:g} m2 or more": (int(cells[large].sum()), "--least-area"),
    }
    return Suggestion(ranked, len(patches), left, len(patches) - len(affordable))


def fits_memory(particles: float, terrain: "Terrain") -> bool:
    """Whether a run of so many particles, in a layer one cell thick, fits into the memory that is free."""
    from runout.forecast.memory import Extent, available_bytes, expected_memory

    free = available_bytes()
    blocks = math.ceil(particles / PER_BLOCK)
    extent = Extent(math.ceil(particles), blocks, 2 * blocks, 4 * blocks, 4 * blocks)
    return free is None or expected_memory(extent, terrain.elevation.size, Scheme()).total <= free


def _without_small_holes(mask: np.ndarray, terrain: "Terrain", least_area: float) -> np.ndarray:
    """The mask with enclosed parts of known cells that are smaller than ``least_area`` [m2]."""
    from scipy import ndimage

    label, count = ndimage.label(ndimage.binary_fill_holes(mask) & ~mask)
    if count == 0:
        return mask
    unknown = np.bincount(label.ravel(), np.isnan(terrain.elevation).ravel(), count + 1) > 0
    small = (np.bincount(label.ravel()) * terrain.cell_area < least_area) & ~unknown
    small[0] = False
    return mask | small[label]


def _patches(label: np.ndarray, numbers: list[int], drained: "Drainage", stable: "Stability") -> Iterator[Patch]:
    """Patches of the labelled cells; the smoothed outline of a later one leaves out those before it."""
    from scipy import ndimage

    boxes = ndimage.find_objects(label)
    taken: list[Any] = []
    for patch in numbers:
        box = boxes[patch - 1]
        inside = label[box] == patch
        shape = _smooth(outline(inside, drained.terrain.part(*box)), drained.terrain, taken)  # 3 x 3 cells or more, once opened
        taken.append(shape)
        yield _patch(shape, float(drained.area[box][inside].max()), drained, stable)


def _patch(shape: Any, drainage_area: float, drained: "Drainage", stable: "Stability") -> Patch:
    """The patch of an outline with means over the area of the cells that it covers."""
    place, area = covered_part(shape, drained.terrain)
    mean = _Mean(area)
    thickness = mean.of(np.where(stable.thickness[place] > 0, stable.thickness[place], np.nan))
    cell = preset("screening").cell_size(thickness, shape.area)
    attributes = {
        "thickness_m": thickness,
        "volume_m3": thickness * shape.area,
        "area_m2": shape.area,
        "probability": mean.of(stable.probability[place]),
        "factor_of_safety": mean.of(stable.factor[place]),
        "slope_deg": float(np.degrees(mean.of(stable.slope[place]))),
        "drainage_area_m2": drainage_area,
        "cell_size_m": cell,
        "particles": math.prod(PARTICLES_PER_CELL) * thickness * shape.area / cell**3,
    }
    return Patch(shape, attributes)


@dataclass(frozen=True)
class _Mean:
    """Means weighted by the covered area (rows, columns) [m2] of cells."""

    area: np.ndarray

    def of(self, values: np.ndarray) -> float:
        """Mean of the known values (rows, columns)."""
        known = np.isfinite(values) & (self.area > 0)
        return float(np.sum(values[known] * self.area[known]) / np.sum(self.area[known]))


def _smooth(shape: Any, terrain: "Terrain", taken: list[Any]) -> Any:
    """Largest polygon of a shape whose steps along cell edges are cut to diagonals, inside the terrain and outside of others."""
    import shapely

    smooth = shapely.simplify(shape, SMOOTHED * min(terrain.cell_size), preserve_topology=True)
    smooth = smooth.intersection(shapely.box(*terrain.extent))
    near = [other for other in taken if other.intersects(smooth)]
    if near:
        smooth = smooth.difference(shapely.union_all(near))
    parts = [part for part in shapely.get_parts(smooth) if part.geom_type == "Polygon" and part.is_valid]
    largest = max(parts or shape.geoms, key=lambda part: part.area)
    place, area = covered_part(largest, terrain)
    if np.isnan(terrain.elevation[place])[area > 0].any():  # a release needs the elevation of all its cells
        return max(shape.geoms, key=lambda part: part.area)
    return largest


def command(path: Path, out: Path | None, terrain_only: bool, strength: Strength | None, choices: PatchChoices | None) -> int:
    """Examine a site or an elevation raster, write ``slopes/`` of its results, and print a line for each subject."""
    start = time.perf_counter()
    landlab_components()
    place = read_place(path, out)
    soil = resolved(strength, choices, place.site.settings.stability if place.site else None)
    terrain = manageable(place.terrain)
    drained = drainage(terrain)
    stable = None if terrain_only else stability(drained, soil)
    slope = terrain_slope(terrain.elevation, terrain.cell_size) if stable is None else stable.slope
    figures, suggestion = terrain_figures(drained, slope), None if stable is None else suggest(drained, stable, soil)
    lines = [*figures.lines(), *(_lines(stable, suggestion, place, soil) if stable and suggestion else ())]
    record = _record(place, terrain, figures, soil, suggestion) | {"lines": lines}
    maps = _maps(drained, slope, stable)
    for line in lines:
        log.output().print(line, markup=False, highlight=False, soft_wrap=True)
    folder = place.results / FOLDER
    write(folder, place.name, terrain, maps, figures, suggestion, record)
    LOGGER.info("wrote %s in %.0f s%s", folder, time.perf_counter() - start, _next(folder, path, place, suggestion))
    return ExitCode.OK


def _next(folder: Path, path: Path, place: Place, suggestion: Suggestion | None) -> str:
    """How to use the proposed releases; empty if there are none."""
    if not suggestion or not suggestion.patches:
        return ""
    if place.site is None:
        return f"; next: runout new FOLDER --dem {path} --release {folder / RELEASE}"
    polygons = os.path.relpath(folder / RELEASE, place.site.folder)  # paths of site.yaml are relative to its folder
    return f"; in site.yaml: release: [{{polygons: {polygons}, thickness: thickness_m}}]"


def _maps(drained: Drainage, slope: np.ndarray, stable: Stability | None) -> dict[str, np.ndarray]:
    maps = {"sink_depth": drained.sink_depth, "drainage_area": drained.area, "ground_slope": np.degrees(slope)}
    if stable is not None:
        maps |= {"factor_of_safety": stable.factor, "failure_probability": stable.probability}
        maps["failure_thickness"] = stable.thickness
    return maps


def _lines(stable: Stability, suggestion: Suggestion, place: Place, soil: StabilitySettings) -> Iterator[str]:
    """Lines on the stability and the proposed releases, or the reason why there are none."""
    if assumed := assumptions(soil):
        yield assumed
    at_one = float(np.nanmean(stable.factor <= 1.0))
    yield f"factor of safety: median at most 1 on {at_one:.1%} of the area; largest probability {np.nanmax(stable.probability):.2g}"
    if not suggestion.patches:
        yield f"no release is proposed: {_reason(stable, suggestion)}"
        return
    more = f", the first {len(suggestion.patches)} are kept" if suggestion.proposed > len(suggestion.patches) else ""
    total = sum(patch.attributes["volume_m3"] for patch in suggestion.patches)
    yield f"releases: {suggestion.proposed} proposed{more}, {total:.4g} m3"
    for patch in suggestion.patches:
        a = patch.attributes
        yield (
            f"release {a['rank']:g}: {a['volume_m3']:.4g} m3 on {a['area_m2']:.4g} m2, {a['thickness_m']:.2f} m thick, probability "
            f"{a['probability']:.2f}, slope {a['slope_deg']:.0f} deg; needs cells of {a['cell_size_m']:.2g} m or less"
        )
    yield from _to_simulate(suggestion, place)


def _to_simulate(suggestion: Suggestion, place: Place) -> Iterator[str]:
    """Lines on the grid that the proposed releases need, on those that are left out, and on their common start."""
    cell = min(patch.attributes["cell_size_m"] for patch in suggestion.patches)
    particles = sum(patch.attributes["volume_m3"] for patch in suggestion.patches) * math.prod(PARTICLES_PER_CELL) / cell**3
    height = _stated_height(place)
    thin = [patch for patch in suggestion.patches if height and patch.attributes["thickness_m"] < FEWEST_MEASURED * height]
    if thin:
        has = "the site has" if place.site else "a new site starts with"
        yield (
            f"grid: {has} cells of {height:g} m; {len(thin)} of the {len(suggestion.patches)} releases are thinner than "
            f"{FEWEST_MEASURED:g} of them, so that their numerical error is not known; in site.yaml write "
            f"simulation.cell_size: {cell:.2g} ({particles:.2g} particles for all), or accuracy: screening instead"
        )
    if not fits_memory(particles, place.terrain):
        yield f"grid: all releases together need {particles:.2g} particles, more than the memory holds; simulate them one by one"
    if suggestion.too_large:
        yield f"left out: {suggestion.too_large} releases, which need more memory than is free with cells of their thickness"
    if len(suggestion.patches) > 1:
        yield f"start: the polygons of one file start together; where each may fail alone, keep one polygon of {RELEASE} per site"


def _stated_height(place: Place) -> float:
    """Height of the cells [m] of the site, or of one that `runout new` makes; 0 where accuracy sets it from the release."""
    if place.site is None:
        return max(place.terrain.cell_size)
    cell_size = place.site.settings.simulation.cell_size
    return 0.0 if cell_size is None else float(np.ravel(cell_size)[-1])


def _reason(stable: Stability, suggestion: Suggestion) -> str:
    """Why no release is proposed: the condition that no cell meets, the steepest slope and the largest probability."""
    steepest, largest = np.degrees(np.nanmax(stable.slope)), np.nanmax(stable.probability)
    if suggestion.too_large:
        return f"{suggestion.too_large} releases need more memory than is free with cells of their thickness; use a larger machine"
    condition, option = next((words, option) for words, (cells, option) in suggestion.left.items() if cells == 0)
    remedy = f"if that is too strict, state another {option}, or weaker or wetter soil"
    return f"no cell {condition}; steepest slope {steepest:.1f} deg, largest probability {largest:.2g}; {remedy}"


def _record(
    place: Place, terrain: "Terrain", figures: TerrainFigures, soil: StabilitySettings, suggestion: Suggestion | None
) -> dict[str, Any]:
    record = {
        "runout": __version__,
        "name": place.name,
        "elevation": terrain.source,
        "rows_columns": list(terrain.shape),
        "cell_size_m": list(terrain.cell_size),
        "changes": list(terrain.changes),
        "terrain": figures.record(),
    }
    if suggestion is None:
        return record
    released = [patch.attributes for patch in suggestion.patches]
    left = {words: cells for words, (cells, _) in suggestion.left.items()}
    return record | {"stability": record_of(soil), "cells_left": left, "releases": released}


def write(
    folder: Path,
    name: str,
    terrain: "Terrain",
    maps: Mapping[str, np.ndarray],
    figures: TerrainFigures,
    suggestion: Suggestion | None,
    record: Mapping[str, Any],
) -> None:
    """Write all files of a folder; those of an earlier call are removed first. Raises StorageError if a file cannot be written."""
    for old in (PAGE, RECORD, MAPS, TERRAIN_LAYERS, RELEASE, *(f"{map_}{end}" for map_ in OWN_MAPS for end in (".tif", ".qml"))):
        (folder / old).unlink(missing_ok=True)
    patches = suggestion.patches if suggestion else []
    write_maps(folder, MAPS, f"{name}: terrain and stability", terrain, {"elevation": terrain.elevation, **maps}, ATTRIBUTES)
    sinks = [{**sink.attributes(), "geometry": sink.outline} for sink in figures.sinks]
    layers = {"sinks": ("MultiPolygon", sinks), "flow_paths": ("LineString", figures.paths)}
    if sinks or figures.paths:
        write_layers(folder / TERRAIN_LAYERS, terrain, layers, slope_styles())
    if patches:
        rows = [{**patch.attributes, "rank": int(patch.attributes["rank"]), "geometry": patch.outline} for patch in patches]
        write_layers(folder / RELEASE, terrain, {"release": ("MultiPolygon", rows)}, slope_styles())
    write_text(slopes_page(name, terrain, maps, figures, patches, record["lines"]), folder / PAGE)
    write_json(record, folder / RECORD)


def write_maps(
    folder: Path, file: str, title: str, terrain: "Terrain", maps: Mapping[str, np.ndarray], attributes: Mapping[str, Any]
) -> None:
    """Write maps as NetCDF, and all but the elevation as a GeoTIFF with a QGIS style each."""
    dataset = map_dataset(terrain, maps, title=title, attrs=attributes)
    write_netcdf(dataset, folder / file)
    write_own_maps(dataset, [name for name in maps if name != "elevation"], folder, THRESHOLDS)


def slopes_page(
    name: str,
    terrain: "Terrain",
    maps: Mapping[str, np.ndarray],
    figures: TerrainFigures,
    patches: Sequence[Patch],
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


def _patch_cells(patch: Patch) -> list[str]:
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


def _sink_cells(sink: Sink) -> list[str]:
    place = f"{sink.easting:.0f}, {sink.northing:.0f}"
    return [place, quantity(sink.depth, "m"), quantity(sink.area, "m2"), quantity(sink.volume, "m3")]


def basemap(terrain: "Terrain", patches: Sequence[Patch] = (), sinks: Sequence[Sink] = ()) -> tuple[Basemap, int]:
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
