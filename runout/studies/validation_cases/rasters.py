"""Rasters and lines of the validation's data, on the cells of a terrain."""

from pathlib import Path

import numpy as np

from runout.errors import InputError
from runout.io.opening import open_raster, open_vector
from runout.model.terrain import Terrain
from runout.scores import Grid, Thalweg, values_at


def on_cells(path: Path, terrain: Terrain) -> np.ndarray:
    """Values (rows, columns) of a raster at the cell centres of a terrain, from the nearest cell; NaN where unknown or outside.

    Unlike the mean by area, it keeps the extent of a flow whose grid is shifted by half a cell.
    """
    with open_raster(path, InputError) as data:
        values = data.read(1, masked=True).astype(float).filled(np.nan)
        west, south, east, north = data.bounds
    rows, columns = values.shape
    grid = Grid(west, south, ((east - west) / columns, (north - south) / rows), (rows, columns), source=str(path))
    x, y = np.meshgrid(terrain.easting, terrain.northing)
    return values_at(grid, values, x.ravel(), y.ravel()).reshape(terrain.shape)


def thalweg_of(path: Path) -> Thalweg:
    """The first line of a vector file, in its own coordinates."""
    import shapely

    file = open_vector(path, InputError)
    frame, _ = file.read(file.layers()[0])
    return Thalweg(shapely.get_coordinates(frame.geometry.iloc[0]))
