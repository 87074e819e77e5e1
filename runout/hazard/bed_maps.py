"""Maps over the members of an ensemble with an erodible bed: eroded depth and change of elevation."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from runout.io import netcdf
from runout.io.member_maps import MemberMaps
from runout.quantities import CHANGE, ERODED

if TYPE_CHECKING:
    import xarray as xr

BED_PRODUCTS = (
    "mean_eroded_depth",
    "peak_eroded_depth",
    "mean_elevation_change",
    "net_erosion_probability",
    "net_deposition_probability",
)


class BedMaps:
    """Sums over members, each taken once; nothing where the members have no bed.

    Parameters
    ----------
    weights : sequence of float
        Of the members; their sum is 1.
    threshold : float
        Least change of elevation [m] that counts as erosion or deposition.
    """

    def __init__(self, weights: Sequence[float] | np.ndarray, threshold: float):
        self.weights, self.threshold = weights, threshold
        self.maps: dict[str, np.ndarray] = {}

    def take(self, number: int, member: MemberMaps) -> None:
        """Add the maps of the member at a place among the weights."""
        if CHANGE not in member.held():
            return
        known, weight = member.known(), float(self.weights[number])
        eroded, change = (member.layer(name, known).astype(np.float64) for name in (ERODED, CHANGE))
        sums = {
            "mean_eroded_depth": weight * eroded,
            "mean_elevation_change": weight * change,
            "net_erosion_probability": weight * (change <= -self.threshold),
            "net_deposition_probability": weight * (change >= self.threshold),
        }
        for name, values in sums.items():
            self.maps[name] = self.maps.get(name, 0.0) + values
        self.maps["peak_eroded_depth"] = np.maximum(self.maps.get("peak_eroded_depth", 0.0), eroded)

    def add_to(self, dataset: "xr.Dataset") -> None:
        """Put the maps into a dataset on the raster; undefined where a member has no value."""
        for name, values in self.maps.items():
            netcdf.add_map(dataset, name, np.where(np.isnan(self.maps["mean_elevation_change"]), np.nan, values))
