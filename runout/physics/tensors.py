"""Vectors and tensors as opaque values: build them with ``vec``, ``sym`` and ``tens``, index them, never operate on them.

As plain Python they are tuples; warp binds them to its vector types. Components of a symmetric tensor are ordered
xx, yy, zz, xy, yz, zx; of a general one by rows.
"""

import math
from typing import Any

real = float
i64 = int


def vec(x, y, z):
    return (x, y, z)


def sym(xx, yy, zz, xy, yz, zx):
    return (xx, yy, zz, xy, yz, zx)


def tens(xx, xy, xz, yx, yy, yz, zx, zy, zz):
    return (xx, xy, xz, yx, yy, yz, zx, zy, zz)


def dot(a: Any, b: Any):
    """Scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def trace(a: Any):
    """Trace of a symmetric tensor."""
    return a[0] + a[1] + a[2]


def isotropic(a: Any):
    """Symmetric tensor a I."""
    return sym(a, a, a, real(0.0), real(0.0), real(0.0))


def shifted(a: Any, s: Any):
    """a + s I."""
    return sym(a[0] + s, a[1] + s, a[2] + s, a[3], a[4], a[5])


def scaled(a: Any, s: Any):
    """s a."""
    return sym(s * a[0], s * a[1], s * a[2], s * a[3], s * a[4], s * a[5])


def added(a: Any, b: Any):
    """a + b."""
    return sym(a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5])


def contracted(a: Any, b: Any):
    """Double contraction a : b of two symmetric tensors."""
    shear = a[3] * b[3] + a[4] * b[4] + a[5] * b[5]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + real(2.0) * shear


def norm(a: Any):
    """Frobenius norm of a symmetric tensor."""
    return math.sqrt(contracted(a, a))


def deviator(a: Any):
    """a - tr(a)/3 I."""
    return shifted(a, -trace(a) * (real(1.0) / real(3.0)))


def product(a: Any, b: Any):
    """Product of two symmetric tensors that commute (functions of one tensor), again symmetric."""
    return sym(
        a[0] * b[0] + a[3] * b[3] + a[5] * b[5],
        a[3] * b[3] + a[1] * b[1] + a[4] * b[4],
        a[5] * b[5] + a[4] * b[4] + a[2] * b[2],
        a[0] * b[3] + a[3] * b[1] + a[5] * b[4],
        a[3] * b[5] + a[1] * b[4] + a[4] * b[2],
        a[5] * b[0] + a[4] * b[3] + a[2] * b[5],
    )


def inverse(a: Any):
    """Inverse of a symmetric tensor that is not singular."""
    xx = a[1] * a[2] - a[4] * a[4]
    xy = a[5] * a[4] - a[3] * a[2]
    zx = a[3] * a[4] - a[1] * a[5]
    d = real(1.0) / (a[0] * xx + a[3] * xy + a[5] * zx)
    return sym(
        xx * d,
        (a[0] * a[2] - a[5] * a[5]) * d,
        (a[0] * a[1] - a[3] * a[3]) * d,
        xy * d,
        (a[3] * a[5] - a[0] * a[4]) * d,
        zx * d,
    )


def invariants(a: Any):
    """The three principal invariants of a symmetric tensor."""
    squares = a[3] * a[3] + a[4] * a[4] + a[5] * a[5]
    second = a[0] * a[1] + a[1] * a[2] + a[2] * a[0] - squares
    xx = a[1] * a[2] - a[4] * a[4]
    xy = a[5] * a[4] - a[3] * a[2]
    zx = a[3] * a[4] - a[1] * a[5]
    return vec(trace(a), second, a[0] * xx + a[3] * xy + a[5] * zx)


def horner(P: Any, K: Any, c: Any):
    """Coefficients of a P + c I, where P = P_0 a^2 + P_1 a + P_2 I and K are the invariants of a.

    By Cayley and Hamilton a^3 = K_0 a^2 - K_1 a + K_2 I, so that a step of a power series costs three products.
    """
    return vec(P[1] + K[0] * P[0], P[2] - K[1] * P[0], c + K[2] * P[0])


def squared_invariants(K: Any):
    """Invariants of a^2 from the invariants K of a."""
    return vec(K[0] * K[0] - real(2.0) * K[1], K[1] * K[1] - real(2.0) * K[0] * K[2], K[2] * K[2])


def interlaced(P: Any, Q: Any, K: Any):
    """Coefficients of a P(a^2) + Q(a^2), where P and Q are coefficients for a^2 and K are the invariants of a.

    The powers of a series that are even and those that are odd are summed beside each other: neither waits for the other.
    """
    R = horner(vec(P[0], Q[0], P[1]), K, Q[1])
    return horner(horner(R, K, P[2]), K, Q[2])


def polynomial(a: Any, P: Any):
    """P_0 a^2 + P_1 a + P_2 I."""
    return shifted(added(scaled(product(a, a), P[0]), scaled(a, P[1])), P[2])
