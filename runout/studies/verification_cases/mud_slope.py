"""Mud down an endless slope: steady flow of a Bingham and a Herschel-Bulkley layer, and a layer that stops."""

from dataclasses import dataclass

import numpy as np

from runout.materials.herschel_bulkley import HerschelBulkley
from runout.studies.verification_cases import flow
from runout.studies.verification_cases.closed_forms import GRAVITY
from runout.studies.verification_cases.finding import Bound, Case, Convergence, Result

DEPTH, SLOPE_DEG, DENSITY, TIME = 1.0, 15.0, 1800.0, 4.0  # [m], [deg], [kg/m3], [s]: four times the decay of the slowest shear
WEIGHT = DENSITY * GRAVITY * float(np.sin(np.radians(SLOPE_DEG)))  # down the slope [N/m3]
STIFFNESS = 200.0  # bulk modulus over the weight of the depth


@dataclass(frozen=True)
class Layer:
    """A layer whose base carries its yield stress over ``yielding`` of its depth, of consistency [Pa s^n] and exponent n."""

    yielding: float
    consistency: float
    exponent: float

    @property
    def mud(self) -> HerschelBulkley:
        """Its material."""
        modulus = STIFFNESS * DENSITY * GRAVITY * DEPTH * 3 * 0.4
        return HerschelBulkley(
            density=DENSITY, youngs_modulus=modulus, yield_stress=(1 - self.yielding) * WEIGHT * DEPTH,
            consistency=self.consistency, flow_index=self.exponent,
        )  # fmt: skip

    def profile(self, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Speed [m/s] and shear rate [1/s] at heights (n,) [m] of steady flow without slip.

        Liu & Mei 1989, J. Fluid Mech. 207:505 (Bingham); Huang & Garcia 1998, J. Fluid Mech. 374:305 (Herschel-Bulkley).
        """
        n, sheared = self.exponent, max(self.yielding * DEPTH, 0.0)
        left = np.clip(sheared - height, 0.0, None)
        scale = (WEIGHT / self.consistency) ** (1 / n)
        return n / (n + 1) * scale * (sheared ** (1 / n + 1) - left ** (1 / n + 1)), scale * left ** (1 / n)

    @property
    def mean_speed(self) -> float:
        """Speed [m/s] of steady flow, mean over the depth."""
        n = self.exponent
        return float(self.profile(np.array([DEPTH]))[0][0] * (1 - n / (2 * n + 1) * self.yielding))


BINGHAM, THINNING = Layer(0.7, 500.0, 1.0), Layer(0.7, 1000.0, 0.5)
RESTING = Layer(-0.1, 500.0, 1.0)  # a tenth thinner than yields


def speeds(layer: Layer, start: Layer, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Heights (n,) [m] and speeds (n,) [m/s] of particles of a layer after :data:`TIME` from the steady flow of another one."""
    scene, particles, _ = flow.endless_slope(layer.mud, DEPTH, cells, SLOPE_DEG, start.profile)
    end = flow.run(scene, particles, (TIME,), 1, along=flow.PERIOD)[-1].particles
    h = DEPTH / cells
    return end.position(np.full(3, h))[:, 2] - flow.BASE * h, end.velocity[:, 0]


def errors(layer: Layer, cells: int) -> tuple[float, float]:
    """Relative L2 error of the profile and relative error of the mean speed, in a layer of ``cells`` through its depth."""
    height, speed = speeds(layer, layer, cells)
    exact = layer.profile(np.clip(height, 0.0, DEPTH))[0]
    return float(np.sqrt(((speed - exact) ** 2).sum() / (exact**2).sum())), float(speed.mean() / layer.mean_speed - 1)


def measure(full: bool) -> list[Result]:
    """Error of the profile on finer grids, mean speed, and what is left of the speed of a layer that must stop."""
    cells = (5, 10, 20, 40) if full else (5, 10, 20)
    results: list[Result] = []
    for name, layer, most in (("Bingham", BINGHAM, 0.1), ("n = 0.5", THINNING, 0.15)):
        error_of = {n: errors(layer, n) for n in cells}
        results.append(Convergence(f"speed, relative L2, {name}", cells, tuple(error_of[n][0] for n in cells), 1.0))
        results.append(Bound(f"error of the mean speed, {name}, 20 cells", error_of[20][1], most, -most))
    left = float(np.abs(speeds(RESTING, BINGHAM, 10)[1]).max()) / BINGHAM.mean_speed
    results.append(Bound("speed left of a layer 0.91 times as thick as yields, over that at the start", left, 1e-3))
    return results


CASE = Case(
    "mud",
    "mud down an endless slope (Bingham, Herschel-Bulkley)",
    f"{DEPTH:g} m deep, {SLOPE_DEG:g} deg, {DENSITY:g} kg/m3, yield stress 0.3 of the shear at the base; viscosity 500 Pa s, or "
    f"consistency 1000 Pa s^0.5 with exponent 0.5; periodic, on a floor that holds; {TIME:g} s from the exact profile",
    measure,
    "The lowest row of particles sticks to the floor: the flow is that of a layer whose sheared part is 0.6 cells thinner. The "
    "layer that stops starts with the speeds of the Bingham flow; its yield stress is 1.1 times the shear at its base.",
)
