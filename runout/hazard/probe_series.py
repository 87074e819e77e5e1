"""Series at the probes of one member, or their percentiles over the members of an ensemble."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runout.errors import StorageError
from runout.hazard.order import normalised, weighted_percentiles
from runout.io import netcdf
from runout.io.probe_files import PERCENTILE, POINTS, SECTIONS, STATION, TIME, add_values
from runout.quantities import ARRIVAL
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

PERCENTILES = (5.0, 50.0, 95.0)


def member_series(path: Path) -> "dict[str, xr.Dataset]":
    """Series of a member's file, by the names of their groups.

    Raises StorageError if the file holds none, or cannot be read.
    """
    groups = _groups(path)
    if not groups:
        raise StorageError(f"{path}: holds no series of probes; run the member again with probes")
    return {group: netcdf.read(path, group) for group in groups}


def ensemble_series(
    files: Sequence[Path], weights: Sequence[float] | np.ndarray, percentiles: Sequence[float] = PERCENTILES
) -> "dict[str, xr.Dataset]":
    """Percentiles of the series of members, (percentile, station, time), and of their peaks, (percentile, station).

    A percentile is that of each time for itself: the curve of a percentile is no member. It is the smallest value at which the
    summed weight reaches it. Members that never arrive count as infinity in the arrival time; ``arrival_probability`` is the weight
    of those that do.

    Parameters
    ----------
    files : sequence of Path
        Files of the valid members.
    weights : sequence of float
        Their weights; any positive scale.
    percentiles : sequence of float
        [percent].

    Raises
    ------
    StorageError
        If a file holds no series, or those of other probes than the first.
    """
    w = normalised(weights, len(files))
    first = member_series(files[0])
    values: dict[str, list[dict[str, np.ndarray]]] = {group: [] for group in first}
    for path in files:
        for group, dataset in member_series(path).items():
            _require_same(dataset, first.get(group), path, files[0])
            values[group].append({str(n): v.values.astype(np.float32) for n, v in dataset.data_vars.items() if _is_sampled(v)})
    return {group: _aggregated(first[group], several, w, percentiles) for group, several in values.items()}


def _is_sampled(variable: "xr.DataArray") -> bool:
    return STATION in variable.dims and variable.name not in ("node_count", "section_length")


def _groups(path: Path) -> list[str]:
    import netCDF4

    with netcdf.reading(path), netCDF4.Dataset(path) as file:
        return [group for group in (POINTS, SECTIONS) if group in file.groups]


def _require_same(dataset: "xr.Dataset", first: "xr.Dataset | None", path: Path, other: Path) -> None:
    if first is not None and all(dataset[name].equals(first[name]) for name in (TIME, "x", "y", "station_name")):
        return
    raise StorageError(f"{path}: its probes are not those of {other.name}; run the ensemble again")


def _aggregated(
    first: "xr.Dataset", several: list[dict[str, np.ndarray]], weights: np.ndarray, percentiles: Sequence[float]
) -> "xr.Dataset":
    dataset = first.drop_vars(list(several[0])).assign_coords({PERCENTILE: (PERCENTILE, np.array(percentiles, float))})
    for name in several[0]:
        stacked: np.ndarray = np.stack([one[name] for one in several])
        if name == ARRIVAL:
            add_values(dataset, "arrival_probability", (np.isfinite(stacked) * weights[:, None]).sum(axis=0).clip(0, 1), (STATION,))
        over_members = percentiles_of(stacked, weights, percentiles)
        add_values(dataset, name, over_members, (PERCENTILE, *first[name].dims))  # type: ignore[arg-type]
        dataset[name].attrs["long_name"] = f"percentile over the members of the {VARIABLES[name].long_name}"
    return dataset.assign_attrs(members=len(several))


def percentiles_of(values: np.ndarray, weights: np.ndarray, percentiles: Sequence[float]) -> np.ndarray:
    """Percentiles (k, ...) over the first axis of values (members, ...); NaN counts as infinity, as a time that never comes."""
    filled = np.where(np.isnan(values), np.inf, values).reshape(len(values), -1)
    over_members = weighted_percentiles(filled, weights, percentiles)
    return np.where(np.isinf(over_members), np.nan, over_members).reshape(len(percentiles), *values.shape[1:])  # type: ignore[no-any-return]
