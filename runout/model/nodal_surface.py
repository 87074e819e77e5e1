"""The ground of contact: the sliding surface on the nodes of the grid, made where it is asked for.

A bed that is eroded and a release that starts later lower it while a run goes on; nothing else changes it.
"""

from dataclasses import dataclass, field

import numpy as np

from runout.model.surface import Surface, spline_at

TILE = 32  # patches along each side of what is made at once
WIDTH = TILE + 2  # nodes that these need
NONE = np.zeros((0, 0))


@dataclass(frozen=True, eq=False)
class NodalSurface:
    """A surface resampled to the nodes of a grid, plus changes of the coefficients in a window of nodes.

    Backends make the coefficients under their blocks; here they are made in tiles, once each, for whoever asks. So memory and time
    follow the places asked for, not the number of nodes under the raster.
    """

    surface: Surface  # on a lattice of its own
    spacing: tuple[float, float]  # of the grid, east and north [m]; node 0 lies at position 0
    # (nx, ny): what the coefficients of the nodes from `first` on have more [m], float64; none beyond
    change: np.ndarray = field(default_factory=lambda: NONE)
    first: tuple[int, int] = (0, 0)  # node of `change[0, 0]`
    _tiles: dict[tuple[int, int], np.ndarray] = field(default_factory=dict, init=False, repr=False)
    _unchanged: dict[tuple[int, int], np.ndarray] = field(default_factory=dict, init=False, repr=False)

    def on_nodes(self, first: tuple[int, int], shape: tuple[int, int]) -> Surface:
        """The ground as a spline whose coefficients sit on so many nodes from the ``first`` on."""
        values = self.surface.on_nodes(self.spacing, first, shape)
        self._add_change(first, values.coefficients)
        return values

    def _add_change(self, first: tuple[int, int], coefficients: np.ndarray) -> None:
        """Add the change to coefficients (n, m) of the surface at the nodes from the ``first`` on."""
        here, there = [], []
        for one, count, start, size in zip(first, coefficients.shape, self.first, self.change.shape, strict=True):
            low, high = max(one, start), min(one + count, start + size)
            here.append(slice(low - one, max(low, high) - one))
            there.append(slice(low - start, max(low, high) - start))
        coefficients[*here] += self.change[*there]

    def with_room(self, first: tuple[int, int], shape: tuple[int, int]) -> "NodalSurface":
        """The same ground, of which :meth:`lower` may lower so many nodes from the ``first`` on; this one stays as it is."""
        if not self.change.size:
            return NodalSurface(self.surface, self.spacing, np.zeros(shape), first)
        low = np.minimum(first, self.first)
        size = np.maximum(np.add(first, shape), np.add(self.first, self.change.shape)) - low
        i, j = self.first - low
        change = np.zeros(size)
        change[i : i + self.change.shape[0], j : j + self.change.shape[1]] = self.change
        return NodalSurface(self.surface, self.spacing, change, (int(low[0]), int(low[1])))

    def lower(self, first: tuple[int, int], depth: np.ndarray) -> None:
        """Lower the coefficients of the nodes from the ``first`` on by a ``depth`` (n, m) [m], in place; they have a change.

        The splines sum to one: the volume under the ground falls by the sum of the depths times the area of a cell.
        """
        i, j = first[0] - self.first[0], first[1] - self.first[1]
        self.change[i : i + depth.shape[0], j : j + depth.shape[1]] -= depth
        for tile in list(self._tiles):
            corner = (tile[0] * TILE, tile[1] * TILE)
            beside = zip(corner, first, depth.shape, strict=True)
            if all(low < start + size and start < low + WIDTH for low, start, size in beside):
                del self._tiles[tile]  # that of the surface itself is kept, since it takes long to make

    def restore(self, change: np.ndarray) -> None:
        """Set the whole change (nx, ny) [m] again, in place."""
        self.change[:] = change
        self._tiles.clear()

    def elevation(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Elevation [m] at local positions [m]."""
        return self.evaluate(x, y)[0]

    def evaluate(
        self, x: np.ndarray, y: np.ndarray, way: tuple[np.ndarray, np.ndarray] | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Elevation [m] and its slopes east and north [1] at local positions [m] of any common shape.

        With a ``way`` east and north (n,) [m] at its end, on the polynomial of the patch where it begins.
        """
        x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
        q = [(place / h).ravel() for place, h in zip((x, y), self.spacing, strict=True)]
        first = [np.floor(p - 0.5).astype(np.int64) for p in q]
        table, begins = self._table(first[0] // TILE, first[1] // TILE)
        begins += first[0] % TILE * WIDTH + first[1] % TILE
        if way:
            q = [p + one / h for p, one, h in zip(q, way, self.spacing, strict=True)]
        evaluated = spline_at(table, begins, WIDTH, q[0] - first[0], q[1] - first[1])
        value, east, north = (one.reshape(x.shape) for one in evaluated)
        return value, east / self.spacing[0], north / self.spacing[1]

    def _table(self, east: np.ndarray, north: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients of the tiles (n,) one behind the other, each once, and where those of each begin (n,)."""
        if not east.size:
            return np.zeros(0), east
        low, count = (east.min(), north.min()), int(np.ptp(north)) + 1
        keys, slot = np.unique((east - low[0]) * count + north - low[1], return_inverse=True)
        tiles = [self._tile(int(low[0] + key // count), int(low[1] + key % count)) for key in keys]
        return np.concatenate(tiles), slot * WIDTH**2

    def _tile(self, i: int, j: int) -> np.ndarray:
        if (i, j) not in self._tiles:
            if (i, j) not in self._unchanged:
                self._unchanged[i, j] = self.surface.on_nodes(self.spacing, (i * TILE, j * TILE), (WIDTH, WIDTH)).coefficients
            tile = self._unchanged[i, j]
            if self.change.size:
                self._add_change((i * TILE, j * TILE), tile := tile.copy())
            self._tiles[i, j] = tile.ravel()
        return self._tiles[i, j]
