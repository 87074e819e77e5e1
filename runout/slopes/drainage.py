"""Drainage of a terrain: sinks filled to their spill, flow directions and drainage area.

Grids of landlab have row 0 in the south; unknown cells are closed, cells beside them and at the rim are open.
"""

import logging
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.errors import LibraryError
from runout.terrain.averaging import block_means
from runout.terrain.open_edge import filled

if TYPE_CHECKING:
    from runout.model.terrain import Terrain

LOGGER = logging.getLogger(__name__)
INSTALL = "pip install 'runout[slopes]'"
LARGEST_GRID = 4_000_000  # cells; drainage takes 10 s of processor time and 1.3 GB of memory per million
OPEN, CLOSED = 1, 4  # status of a node in landlab
ELEVATION = "topographic__elevation"


def landlab_components() -> Any:
    """The module ``landlab.components``. Raises LibraryError if landlab is not installed or cannot be imported."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from landlab import components
    except ImportError as cause:
        raise LibraryError(f"this command needs landlab, which cannot be imported ({cause}); install it: {INSTALL}") from cause
    return components


def manageable(terrain: "Terrain", largest: int = LARGEST_GRID) -> "Terrain":
    """The terrain, averaged over square blocks of cells if it has more than ``largest`` cells; a warning says so."""
    step = 1
    while (terrain.shape[0] // step) * (terrain.shape[1] // step) > largest:
        step += 1
    if step == 1:
        return terrain
    coarse = block_means(terrain, step, step, f"more than {largest:,} cells".replace(",", " "))
    LOGGER.warning("%s: %s; terrain.extent of site.yaml limits the area instead", terrain.source, coarse.changes[-1])
    return coarse


def raster_grid(terrain: "Terrain", elevation: np.ndarray | None = None) -> Any:
    """Grid of landlab with the elevation of a terrain, or another one (rows, columns) [m] on its cells.

    Unknown cells are closed nodes with the elevation of the nearest known cell. Known cells at the rim of the raster and beside
    unknown cells are open boundaries: what flows there leaves, as over the open edge of a run.
    """
    landlab_components()
    from landlab import RasterModelGrid
    from scipy import ndimage

    z = terrain.elevation if elevation is None else elevation
    known = np.isfinite(z)
    grid = RasterModelGrid(terrain.shape, xy_spacing=terrain.cell_size, xy_of_lower_left=(terrain.west, terrain.south))
    grid.add_field(ELEVATION, nodes(filled(z, terrain.cell_size)).astype(np.float64), at="node")
    beside = known & ndimage.binary_dilation(~known, np.ones((3, 3), bool), border_value=1)
    grid.status_at_node[nodes(beside)] = OPEN
    grid.status_at_node[nodes(~known)] = CLOSED
    return grid


def nodes(values: np.ndarray) -> np.ndarray:
    """Values (n,) at the nodes of landlab of a map (rows, columns), north up."""
    return np.ascontiguousarray(values[::-1]).ravel()


def on_map(values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Map (rows, columns), north up, of values (n,) at the nodes of landlab."""
    return np.ascontiguousarray(np.asarray(values).reshape(shape)[::-1])


@dataclass(frozen=True)
class Drainage:
    """Drainage of a terrain."""

    terrain: "Terrain"
    filled: np.ndarray  # (rows, columns): elevation with every sink filled to its spill [m]; NaN where unknown
    area: np.ndarray  # (rows, columns): plan area that drains through the cell, the cell included [m2]; NaN where unknown
    # (rows, columns) of int: flat index (north up) of the cell that the water of a cell goes to next; its own where it leaves the
    # terrain
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

    Sinks are filled with the priority flood of Barnes et al. (2014, Comput. Geosci. 62:117), flats with a minute gradient, so that
    all water reaches an open edge (landlab's SinkFillerBarnes and FlowAccumulator; O'Callaghan and Mark 1984 for D8). Raises
    LibraryError if landlab is missing.
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
