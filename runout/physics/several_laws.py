"""Several laws in one run: each mass follows its own.

A record of parameters holds the number of its law, ``law_number``. Where kernels are compiled, a function here takes the place of
that of a single law; it calls the function of law number :data:`LAW` for records of that law, and passes the others on to the
next of a chain (:mod:`runout.model.law_mixtures`).
"""

from typing import Any

from runout.physics.contact import law_resistance
from runout.physics.contact import law_resistance as other_law_resistance
from runout.physics.plastic import effective_return, law_return
from runout.physics.plastic import effective_return as other_effective_return
from runout.physics.plastic import law_return as other_law_return
from runout.physics.tensors import real

LAW = 0  # number of the law whose function a link of the chain calls


def own_return(h: Any, history: Any, mat: Any):
    """:func:`runout.physics.plastic.law_return` of the law that the record ``mat`` belongs to."""
    if mat.law_number == real(LAW):
        return law_return(h, history, mat)
    return other_law_return(h, history, mat)


def own_effective_return(h: Any, history: Any, mat: Any, effective: Any):
    """:func:`runout.physics.plastic.effective_return` of the law that the record ``mat`` belongs to."""
    if mat.law_number == real(LAW):
        return effective_return(h, history, mat, effective)
    return other_effective_return(h, history, mat, effective)


def own_resistance(normal: Any, slip: Any, area: Any, dt: Any, basal: Any):
    """:func:`runout.physics.contact.law_resistance` of the law that the record ``basal`` belongs to."""
    if basal.law_number == real(LAW):
        return law_resistance(normal, slip, area, dt, basal)
    return other_law_resistance(normal, slip, area, dt, basal)
