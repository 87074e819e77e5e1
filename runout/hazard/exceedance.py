"""Exceedance probabilities, percentiles and extremes over the members of an ensemble, whose files are read once.

The files come one after another. The values of each go by tiles of the raster into a :class:`runout.hazard.tiles.TileStore`;
then the statistics of each tile are made of the values of all members. Where no member arrives there is no tile.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.hazard.order import CellValues, effective_sample_size, equal, normalised, weighted_percentiles
from runout.hazard.sampling import Estimator, independent, rms
from runout.hazard.tiles import TileStore, reached_tiles
from runout.io import netcdf
from runout.io.member_maps import Block, MemberMaps
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["QUANTITIES", "Quantity", "aggregate", "effective_sample_size", "normalised", "weighted_percentiles"]

MEMORY_BYTES = 64 * 1024**2  # of an aggregation, beside the maps that it makes
_LARGEST_SIDE = 32  # cells of a tile; parts of the raster in the files begin on multiples of it
_BYTES_PER_CELL = 128  # of the memory, for each cell of a block: five maps, their tiles, and the batch beside them
INDEPENDENT = Estimator()
_COPIES, _WEIGHTED_COPIES = 3, 12  # of a tile's values: as read and sorted; with order, summed weights and their comparison


@dataclass(frozen=True)
class Quantity:
    """A quantity whose maximum is compared with thresholds: the member's map and the names made of it."""

    member_map: str
    percentile: str
    peak: str


QUANTITIES = {
    "thickness": Quantity("max_flow_thickness", "flow_thickness_percentile", "peak_flow_thickness"),
    "speed": Quantity("max_speed", "speed_percentile", "peak_speed"),
    "pressure": Quantity("max_pressure", "pressure_percentile", "peak_pressure"),
}


_DEPOSIT = Quantity("deposit_thickness", "deposit_thickness_percentile", "peak_deposit_thickness")


def stated_thresholds(hazard: Any) -> dict[str, list[float]]:
    """Thresholds of each quantity in the settings ``hazard`` of a site."""
    return {name: getattr(hazard, f"{name}_thresholds") for name in QUANTITIES}


