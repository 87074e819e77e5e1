"""U10: Drucker-Prager on a single point, strain driven."""

import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
from scipy.optimize import brentq

from runout.materials import granular_flow
from runout.materials.drucker_prager import Cone, DruckerPrager
from runout.materials.granular_flow import GranularFlow
from runout.model.laws import LAWS
from runout.physics import elastic
from runout.studies.verification_cases.finding import Bound, Case, Convergence, Result

SOIL, GRAINS = LAWS.find("drucker_prager"), LAWS.find("granular_flow")
COHESION, PRESSURE = 10e3, 50e3
Tensor = tuple[float, ...]
CELL = 100e3  # [Pa] of the triaxial test


def record(cone: Cone = Cone.TRIAXIAL_COMPRESSION, friction_angle: float = 30.0, cohesion: float = COHESION) -> SimpleNamespace:
    """Record of parameters of the law, and the bulk modulus [Pa]."""
    m = DruckerPrager(
        density=2000.0, youngs_modulus=10e6, poisson_ratio=0.25, friction_angle=friction_angle, cohesion=cohesion, cone=cone
    )
    return SimpleNamespace(**m.record(), bulk=m.lame_lambda + 2 * m.shear_modulus / 3)


def pressed(mat: SimpleNamespace, pressure: float = PRESSURE) -> Tensor:
    """B = b_e - I [1] of a mean pressure [Pa]."""
    return elastic.strain_of_log((*[-pressure / (3 * mat.bulk)] * 3, 0.0, 0.0, 0.0))


def path(mat: SimpleNamespace, B: Tensor, rate: Callable[[int], Tensor], steps: int) -> list[tuple[Tensor, Tensor, float]]:
    """B, Hencky strain and dissipated energy [J/m3] after each step with velocity gradient times dt ``rate(k)``."""
    history, states = 0.0, []
    for k in range(steps):
        B, h, history, lost = SOIL.step(B, rate(k), history, mat)
        states.append((B, h, lost))
    return states


