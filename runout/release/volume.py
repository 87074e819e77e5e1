"""Compares thickness and volume of a release with the stated volume."""

import numpy as np

from runout.errors import ReleaseError
from runout.model.limits import checked

TOLERANCE = 0.01  # largest relative difference of computed and stated volume
PRINTED = 1e-6  # smaller differences are rounding of a printed volume and not reported


def matched(thickness: np.ndarray, cell_area: float, volume: float | None, source: str) -> tuple[np.ndarray, tuple[str, ...]]:
    """Thickness scaled to the stated volume, and a sentence if the scaling is noticeable.

    Parameters
    ----------
    thickness : ndarray
        Mean thickness over cells of one size [m].
    cell_area : float
        [m2]
    volume : float or None
        Stated volume [m3]; None leaves the thickness as it is.

    Raises
    ------
    ReleaseError
        If both differ by more than 1 %.
    """
    if volume is None:
        return thickness, ()
    stated, computed = checked("volume", volume, place=source, error=ReleaseError), float(thickness.sum() * cell_area)
    if computed == 0:
        raise ReleaseError(f"{source}: the volume is stated as {stated:.6g} m3, but the thickness is 0 everywhere")
    difference = computed / stated - 1.0
    if abs(difference) > TOLERANCE:
        raise ReleaseError(
            f"{source}: area and thickness give {computed:.6g} m3, the stated volume is {stated:.6g} m3 ({difference:+.1%}); "
            f"correct one of them, or leave one out ({TOLERANCE:.0%} is allowed)"
        )
    if abs(difference) < PRINTED:
        return thickness * (stated / computed), ()
    factor = stated / computed
    return thickness * factor, (f"{source}: thickness scaled by {factor:.7g} to the stated {stated:.6g} m3.",)
