"""What the laws that flow share: the end of a step, once the return has said which stress is left.

The return remembers the log volume that was gained without stress; it must be lost again before the material carries load
(Tampubolon et al. 2017, ACM TOG 36:105, sec. 4.3.4).
"""

from typing import Any

from runout.physics.elastic import kirchhoff_stress, strain_of_log, strain_series
from runout.physics.tensors import added, contracted, real, scaled, trace


def same(a: Any, b: Any):
    """Whether two strains are equal: the material did not flow."""
    return (a[0] == b[0]) and (a[1] == b[1]) and (a[2] == b[2]) and (a[3] == b[3]) and (a[4] == b[4]) and (a[5] == b[5])


def gained_volume(h: Any, new: Any):
    """Log volume [1] that a return from Hencky strain ``h`` to ``new`` has taken from the strain, not below 0."""
    left = trace(h) - trace(new)
    if left < real(0.0):
        left = real(0.0)
    return left


def dissipated_energy(elastic: Any, new: Any, mat: Any):
    """Energy [J/m3] that the flow from a trial strain takes per stress-free volume.

    tau : flow, not the drop of stored energy: that adds the energy of the whole trial overshoot, first order in dt.
    """
    return contracted(kirchhoff_stress(new, mat), added(elastic, scaled(new, real(-1.0))))


def end_of_step(trial: Any, elastic: Any, new: Any, left: Any, lost: Any):
    """New B, the Hencky strain that gives its stress, history, and energy dissipated per stress-free volume [J/m3].

    From the trial strain, its Hencky strain, and what a return made of it.
    """
    if same(elastic, new):
        return trial, elastic, left, real(0.0)
    return strain_of_log(new), new, left, lost


def end_of_small_step(trial: Any, elastic: Any, new: Any, left: Any, lost: Any):
    """:func:`end_of_step` without loops for small strain, and the square that ``elastic.is_small`` must accept."""
    square = contracted(trial, trial)
    if square < real(4.0) * contracted(new, new):
        square = real(4.0) * contracted(new, new)
    if same(elastic, new):
        return trial, elastic, left, real(0.0), square
    return strain_series(scaled(new, real(2.0))), new, left, lost, square
