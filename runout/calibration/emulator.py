"""Gaussian process of one scalar of the members over the unit cube of their parameters, and its error on unseen members.

Kernel: a linear trend, Matern 5/2 with one length for each parameter, and a nugget for what no parameter explains (seeds of the
particles, jumps of the front from cell to cell). Rasmussen & Williams 2006, Gaussian Processes for Machine Learning,
eq. 2.23 to 2.24, 4.14 and 5.8.
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.errors import LibraryError

INSTALL = "pip install 'runout[calibration]'"
FOLDS = 8
RESTARTS = 2  # of the search for the lengths of the kernel
SMALLEST_SPREAD = 1e-9  # of values over their size; less is a constant


@contextmanager
def of_extra(name: str) -> Iterator[None]:
    """Block that imports a library of the extra ``calibration``; LibraryError with the command that installs it."""
    try:
        yield
    except ImportError as cause:
        raise LibraryError(f"this command needs {name}, which cannot be imported ({cause}); install it: {INSTALL}") from cause


@contextmanager
def one_thread() -> Iterator[None]:
    """Block in which linear algebra has one thread: matrices are small, and waiting threads make it five times as slow."""
    with of_extra("scikit-learn"):
        from threadpoolctl import threadpool_limits
    with threadpool_limits(1):
        yield


@dataclass(frozen=True)
class Emulator:
    """Predicts a scalar of a member from its point in the cube."""

    points: np.ndarray  # (members, parameters): coordinates of the members in the cube
    values: np.ndarray  # (members,): the scalar of each
    # centre, scale: mean and standard deviation of the values, which the process does not see
    centre: float
    scale: float
    process: Any  # of the standardised values
    # (members,): value minus prediction of each member by a process that was fitted without its eighth of the members
    residuals: np.ndarray
    # root mean square of the residuals over their predicted standard deviation, 1 or more [1]; predicted deviations are multiplied
    # by it, since those of few members are too small
    widening: float

    @classmethod
    def fit(cls, points: np.ndarray, values: np.ndarray) -> "Emulator":
        """The emulator of values (members,) at points (members, parameters); see :func:`varies` for what it needs."""
        centre, scale = float(values.mean()), float(values.std())
        standard = (values - centre) / scale
        with one_thread():
            process = _fitted(points, standard, _kernel(points.shape[1]), RESTARTS)
            residuals, deviations = _held_out(points, standard, process.kernel_)
        widening = max(1.0, float(np.sqrt(np.mean(np.square(residuals / deviations)))))
        return cls(points, values, centre, scale, process, residuals * scale, widening)

    @property
    def q2(self) -> float:
        """Held-out share of the variance that is predicted, 1 - sum of squared residuals over that of deviations [1]; best 1."""
        return 1.0 - float(np.square(self.residuals).sum() / np.square(self.values - self.centre).sum())

    @property
    def noise(self) -> float:
        """Standard deviation of the part that no parameter explains, in the unit of the scalar."""
        return self.scale * float(np.sqrt(self.process.kernel_.k2.noise_level))

    def predict(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (n,) of the scalar of a member at points (n, parameters), with the nugget.

        Equations 2.25 and 2.26; the same method of scikit-learn checks its input for longer than it works, thousands of times.
        """
        from scipy.linalg import solve_triangular

        own, kernel = self.process, self.process.kernel_
        cross = kernel(points - 0.5, own.X_train_)
        explained = np.square(solve_triangular(own.L_, cross.T, lower=True, check_finite=False)).sum(axis=0)
        deviation = np.sqrt(np.maximum(kernel.diag(points - 0.5) - explained, 0.0))
        return self.centre + self.scale * (cross @ own.alpha_), self.widening * self.scale * deviation

    def mean(self, points: np.ndarray) -> np.ndarray:
        """Mean (n,) of the scalar at points (n, parameters)."""
        return self.centre + self.scale * self.process.predict(points - 0.5)  # type: ignore[no-any-return]

    def draws(self, points: np.ndarray, count: int, seed: int) -> np.ndarray:
        """Values (count, n) at points (n, parameters) of functions drawn from the process, without its nugget."""
        mean, covariance = self.process.predict(points - 0.5, return_cov=True)
        covariance[np.diag_indices_from(covariance)] += 1e-8 - self.process.kernel_.k2.noise_level
        lower = np.linalg.cholesky(_positive(covariance))
        normal = np.random.default_rng(seed).standard_normal((count, len(points)))
        return self.centre + self.scale * (mean + self.widening * normal @ lower.T)  # type: ignore[no-any-return]


def varies(values: np.ndarray) -> bool:
    """Whether values (members,) differ, so that there is something to predict."""
    return bool(np.ptp(values) > SMALLEST_SPREAD * max(float(np.abs(values).max()), 1e-300))


def _kernel(parameters: int) -> Any:
    with of_extra("scikit-learn"):
        from sklearn.gaussian_process.kernels import ConstantKernel, DotProduct, Matern, WhiteKernel
    trend = ConstantKernel(1.0, (1e-3, 1e3)) * DotProduct(1.0, "fixed")
    rest = ConstantKernel(1.0, (1e-3, 1e3)) * Matern([0.5] * parameters, (0.05, 20.0), nu=2.5)
    return (trend + rest) + WhiteKernel(1e-2, (1e-6, 1.0))


def _fitted(points: np.ndarray, values: np.ndarray, kernel: Any, restarts: int) -> Any:
    with of_extra("scikit-learn"):
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor
    process = GaussianProcessRegressor(kernel, alpha=1e-10, n_restarts_optimizer=restarts, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a length at its bound: a parameter without effect
        return process.fit(points - 0.5, values)


def _held_out(points: np.ndarray, values: np.ndarray, kernel: Any) -> tuple[np.ndarray, np.ndarray]:
    """Residual and predicted deviation (members,) of each member by a process that was fitted anew without its fold.

    Folds are drawn at random: those of equal last bits of the numbers would cut boxes out of a Sobol net.
    """
    folds = np.array_split(np.random.default_rng(0).permutation(len(values)), FOLDS)
    residuals, deviations = np.empty(len(values)), np.empty(len(values))
    for fold in folds:
        rest = np.setdiff1d(np.arange(len(values)), fold)
        process = _fitted(points[rest], values[rest], kernel, 0)
        mean, deviations[fold] = process.predict(points[fold] - 0.5, return_std=True)
        residuals[fold] = values[fold] - mean
    return residuals, deviations


def _positive(covariance: np.ndarray) -> np.ndarray:
    """A covariance (n, n) whose round-off is lifted off the diagonal, so that it has a Cholesky factor."""
    lift = 1e-8
    while lift < 1e-3:
        try:
            np.linalg.cholesky(covariance)
        except np.linalg.LinAlgError:
            covariance[np.diag_indices_from(covariance)] += lift
            lift *= 10.0
        else:
            break
    return covariance
