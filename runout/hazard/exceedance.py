"""Exceedance probabilities, percentiles and extremes over the members of an ensemble, whose files are read once.

The files come one after another. The values of each go by tiles of the raster into a :class:`runout.hazard.tiles.TileStore`;
then the statistics of each tile are made of the values of all members. Where no member arrives there is no tile.
"""

import json
import math
import mmap
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike

from runout.errors import StorageError
from runout.hazard.danger import INTENSITY, LEVEL, RATE, DangerClasses
from runout.hazard.frequency import Frequencies, annual_exceedance, at_return_period
from runout.hazard.joint import NOWHERE, conditions_of, require_conditions, with_conditions
from runout.hazard.order import CellValues, effective_sample_size, equal, normalised, weighted_percentiles
from runout.hazard.sampling import Estimator, Scatter, Strata, independent, rms
from runout.hazard.tiles import TileStore, reached_tiles
from runout.io import netcdf
from runout.io.member_maps import MEMBER_MAPS, Block, MemberMaps
from runout.model.joint_conditions import ATTRIBUTE, Condition, Key, maps_of, meets, places_in, to_record
from runout.quantities import (
    ALL_QUANTITIES,
    ARRIVAL,
    ARRIVAL_PERCENTILE,
    CHANGE,
    CHANGE_PERCENTILE,
    FIRST_ARRIVAL,
    MET,
    QUANTITIES,
    MapQuantity,
)
from runout.quantities.thickness_and_speed import at_one_time
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["aggregate", "effective_sample_size", "normalised", "weighted_percentiles"]

MEMORY_BYTES = 64 * 1024**2  # of an aggregation, beside the maps that it makes
_LARGEST_SIDE = 32  # cells of a tile; parts of the raster in the files begin on multiples of it
_BYTES_PER_CELL = 26 * len(MEMBER_MAPS)  # of the memory, for each cell of a block: maps, their tiles, and the batch beside them
INDEPENDENT = Estimator()
_KINDS = ("probability", "standard_error")
_COPIES, _WEIGHTED_COPIES = 3, 12  # of a tile's values: as read and sorted; with order, summed weights and their comparison


def stated_thresholds(hazard: Any, bed: bool = False) -> dict[str, list[float]]:
    """Thresholds of each quantity in the settings ``hazard`` of a site, those of an erodible bed where it has a ``bed``.

    A quantity of a bed that states none has its default ones.
    """
    stated = {name: getattr(hazard, q.setting) for name, q in ALL_QUANTITIES.items() if bed or not q.of_bed}
    return {name: list(ALL_QUANTITIES[name].thresholds) if limits is None else limits for name, limits in stated.items()}


