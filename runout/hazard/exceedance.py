"""Exceedance probabilities, percentiles and extremes over the members of an ensemble."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runout.errors import StorageError
from runout.io import netcdf
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

BLOCK_BYTES = 256 * 1024**2  # of all members' values in memory at once
_SMALLEST_BLOCK = 16  # rows
_ROUNDING = 1e-12  # summed weights of equal members reach 1/2 exactly
_COPIES = 4  # the stack, its wet columns, their order and their summed weights


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


def aggregate(
    members: Sequence[Path],
    weights: Sequence[float] | np.ndarray,
    thresholds: Mapping[str, Sequence[float]],
    percentiles: Sequence[float],
    *,
    block_bytes: int = BLOCK_BYTES,
) -> "xr.Dataset":
    """Hazard maps of the members' files, on their grid.

    Members are read in blocks of rows, so that memory is bounded by ``block_bytes`` and the maps themselves. Probability
    is the summed weight of the members whose maximum reaches the threshold, with the standard error
    ``sqrt(p (1 - p) / N_eff)``, ``N_eff = 1 / sum(w^2)``; a percentile is the smallest value at which the summed
    weight reaches it. A cell that any member leaves undefined (NaN) is undefined.

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

    Raises
    ------
    StorageError
        If a member's file cannot be read, lacks a map, or lies on another grid than the first.
    ValueError
        If there are no members, the weights do not fit, or there is no threshold of thickness.
    """
    if len(thresholds.get("thickness", ())) == 0:
        raise ValueError("no threshold of the flow thickness is given; inundation needs one, for example 0.1 m")
    w = normalised(weights, len(members))
    dataset = _empty(members[0], thresholds, percentiles, w)
    _require_one_grid(members, dataset)
    rows = _rows_per_block(len(members), dataset.sizes["x"], block_bytes)
    for first in range(0, dataset.sizes["y"], rows):
        block = slice(first, min(first + rows, dataset.sizes["y"]))
        for name in thresholds:
            _aggregate_quantity(dataset, members, w, name, block)
        _aggregate_deposit(dataset, members, w, block)
        arrival = _stack(members, "arrival_time", block)
        dataset["first_arrival_time"][block] = np.fmin.reduce(arrival, axis=0)
    dataset["inundation_probability"][:] = dataset["thickness_exceedance_probability"].values[0]
    return dataset


def normalised(weights: Sequence[float] | np.ndarray, count: int) -> np.ndarray:
    """Weights (count,) of sum 1."""
    w = np.asarray(weights, dtype=np.float64)
    if count == 0 or w.shape != (count,):
        raise ValueError(f"{count} members and {w.size} weights; at least one member, and a weight for each, are needed")
    if not (np.isfinite(w).all() and w.min() >= 0 and w.sum() > 0):
        raise ValueError(f"weights range from {w.min():g} to {w.max():g}; they must be finite, not negative, and not all 0")
    return w / w.sum()


def effective_sample_size(weights: np.ndarray) -> float:
    """Number of equally weighted members that would be as certain, 1 / sum(w^2), for weights of sum 1."""
    return float(1.0 / np.sum(np.square(weights)))


def weighted_percentiles(values: np.ndarray, weights: np.ndarray, percentiles: Sequence[float] | np.ndarray) -> np.ndarray:
    """Percentiles (k, cells) over the first axis of ``values`` (members, cells), for weights of sum 1.

    The smallest value at which the summed weight reaches the percentile (the inverted distribution function).
    """
    order = np.argsort(values, axis=0)
    reached = np.cumsum(weights[order], axis=0)
    ranks = [np.argmax(reached >= q / 100.0 - _ROUNDING, axis=0) for q in percentiles]
    index = np.stack([np.take_along_axis(order, rank[None], axis=0)[0] for rank in ranks])
    return np.take_along_axis(values, index, axis=0)


def _aggregate_quantity(dataset: "xr.Dataset", members: Sequence[Path], w: np.ndarray, name: str, block: slice) -> None:
    quantity = QUANTITIES[name]
    stack = _stack(members, quantity.member_map, block)
    wet, unknown = _wet_and_unknown(stack)
    values = stack[:, wet]
    if f"{name}_threshold" in dataset.coords:
        limits = dataset[f"{name}_threshold"].values.astype(stack.dtype)
        p = np.stack([np.clip(w @ (values >= limit), 0.0, 1.0) for limit in limits])
        error = np.sqrt(p * (1.0 - p) / effective_sample_size(w))
        _place(dataset, f"{name}_exceedance_probability", p, wet, unknown, block)
        _place(dataset, f"{name}_exceedance_standard_error", error, wet, unknown, block)
    _place(dataset, quantity.percentile, weighted_percentiles(values, w, dataset["percentile"].values), wet, unknown, block)
    _place(dataset, quantity.peak, values.max(axis=0), wet, unknown, block)
    if name == "thickness":
        _place(dataset, "members_reached", (values >= limits[0]).sum(axis=0), wet, unknown, block)


def _aggregate_deposit(dataset: "xr.Dataset", members: Sequence[Path], w: np.ndarray, block: slice) -> None:
    stack = _stack(members, "deposit_thickness", block)
    wet, unknown = _wet_and_unknown(stack)
    values = stack[:, wet]
    quantiles = weighted_percentiles(values, w, dataset["percentile"].values)
    _place(dataset, "deposit_thickness_percentile", quantiles, wet, unknown, block)
    _place(dataset, "mean_deposit_thickness", w @ values, wet, unknown, block)
    _place(dataset, "peak_deposit_thickness", values.max(axis=0), wet, unknown, block)


def _wet_and_unknown(stack: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cells (rows, columns) that any member reaches, and those that any member leaves undefined."""
    unknown = np.isnan(stack).any(axis=0)
    return (stack > 0).any(axis=0) & ~unknown, unknown


