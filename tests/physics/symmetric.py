"""Symmetric tensors as matrices and back, for tests."""

import numpy as np

XX_TO_ZX = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))


def matrix(a) -> np.ndarray:
    """3 x 3 matrix of components xx, yy, zz, xy, yz, zx."""
    m = np.zeros((3, 3))
    for value, (i, j) in zip(a, XX_TO_ZX, strict=True):
        m[i, j] = m[j, i] = value
    return m


def components(m: np.ndarray) -> tuple[float, ...]:
    """Components xx, yy, zz, xy, yz, zx of a symmetric matrix."""
    return tuple(float(m[i, j]) for i, j in XX_TO_ZX)


def rotation(rng: np.random.Generator) -> np.ndarray:
    """A random proper rotation."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def flat(m: np.ndarray) -> tuple[float, ...]:
    """The nine components of a matrix by rows."""
    return tuple(float(v) for v in m.ravel())