def aggregate(
    members: Sequence[Path],
    weights: Sequence[float] | np.ndarray,
    thresholds: Mapping[str, Sequence[float]],
    percentiles: Sequence[float],
    *,
    joint: Sequence[Condition] = (),
    estimator: Estimator | Strata = INDEPENDENT,
    frequencies: Frequencies | None = None,
    return_periods: Sequence[float] = (),
    danger: DangerClasses | None = None,
    memory_bytes: int = MEMORY_BYTES,
    folder: Path | None = None,
    each: Callable[[int, MemberMaps], None] | None = None,
) -> "xr.Dataset":
    """Hazard maps of the members' files, on their raster; every file is opened once.

    Memory is bounded by ``memory_bytes``, the caches of an open file (8 MiB a map) and the maps, whose zeros take none.
    Probability is the summed weight of the members whose maximum reaches the threshold, with the standard error of
    ``estimator``; a percentile is the smallest value at which the summed weight reaches it. A cell that any member leaves
    undefined (NaN) is undefined. Members that do not arrive count as infinity in percentiles of the arrival time, which are NaN
    where they are infinite. Annual rates and values at return periods exist with ``frequencies`` only
    (:mod:`runout.hazard.frequency`).

    Parameters
    ----------
    members : sequence of Path
        Files of the valid members.
    weights : sequence of float
        Their weights, in the same order; any positive scale.
    thresholds : mapping of str to sequence of float
        Thresholds by the name of the quantity (:data:`runout.quantities.ALL_QUANTITIES`), in its unit; the lowest thickness, of
        which there must be one, is that of inundation. Without thresholds a quantity has its percentiles and extremes only.
    percentiles : sequence of float
        Percentiles [percent], 0 to 100.
    joint : sequence of mapping of str to float
        Thresholds by quantity that a member has to reach together, those of the flow at one time. Where members do not record a
        condition, :func:`runout.quantities.thickness_and_speed.at_one_time` bounds it, and the words of the condition tell.
    estimator : Estimator
        Estimator of the standard errors. Its blocks need members of equal weights in the order of the net.
    frequencies : Frequencies, optional
        Annual rates of the members, in the same order.
    return_periods : sequence of float
        Return periods [a] of maps of the values; they need ``frequencies``.
    danger : DangerClasses, optional
        Classes of intensity and levels of danger, for rates of the members in their order.
    memory_bytes : int
        1.25 MiB at least are used for each map of a member.
    folder : Path, optional
        Where a temporary file goes, 4 bytes for each map, cell and member where a member arrives; default: that of the first file.
    each : callable, optional
        Called with the place in ``members`` and the open file of every member.

    Raises
    ------
    StorageError
        If a member's file cannot be read, lacks a map, or lies on another grid than the first, or the disk is full.
    ValueError
        If there are no members, the weights do not fit, there is no threshold of thickness, a joint condition is invalid, or
        return periods are asked for without annual rates.
    """
    require_conditions(joint)
    if len(return_periods) and frequencies is None:
        raise ValueError("return periods need annual rates of the members; state ensemble.scenarios")
    if len(thresholds.get("thickness", ())) == 0:
        raise ValueError("no threshold of the flow thickness is given; inundation needs one, for example 0.1 m")
    w = normalised(weights, len(members))
    asked = to_record([*joint, *(danger.scheme.conditions if danger else ())])
    side = _side(w, memory_bytes)
    with ExitStack() as stack:
        for number, path in enumerate(members):
            with MemberMaps(path) as member:
                places = places_in(str(member.attributes.get(ATTRIBUTE, "[]"))) if asked else {}
                if number == 0:
                    quantities = _quantities_of(member, thresholds, joint)
                    others = (ARRIVAL, *((MET,) if places else ()))
                    names = list(dict.fromkeys((*(quantity.member_map for quantity in quantities.values()), *others)))
                    layers = len(quantities) + len(others)
                    per_cell = _BYTES_PER_CELL * max(1.0, layers / len(MEMBER_MAPS))
                    place = folder or Path(path).parent
                    store = stack.enter_context(TileStore(place, layers, side**2, memory_bytes // 4))
                    empty = empty_maps(member.grid(), thresholds, percentiles, joint, w, quantities)
                    if frequencies is not None:
                        empty = with_annual_maps(empty, return_periods, quantities)
                    empty = danger.add_to(empty) if danger else empty
                    maps = _Maps(empty, w, store, side, estimator, frequencies, danger, places)
                    maps.leave_out(member.known())
                member.require_grid(maps.dataset, Path(members[0]).name)
                if each is not None:
                    each(number, member)
                maps.places = dict(maps.places.items() & places.items())
                for block in member.blocks(int(memory_bytes / per_cell), [name for name in names if name != MET or places]):
                    maps.take(number, block)
        store.finish()
        maps.tell_places()
        for tile in store:
            maps.place(tile)
    return maps.finished()


def _quantities_of(
    member: MemberMaps, thresholds: Mapping[str, Sequence[float]], joint: Sequence[Condition]
) -> dict[str, MapQuantity]:
    """Quantities whose map a member holds; StorageError if it lacks one that has a threshold."""
    map_names = member.held()
    names = {name for name, limits in thresholds.items() if len(limits)} | {name for one in joint for name in at_one_time(one)}
    for name in sorted(names):
        if ALL_QUANTITIES[name].member_map not in map_names:
            lacking = f"{member.path}: {ALL_QUANTITIES[name].member_map} is missing, which thresholds of {name} need"
            raise StorageError(f"{lacking}; run the ensemble again")
    return {name: quantity for name, quantity in ALL_QUANTITIES.items() if quantity.member_map in map_names}


def _values_of(quantity: MapQuantity, mapped: np.ndarray) -> np.ndarray:
    """Values of a quantity, 0 or more, from those of its map of a member, of the same shape."""
    return np.maximum(np.float32(quantity.sign) * mapped, np.float32(0.0)) if quantity.part_of else mapped


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
        Maps of :func:`empty_maps`, which are filled.
    weights : ndarray (members,)
        Weights of the members; their sum is 1.
    store : TileStore
        Values of the quantities in the order of the table, then of the arrival, then of the conditions that members record.
    side : int
        Cells along a side of a tile.
    estimator : Estimator or Strata
        Estimator of the standard errors.
    frequencies : Frequencies, optional
        Annual rates of the members.
    danger : DangerClasses, optional
        Classes of intensity and levels of danger.
    places : mapping
        Bits of the conditions that the first member records; those that all members record once these are taken.
    """

    def __init__(
        self, dataset: "xr.Dataset", weights: np.ndarray, store: TileStore, side: int, estimator: Estimator | Strata,
        frequencies: Frequencies | None = None, danger: DangerClasses | None = None, places: Mapping[Key, int] = NOWHERE,
    ):  # fmt: skip
        self.frequencies, self.places, self.records = frequencies, places, bool(places)
        self.dataset, self.weights, self.store, self.side, self.estimator = dataset, weights, store, side, estimator
        self.danger = danger
        self.joint = conditions_of(dataset)
        self.scatters: dict[tuple[str, int], Scatter] = {}  # by map of standard errors and place of its layer
        self.quantities = {name: quantity for name, quantity in ALL_QUANTITIES.items() if quantity.peak in dataset}
        self.maps = {str(name): array.values for name, array in dataset.data_vars.items()}
        self.shape = (dataset.sizes["y"], dataset.sizes["x"])
        self.across = -(-self.shape[1] // side)
        self.limits = {name: self._limits(quantity.threshold) for name, quantity in self.quantities.items()}

    def _limits(self, dimension: str) -> np.ndarray:
        return self.dataset[dimension].values.astype(np.float32) if dimension in self.dataset.coords else np.empty(0, np.float32)

    def leave_out(self, known: np.ndarray | None) -> None:
        """Mark the cells without elevation."""
        if known is not None:
            for quantity in self.quantities.values():
                self.maps[quantity.peak][~known] = np.nan

    def take(self, member: int, block: Block) -> None:
        """Store the tiles of a block of a member in which anything is above 0, and keep the first arrivals."""
        place = (block.rows, block.columns)
        first = self.maps[FIRST_ARRIVAL][place]
        np.fmin(first, block.maps[ARRIVAL], out=first)
        layers = [_values_of(quantity, block.maps[quantity.member_map]) for quantity in self.quantities.values()]
        for quantity, layer in zip(self.quantities.values(), layers, strict=True):
            if np.isnan(layer.min()):
                self.maps[quantity.peak][place][np.isnan(layer)] = np.nan
        met = [np.nan_to_num(block.maps.get(MET, np.zeros_like(layers[0])))] if self.records else []
        rows, columns, values = reached_tiles([*layers, block.maps[ARRIVAL], *met], self.side)
        if len(rows):
            numbers = (block.rows.start // self.side + rows) * self.across + block.columns.start // self.side + columns
            self.store.add(member, numbers, values)

    def tell_places(self) -> None:
        """State which conditions all members record, in the words of the joint conditions and in the record of the scheme."""
        if self.joint:
            self.dataset = with_conditions(self.dataset, self.joint, self.places)
        if self.danger:
            self.danger = replace(self.danger, places=self.places)
            for name in {INTENSITY, LEVEL} & self.maps.keys():
                self.dataset[name].attrs["scheme_record"] = json.dumps(self.danger.record())

    def place(self, tile: int) -> None:
        """Put the statistics of a tile into the maps."""
        members = self.store.members_of(tile)
        for k, quantity in enumerate(self.quantities.values()):
            self._put_quantity(tile, quantity, self.store.values_of(tile, k), members)
        for k, condition in enumerate(self.joint):
            self._put_joint(tile, condition, k, members)
        if CHANGE_PERCENTILE in self.maps:
            self._put_change(tile, members)
        if self.danger:
            for name, layers in self.danger.tile(self._values(tile, self.danger.quantities), members):
                self._put(tile, name, layers)
        arrival = self.store.values_of(tile, len(self.quantities))
        arrival[np.isnan(arrival)] = np.inf
        percentiles = CellValues(arrival, members, self.weights, absent=np.inf).percentiles(self.dataset["percentile"].values)
        self._put(tile, ARRIVAL_PERCENTILE, np.where(np.isinf(percentiles), np.nan, percentiles))

    def _put_quantity(self, tile: int, quantity: MapQuantity, unsorted: np.ndarray, members: np.ndarray) -> None:
        """Exceedance, percentiles and extremes from values (cells, members) in ascending order of the members."""
        limits = self.limits[quantity.name]
        spread = self.estimator.spread(unsorted, members, len(self.weights), limits)
        for k, limit in enumerate(limits):
            if limit > 0:
                self._scatter(f"{quantity.name}_exceedance_standard_error", k, unsorted >= limit, members)
        self._put_annual(tile, quantity, unsorted, members)
        if quantity.mean:
            self._put_mean(tile, quantity, unsorted, members)
        values = CellValues(unsorted, members, self.weights)
        if quantity.percentile:
            self._put(tile, quantity.percentile, values.percentiles(self.dataset["percentile"].values))
        for k, limit in enumerate(limits):
            p = self._put_exceedance(tile, quantity.name, k, values, limit, None if spread is None else spread[k])
            if quantity.name == "thickness" and k == 0:
                self._put(tile, "inundation_probability", p)
                self._put(tile, "members_reached", np.where(values.peak > 0, values.count(limit), 0))
        self._put(tile, quantity.peak, np.where(np.isnan(self._cells(tile, quantity.peak)), np.nan, values.peak))

    def _put_mean(self, tile: int, quantity: MapQuantity, unsorted: np.ndarray, members: np.ndarray) -> None:
        """Mean over the members, their standard deviation, and the standard error of the mean."""
        error = self.estimator.of_mean(unsorted, members, len(self.weights))
        self._scatter(quantity.standard_error, 0, unsorted, members)
        values = CellValues(unsorted.astype(np.float64), members, self.weights)
        deviation = values.deviation
        if error is None:
            error = deviation / np.sqrt(effective_sample_size(self.weights))
        for name, cells in ((quantity.mean, values.mean), (quantity.deviation, deviation), (quantity.standard_error, error)):
            self._put(tile, name, cells)

    def _scatter(self, name: str, index: int, values: np.ndarray, members: np.ndarray) -> None:
        """Add the scatter of some cells to that of a map of standard errors."""
        of_cells, of_others = self.estimator.scatter(values, members, len(self.weights)), self.scatters.get((name, index))
        self.scatters[name, index] = of_cells if of_others is None else of_others + of_cells

    def _scale_errors(self) -> None:
        """Bring the standard errors from the spread over blocks to the whole net; untouched cells of 0 take no memory."""
        for (name, index), of_map in self.scatters.items():
            factor, layers = self.estimator.factor(of_map), self.maps[name]
            for row in layers if layers.ndim == 2 else layers[index]:
                cells = row > 0
                if cells.any():
                    row[cells] *= np.float32(factor)

    def _put_annual(self, tile: int, quantity: MapQuantity, unsorted: np.ndarray, members: np.ndarray) -> None:
        """Annual rates of exceedance and values at return periods; members that have no values here do not count."""
        if self.frequencies is None:
            return
        values, rate = unsorted.T, self.frequencies.rate[members]
        for k, limit in enumerate(self.limits[quantity.name]):
            self._put(tile, quantity.annual_exceedance, annual_exceedance(values, limit, rate), k)
        if quantity.at_return_period in self.maps:
            for k, years in enumerate(self.dataset["return_period"].values):
                self._put(tile, quantity.at_return_period, at_return_period(values, rate, years), k)

    def _put_change(self, tile: int, members: np.ndarray) -> None:
        """Percentiles of a map with values of both signs: members that have none here have 0, between the others."""
        whole = np.zeros((self.side**2, len(self.weights)), np.float32)
        for k, quantity in enumerate(self.quantities.values()):
            if quantity.part_of == CHANGE:
                whole[:, members] += np.float32(quantity.sign) * self.store.values_of(tile, k)
        values = CellValues(whole, np.arange(len(self.weights)), self.weights)
        self._put(tile, CHANGE_PERCENTILE, values.percentiles(self.dataset["percentile"].values))

    def _put_joint(self, tile: int, condition: Condition, index: int, members: np.ndarray) -> None:
        """Exceedance of a joint condition: each member meets it (1) or not (0)."""
        met = meets(condition, self._values(tile, maps_of(condition)), self.places)
        unsorted, one = met.astype(np.float32), np.ones(1, np.float32)
        spread = self.estimator.spread(unsorted, members, len(self.weights), one)
        self._scatter("joint_exceedance_standard_error", index, unsorted, members)
        if self.frequencies is not None:
            rate = annual_exceedance(unsorted.T, one[0], self.frequencies.rate[members])
            self._put(tile, "joint_annual_exceedance", rate, index)
        values = CellValues(unsorted, members, self.weights)
        self._put_exceedance(tile, "joint", index, values, one[0], None if spread is None else spread[0])

    def _values(self, tile: int, names: Collection[str]) -> dict[str, np.ndarray]:
        """Values (cells, members) of some quantities in a tile, of those that have a map, and of recorded conditions."""
        places = {name: k for k, name in enumerate(self.quantities) if name in names}
        met = {MET: len(self.quantities) + 1} if self.places else {}
        return {name: self.store.values_of(tile, k) for name, k in (places | met).items()}

    def _put_exceedance(
        self, tile: int, name: str, index: int, values: CellValues, limit: np.floating, spread: np.ndarray | None
    ) -> np.ndarray:
        """Probability, which is returned, and its standard error; cells that no member reaches keep 0."""
        wet = values.peak > 0
        p = np.where(wet, values.probability(limit), 0.0)
        error = independent(p, self.weights) if spread is None else np.where(wet, spread, 0.0)
        self._put(tile, f"{name}_exceedance_probability", p, index)
        self._put(tile, f"{name}_exceedance_standard_error", error, index)
        return p

    def _put(self, tile: int, name: str, values: np.ndarray, index: int | None = None) -> None:
        layers = self.maps[name] if index is None else self.maps[name][index]
        target = layers[..., *self._place_of(tile)]
        target[...] = values.reshape(*values.shape[:-1], self.side, self.side)[..., : target.shape[-2], : target.shape[-1]]

    def _cells(self, tile: int, name: str) -> np.ndarray:
        """Values of a map in the cells of a tile (cells,); 0 beyond the raster."""
        cells = np.zeros((self.side, self.side), np.float32)
        part = self.maps[name][self._place_of(tile)]
        cells[: part.shape[0], : part.shape[1]] = part
        return cells.ravel()

    def _place_of(self, tile: int) -> tuple[slice, slice]:
        row, column = (self.side * number for number in divmod(tile, self.across))
        return slice(row, row + self.side), slice(column, column + self.side)

    def finished(self) -> "xr.Dataset":
        """The maps, without values where a member leaves a cell undefined."""
        self._scale_errors()
        undefined = {name: np.isnan(self.maps[quantity.peak]) for name, quantity in self.quantities.items()}
        for name, quantity in self.quantities.items():
            of_some = ("inundation_probability", "members_reached") if name == "thickness" else ()
            annual = quantity.annual_exceedance, quantity.at_return_period
            for product in (*map(quantity.exceedance, _KINDS), quantity.percentile, *quantity.means, *annual, *of_some):
                self._undefine(product, undefined[name])
            if quantity.part_of:
                self._undefine(f"{quantity.part_of}_percentile", undefined[name])
        for k, condition in enumerate(self.joint):
            unknown = np.any([undefined[name] for name in condition], axis=0)
            for product in (*(f"joint_exceedance_{kind}" for kind in _KINDS), "joint_annual_exceedance"):
                self._undefine(product, unknown, k)
        if self.danger:
            unknown = np.any([undefined[name] for name in self.danger.quantities if name in undefined], axis=0)
            for name in (RATE, INTENSITY, LEVEL):
                self._undefine(name, unknown)
        for name in (*self.quantities, "joint"):
            self._add_mean_error(name)
        return self.dataset

    def _undefine(self, product: str, cells: np.ndarray, index: int | slice = slice(None)) -> None:
        """Leave the values of a product, if there is one, undefined in some cells (rows, columns) of bool."""
        if product not in self.maps or not cells.any():
            return
        target = self.maps[product]
        layers = target if target.ndim == 2 else target[index]
        layers[..., cells] = np.nan if target.dtype.kind == "f" else VARIABLES[product].fill

    def _add_mean_error(self, name: str) -> None:
        """Root mean square of the standard errors of each threshold, and their estimator."""
        error_name, probability_name = (f"{name}_exceedance_{kind}" for kind in ("standard_error", "probability"))
        if error_name not in self.maps:
            return
        means = [rms(error, p) for error, p in zip(self.maps[error_name], self.maps[probability_name], strict=True)]
        mean, dimension = f"{name}_exceedance_rms_error", self.dataset[error_name].dims[0]
        self.dataset[mean] = (dimension, means, VARIABLES[mean].attributes())
        for product in (mean, error_name):
            self.dataset[product].attrs["estimator"] = self.estimator.statement(len(self.weights))


def empty_maps(
    dataset: "xr.Dataset",
    thresholds: Mapping[str, Sequence[float]],
    percentiles: Sequence[float],
    joint: Sequence[Condition],
    weights: np.ndarray,
    quantities: Mapping[str, MapQuantity] = QUANTITIES,
) -> "xr.Dataset":
    """All maps of ``quantities`` at zero, and no arrival, on the raster of ``dataset``, which has nothing but its place.

    The other parameters are those of :func:`runout.hazard.exceedance.aggregate`, the weights of sum 1.
    """
    shape = (dataset.sizes["y"], dataset.sizes["x"])
    dataset = dataset.assign_coords(percentile=np.unique(np.asarray(percentiles, np.float64)))
    dimensions = {"joint": "joint"} if joint else {}
    dataset = with_conditions(dataset, joint) if joint else dataset
    for name, quantity in quantities.items():
        for product in filter(None, (quantity.peak, *quantity.means)):
            netcdf.add_map(dataset, product, zeros_by_page(shape, np.float32))
        limits = np.unique(np.asarray(thresholds.get(name, ()), np.float64))
        if limits.size:
            dataset = dataset.assign_coords({quantity.threshold: limits})
            dimensions[name] = quantity.threshold
    for name, dimension in dimensions.items():
        for kind in ("probability", "standard_error"):
            layers = zeros_by_page((dataset.sizes[dimension], *shape), np.float32)
            netcdf.add_map(dataset, f"{name}_exceedance_{kind}", layers, (dimension,))
    netcdf.add_map(dataset, "inundation_probability", zeros_by_page(shape, np.float32))
    netcdf.add_map(dataset, "members_reached", zeros_by_page(shape, np.int32))
    netcdf.add_map(dataset, FIRST_ARRIVAL, np.full(shape, np.nan, np.float32))
    layers_of_percentiles = (dataset.sizes["percentile"], *shape)
    of_quantities = [q.percentile or f"{q.part_of}_percentile" for q in quantities.values()]
    for name in dict.fromkeys(of_quantities):
        netcdf.add_map(dataset, name, zeros_by_page(layers_of_percentiles, np.float32), ("percentile",))
    netcdf.add_map(dataset, ARRIVAL_PERCENTILE, np.full(layers_of_percentiles, np.nan, np.float32), ("percentile",))
    dataset["effective_sample_size"] = effective_sample_size(weights)
    return dataset


def with_annual_maps(
    dataset: "xr.Dataset", return_periods: Sequence[float], quantities: Mapping[str, MapQuantity] = QUANTITIES
) -> "xr.Dataset":
    """The maps of :func:`empty_maps` with those of annual rates at zero, and values at return periods that nothing reaches."""
    shape = (dataset.sizes["y"], dataset.sizes["x"])
    names = {q.annual_exceedance: q.threshold for q in quantities.values()} | {"joint_annual_exceedance": "joint"}
    for name, dimension in names.items():
        if dimension in dataset.coords:
            netcdf.add_map(dataset, name, zeros_by_page((dataset.sizes[dimension], *shape), np.float32), (dimension,))
    if len(return_periods):
        dataset = dataset.assign_coords(return_period=np.unique(np.asarray(return_periods, np.float64)))
        for name in filter(None, (q.at_return_period for q in quantities.values())):
            nowhere = np.full((dataset.sizes["return_period"], *shape), np.nan, np.float32)
            netcdf.add_map(dataset, name, nowhere, ("return_period",))
    return dataset


def zeros_by_page(shape: tuple[int, ...], dtype: DTypeLike) -> np.ndarray[Any, Any]:
    """Zeros of which a page of the system, 4 KiB on most, takes memory with the first value that changes in it.

    ``numpy.zeros`` asks Linux for pages of 2 MiB in arrays above 4 MiB. A flow in a few rows of a map then takes most of the map.
    Without that choice of pages, as on other systems, they are those of ``numpy.zeros``.
    """
    if not hasattr(mmap, "MADV_NOHUGEPAGE"):
        return np.zeros(shape, dtype)
    values = math.prod(shape)
    size = max(1, values * np.dtype(dtype).itemsize)
    try:
        memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError as cause:
        raise MemoryError(f"{size} bytes for maps of {shape} cells") from cause
    with suppress(OSError):  # of a kernel without huge pages
        memory.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(memory, dtype, values).reshape(shape)
