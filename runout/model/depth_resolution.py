"""What the grid resolves of a flow: cells through its depth, and how soon the viscosity of the transfers stops its shear."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from runout.model.scene import Scene
from runout.physics import numerical_scales as formulas

FEWEST_CELLS = 4  # through the depth: below, numerical viscosity stops shear within about a second
# the worst of several runs
WORST = {"cells_through_depth": min, "numerical_viscosity": max, "shear_decay_time": min, "smallest_feature": max}


@dataclass(frozen=True)
class DepthResolution:
    """What a grid and its time step resolve of a flow of one depth.

    Attributes
    ----------
    depth : float
        Vertical [m].
    cells_through_depth : float
        Vertical cells.
    numerical_viscosity : float
        Kinematic viscosity of the transfers [m2/s] for shear through the depth; zero for aflip that keeps all.
    shear_decay_time : float
        Time [s] in which it lets that shear fall to 1/e.
    smallest_feature : float
        Width [m] of the smallest feature that the maps can show.
    """

    depth: float
    cells_through_depth: float
    numerical_viscosity: float
    shear_decay_time: float
    smallest_feature: float = 0.0

    @classmethod
    def of(cls, depth: float, scene: Scene, dt: float) -> "DepthResolution":
        """Of a flow of ``depth`` [m] in a scene that is stepped by ``dt`` [s]; zero cells and no viscosity without a flow."""
        h = scene.spacing[2]
        feature = formulas.smallest_feature(max(scene.spacing[:2]), max(scene.raster.cell_size))
        if not (depth > 0 and dt > 0):
            return cls(0.0, 0.0, 0.0, math.inf, feature)
        wave = formulas.shear_wave_length(depth)
        viscosity = formulas.numerical_viscosity(h, wave, dt, scene.keeps)
        return cls(depth, depth / h, viscosity, formulas.decay_time(viscosity, wave) if viscosity > 0 else math.inf, feature)

    @property
    def is_coarse(self) -> bool:
        """Whether there is a flow of less than :data:`FEWEST_CELLS` cells."""
        return 0 < self.cells_through_depth < FEWEST_CELLS

    def statement(self) -> str:
        """All of it in a sentence without a beginning and an end."""
        return (
            f"{self.cells_through_depth:.2g} cells through a depth of {self.depth:.3g} m; the transfers act like a viscosity of "
            f"{self.numerical_viscosity:.2g} m2/s, which stops shear through the depth in {self.shear_decay_time:.2g} s"
        )

    def attributes(self) -> dict[str, float]:
        """Numbers for a file, by name; without a flow, or without any viscosity, what there is."""
        return {name: value for name, value in asdict(self).items() if math.isfinite(value)}


def flow_depth(peak_thickness: np.ndarray) -> float:
    """Depth [m] of a flow from the map of its largest thickness: the mean over its volume; 0 without any."""
    thickness = np.nan_to_num(np.asarray(peak_thickness, np.float64))
    return float((thickness**2).sum() / thickness.sum()) if thickness.sum() > 0 else 0.0


def worst(found: Iterable[Mapping[str, Any]]) -> dict[str, float]:
    """The least resolved of several runs, number by number; empty where no run tells."""
    told = [attributes for attributes in found if set(WORST) <= set(attributes)]
    return {name: float(pick(float(a[name]) for a in told)) for name, pick in WORST.items()} if told else {}
