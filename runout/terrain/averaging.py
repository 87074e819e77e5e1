"""Terrain on coarser cells: the mean elevation of whole blocks of cells."""

from dataclasses import replace

import numpy as np

from runout.errors import ConfigError, DemError, Problem
from runout.model.limits import checked
from runout.model.terrain import Terrain

FINEST_RESOLUTION = 0.75  # smallest useful terrain.resolution, as a share of the raster's cell
FEWEST_AVERAGED = 3  # cells along a side


def averaged(terrain: Terrain, resolution: float, file: str = "") -> Terrain:
    """The terrain averaged over whole blocks of cells; a block with an unknown cell is unknown.

    Parameters
    ----------
    terrain : Terrain
    resolution : float
        Size [m] of the blocks, which is rounded to whole cells.
    file : str, optional
        Name of the site.yaml that states the resolution.

    Raises
    ------
    ConfigError
        If the resolution is finer than the raster's cells, or leaves fewer than three blocks along a side.
    DemError
        If it is no resolution.
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


def block_means(terrain: Terrain, east: int, north: int, why: str) -> Terrain:
    """The terrain averaged over blocks of ``east`` x ``north`` cells; a change says so with the reason ``why``."""
    own, rows, columns = terrain.cell_size, terrain.shape[0] // north, terrain.shape[1] // east
    kept = terrain.elevation[terrain.shape[0] - rows * north :, : columns * east]  # blocks start at the south-west corner
    mean = kept.reshape(rows, north, columns, east).mean(axis=(1, 3))
    change = f"averaged over blocks of {east} x {north} cells to {own[0] * east:g} m x {own[1] * north:g} m ({why})"
    unknown = int(np.isnan(mean).sum())
    change += f"; {unknown} of {mean.size} blocks hold an unknown cell and are unknown" if unknown else ""
    return replace(terrain, elevation=mean, cell_size=(own[0] * east, own[1] * north), changes=(*terrain.changes, change))
