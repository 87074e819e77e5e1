"""U1: identities of the B-spline weights."""

import numpy as np

from runout.physics import bspline
from runout.studies.verification_cases.finding import Bound, Case, Result


def largest_defect(real: type) -> float:
    """Largest error of the five identities at 10^4 points, nodes and cell centres among them, in cells of one."""
    rng = np.random.default_rng(0)
    whole = np.arange(-500, 500)
    q = np.concatenate([rng.uniform(-500, 500, 8000), whole, whole + 0.5])
    f: np.ndarray = (q - np.floor(q - 0.5)).astype(real)
    w, s = np.stack(bspline.weights(f), 1), np.stack(bspline.weight_slopes(f), 1)
    arm = np.arange(3, dtype=real) - f[:, None]
    second = (w * arm**2).sum(1) * real(bspline.inverse_inertia(1.0))
    defects = [w.sum(1) - 1, s.sum(1), (w * arm).sum(1), (s * arm).sum(1) - 1, second - 1]
    return float(np.abs(defects).max())


def measure(full: bool) -> list[Result]:
    """Defects in both precisions."""
    return [
        Bound("largest defect, float64", largest_defect(np.float64), 1e-14),
        Bound("largest defect, float32", largest_defect(np.float32), 1e-6),
    ]


CASE = Case(
    "U1",
    "weights",
    "10^4 points, nodes, cell centres and negative ones among them: sums of weights, slopes, arms and their products, D = h^2/4",
    measure,
)
