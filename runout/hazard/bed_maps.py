"""Means over the members of an ensemble with an erodible bed: change of elevation, and share of the bed in the deposit."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from runout.io import netcdf
from runout.io.member_maps import MemberMaps
from runout.quantities import CHANGE, CHANGE_PERCENTILE, DEPOSIT, QUANTITIES, SHARE

if TYPE_CHECKING:
    import xarray as xr

MEAN_CHANGE, MEAN_SHARE = f"mean_{CHANGE}", f"mean_{SHARE}"
BED_MEANS = (MEAN_CHANGE, MEAN_SHARE)
CHANGES = (MEAN_CHANGE, CHANGE_PERCENTILE)  # maps of one scale


class BedMaps:
    """Sums over members, each taken once; nothing where the members have no bed.

    Parameters
    ----------
    weights : sequence of float
        Of the members; their sum is 1.
    """

    def __init__(self, weights: Sequence[float] | np.ndarray):
        self.weights = weights
        self.change: np.ndarray | None = None  # weighted mean [m]
        self.deposit = self.of_bed = np.zeros(())  # weighted mean thickness [m], and the part of it from the bed

    def take(self, number: int, member: MemberMaps) -> None:
        """Add the maps of the member at a place among the weights."""
        if CHANGE not in member.held():
            return
        known, weight = member.known(), float(self.weights[number])
        names = (CHANGE, QUANTITIES[DEPOSIT].member_map, SHARE)
        change, deposit, share = (member.layer(name, known).astype(np.float64) for name in names)
        self.change = weight * change + (0.0 if self.change is None else self.change)
        self.deposit = self.deposit + weight * deposit
        self.of_bed = self.of_bed + weight * deposit * np.nan_to_num(share)

    def add_to(self, dataset: "xr.Dataset") -> None:
        """Put the maps into a dataset on the raster; undefined where a member has no value, shares also without deposit."""
        if self.change is None:
            return
        share = np.full(self.change.shape, np.nan)
        np.divide(self.of_bed, self.deposit, out=share, where=self.deposit > 0.0)
        netcdf.add_map(dataset, MEAN_CHANGE, self.change)
        netcdf.add_map(dataset, MEAN_SHARE, share)
