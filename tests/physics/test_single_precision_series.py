"""In single precision the power series of the strain end earlier and serve larger strain; no digit of float32 is lost by it."""

import numba
import numpy as np
import pytest

from runout.backends.compile import numba_binding

HALF_UNIT = 2.0**-24
LARGEST = 0.28  # norm of the strain up to which the series serve in float32


def strains(size, n=2000):
    """Symmetric tensors (n, 6) of norm ``size``, exact in float32."""
    a = np.random.default_rng(4).normal(size=(n, 6))
    norm = np.sqrt((a[:, :3] ** 2).sum(1) + 2 * (a[:, 3:] ** 2).sum(1))
    return (a * (0.999 * size / norm)[:, None]).astype(np.float32).astype(np.float64)


def applied(name, real, B):
    f = getattr(numba_binding(real, False).elastic, name)

    def rows(B, out):
        for p in range(len(B)):
            r = f((B[p, 0], B[p, 1], B[p, 2], B[p, 3], B[p, 4], B[p, 5]))
            for k in range(6):
                out[p, k] = r[k]

    out = np.zeros(B.shape, real)
    numba.njit(rows)(B.astype(real), out)
    return out.astype(np.float64)


def exactly(name, B):
    """By eigenvalues, in float64."""
    values, vectors = np.linalg.eigh(B[:, [0, 3, 5, 3, 1, 4, 5, 4, 2]].reshape(-1, 3, 3))
    changed = np.log1p(values) / 2 if name == "log_strain_series" else np.expm1(values)
    whole = np.einsum("pij,pj,pkj->pik", vectors, changed, vectors).reshape(-1, 9)
    return whole[:, [0, 4, 8, 1, 5, 2]]


@pytest.mark.parametrize("name", ["log_strain_series", "strain_series"])
@pytest.mark.parametrize("size", [1e-3, 1e-2, 0.1, LARGEST])
def test_error_in_single_precision_is_that_of_rounding(name, size):
    B = strains(size)
    exact = exactly(name, B)
    error = np.abs(applied(name, np.float32, B) - exact).max(axis=1) / np.abs(exact).max(axis=1)
    assert error.max() < 4 * HALF_UNIT
    assert error.mean() < 1.25 * HALF_UNIT  # 1.01 at most, and no less with one order more


@pytest.mark.parametrize(("name", "terms"), [("log_strain_series", 12), ("strain_series", 7)])
def test_dropped_terms_are_less_than_half_a_unit_in_the_last_place(name, terms):
    """For a strain in one direction the series are those of log(1 + x)/2 and exp(x) - 1."""
    x = np.array([-LARGEST, LARGEST])
    n = np.arange(1, terms + 1)
    if name == "log_strain_series":
        short, exact = ((-1.0) ** (n + 1) * x[:, None] ** n / (2 * n)).sum(1), np.log1p(x) / 2
    else:
        short, exact = (x[:, None] ** n / np.cumprod(n.astype(float))).sum(1), np.expm1(x)
    assert np.abs(short / exact - 1).max() < 0.5 * HALF_UNIT


def test_small_means_what_each_precision_can_bear():
    for real, limit in ((np.float32, LARGEST), (np.float64, 0.1)):
        is_small = numba_binding(real, False).elastic.is_small
        verdict = numba.njit(lambda square, f=is_small: f(square))
        assert verdict(real((0.999 * limit) ** 2))
        assert not verdict(real((1.001 * limit) ** 2))