def aggregate(
    members: Sequence[Path],
    weights: Sequence[float] | np.ndarray,
    thresholds: Mapping[str, Sequence[float]],
    percentiles: Sequence[float],
    *,
    estimator: Estimator = INDEPENDENT,
    memory_bytes: int = MEMORY_BYTES,
    folder: Path | None = None,
    each: Callable[[int, MemberMaps], None] | None = None,
) -> "xr.Dataset":
    """Hazard maps of the members' files, on their raster; every file is opened once.

    Memory is bounded by ``memory_bytes`` and the maps themselves. Probability is the summed weight of the members whose
    maximum reaches the threshold, with the standard error of ``estimator``; a percentile is the smallest value at which the
    summed weight reaches it. A cell that any member leaves undefined (NaN) is undefined.

    Parameters
    ----------
    members : sequence of Path
        Files of the valid members.
    weights : sequence of float
        Their weights, in the same order; any positive scale.
    thresholds : mapping of str to sequence of float
        Thresholds of "thickness" [m], "speed" [m/s] and "pressure" [Pa]; the lowest thickness, of which there must be one,
        is that of inundation. Without thresholds a quantity has its percentiles and peak only.
    percentiles : sequence of float
        Percentiles [percent], 0 to 100.
    estimator : Estimator
        Of the standard errors; blocks need equal weights and the order of the net.
    memory_bytes : int
        8 MiB at least are used.
    folder : Path, optional
        Where a temporary file goes, 16 bytes for each cell and member where a member arrives; by default that of the first file.
    each : callable, optional
        Called with the place in ``members`` and the open file of every member.

    Raises
    ------
    StorageError
        If a member's file cannot be read, lacks a map, or lies on another grid than the first, or the disk is full.
    ValueError
        If there are no members, the weights do not fit, or there is no threshold of thickness.
    """
    if len(thresholds.get("thickness", ())) == 0:
        raise ValueError("no threshold of the flow thickness is given; inundation needs one, for example 0.1 m")
    w = normalised(weights, len(members))
    side = _side(w, memory_bytes)
    with TileStore(folder or Path(members[0]).parent, len(thresholds) + 1, side**2, memory_bytes // 4) as store:
        for number, path in enumerate(members):
            with MemberMaps(path) as member:
                if number == 0:
                    maps = _Maps(_empty(member.grid(), thresholds, percentiles, w), tuple(thresholds), w, store, side, estimator)
                    maps.leave_out(member.known())
                member.require_grid(maps.dataset, Path(members[0]).name)
                if each is not None:
                    each(number, member)
                for block in member.blocks(memory_bytes // _BYTES_PER_CELL):
                    maps.take(number, block)
        store.finish()
        for tile in store:
            maps.place(tile)
    return maps.finished()


def _side(weights: np.ndarray, memory_bytes: int) -> int:
    """Cells along a side of a tile, a power of two, so that the values of all members of one map fit into half of the memory."""
    copies = _COPIES if equal(weights) else _WEIGHTED_COPIES
    cells = memory_bytes / 2 / (len(weights) * np.dtype(np.float32).itemsize * copies)
    return int(min(_LARGEST_SIDE, 2 ** max(0, int(np.log2(max(cells, 1.0))) // 2)))


class _Maps:
    """The maps while they are made; NaN in those of the peaks marks cells that a member leaves undefined.

    Parameters
    ----------
    dataset : xarray.Dataset
        All maps at zero.
    names : tuple of str
        Quantities with thresholds or percentiles.
    weights : ndarray (members,)
        Of sum 1.
    store : TileStore
        Values of the maps of ``names`` and of the deposit.
    side : int
        Cells along a side of a tile.
    estimator : Estimator
        Of the standard errors.
    """

    def __init__(
        self,
        dataset: "xr.Dataset",
        names: tuple[str, ...],
        weights: np.ndarray,
        store: TileStore,
        side: int,
        estimator: Estimator,
    ):
        self.dataset, self.names, self.weights, self.store, self.side = dataset, names, weights, store, side
        self.estimator = estimator
        self.quantities = (*(QUANTITIES[name] for name in names), _DEPOSIT)
        self.maps = {str(name): array.values for name, array in dataset.data_vars.items()}
        self.shape = (dataset.sizes["y"], dataset.sizes["x"])
        self.across = -(-self.shape[1] // side)
        self.limits = {name: self._limits(name) for name in names}

    def _limits(self, name: str) -> np.ndarray:
        dimension = f"{name}_threshold"
        return self.dataset[dimension].values.astype(np.float32) if dimension in self.dataset.coords else np.empty(0, np.float32)

    def leave_out(self, known: np.ndarray | None) -> None:
        """Mark the cells without elevation."""
        if known is not None:
            for quantity in self.quantities:
                self.maps[quantity.peak][~known] = np.nan

    def take(self, member: int, block: Block) -> None:
        """Store the tiles of a block of a member in which anything is above 0, and keep the first arrivals."""
        place = (block.rows, block.columns)
        first = self.maps["first_arrival_time"][place]
        np.fmin(first, block.maps["arrival_time"], out=first)
        layers = [block.maps[quantity.member_map] for quantity in self.quantities]
        for quantity, layer in zip(self.quantities, layers, strict=True):
            if np.isnan(layer.min()):
                self.maps[quantity.peak][place][np.isnan(layer)] = np.nan
        rows, columns, values = reached_tiles(layers, self.side)
        if len(rows):
            numbers = (block.rows.start // self.side + rows) * self.across + block.columns.start // self.side + columns
            self.store.add(member, numbers, values)

    def place(self, tile: int) -> None:
        """Put the statistics of a tile into the maps."""
        given = self.store.members_of(tile)
        for k, quantity in enumerate(self.quantities):
            unsorted, limits = self.store.values_of(tile, k), self._limits_of(k)
            spread = self.estimator.spread(unsorted, given, len(self.weights), limits)
            values = CellValues(unsorted, given, self.weights)
            self._put(tile, quantity.percentile, values.percentiles(self.dataset["percentile"].values))
            if quantity is _DEPOSIT:
                self._put(tile, "mean_deposit_thickness", values.mean)
            else:
                self._put_exceedance(tile, self.names[k], values, spread)
            self._put(tile, quantity.peak, np.where(np.isnan(self._cells(tile, quantity.peak)), np.nan, values.peak))

    def _limits_of(self, quantity: int) -> np.ndarray:
        """Thresholds of a quantity by its place; none for the deposit."""
        return self.limits[self.names[quantity]] if quantity < len(self.names) else np.empty(0, np.float32)

    def _put_exceedance(self, tile: int, name: str, values: CellValues, spread: np.ndarray | None) -> None:
        """Counts, probabilities and their standard errors; cells that no member reaches keep 0."""
        wet = values.peak > 0
        for k, limit in enumerate(self.limits[name]):
            p = np.where(wet, values.probability(limit), 0.0)
            error = independent(p, self.weights) if spread is None else np.where(wet, spread[k], 0.0)
            self._put(tile, f"{name}_exceedance_probability", p, k)
            self._put(tile, f"{name}_exceedance_standard_error", error, k)
            if name == "thickness" and k == 0:
                self._put(tile, "inundation_probability", p)
                self._put(tile, "members_reached", np.where(wet, values.count(limit), 0))

    def _put(self, tile: int, name: str, values: np.ndarray, index: int | None = None) -> None:
        layers = self.maps[name] if index is None else self.maps[name][index]
        target = layers[..., *self._place_of(tile)]
        target[...] = values.reshape(*values.shape[:-1], self.side, self.side)[..., : target.shape[-2], : target.shape[-1]]

    def _cells(self, tile: int, name: str) -> np.ndarray:
        """Values of a map in the cells of a tile (cells,); 0 beyond the raster."""
        cells = np.zeros((self.side, self.side), np.float32)
        found = self.maps[name][self._place_of(tile)]
        cells[: found.shape[0], : found.shape[1]] = found
        return cells.ravel()

    def _place_of(self, tile: int) -> tuple[slice, slice]:
        row, column = (self.side * number for number in divmod(tile, self.across))
        return slice(row, row + self.side), slice(column, column + self.side)

    def finished(self) -> "xr.Dataset":
        """The maps, without values where a member leaves a cell undefined."""
        of_some = {"thickness": ("inundation_probability", "members_reached"), "deposit_thickness": ("mean_deposit_thickness",)}
        for name, quantity in zip((*self.names, "deposit_thickness"), self.quantities, strict=True):
            unknown = np.isnan(self.maps[quantity.peak])
            if not unknown.any():
                continue
            exceedance = (f"{name}_exceedance_probability", f"{name}_exceedance_standard_error")
            for product in {*exceedance, quantity.percentile, *of_some.get(name, ())} & set(self.maps):
                target = self.maps[product]
                target[..., unknown] = np.nan if target.dtype.kind == "f" else VARIABLES[product].fill
        for name in self.names:
            self._add_mean_error(name)
        return self.dataset

    def _add_mean_error(self, name: str) -> None:
        """Root mean square of the standard errors of each threshold, and how they were found."""
        if len(self.limits[name]) == 0:
            return
        errors, probabilities = (self.maps[f"{name}_exceedance_{kind}"] for kind in ("standard_error", "probability"))
        means = [rms(error, probability) for error, probability in zip(errors, probabilities, strict=True)]
        mean = f"{name}_exceedance_rms_error"
        self.dataset[mean] = (f"{name}_threshold", means, VARIABLES[mean].attributes())
        for product in (mean, f"{name}_exceedance_standard_error"):
            self.dataset[product].attrs["estimator"] = self.estimator.statement(len(self.weights))


def _empty(
    dataset: "xr.Dataset", thresholds: Mapping[str, Sequence[float]], percentiles: Sequence[float], weights: np.ndarray
) -> "xr.Dataset":
    """All maps at zero on the raster of ``dataset``, which has nothing but its place."""
    shape = (dataset.sizes["y"], dataset.sizes["x"])
    dataset = dataset.assign_coords(percentile=np.unique(np.asarray(percentiles, np.float64)))
    for name, limits in thresholds.items():
        netcdf.add_map(dataset, QUANTITIES[name].peak, np.zeros(shape, np.float32))
        if len(limits) == 0:
            continue
        dimension = f"{name}_threshold"
        dataset = dataset.assign_coords({dimension: np.unique(np.asarray(limits, np.float64))})
        for product in (f"{name}_exceedance_probability", f"{name}_exceedance_standard_error"):
            netcdf.add_map(dataset, product, np.zeros((dataset.sizes[dimension], *shape), np.float32), (dimension,))
    for name in (*(QUANTITIES[name].percentile for name in thresholds), "deposit_thickness_percentile"):
        netcdf.add_map(dataset, name, np.zeros((dataset.sizes["percentile"], *shape), np.float32), ("percentile",))
    for name in ("inundation_probability", "mean_deposit_thickness", "peak_deposit_thickness"):
        netcdf.add_map(dataset, name, np.zeros(shape, np.float32))
    netcdf.add_map(dataset, "first_arrival_time", np.full(shape, np.nan, np.float32))
    netcdf.add_map(dataset, "members_reached", np.zeros(shape, np.int32))
    dataset["effective_sample_size"] = effective_sample_size(weights)
    return dataset
