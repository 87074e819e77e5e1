"""Command ``runout screen``: a cheap baseline of the runout of a site, and the places where three dimensions may matter."""

import logging
import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import numpy as np

from runout import __version__, log
from runout.config.site_files import may_hold_bodies
from runout.errors import ConfigError, ExitCode
from runout.hazard.outline_style import screen_styles
from runout.io.atomic import whole_file, write_json
from runout.io.vector import outline, write_layers
from runout.report.maps import DPI, png
from runout.slopes.choices import MassWasting
from runout.slopes.choices import record as record_of
from runout.slopes.drainage import Drainage, drainage, landlab_components
from runout.slopes.mass_wasting import Baseline, mass_wasting
from runout.slopes.path_features import Feature, FlowPath, Standing, features, flow_path
from runout.slopes.place import is_raster
from runout.slopes.suggestion import write_maps

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.model.terrain import Terrain

LOGGER = logging.getLogger("runout.slopes")
FOLDER, MAPS, RECORD, LAYERS, PICTURE = "screen", "screen.nc", "screen.json", "screen.gpkg", "screen.png"
LEAST = 0.1  # [m] of flow that counts as reached
CROWDED = 2.0  # largest flow thickness over that of the release; the automaton adds all mass that enters a cell in an iteration
LISTED = 10  # places that are printed
ATTRIBUTES = {
    "summary": "Runout of a gravitational mass movement by landlab's MassWastingRunout, a cellular automaton without time",
    "source": f"runout {__version__}, landlab MassWastingRunout",
    "comment": "thicknesses are vertical; a flow thickness is a volume per area of a cell and iteration",
}


def command(path: Path, out: Path | None, parameters: MassWasting) -> int:
    """Run the baseline, write ``screen/`` of the results, and print its extent and the places to look at."""
    from runout.config.site import read_site

    landlab_components()
    if is_raster(path):
        remedy = f"`runout new FOLDER --dem {path} --release RELEASE` makes one"
        raise ConfigError(f"{path}: is a raster; the baseline needs a site with a release: {remedy}")
    site = read_site(path)
    if not site.settings.release:
        message = "the baseline starts from releases, and the site has an inflow alone"
        raise ConfigError(f"{site.file}: {message}; state a release: the volume of the hydrograph on the area where it enters")
    for one in site.settings.inflow or ():
        LOGGER.warning("inflow %s is left out: the baseline starts from releases", one.name)
    terrain, releases = site.terrain(), site.releases()
    start = time.perf_counter()
    baseline = mass_wasting(terrain, releases, parameters)
    took = time.perf_counter() - start
    drained = drainage(baseline.terrain)
    way = flow_path(drained, baseline.release, baseline.peak, LEAST)
    places = features(drained, way, baseline.peak, _standing(site, terrain))
    figures = _figures(baseline, drained, way, took)
    lines = list(_lines(baseline, figures, way, places))
    for line in lines:
        log.output().print(line, markup=False, highlight=False, soft_wrap=True)
    folder = (out or site.folder / "results") / FOLDER
    record = {"runout": __version__, "parameters": record_of(parameters), **figures, "places": [one.attributes() for one in places]}
    _write(folder, site, baseline, drained, way, places, record)
    LOGGER.info("wrote %s; next: runout compare %s %s", folder, *map(quote, (str(folder), str(site.folder))))
    return ExitCode.OK


def _standing(site: "Site", terrain: "Terrain") -> list[Standing]:
    """Obstacles and structures of a site."""
    standing = [Standing("obstacle", "", *part) for obstacles in site.files.obstacles() for part in obstacles.parts]
    if not may_hold_bodies(site.settings):
        return standing
    from runout.structures.ground import elevation_at
    from runout.structures.solid import footprint

    for solid in site.files.bodies().solids:
        height = solid.vertices[:, 2] - elevation_at(terrain, solid.vertices)
        hangs = None if solid.clearance is None else max(0.0, float(np.nanmin(height)))
        standing.append(Standing("structure", solid.name, footprint(solid, terrain), float(np.nanmax(height)), hangs))
    return standing


def _figures(baseline: Baseline, drained: Drainage, way: FlowPath, took: float) -> dict[str, Any]:
    """Numbers of the baseline for the record."""
    terrain, reached = baseline.terrain, np.nan_to_num(baseline.peak) >= LEAST
    ground = np.where(baseline.release > 0, terrain.elevation, -np.inf)
    top = np.unravel_index(np.argmax(ground), ground.shape)
    far = np.hypot(terrain.easting[None, :] - terrain.easting[top[1]], terrain.northing[:, None] - terrain.northing[top[0]])
    toe = np.unravel_index(np.argmax(np.where(reached, far, -1.0)), far.shape)
    length, fall = float(far[toe]), float(terrain.elevation[top] - terrain.elevation[toe])
    return {
        "seconds": took,
        "iterations": baseline.iterations,
        "still_moving": baseline.moving,
        "rows_columns": list(terrain.shape),
        "cell_size_m": terrain.cell_size[0],
        "release_cells": int((baseline.release > 0).sum()),
        "volumes_m3": baseline.volumes,
        "reached_area_m2": float(reached.sum() * terrain.cell_area),
        "largest_thickness_m": float(np.nanmax(baseline.peak)),
        "length_m": length,
        "fall_m": fall,
        "travel_angle_deg": math.degrees(math.atan2(fall, length)) if length > 0 else 0.0,
        "path_length_m": float(way.distance[-1]),
        "confined_share": float(way.confined.mean()),
    }


