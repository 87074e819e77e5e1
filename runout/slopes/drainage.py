"""Drainage of a terrain: sinks filled to their spill, flow directions and drainage area."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from runout.slopes.grid import ELEVATION, landlab_components, on_map, raster_grid

if TYPE_CHECKING:
    from runout.model.terrain import Terrain


@dataclass(frozen=True)
class Drainage:
    """Drainage of a terrain.

    Attributes
    ----------
    terrain : Terrain
    filled : ndarray (rows, columns)
        Elevation with every sink filled to its spill [m]; NaN where unknown.
    area : ndarray (rows, columns)
        Plan area that drains through the cell, the cell included [m2]; NaN where unknown.
    receiver : ndarray (rows, columns) of int
        Flat index (north up) of the cell that the water of a cell goes to next; its own where it leaves the terrain.
    """

    terrain: "Terrain"
    filled: np.ndarray
    area: np.ndarray
    receiver: np.ndarray

    @property
    def sink_depth(self) -> np.ndarray:
        """Depth (rows, columns) below the spill of the sink around a cell [m], 0 outside of sinks; NaN where unknown."""
        return np.maximum(self.filled - self.terrain.elevation, 0.0)

    @property
    def specific_area(self) -> np.ndarray:
        """Drainage area per width of a cell (rows, columns) [m]."""
        return self.area / np.sqrt(self.terrain.cell_area)


def drainage(terrain: "Terrain") -> Drainage:
    """Drainage of a terrain along the steepest of eight directions, over the filled sinks.

    Sinks are filled with the priority flood of Barnes et al. (2014, Comput. Geosci. 62:117), flats with a minute gradient, so
    that all water reaches an open edge (landlab's SinkFillerBarnes and FlowAccumulator; O'Callaghan and Mark 1984 for D8).

    Raises
    ------
    LibraryError
        If landlab is missing.
    """
    components, grid = landlab_components(), raster_grid(terrain)
    components.SinkFillerBarnes(grid, method="D8", fill_flat=False).run_one_step()
    components.FlowAccumulator(grid, flow_director="FlowDirectorD8").run_one_step()
    shape = terrain.shape
    area = np.maximum(on_map(grid.at_node["drainage_area"], shape), terrain.cell_area)  # landlab counts no rim cell
    receiver = on_map(grid.at_node["flow__receiver_node"], shape)
    row, column = np.divmod(receiver, shape[1])
    return Drainage(
        terrain,
        terrain.where_known(on_map(grid.at_node[ELEVATION], shape)),
        terrain.where_known(area),
        (shape[0] - 1 - row) * shape[1] + column,
    )
