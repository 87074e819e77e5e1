"""The series of the strain lose no digit of either precision up to one limit; larger strain takes few square roots."""

from functools import cache

import numba
import numpy as np
import pytest

from runout.backends.compile import numba_binding
from runout.physics import elastic

LARGEST = 0.28  # norm of the strain up to which the series serve
PRECISIONS = pytest.mark.parametrize("real", [np.float32, np.float64])
ROWS, COMPONENTS = [0, 3, 5, 3, 1, 4, 5, 4, 2], [0, 4, 8, 1, 5, 2]
PRINCIPAL = {  # strains in the principal directions; None are random
    "random": None,
    "tension": (1.0, 0.0, 0.0),
    "compression": (-1.0, 0.0, 0.0),
    "repeated": (1.0, 1.0, -0.5),
    "nearly repeated": (-1.0, -1.0 - 1e-7, 1e-7),
    "isotropic": (-1.0, -1.0, -1.0),
}


def turned(principal):
    """Symmetric tensors (n, 6) of principal values (n, 3) in random directions."""
    q = np.linalg.qr(np.random.default_rng(5).normal(size=(len(principal), 3, 3)))[0]
    return np.einsum("pij,pj,pkj->pik", q, principal, q).reshape(-1, 9)[:, COMPONENTS]


def strains(size, real, kind="random", n=2000):
    """Symmetric tensors (n, 6) of norm ``size``, exact in a precision."""
    values = np.random.default_rng(4).normal(size=(n, 3)) if PRINCIPAL[kind] is None else np.tile(PRINCIPAL[kind], (n, 1))
    return turned(values * (0.999 * size / np.linalg.norm(values, axis=1))[:, None]).astype(real)


@cache
def compiled(name, real):
    """A function of elastic over rows of tensors (n, 6), compiled by numba in a precision."""
    f = getattr(numba_binding(real, False).elastic, name)

    def rows(B, out):
        for p in range(len(B)):
            r = f((B[p, 0], B[p, 1], B[p, 2], B[p, 3], B[p, 4], B[p, 5]))
            for k in range(6):
                out[p, k] = r[k]

    return numba.njit(rows)


def applied(name, B):
    """A function of elastic in the precision of ``B`` (n, 6)."""
    out = np.zeros_like(B)
    compiled(name, B.dtype.type)(B, out)
    return out.astype(np.longdouble)


def exactly(name, B):
    """By 70 terms of the power series of the tensor, in extended precision."""
    whole = B.astype(np.longdouble)[:, ROWS].reshape(-1, 3, 3)
    power, total = whole, whole.copy()
    for k in range(2, 70):
        power = power @ whole / (1 if name == "log_strain_series" else k)
        total += (-1) ** (k + 1) * power / k if name == "log_strain_series" else power
    return total.reshape(-1, 9)[:, COMPONENTS] / (2 if name == "log_strain_series" else 1)


@PRECISIONS
@pytest.mark.parametrize("name", ["log_strain_series", "strain_series"])
@pytest.mark.parametrize("kind", PRINCIPAL)
@pytest.mark.parametrize("size", [1e-3, 0.1, LARGEST])
def test_error_of_the_series_is_that_of_rounding(name, size, kind, real):
    B, half_unit = strains(size, real, kind), np.finfo(real).eps / 2
    exact = exactly(name, B)
    error = np.abs(applied(name, B) - exact).max(axis=1) / np.abs(exact).max(axis=1)
    assert error.max() < 6 * half_unit
    if kind == "random":  # elsewhere all tensors round alike
        assert error.mean() < 1.5 * half_unit


@pytest.mark.parametrize(("name", "terms"), [("log_strain_series", 12), ("strain_series", 7)])
def test_dropped_terms_of_single_precision_are_less_than_half_a_unit_in_the_last_place(name, terms):
    """For a strain in one direction the series are those of log(1 + x)/2 and exp(x) - 1."""
    x = np.array([-LARGEST, LARGEST])
    n = np.arange(1, terms + 1)
    if name == "log_strain_series":
        short, exact = ((-1.0) ** (n + 1) * x[:, None] ** n / (2 * n)).sum(1), np.log1p(x) / 2
    else:
        short, exact = (x[:, None] ** n / np.cumprod(n.astype(float))).sum(1), np.expm1(x)
    assert np.abs(short / exact - 1).max() < 0.25 * np.finfo(np.float32).eps


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="needs extended precision")
@pytest.mark.parametrize(("name", "exact"), [("log_strain_series", lambda x: np.log1p(x) / 2), ("strain_series", np.expm1)])
def test_dropped_terms_of_double_precision_are_less_than_two_units_in_the_last_place(name, exact):
    """Extended precision shows the error of the polynomial itself; its coefficients are double."""
    x = np.linspace(-LARGEST, LARGEST, 2000, dtype=np.longdouble)
    nothing = np.zeros_like(x)
    found = getattr(elastic, name)((x, nothing, nothing, nothing, nothing, nothing))[0]
    assert np.abs(found / exact(x) - 1).max() < 1.6 * np.finfo(float).eps


@PRECISIONS
@pytest.mark.parametrize("largest", [0.4, 1.0])
def test_large_strain_keeps_its_digits(largest, real):
    """By few square roots: six for all of them lose 2e-4 of the strain in float32 and 5e-13 in float64."""
    log = np.random.default_rng(6).uniform(-largest, largest, (2000, 3))
    log = log[np.linalg.norm(np.expm1(2 * log), axis=1) > LARGEST]
    B, h = turned(np.expm1(2 * log)).astype(real), turned(log)
    error = np.abs(applied("log_strain_scaled", B) - h).max() / np.abs(h).max()
    assert error < (1e-5 if real is np.float32 else 2e-14)


@PRECISIONS
def test_small_has_one_limit_for_both_precisions(real):
    is_small = numba_binding(real, False).elastic.is_small
    verdict = numba.njit(lambda square: is_small(square))
    assert verdict(real((0.999 * LARGEST) ** 2))
    assert not verdict(real((1.001 * LARGEST) ** 2))
