"""Values of many members, which come member by member and are needed tile by tile."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from runout.io.atomic import storage_error

IN_MEMORY = 2**20  # bytes, above which the values go to a file
_INDEX = np.dtype(np.int32)
_VALUE = np.dtype(np.float32)
_RUN = np.dtype([("tile", np.int32), ("rows", np.int32), ("place", np.int64)])  # rows of one tile, one after another in the file


def reached_tiles(layers: Sequence[np.ndarray], side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tiles of ``side`` x ``side`` cells in which a layer (rows, columns) is above 0.

    Returns
    -------
    rows, columns : ndarray (tiles,)
        Places, counted in tiles.
    values : ndarray (tiles, layers, cells)
        Values; 0 in cells of a tile beyond the layers.
    """
    shape = layers[0].shape
    down, across = (-(-size // side) for size in shape)
    reached = np.zeros((down * side, across * side), bool)
    for layer in layers:
        reached[: shape[0], : shape[1]] |= layer > 0
    by_tile = reached.reshape(down, side, across, side).any(axis=(1, 3))
    rows, columns = np.nonzero(by_tile)
    if len(rows) == 0:
        return rows, columns, np.empty((0, len(layers), side**2), _VALUE)
    row, column, down, across = rows.min(), columns.min(), np.ptp(rows) + 1, np.ptp(columns) + 1
    values = np.zeros((len(layers), down * side, across * side), _VALUE)
    for layer, target in zip(layers, values, strict=True):
        reached_part = layer[row * side : (row + down) * side, column * side : (column + across) * side]
        target[: reached_part.shape[0], : reached_part.shape[1]] = reached_part
    tiles = values.reshape(-1, down, side, across, side)[:, rows - row, :, columns - column, :]
    return rows, columns, tiles.reshape(len(rows), len(layers), side**2)


class TileStore:
    """Values above 0 by tile, in a file without a name that the system removes with the process, however that ends.

    A batch of rows (tile, member, values of all maps) is sorted by tile and appended to the file: per tile the members,
    then the values of each map, so that one map of one tile is read without the others.

    Parameters
    ----------
    folder : Path
        Folder of the file.
    maps : int
        Number of maps.
    cells : int
        Number of cells of a tile.
    batch_bytes : int
        Memory of a batch.

    Raises
    ------
    StorageError
        From all methods, if the file cannot be written, for example on a full disk.
    """

    def __init__(self, folder: Path, maps: int, cells: int, batch_bytes: int):
        self.folder, self.maps, self.cells = folder, maps, cells
        capacity = max(1, batch_bytes // (maps * cells * _VALUE.itemsize))
        self.tiles, self.members = np.empty(capacity, _INDEX), np.empty(capacity, _INDEX)
        self.values = np.empty((capacity, maps, cells), _VALUE)
        self.used, self.end = 0, 0
        self.runs: list[np.ndarray] = []  # of all batches
        self.file = tempfile.SpooledTemporaryFile(max_size=IN_MEMORY, dir=str(folder))  # noqa: SIM115

    def __enter__(self) -> "TileStore":
        return self

    def __exit__(self, *error: object) -> None:
        with suppress(OSError):  # what a full disk does not take any more
            self.file.close()

    def add(self, member: int, tiles: np.ndarray, values: np.ndarray) -> None:
        """Add rows of a member: numbers of tiles (rows,) and values (rows, maps, cells); members come in ascending order."""
        done = 0
        while done < len(tiles):
            count = min(len(tiles) - done, len(self.tiles) - self.used)
            place, rows = slice(self.used, self.used + count), slice(done, done + count)
            self.tiles[place], self.members[place], self.values[place] = tiles[rows], member, values[rows]
            self.used, done = self.used + count, done + count
            if self.used == len(self.tiles):
                self._flush()

    def finish(self) -> None:
        """Write what is left and give the memory of the batch back; to be called before anything is read."""
        self._flush()
        self.tiles, self.members = np.empty(0, _INDEX), np.empty(0, _INDEX)
        self.values = np.empty((0, self.maps, self.cells), _VALUE)
        runs = np.concatenate([np.empty(0, _RUN), *self.runs])
        self.runs = [runs[np.argsort(runs["tile"], kind="stable")]]

    def _flush(self) -> None:
        order = np.argsort(self.tiles[: self.used], kind="stable")
        numbers, starts = np.unique(self.tiles[order], return_index=True)
        runs = np.empty(len(numbers), _RUN)
        runs["tile"], runs["rows"] = numbers, np.diff(starts, append=len(order))
        sizes = runs["rows"] * np.int64(_INDEX.itemsize + self.maps * self.cells * _VALUE.itemsize)
        runs["place"] = self.end + np.cumsum(sizes) - sizes
        try:
            for first, count in zip(starts, runs["rows"], strict=True):
                self._write(order[first : first + count])
            self.file.flush()
        except OSError as cause:
            raise storage_error(self.folder / "values of the members", cause) from cause
        self.runs.append(runs)
        self.used, self.end = 0, self.end + int(sizes.sum())

    def _write(self, rows: np.ndarray) -> None:
        self.file.write(self.members[rows].data)
        for k in range(self.maps):
            self.file.write(self.values[rows, k].data)

    def __iter__(self) -> Iterator[int]:
        """Numbers of the tiles with values, ascending."""
        return iter(np.unique(self.runs[0]["tile"]).tolist())

    def _runs_of(self, tile: int) -> Iterator[tuple[int, int]]:
        """Places in the file, and numbers of rows."""
        first, end = np.searchsorted(self.runs[0]["tile"], [tile, tile + 1])
        return zip(self.runs[0]["place"][first:end].tolist(), self.runs[0]["rows"][first:end].tolist(), strict=True)

    def members_of(self, tile: int) -> np.ndarray:
        """Members with values in a tile, ascending, (members,)."""
        return np.concatenate([self._read(place, np.empty(rows, _INDEX)) for place, rows in self._runs_of(tile)])

    def values_of(self, tile: int, map_index: int) -> np.ndarray:
        """Values of one map in a tile (cells, members), in the order of :meth:`members_of`."""
        values = np.empty((self.cells, sum(rows for _, rows in self._runs_of(tile))), _VALUE)
        first = 0
        for place, rows in self._runs_of(tile):
            start = place + rows * (_INDEX.itemsize + map_index * self.cells * _VALUE.itemsize)
            values[:, first : first + rows] = self._read(start, np.empty((rows, self.cells), _VALUE)).T
            first += rows
        return values

    def _read(self, place: int, into: np.ndarray) -> np.ndarray:
        self.file.seek(place)
        self.file.readinto(into.data.cast("B"))
        return into
