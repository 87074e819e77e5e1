"""The step of every law that yields: trial strain, return of the law, new state.

A law is a return mapping: from the Hencky strain of an elastic step it makes the strain of an admissible stress. It takes the place
of :func:`law_return` where kernels are compiled.

A mass with pore pressure yields by effective stress: its law gets a strain whose mean stress is the share 1 - lambda of the total
one (:func:`effective_return`). For a friction cone this is a cone of slope M (1 - lambda) on total stress.
"""

from typing import Any

from runout.physics.elastic import (
    kirchhoff_stress,
    log_strain,
    log_strain_series,
    pressure,
    strain_of_log,
    strain_series,
    trial_strain,
)
from runout.physics.tensors import added, contracted, real, scaled, shifted, trace


def same(a: Any, b: Any):
    """Whether two strains are equal: the material did not flow."""
    return (a[0] == b[0]) and (a[1] == b[1]) and (a[2] == b[2]) and (a[3] == b[3]) and (a[4] == b[4]) and (a[5] == b[5])


def gained_volume(h: Any, new: Any):
    """Log volume [1] that a return from Hencky strain ``h`` to ``new`` has taken from the strain, not below 0.

    A law without tension remembers it: it must be lost again before the material carries load (Tampubolon et al. 2017, ACM TOG
    36:105, sec. 4.3.4).
    """
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


def law_return(h: Any, history: Any, mat: Any):
    """Hencky strain, history and energy dissipated per stress-free volume [J/m3] after the return of a trial Hencky strain.

    Here that of a material without yield; the ``update`` of a law stands in its place where kernels are compiled.
    """
    return h, history, real(0.0)


def step(B: Any, L: Any, history: Any, mat: Any):
    """One step of a law.

    Returns the new B, the Hencky strain that gives its stress, the history variable and the energy
    dissipated per stress-free volume [J/m3].
    """
    trial = trial_strain(B, L)
    elastic = log_strain(trial)
    new, left, lost = law_return(elastic, history, mat)
    return end_of_step(trial, elastic, new, left, lost)


def step_small(B: Any, L: Any, history: Any, mat: Any):
    """:func:`step` without loops for small strain, and the square that ``elastic.is_small`` must accept."""
    trial = trial_strain(B, L)
    elastic = log_strain_series(trial)
    new, left, lost = law_return(elastic, history, mat)
    return end_of_small_step(trial, elastic, new, left, lost)


def history_share(history: Any, effective: Any):
    """Factor [1] of the history of a law where its strain has the factor ``effective`` of the trace.

    Here 1; :func:`volume_share` stands in its place for laws whose history is a gained volume.
    """
    return real(1.0)


def volume_share(history: Any, effective: Any):
    """:func:`history_share` of a gained volume, which adds to the trace of the strain; a history below 0 is none."""
    share = real(1.0)
    if history > real(0.0):
        share = effective
    return share


def with_trace(h: Any, share: Any):
    """Strain with the same deviator as ``h``, and ``share`` times its trace."""
    return shifted(h, (share - real(1.0)) * (real(1.0) / real(3.0)) * trace(h))


def effective_return(h: Any, history: Any, mat: Any, effective: Any):
    """:func:`law_return` where grains carry the share ``effective`` [1] of the mean stress, above 0."""
    inverse = real(1.0) / effective
    grains = with_trace(h, effective)
    new, left, lost = law_return(grains, history * history_share(history, effective), mat)
    left = left * history_share(left, inverse)
    if same(grains, new):
        return h, left, lost
    total = with_trace(new, inverse)
    by_water = (real(1.0) - effective * effective) * pressure(total, mat) * (trace(total) - trace(h))
    return total, left, lost + by_water


def dry_return(h: Any, history: Any, mat: Any):
    """:func:`law_return` of a law that states its return by effective stress, where grains carry all of the mean stress."""
    return effective_return(h, history, mat, real(1.0))


def effective_step(B: Any, L: Any, history: Any, mat: Any, effective: Any):
    """:func:`step` by effective stress."""
    trial = trial_strain(B, L)
    elastic = log_strain(trial)
    new, left, lost = effective_return(elastic, history, mat, effective)
    return end_of_step(trial, elastic, new, left, lost)


def effective_step_small(B: Any, L: Any, history: Any, mat: Any, effective: Any):
    """:func:`step_small` by effective stress."""
    trial = trial_strain(B, L)
    elastic = log_strain_series(trial)
    new, left, lost = effective_return(elastic, history, mat, effective)
    return end_of_small_step(trial, elastic, new, left, lost)
