"""A point of material that is strained: records of parameters, simple shear, pressure, stresses."""

import math
from types import SimpleNamespace

from runout.model.laws import law_of
from runout.physics import elastic


def record(material, **more):
    """Record of parameters of a material and its bulk modulus [Pa]; ``more`` numbers, such as the time step."""
    return SimpleNamespace(**material.record() | {"bulk": material.lame_lambda + 2 * material.shear_modulus / 3} | more)


def pressed(mat, pressure):
    """B = b_e - I [1] of a mean pressure [Pa]."""
    return elastic.strain_of_log((*[-pressure / (3 * mat.bulk)] * 3, 0.0, 0.0, 0.0))


def sheared(material, mat, B, gamma, steps, history=0.0):
    """Hencky strain, history and dissipated energy [J/m3] after each step of simple shear at constant volume to ``gamma``."""
    step, states = law_of(material).step, []
    for _ in range(steps):
        B, h, history, lost = step(B, (0.0, gamma / steps, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), history, mat)
        states.append((h, history, lost))
    return states


def shear_stress(h, mat):
    """s = sqrt(J_2) [Pa]."""
    return elastic.deviatoric_stress(h, mat) / math.sqrt(3.0)