def _place(dataset: "xr.Dataset", name: str, values: np.ndarray, wet: np.ndarray, unknown: np.ndarray, block: slice) -> None:
    target = dataset[name].values[..., block, :]
    target[..., wet] = values
    target[..., unknown] = np.nan if target.dtype.kind == "f" else VARIABLES[name].fill


def _stack(members: Sequence[Path], name: str, block: slice) -> np.ndarray:
    return np.stack([netcdf.read_rows(path, name, block) for path in members])


def _rows_per_block(members: int, columns: int, block_bytes: int) -> int:
    rows = block_bytes // (members * columns * np.dtype(np.float32).itemsize * _COPIES)
    whole_chunks = rows - rows % netcdf.CHUNK
    return int(whole_chunks or max(rows, _SMALLEST_BLOCK))


def _empty(
    first: Path, thresholds: Mapping[str, Sequence[float]], percentiles: Sequence[float], weights: np.ndarray
) -> "xr.Dataset":
    """All maps at zero on the grid of the first member."""
    dataset = netcdf.read_grid(first)
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
    for name in ("inundation_probability", "mean_deposit_thickness", "peak_deposit_thickness", "first_arrival_time"):
        netcdf.add_map(dataset, name, np.zeros(shape, np.float32))
    netcdf.add_map(dataset, "members_reached", np.zeros(shape, np.int32))
    dataset["effective_sample_size"] = effective_sample_size(weights)
    return dataset


def _require_one_grid(members: Sequence[Path], dataset: "xr.Dataset") -> None:
    for path in members[1:]:
        grid = netcdf.read_grid(path)
        if not (np.array_equal(grid["x"], dataset["x"]) and np.array_equal(grid["y"], dataset["y"])):
            raise StorageError(
                f"{path}: its grid ({grid.sizes['y']} rows, {grid.sizes['x']} columns) is not that of {members[0].name}; "
                "the elevation raster has changed in between, remove the file and run the ensemble again"
            )
