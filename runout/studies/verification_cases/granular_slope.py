"""T7: steady flow of grains with mu(I) down an infinite slope, started from Bagnold's profile."""

import numpy as np

from runout.materials.granular_flow import GranularFlow
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.studies.verification_cases import flow
from runout.studies.verification_cases.closed_forms import GRAVITY
from runout.studies.verification_cases.finding import Bound, Case, Convergence, Result
from runout.studies.verification_cases.flow import Frame

DEPTH, GRAIN, TIME = 0.05, 1e-3, 0.2  # [m], [m], [s]
STATIC, DYNAMIC, CONSTANT = 0.38, 0.64, 0.3
STIFFNESS = 1000.0  # bulk modulus over the weight of the depth
FRAMES = 20


def grains() -> GranularFlow:
    """Glass beads of a millimetre."""
    modulus = STIFFNESS * 1500.0 * GRAVITY * DEPTH * 3 * 0.4
    return GranularFlow(
        density=1500.0, youngs_modulus=modulus, static_friction=STATIC, dynamic_friction=DYNAMIC, inertial_constant=CONSTANT,
        grain_size=GRAIN,
    )  # fmt: skip


def bagnold(height: np.ndarray, slope_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Speed [m/s] and shear rate [1/s] at heights (n,) [m] of a steady flow of :data:`DEPTH` that does not slip.

    Silbert et al. 2001, Phys. Rev. E 64:051302, sec. V; with mu(I) = tan(slope) throughout.
    """
    slope = np.radians(slope_deg)
    inertial = CONSTANT * (np.tan(slope) - STATIC) / (DYNAMIC - np.tan(slope))
    scale = inertial / GRAIN * np.sqrt(GRAVITY * np.cos(slope))
    return 2 / 3 * scale * (DEPTH**1.5 - (DEPTH - height) ** 1.5), scale * np.sqrt(DEPTH - height)


def drift(cells: int, slope_deg: float, samples: int = 1) -> tuple[float, float]:
    """Relative L2 of the speed after :data:`TIME` from the exact state, and the share of the drop of potential energy that
    is not accounted for if ``samples`` steps are watched."""
    h = DEPTH / cells
    scene, p, height = flow.endless_slope(grains(), DEPTH, cells, slope_deg, lambda z: bagnold(z, slope_deg))
    frames = flow.run(scene, p, tuple(TIME * (np.arange(FRAMES) + 1) / FRAMES), samples, along=flow.PERIOD)
    q = frames[-1].particles
    above = np.clip(q.position(np.full(3, h))[:, 2] - flow.BASE * h, 0.0, DEPTH)
    exact = bagnold(above, slope_deg)[0]
    error = np.sqrt(((q.velocity[:, 0] - exact) ** 2).sum() / (exact**2).sum())
    return float(error), _unexplained(p, frames, scene, height)


def _unexplained(start: Particles, frames: list[Frame], scene: Scene, height: np.ndarray) -> float:
    """Share of the drop of potential energy that is not accounted for; the drop is the work of gravity, for places repeat."""
    weight, h = np.array(scene.gravity), np.full(3, scene.spacing[0])
    power = [start.mass @ start.velocity[:, 0] * weight[0]]
    power += [flow.ACROSS * f.particles.mass @ f.particles.velocity[:, 0] * weight[0] for f in frames]
    end = frames[-1]
    sunk = (end.particles.mass * (end.particles.position(h)[:, 2] - flow.BASE * h[2])).sum() * flow.ACROSS - start.mass @ height
    drop = np.trapezoid(power, [0.0, *(f.time for f in frames)]) + weight[2] * sunk
    return float(1 - (1 - end.energies.residual) * end.energies.drop / drop)


def measure(full: bool) -> list[Result]:
    """Drift at 24 degrees on finer grids, in full at 22 and 26 too; no motion below mu_s."""
    cells = (10, 20, 40) if full else (5, 10, 20)
    drift_of = {n: drift(n, 24.0, 160 if n == 20 else 1) for n in cells}
    results: list[Result] = [Convergence("speed, 24 deg", cells, tuple(drift_of[n][0] for n in cells), 1.0)]
    results.append(Bound("speed, relative L2, 24 deg, 20 cells", drift_of[20][0], 0.03))
    unexplained = "energy not accounted for, over the work of gravity, 24 deg, 20 cells"
    results.append(Bound(unexplained, drift_of[20][1], 0.01, -0.01))
    for slope in (22.0, 26.0) if full else ():
        results.append(Bound(f"speed, relative L2, {slope:g} deg, 20 cells", drift(20, slope)[0], 0.03))
    return results


CASE = Case(
    "T7",
    "flow of grains down an endless slope (Bagnold)",
    f"mu(I) with mu_s = {STATIC:g}, mu_2 = {DYNAMIC:g}, I_0 = {CONSTANT:g}, d = 1 mm; {1e3 * DEPTH:g} mm deep, periodic, on a "
    f"floor that holds; the drift in {TIME:g} s from the exact profile",
    measure,
)
