"""Quadratic B-splines on a unit lattice (Steffen, Kirby & Berzins 2008, IJNME 76:922, eq. 16).

A point sees three nodes an axis. ``f`` is its offset from the first of them in cells, 0.5 <= f < 1.5.
"""

import math
from typing import Any

from runout.physics.tensors import real, vec


def first_node(q: Any):
    """Index of the first of the three nodes that a point at lattice position ``q`` [cells] sees."""
    return int(math.floor(q - real(0.5)))


def weights(f: Any):
    """Weights of the three nodes; they sum to one."""
    a = real(1.5) - f
    b = f - real(1.0)
    c = f - real(0.5)
    return vec(real(0.5) * a * a, real(0.75) - b * b, real(0.5) * c * c)


def weight_slopes(f: Any):
    """Derivatives of the three weights with the position [1 / cell]; they sum to zero."""
    return vec(f - real(1.5), real(2.0) - real(2.0) * f, f - real(0.5))


def inverse_inertia(h: Any):
    """Inverse of D = h^2/4, the second moment of the weights [1/m2] (Jiang et al. 2016, sec. 5.3)."""
    return real(4.0) / (h * h)
