"""Modelled change of the ground against a DEM of difference: parts of erosion and deposition."""

from dataclasses import dataclass

import numpy as np

from runout.scores.contingency import Contingency, contingency
from runout.scores.field_errors import FieldErrors, field_errors


@dataclass(frozen=True)
class ChangeErrors:
    """Errors of a change of elevation, as a whole and by its two parts.

    Attributes
    ----------
    change : FieldErrors
        Of the change [m], negative where the ground is lowered; its sums are net volumes [m3].
    erosion, deposition : FieldErrors
        Of the lowering and of the rise alone, both positive [m]; their sums are volumes [m3].
    erosion_area, deposition_area, changed_area : Contingency
        Of the areas that are lowered, raised, or either of both by the detection limit or more.
    """

    change: FieldErrors
    erosion: FieldErrors
    deposition: FieldErrors
    erosion_area: Contingency
    deposition_area: Contingency
    changed_area: Contingency


def elevation_change(deposit: np.ndarray, release: np.ndarray) -> np.ndarray:
    """Change of the ground (rows, columns) [m] by a mass that left its scar: deposit minus release, both vertical."""
    return np.asarray(deposit, np.float64) - np.asarray(release, np.float64)


def change_errors(modelled: np.ndarray, observed: np.ndarray, cell_area: float = 1.0, detection_limit: float = 0.0) -> ChangeErrors:
    """Errors of a modelled change of elevation against a DEM of difference.

    Parameters
    ----------
    modelled, observed : ndarray (rows, columns)
        Later minus earlier elevation [m], NaN where unknown.
    cell_area : float
        Area of a cell [m2].
    detection_limit : float
        Smallest change [m] that counts, of both (Wheaton et al. 2010, Earth Surf. Process. Landforms 35:136); smaller ones
        count as 0.

    Raises
    ------
    ObservationError
        If the shapes differ.
    """
    m, o = (detected(values, detection_limit) for values in (modelled, observed))
    lowered, raised = ((np.maximum(sign * m, 0.0), np.maximum(sign * o, 0.0)) for sign in (-1.0, 1.0))
    return ChangeErrors(
        field_errors(m, o, cell_area),
        field_errors(lowered[0], lowered[1], cell_area),
        field_errors(raised[0], raised[1], cell_area),
        contingency(_above_zero(lowered[0]), _above_zero(lowered[1]), cell_area),
        contingency(_above_zero(raised[0]), _above_zero(raised[1]), cell_area),
        contingency(_above_zero(np.abs(m)), _above_zero(np.abs(o)), cell_area),
    )


def detected(change: np.ndarray, limit: float) -> np.ndarray:
    """A change of elevation [m] with 0 where it is smaller than the detection limit [m]."""
    change = np.asarray(change, np.float64)
    return np.where(np.abs(change) < limit, 0.0, change)


def _above_zero(values: np.ndarray) -> np.ndarray:
    return np.where(np.isnan(values), np.nan, values > 0.0)
