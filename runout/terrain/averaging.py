"""Means of the elevations of a terrain: on coarser cells over whole blocks, or on its own cells over a triangle."""

from dataclasses import replace

import numpy as np

from runout.errors import ConfigError, DemError, Problem
from runout.model.limits import checked
from runout.model.terrain import Terrain
from runout.terrain import relief
from runout.terrain.open_edge import continued

FINEST_RESOLUTION = 0.75  # smallest useful terrain.resolution, as a share of the raster's cell
FEWEST_AVERAGED = 3  # cells along a side
SHORTEST = 0.5  # half-width of a triangle [cells]: a shorter one averages nothing


def averaged(terrain: Terrain, resolution: float, file: str = "") -> Terrain:
    """The terrain averaged over whole blocks of cells; a block with an unknown cell is unknown.

    ``resolution``: size [m] of the blocks, which is rounded to whole cells. ``file``: name of the site.yaml that states the
    resolution. Raises ConfigError if the resolution is finer than the raster's cells, or leaves fewer than three blocks along a
    side. Raises DemError if it is no resolution.
    """
    own, place, key = terrain.cell_size, file or terrain.source, "terrain.resolution" if file else "resolution"
    resolution = checked("resolution", resolution, place=place, error=DemError)
    if resolution < FINEST_RESOLUTION * min(own):
        message = f"{resolution:g} m is finer than the raster's own cells of {own[0]:g} m x {own[1]:g} m"
        raise ConfigError([Problem(place, None, key, message, "remove it, or use a finer raster")])
    if resolution > min(terrain.size) / FEWEST_AVERAGED:
        size = f"{terrain.size[0]:g} m x {terrain.size[1]:g} m"
        message = f"{resolution:g} m leaves fewer than {FEWEST_AVERAGED} cells along a side of a raster of {size}"
        raise ConfigError([Problem(place, None, key, message, "write a smaller size, or remove it")])
    east, north = (max(1, round(resolution / size)) for size in own)
    return block_means(terrain, east, north, key)


def smoothed(terrain: Terrain, length: float, file: str = "") -> Terrain:
    """The terrain averaged over a triangle of half-width ``length`` [m] along both axes, without waves of two cells.

    Planes stay (:func:`runout.terrain.relief.filtered`). Unknown cells stay unknown; beside them the known ground counts as if it
    went on with its slope.

    ``length``: half-width [m]: more than half a cell, at most a third of the raster. ``file``: name of the site.yaml that states
    it. Raises ConfigError if the length is too short or too long for the raster. Raises DemError if it is no length.
    """
    own, place, key = terrain.cell_size, file or terrain.source, "terrain.smoothing" if file else "smoothing"
    length = checked("smoothing", length, place=place, error=DemError)
    if length <= SHORTEST * min(own):
        message = f"{length:g} m averages nothing on cells of {own[0]:g} m x {own[1]:g} m"
        raise ConfigError([Problem(place, None, key, message, f"write {min(own):g} or more, or remove it")])
    longest = min(terrain.size) / FEWEST_AVERAGED
    if length > longest:
        message = f"{length:g} m is more than a third of a raster of {terrain.size[0]:g} m x {terrain.size[1]:g} m"
        raise ConfigError([Problem(place, None, key, message, f"write {longest:.3g} or less, or remove it")])
    z = continued(terrain.elevation, own, length + 3.0 * max(own))
    for axis, size in ((1, own[0]), (0, own[1])):
        along = np.moveaxis(z, axis, 0)
        z = np.moveaxis(relief.filtered(along, length / size, np.arange(float(len(along)))), 0, axis)
    change = f"averaged over a triangle of half-width {length:g} m along both axes ({key})"
    return replace(terrain, elevation=terrain.where_known(z), changes=(*terrain.changes, change))


def block_means(terrain: Terrain, east: int, north: int, why: str) -> Terrain:
    """The terrain averaged over blocks of ``east`` x ``north`` cells; a change says so with the reason ``why``."""
    own, rows, columns = terrain.cell_size, terrain.shape[0] // north, terrain.shape[1] // east
    whole_blocks = terrain.elevation[terrain.shape[0] - rows * north :, : columns * east]  # blocks start at the south-west corner
    mean = whole_blocks.reshape(rows, north, columns, east).mean(axis=(1, 3))
    change = f"averaged over blocks of {east} x {north} cells to {own[0] * east:g} m x {own[1] * north:g} m ({why})"
    unknown = int(np.isnan(mean).sum())
    change += f"; {unknown} of {mean.size} blocks hold an unknown cell and are unknown" if unknown else ""
    return replace(terrain, elevation=mean, cell_size=(own[0] * east, own[1] * north), changes=(*terrain.changes, change))
