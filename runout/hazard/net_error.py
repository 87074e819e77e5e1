"""Error of the mean over a Sobol net, from a Gaussian process of the values over the sampled parameters.

The values of a map at the points u of the parameters are s (g(u) + noise). The covariance of g is the sum of a smooth part, the
correlation of Matérn with nu = 5/2, and a part with jumps, q times that with nu = 1/2, with a length for each parameter; the noise
of the seeds has the variance r. The error of the mean over n points is that of Bayesian quadrature with equal weights,

    e^2 = s^2 (mean k(u_i, u_j) - 2 mean k(u_i, U) + mean k(U, U') + r / n)

with U and U' uniform. Lengths, q and r are the most probable ones for all cells of the map together, of unknown mean. They need the
products of the values of the members alone. Each length has a log-normal distribution before: median 1, the range of a parameter,
and deviation 1 of the logarithm. Smooth maps have a smaller error than rough ones, and so have points that happen to be even.

References
----------
O'Hagan A. (1991), J. Stat. Plan. Inference 29, 245 (Bayesian quadrature); Rasmussen C.E., Williams C.K.I. (2006), Gaussian
Processes for Machine Learning, eq. 4.17 (Matérn), 5.9 (gradient), 2.45 (unknown mean).
"""

import math
from collections.abc import Iterable

import numpy as np

from runout.ensemble.design import NetPoints

FITTED = 128  # members of the net, from its first on, that decide lengths, jumps and noise: a net as well
LENGTHS, JUMPS, NOISES = (0.05, 20.0), (1e-6, 100.0), (1e-6, 100.0)  # ranges of lengths [range of a parameter], q and r
ROWS = 256  # of covariances at once
ROOT = math.sqrt(5.0)


def error_of_net(products: np.ndarray, points: NetPoints) -> float:
    """Mean square of the error of the mean over a net, summed over the cells of a map.

    Parameters
    ----------
    products : ndarray (first members, first members)
        Sum over the cells of the products of the deviations of two members from the mean of the net.
    points : NetPoints
    """
    from scipy.optimize import minimize

    first = points.members[: len(products)]
    start = np.array([*np.zeros(first.shape[1]), math.log(0.1), math.log(0.01)])
    bounds = np.log([*[LENGTHS] * first.shape[1], JUMPS, NOISES])
    fit = minimize(_deviance, start, args=(products, first), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 60})
    *lengths, jumps, noise = np.exp(fit.x)
    smooth, rough, _ = _covariance(first, first, lengths, jumps)
    inverse, _ = _inverse(smooth + rough, noise)
    variance = float((inverse * products).sum()) / (len(first) - 1)
    pairs = (points.members, points.members), (points.members, points.volume), (points.volume, points.volume)
    within, across, whole = (_mean_covariance(a, b, lengths, jumps) for a, b in pairs)
    return variance * (max(within - 2.0 * across + whole, 0.0) + noise / len(points.members))


def _deviance(logarithms: np.ndarray, products: np.ndarray, points: np.ndarray) -> tuple[float, np.ndarray]:
    """Minus twice the logarithm of the probability of lengths, jumps and noise, but for a constant, and its gradient."""
    count, lengths = len(points), logarithms[:-2]
    jumps, noise = np.exp(logarithms[-2:])
    smooth, rough, distances = _covariance(points, points, np.exp(lengths), jumps)
    inverse, determinant = _inverse(smooth + rough, noise)
    explained = inverse @ products
    square = float(np.trace(explained))
    change = inverse - (count - 1) / square * explained @ inverse
    slopes = [*(_slope(smooth, rough, distance) for distance in distances), rough]
    gradient = np.array([*((change * slope).sum() for slope in slopes), noise * np.trace(change)])
    gradient[: len(lengths)] += 2.0 * lengths
    return determinant + (count - 1) * math.log(square) + float(lengths @ lengths), gradient


def _inverse(covariance: np.ndarray, noise: float) -> tuple[np.ndarray, float]:
    """Inverse of the covariance with noise, without the part of the unknown mean, and the logarithm of its determinant."""
    lower = np.linalg.cholesky(covariance + noise * np.eye(len(covariance)))
    inverse_lower = np.linalg.inv(lower)
    inverse = inverse_lower.T @ inverse_lower
    rows = inverse.sum(axis=0)
    determinant = 2.0 * float(np.log(np.diag(lower)).sum()) + math.log(rows.sum())
    return inverse - np.outer(rows, rows) / rows.sum(), determinant


def _covariance(
    a: np.ndarray, b: np.ndarray, lengths: Iterable[float], jumps: float
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Smooth part and part with jumps of the covariance of two sets of points, and their distances over the lengths."""
    distances = [np.abs(x[:, None] - y) / length for x, y, length in zip(a.T, b.T, lengths, strict=True)]
    smooth, total = np.ones((len(a), len(b))), np.zeros((len(a), len(b)))
    for distance in distances:
        smooth *= 1.0 + ROOT * distance + 5.0 / 3.0 * distance * distance
        total += distance
    return smooth * np.exp(-ROOT * total), jumps * np.exp(-total), distances


def _slope(smooth: np.ndarray, rough: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Slope of the covariance with the logarithm of the length of a parameter."""
    z = ROOT * distance
    return smooth * z * z * (1.0 + z) / (3.0 + 3.0 * z + z * z) + rough * distance


def _mean_covariance(a: np.ndarray, b: np.ndarray, lengths: Iterable[float], jumps: float) -> float:
    parts = (_covariance(a[row : row + ROWS], b, lengths, jumps) for row in range(0, len(a), ROWS))
    return math.fsum(float(smooth.sum() + rough.sum()) for smooth, rough, _ in parts) / (len(a) * len(b))
