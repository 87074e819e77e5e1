"""Command ``runout scarp``: writes the thickness of a scarp as a raster that a site takes as a release."""

import logging
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runout import __version__, log
from runout.config.schema import NAME
from runout.errors import ConfigError, ExitCode
from runout.hazard.style import class_edges, qml
from runout.io.atomic import write_json, write_text
from runout.io.geotiff import write_cog
from runout.io.netcdf import map_dataset
from runout.slopes.choices import ScarpChoices, record
from runout.slopes.place import read_place
from runout.slopes.scarp import scarp_ellipsoid, scarp_planes
from runout.variables import VARIABLES

if TYPE_CHECKING:
    from runout.model.release import Release
    from runout.model.terrain import Terrain

LOGGER = logging.getLogger("runout.slopes")
FOLDER = "scarp"


def command(path: Path, out: Path | None, choices: ScarpChoices) -> int:
    """Make the scarp that is stated and write ``scarp/NAME.tif`` of the results with a record of its choices."""
    if not re.fullmatch(NAME, choices.name):
        raise ConfigError(f"--name is {choices.name!r}; use letters, digits, - and _")
    place = read_place(path, out)
    terrain = place.terrain
    release = _scarp(terrain, choices)
    file = place.results / FOLDER / f"{choices.name}.tif"
    maps = map_dataset(terrain, {"release_thickness": release.thickness}, title=f"{place.name}: scarp {choices.name}")
    stored = maps["release_thickness"].values.astype(np.float64)
    volume = float(stored.sum() * terrain.cell_area)
    contents = {"runout": __version__, "elevation": terrain.source, **record(choices), "volume_m3": volume}
    contents |= {"area_m2": release.area, "largest_thickness_m": float(release.thickness.max())}
    write_cog(maps, "release_thickness", file)
    edges = class_edges("release_thickness", (), 0.0, float(stored.max()))
    write_text(qml(edges, VARIABLES["release_thickness"].printed[0], "release_thickness"), file.with_suffix(".qml"))
    write_json(contents, file.with_suffix(".json"))
    console = log.output()
    console.print(f"volume: {volume:.9g} m3", markup=False)
    console.print(f"area: {release.area:.6g} m2; largest thickness {release.thickness.max():.4g} m", markup=False)
    LOGGER.info("wrote %s; a site takes it as `release: [{raster: %s}]`, and `runout new` as --release", file, file.name)
    return ExitCode.OK


def _scarp(terrain: "Terrain", choices: ScarpChoices) -> "Release":
    if choices.ellipsoid is not None:
        east, north, along, across, depth = choices.ellipsoid
        return scarp_ellipsoid(
            terrain, (east, north), (along, across), depth, azimuth_deg=choices.azimuth, tilt_deg=choices.tilt,
            volume=choices.volume, name=choices.name,
        )  # fmt: skip
    return scarp_planes(terrain, choices.plane, outline=choices.outline, volume=choices.volume, name=choices.name)
