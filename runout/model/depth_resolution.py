"""Resolution of a flow by the grid: cells through its depth, numerical viscosity, and decay time of shear."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from runout.model.scene import Scene
from runout.physics import numerical_scales as formulas

FEWEST_CELLS = 4  # cells through the depth; with fewer, numerical viscosity stops shear within about a second
SHARING = 4.0  # particles in a neighbourhood that make a flow, not single particles
# reduction over several runs to the least resolved
WORST = {
    "depth": min, "cells_through_depth": min, "numerical_viscosity": max, "shear_decay_time": min, "smallest_feature": max,
    "least_thickness": max,
}  # fmt: skip
LOST = (
    f"with fewer than {FEWEST_CELLS} cells the velocity profile and the shear through the depth are lost: the mass moves in "
    "columns, as in depth-averaged models"
)


@dataclass(frozen=True)
class DepthResolution:
    """Resolution of a flow of one depth by a grid and its time step."""

    depth: float  # vertical [m]
    cells_through_depth: float  # vertical cells
    numerical_viscosity: float  # kinematic viscosity of the transfers [m2/s] for shear through the depth
    shear_decay_time: float  # time [s] in which numerical viscosity reduces that shear to 1/e
    smallest_feature: float = 0.0  # width [m] of the smallest feature that the maps can show
    least_thickness: float = 0.0  # least thickness [m] that the maps can show: thinner flows are single particles

    @classmethod
    def of(cls, depth: float, scene: Scene, dt: float, particle_volume: float = 0.0) -> "DepthResolution":
        """Resolution of a flow of ``depth`` [m] in a scene with time step ``dt`` [s]; that of the depth is zero for depth 0.

        ``particle_volume`` [m3] is that of a particle, 0 if unknown.
        """
        h = scene.spacing[2]
        feature = formulas.smallest_feature(max(scene.spacing[:2]), max(scene.raster.cell_size))
        thinnest = formulas.least_thickness(particle_volume, scene.spacing[0] * scene.spacing[1], SHARING)
        if not (depth > 0 and dt > 0):
            return cls(0.0, 0.0, 0.0, math.inf, feature, thinnest)
        wave = formulas.shear_wave_length(depth)
        viscosity = formulas.numerical_viscosity(h, wave, dt)
        return cls(depth, depth / h, viscosity, formulas.decay_time(viscosity, wave), feature, thinnest)

    @property
    def is_coarse(self) -> bool:
        """Whether the flow has less than :data:`FEWEST_CELLS` cells through its depth; False without a flow."""
        return 0 < self.cells_through_depth < FEWEST_CELLS

    def statement(self) -> str:
        """Cells, viscosity and decay time as a clause for a sentence."""
        viscosity = float(f"{self.numerical_viscosity:.2g}")  # without a power of ten
        return (
            f"{self.cells_through_depth:.2g} cells through a depth of {self.depth:.3g} m; the transfers act like a viscosity of "
            f"{viscosity:g} m2/s, which stops shear through the depth in {self.shear_decay_time:.2g} s"
        )

    def warning(self) -> str:
        """What a flow with few cells through its depth loses, as a clause for a sentence; empty if it is resolved."""
        return f"{self.statement()}; {LOST}" if self.is_coarse else ""

    def attributes(self) -> dict[str, float]:
        """Attributes for a file; numbers that are undefined without a flow or viscosity are left out."""
        return {name: value for name, value in asdict(self).items() if math.isfinite(value)}


def flow_depth(peak_thickness: np.ndarray) -> float:
    """Depth [m] of a flow: volume-weighted mean of the map of maximum thickness; 0 without a flow."""
    thickness = np.nan_to_num(np.asarray(peak_thickness, np.float64))
    return float((thickness**2).sum() / thickness.sum()) if thickness.sum() > 0 else 0.0


def worst(runs: Iterable[Mapping[str, Any]]) -> dict[str, float]:
    """For each attribute, the value of the least resolved run; empty if no run has any."""
    told = [attributes for attributes in runs if set(WORST) <= set(attributes)]
    return {name: float(pick(float(a[name]) for a in told)) for name, pick in WORST.items()} if told else {}
