"""Maps over the members before any member counts."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from runout.hazard.joint import Condition, with_conditions
from runout.hazard.order import effective_sample_size
from runout.hazard.zeros import zeros_by_page
from runout.io import netcdf
from runout.map_quantities import ARRIVAL_PERCENTILE, FIRST_ARRIVAL, QUANTITIES, MapQuantity

if TYPE_CHECKING:
    import xarray as xr


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
        for product in filter(None, (quantity.peak, quantity.mean)):
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
    for quantity in quantities.values():
        netcdf.add_map(dataset, quantity.percentile, zeros_by_page(layers_of_percentiles, np.float32), ("percentile",))
    netcdf.add_map(dataset, ARRIVAL_PERCENTILE, np.full(layers_of_percentiles, np.nan, np.float32), ("percentile",))
    dataset["effective_sample_size"] = effective_sample_size(weights)
    return dataset
