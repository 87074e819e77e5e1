"""How often the numerical error of the cells holds against half the cells.

``python tests/benchmarks/second_grid.py RESULTS FINER``: RESULTS is a folder of ``runout verify SITE --second-grid``, FINER one of
``runout run SITE --set simulation.cell_size=H/2 --out FINER`` with half the cells. Prints the share of the cells in which the
difference of the two stays within the bar, among those that either reaches, and the median bar over the median difference. The
figures of docs/guide/maps.md have cells of 20 m for jacksboro and frank_slide, and of 5 m for cascades_2021, with eight members.
"""

import sys
from pathlib import Path

import numpy as np
import xarray as xr


def coverage(first: xr.DataArray, finer: xr.DataArray, error: xr.DataArray, least: float) -> tuple[float, float]:
    """Share of the cells whose difference is within the bar, and median bar over median difference."""
    difference = np.abs(first.values - finer.values)
    reached = (first.values > least) | (finer.values > least)
    bar = error.values[reached]
    return float((difference[reached] <= bar + 1e-6).mean()), float(np.median(bar) / max(np.median(difference[reached]), 1e-9))


def main(results: Path, finer: Path) -> None:
    """Print the mean thickness, then each probability of thickness."""
    with xr.open_dataset(results / "hazard.nc") as a, xr.open_dataset(finer / "hazard.nc") as b:
        names = "mean_flow_thickness", "flow_thickness_numerical_error"
        share, ratio = coverage(a[names[0]], b[names[0]], a[names[1]], 0.05)
        print(f"mean thickness: holds in {100 * share:.0f} % of the cells, median bar {ratio:.1f} times the median difference")
        for limit in a["thickness_threshold"].values:
            name = "thickness_exceedance_probability"
            maps = a[name], b[name], a[name.replace("probability", "numerical_error")]
            p, q, error = (values.sel(thickness_threshold=limit) for values in maps)
            print(f"probability of {limit:g} m: holds in {100 * coverage(p, q, error, 0.0)[0]:.0f} % of the cells")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:3]))
