"""The scene of the benchmarks: a moving Drucker-Prager layer on a plane, with contact, in one body or in several far apart."""

import math
from dataclasses import dataclass

import numpy as np

from runout.materials.drucker_prager import DruckerPrager
from runout.model.particles import Particles
from runout.model.scene import STANDARD_GRAVITY, Raster, Scene
from runout.model.surface import Surface
from runout.release import arrangement

SPACING = 2.0  # [m]
PER_CELL = 2  # particles of a cell along an axis
MARGIN = 16  # cells around the layer, to move into
SPEED = 4.0  # [m/s] down the slope; 1 to 2 % of the particles change their cell in a step
SLOPE = math.radians(20.0)
FRICTION = math.tan(math.radians(17.0))
SAND = DruckerPrager(density=2000.0, youngs_modulus=1e7, poisson_ratio=0.3, friction_angle=30.0)


@dataclass(frozen=True)
class Layer:
    """A square layer with eight particles a cell, or another number above each other."""

    particles: int  # about so many; a whole number of columns is made
    depth: int = 8  # cells through its depth
    # volume of the box around all bodies over the volume of the bodies; 1 is one body, more is two, apart along a contour
    sparsity: float = 1.0
    precision: str = "float32"
    aligned: bool = False  # keep the plane level and tilt gravity, so that the box around the layer holds the layer alone
    upwards: int = PER_CELL  # particles of a cell above each other

    @property
    def columns(self) -> tuple[int, int]:
        """Columns of cells down the slope and, an even number, along the contour."""
        area = self.particles / (PER_CELL**2 * self.upwards * self.depth)
        across = max(2, 2 * round(math.sqrt(area) / 2))
        return max(1, round(area / across)), across

    @property
    def gap(self) -> int:
        """Cells between the two bodies."""
        return round((self.sparsity - 1.0) * self.columns[1])

    def build(self, seed: int = 0) -> tuple[Scene, Particles]:
        """Scene and particles; seeded positions in plan within their share of a cell, stressed by the weight above."""
        raster = Raster(self.columns[1] + self.gap + 2 * MARGIN, self.columns[0] + 2 * MARGIN, (SPACING, SPACING))
        surface = self._plane(raster)
        particles = self._particles(surface, np.random.default_rng(seed))
        tilt = SLOPE if self.aligned else 0.0
        gravity = (STANDARD_GRAVITY * math.sin(tilt), 0.0, -STANDARD_GRAVITY * math.cos(tilt))
        scene = Scene((SPACING,) * 3, surface, raster, (SAND,), (FRICTION,), gravity, precision=self.precision)
        return scene, particles

    def _plane(self, raster: Raster) -> Surface:
        """The ground; its lattice is as coarse as possible, so that it does not affect the measurement."""
        x = np.linspace(0.0, raster.columns * SPACING, 8)
        y = np.linspace(0.0, raster.rows * SPACING, 8)
        slope = 0.0 if self.aligned else math.tan(SLOPE)
        fall = np.repeat(slope * (x[-1] - x)[:, None], len(y), axis=1)
        return Surface.through(10.0 + fall, (float(x[1]), float(y[1])))

    def _particles(self, surface: Surface, rng: np.random.Generator) -> Particles:
        per_cell = np.array([PER_CELL, PER_CELL, self.upwards])
        own = SPACING / per_cell
        counts = (per_cell * (*self.columns, self.depth)).tolist()
        index = np.stack(np.unravel_index(np.arange(math.prod(counts)), counts), axis=1)
        q = index + np.column_stack([rng.uniform(0.0, 1.0, (len(index), 2)), arrangement.shares(index[:, :2])])
        q[:, 1] += np.where(q[:, 1] >= counts[1] / 2, self.gap * PER_CELL, 0)
        x = q * own + np.array([MARGIN * SPACING, MARGIN * SPACING, 0.0])
        above = self.depth * SPACING - q[:, 2] * own[2]
        x[:, 2] += surface.elevation(x[:, 0], x[:, 1])
        p = Particles.at(x, np.full(3, SPACING))
        p.volume[:] = own.prod()
        p.mass[:] = SAND.density * own.prod()
        p.radius[:] = arrangement.half_size(own[2])
        stiffness = SAND.lame_lambda + 2 * SAND.shear_modulus
        p.strain[:, 2] = np.expm1(-2 * SAND.density * STANDARD_GRAVITY * above / stiffness)
        down = np.array([1.0, 0.0, 0.0]) if self.aligned else np.array([math.cos(SLOPE), 0.0, -math.sin(SLOPE)])
        p.velocity[:] = SPEED * down
        return p