def _lines(baseline: Baseline, figures: dict[str, Any], way: FlowPath, places: Sequence[Feature]) -> Iterator[str]:
    rows, columns = baseline.terrain.shape
    yield (
        f"baseline: {figures['seconds']:.1f} s, {baseline.iterations} iterations on {rows} x {columns} cells of "
        f"{figures['cell_size_m']:g} m" + ("; mass was STILL MOVING at the last iteration" if baseline.moving else "")
    )
    yield "volume: " + ", ".join(f"{name} {value:.4g} m3" for name, value in figures["volumes_m3"].items())
    yield (
        f"extent: {figures['reached_area_m2']:.4g} m2 of {LEAST:g} m or more; {figures['length_m']:.0f} m long, "
        f"{figures['fall_m']:.0f} m of fall, travel angle {figures['travel_angle_deg']:.1f} deg"
    )
    crowded = figures["largest_thickness_m"] / float(np.nanmax(baseline.release))
    if crowded > CROWDED:
        yield (
            f"flow thickness: up to {figures['largest_thickness_m']:.3g} m, {crowded:.2g} times the release: the automaton crowds "
            "mass in few cells; use its extent and deposit"
        )
    yield f"flow path: {figures['path_length_m']:.0f} m, {figures['confined_share']:.0%} of it confined on both sides"
    for place in places[:LISTED]:
        yield f"look in 3D: {place.words()}"
    if len(places) > LISTED:
        yield f"look in 3D: {len(places) - LISTED} places more, in {LAYERS}"
    if not places:
        yield "look in 3D: the flow path has no steep step, leaves no channel and reaches no structure of the site"


def _write(
    folder: Path,
    site: "Site",
    baseline: Baseline,
    drained: Drainage,
    way: FlowPath,
    places: Sequence[Feature],
    record: dict[str, Any],
) -> None:
    from shapely import LineString, Point

    maps = {
        "elevation": baseline.terrain.elevation,
        "release_thickness": baseline.release,
        "max_flow_thickness": baseline.peak,
        "deposit_thickness": baseline.deposit,
        "elevation_change": baseline.change,
    }
    write_maps(folder, MAPS, f"{site.name}: baseline of the runout", baseline.terrain, maps, ATTRIBUTES)
    extent = outline(np.nan_to_num(baseline.peak) >= LEAST, baseline.terrain)
    path = [{"length_m": float(way.distance[-1]), "geometry": LineString(way.points(drained))}] if len(way.cells) > 1 else []
    rows = [{**one.attributes(), "geometry": Point(one.easting, one.northing)} for one in places]
    reached = [] if extent.is_empty else [{"thickness_m": LEAST, "geometry": extent}]
    layers = {"extent": ("MultiPolygon", reached), "flow_path": ("LineString", path), "places": ("Point", rows)}
    write_layers(folder / LAYERS, baseline.terrain, layers, screen_styles())
    write_json(record, folder / RECORD)
    with whole_file(folder / PICTURE) as temporary:
        temporary.write_bytes(picture(baseline, drained, way, places))


def picture(baseline: Baseline, drained: Drainage, way: FlowPath, places: Sequence[Feature], dpi: int = DPI) -> bytes:
    """PNG of the deposit over hillshade, with the extent (dashed), the release, the flow path and the places on it."""
    from shapely import LineString, Point

    from runout.report.maps import Basemap, draw_map
    from runout.report.marks import Mark
    from runout.report.values import STYLES

    terrain = baseline.terrain
    marks = [Mark(LineString(way.points(drained)), "")] if len(way.cells) > 1 else []
    marks += [Mark(Point(one.easting, one.northing), one.label()) for one in places]
    released = [outline(np.nan_to_num(baseline.release) > 0, terrain)]
    reached = np.nan_to_num(baseline.peak) >= LEAST
    base = Basemap(
        terrain.easting, terrain.northing, terrain.elevation, released, zones=[Mark(outline(reached, terrain), "")], observed=marks
    )
    shown = np.where(baseline.deposit >= LEAST, baseline.deposit, np.nan)
    return png(draw_map(base, shown, STYLES["deposit"], base.window(reached), "Baseline: deposit and extent"), dpi)