def shear(mat: SimpleNamespace, gamma: float, steps: int) -> list[tuple[Tensor, Tensor, float]]:
    """States of simple shear at constant volume to ``gamma``."""
    step = (0.0, gamma / steps, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return path(mat, pressed(mat), lambda k: step, steps)


def plateau_defect(mat: SimpleNamespace) -> float:
    """Relative distance of q from M p_0 + q_c after a shear of 5."""
    h = shear(mat, 5.0, 500)[-1][1]
    return abs(elastic.deviatoric_stress(h, mat) / (mat.cone_slope * PRESSURE + mat.cone_intercept) - 1)


def triaxial_defect() -> float:
    """Relative distance of the deviator from its peak 3 (M s_3 + q_c)/(3 - M) in drained triaxial compression."""
    mat, history = record(), 0.0
    B = pressed(mat, CELL)
    for _ in range(40):

        def excess(d: float, B: Tensor = B, history: float = history) -> float:
            h = SOIL.step(B, (d, 0.0, 0.0, 0.0, d, 0.0, 0.0, 0.0, -2e-3), history, mat)[1]
            return float(-elastic.kirchhoff_stress(h, mat)[0] - CELL)

        d = brentq(excess, -1e-2, 1e-2, xtol=1e-16)
        B, h, history, _ = SOIL.step(B, (d, 0.0, 0.0, 0.0, d, 0.0, 0.0, 0.0, -2e-3), history, mat)
    peak = 3 * (mat.cone_slope * CELL + mat.cone_intercept) / (3 - mat.cone_slope)
    return abs(elastic.deviatoric_stress(h, mat) / peak - 1)


def apex_defect() -> float:
    """Relative distance of the pressure from that of the apex, -q_c/M, after isotropic extension past it."""
    mat = record()
    h = path(mat, (0.0,) * 6, lambda k: (1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 1e-3), 50)[-1][1]
    return abs(elastic.pressure(h, mat) / (-mat.cone_intercept / mat.cone_slope) - 1)


def path_errors(steps: tuple[int, ...], gamma: float = 0.1) -> list[float]:
    """Error of the stress after shear past the yield in so many steps, over the pressure; against ten times the finest."""
    mat = record()

    def stress(count: int) -> np.ndarray:
        return np.array(elastic.kirchhoff_stress(shear(mat, gamma, count)[-1][1], mat))

    exact = stress(10 * steps[-1])
    return [float(np.abs(stress(n) - exact).max() / PRESSURE) for n in steps]


def random_path_defects(steps: int = 400) -> tuple[float, float, float, int]:
    """On a random path: largest excess over the yield surface and beyond the apex, over the pressure and p_0; least
    dissipation of a step [J/m3]; how many steps end on the cone or at the apex, whichever are fewer.

    Without cohesion: at a cohesive apex the volume that is gained and lost again gives its work back.
    """
    mat, rng = record(cohesion=0.0), np.random.default_rng(3)
    swell = -5e-4 * np.sin(np.arange(steps) / 20)[:, None]
    rates = 2e-3 * rng.normal(size=(steps, 9)) + swell * np.eye(3).ravel()
    states = path(mat, pressed(mat), lambda k: tuple(map(float, rates[k])), steps)
    p = np.array([elastic.pressure(h, mat) for _, h, _ in states])
    q = np.array([elastic.deviatoric_stress(h, mat) for _, h, _ in states])
    excess, scale = q - mat.cone_slope * p, np.abs(p) + PRESSURE
    apex = p < 1e-9 * PRESSURE
    cone = ~apex & (excess > -1e-9 * scale)
    least = min(lost for _, _, lost in states)
    return float((excess / scale).max()), float((-p / scale).max()), least, int(min(cone.sum(), apex.sum()))


def turned_defect(steps: int = 200) -> float:
    """Difference of the strain of a sheared point from that of one that also turns by 1.5 rad, turned back."""
    mat, gamma = record(), 0.5 / steps

    def turn(k: int) -> np.ndarray:
        a = 1.5 * k / steps
        return np.array([[math.cos(a), -math.sin(a), 0.0], [math.sin(a), math.cos(a), 0.0], [0.0, 0.0, 1.0]])

    def rate(k: int) -> Tensor:
        F = np.eye(3)
        F[0, 1] = gamma
        return tuple((turn(k + 1) @ F @ turn(k).T - np.eye(3)).ravel().tolist())

    still, moved = shear(mat, 0.5, steps), path(mat, pressed(mat), rate, steps)
    back = [turn(k + 1).T @ _matrix(state[1]) @ turn(k + 1) for k, state in enumerate(moved)]
    return float(np.abs(np.array(back) - [_matrix(state[1]) for state in still]).max())


def flowing(step: float = 1e-4) -> tuple[float, float, float]:
    """mu(I) in steady shear: relative distance of the stress from mu(I) p at the rate of shear, at the rate of the plastic shear of
    the last step, and least dissipation of a step over the pressure."""
    m = GranularFlow(density=1500.0, youngs_modulus=1e7, static_friction=0.38, dynamic_friction=0.64, grain_size=1e-3)
    dt, inertia = 1e-5, 1e-3 * math.sqrt(1500.0 / PRESSURE)
    mat = SimpleNamespace(**{**m.record(), "time_step": dt, "bulk": m.lame_lambda + 2 * m.shear_modulus / 3})
    B, history, losses = pressed(mat), 0.0, []
    for _ in range(2000):
        trial = elastic.log_strain(elastic.trial_strain(B, (0.0, step, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
        B, h, history, lost = GRAINS.step(B, (0.0, step, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), history, mat)
        losses.append(lost)
    shear = elastic.deviatoric_stress(h, mat) / math.sqrt(3) / PRESSURE
    plastic = (elastic.deviatoric_stress(trial, mat) / math.sqrt(3) / PRESSURE - shear) * PRESSURE / mat.shear_modulus
    by_rate, by_flow = (granular_flow.friction(s / dt * inertia, mat) for s in (step, plastic))
    return abs(shear / by_rate - 1), abs(shear / by_flow - 1), min(losses) / PRESSURE


def _matrix(h: Tensor) -> np.ndarray:
    return np.array([[h[0], h[3], h[5]], [h[3], h[1], h[4]], [h[5], h[4], h[2]]])


def measure(full: bool) -> list[Result]:
    """End states, path, admissibility, objectivity."""
    steps = (25, 50, 100, 200) if full else (25, 50, 100)
    errors = path_errors(steps)
    over, beyond, least, visits = random_path_defects()
    by_rate, by_flow, lost = flowing()
    return [
        *(Bound(f"plateau of shear to 5, {cone.replace('_', ' ')}", plateau_defect(record(cone)), 1e-10) for cone in Cone),
        Bound("plateau of von Mises (no friction)", plateau_defect(record(friction_angle=0.0)), 1e-10),
        Bound("peak of triaxial compression", triaxial_defect(), 1e-9),
        Bound("apex in isotropic extension", apex_defect(), 1e-10),
        Convergence("stress on the path, shear of 0.1", steps, tuple(errors), 1.0),
        Bound("error on the path, steps of 1e-3", errors[2], 5e-4),
        Bound("largest excess over the yield surface, random path", over, 1e-10),
        Bound("largest tension beyond the apex, random path", beyond, 1e-10),
        Bound("least dissipation of a step, random path [J/m3]", least, low=0.0),
        Bound("steps of that random path on the cone and at the apex, whichever fewer", visits, low=50),
        Bound("turning with the observer, strain", turned_defect(), 1e-12),
        Bound("mu(I) in steady shear, rate of the shear", by_rate, 1e-3),
        Bound("mu(I) in steady shear, rate of the plastic shear", by_flow, 1e-10),
        Bound("least dissipation of a step over the pressure, mu(I)", lost, low=0.0),
    ]


CASE = Case(
    "U10",
    "element paths",
    "Drucker-Prager, E = 10 MPa, nu = 0.25, phi = 30 deg, c = 10 kPa, p_0 = 50 kPa, single point",
    measure,
    "The path converges with order one: the return goes along the deviator at the end of a step, whose direction turns in large "
    "shear. Steps of 1e-3 are 4e-4 of the pressure off, four times the aim of 1e-4. mu(I) is sheared at 10/s in steps of 1e-4.",
)
