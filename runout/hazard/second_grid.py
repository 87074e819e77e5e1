"""Numerical error in each cell, from the same members on a second grid, and which of three errors decides there.

Errors of the grid are of first order in its cells (``docs/error_budget.md``). The difference of a map from that of cells c times as
large is c - 1 times its own error, so the error is the difference over c - 1. Where two maps cross, that is 0 by chance, and a flow
whose edge lies elsewhere errs beside the edge as well: a cell has the largest error within a cell of the second grid around it.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runout.forecast.sampling_error import BAR
from runout.hazard.members import Ensemble
from runout.io import netcdf
from runout.io.places import SECOND_GRID
from runout.model.limits import spacing_of
from runout.quantities import ALL_QUANTITIES, QUANTITIES

if TYPE_CHECKING:
    import xarray as xr

    from runout.config.site import Site

RATIO = 1.5  # cells of the second grid over those of the first; its members have a fifth of the particle-steps
DECIDING = "deciding_error"
SOURCES = (("parameters", "#0072b2"), ("grid", "#e69f00"), ("number of members", "#cc79a7"))  # and colours, from 1 on


def on_second_grid(site: "Site", members: int) -> "Site":
    """A site with its first members on the cells of the second grid."""
    size = spacing_of(site.resolved()["simulation"]["cell_size"])
    update = {"members": members, "tolerance": None} if getattr(site.settings.ensemble, "tolerance", None) is not None else {}
    return site.with_settings(
        simulation=site.settings.simulation.with_cell_size(tuple(RATIO * one for one in size)),
        ensemble=site.settings.ensemble.model_copy(update=update),
    )


def of_members(first: Ensemble, results: Path, site: "Site") -> Ensemble | None:
    """The members of an ensemble on the second grid, in ``second_grid`` of its results; None unless each valid member is there."""
    from runout.ensemble.member import planned_table

    if not (Path(results) / SECOND_GRID / "members").is_dir():
        return None
    second = Ensemble.of(Path(results) / SECOND_GRID, planned_table(on_second_grid(site, len(first.table))))
    if not set(first.files) <= set(second.files):
        return None
    return replace(second, files={number: second.files[number] for number in first.files})


def numerical_error(first: np.ndarray, second: np.ndarray, reach: tuple[int, int]) -> np.ndarray:
    """Bar of the numerical error of a map (rows, columns) from that of the second grid, both 0 or more; unknown cells stay so.

    Parameters
    ----------
    reach : tuple of int
        Rows and columns to either side within which the largest error counts.
    """
    from scipy.ndimage import maximum_filter

    difference = np.abs(np.nan_to_num(first) - np.nan_to_num(second)) / (RATIO - 1.0)
    error: np.ndarray = maximum_filter(difference, tuple(2 * cells + 1 for cells in reach))
    return np.where(np.isnan(first), np.nan, error)


def add_errors(hazard: "xr.Dataset", second: "xr.Dataset", spacing: tuple[float, float]) -> None:
    """Put the numerical errors of means and probabilities into hazard maps, and which error decides.

    Parameters
    ----------
    hazard, second : xarray.Dataset
        Maps of the same members on both grids, on the same raster.
    spacing : tuple of float
        Cells of the second grid, north and east [m].
    """
    size = (abs(float(hazard[axis][1] - hazard[axis][0])) for axis in ("y", "x"))
    reach = tuple(max(1, round(cells / one)) for cells, one in zip(spacing, size, strict=True))
    for source, name in _pairs(hazard):
        first, other = hazard[source], second[source]
        layers = first.values.reshape(-1, *first.shape[-2:]), other.values.reshape(-1, *other.shape[-2:])
        errors = np.stack([numerical_error(a, b, (reach[0], reach[1])) for a, b in zip(*layers, strict=True)])
        largest = 1.0 if "probability" in source else np.inf
        netcdf.add_map(hazard, name, np.minimum(errors, largest).reshape(first.shape), tuple(map(str, first.dims[:-2])))
    _add_deciding(hazard)


def _pairs(hazard: "xr.Dataset") -> Iterator[tuple[str, str]]:
    """Name of each map with a numerical error, and of that error."""
    for quantity in ALL_QUANTITIES.values():
        names = quantity.mean, quantity.numerical_error
        if names[0] in hazard:
            yield names
    for name in (*ALL_QUANTITIES, "joint"):
        if f"{name}_exceedance_probability" in hazard:
            yield f"{name}_exceedance_probability", f"{name}_exceedance_numerical_error"


def _add_deciding(hazard: "xr.Dataset") -> None:
    """Put in which of three errors of the mean thickness is the largest: 1 parameters, 2 grid, 3 number of members."""
    thickness = QUANTITIES["thickness"]
    bars = [BAR * hazard[thickness.deviation].values, hazard[thickness.numerical_error].values]
    bars.append(BAR * hazard[thickness.standard_error].values)
    known = np.nan_to_num(np.stack(bars))
    deciding = np.where(known.max(axis=0) > 0, known.argmax(axis=0) + 1, 0).astype(np.uint8)
    netcdf.add_map(hazard, DECIDING, deciding)
    hazard[DECIDING].attrs |= {
        "flag_values": np.arange(len(SOURCES) + 1, dtype=np.uint8),
        "flag_meanings": " ".join(["none", *(words.replace(" ", "_") for words, _ in SOURCES)]),
    }
