"""A layer that slides over a bed and takes it up at a fixed rate: speed of its middle, mass, and what is left of the bed.

The mass at rest that joins takes momentum from the flow: d(m v)/dt = m a with m = m_0 + k t, a = g (sin - mu cos), k = rho E.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from runout.backends.protocol import get_backend
from runout.erosion.growth import GrowthErosion
from runout.erosion.ramms import RammsErosion
from runout.materials.drucker_prager import DruckerPrager
from runout.model.bed import Bed
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.model.terrain import Terrain
from runout.simulation.erosion import ErodingBed
from runout.simulation.run import Run, RunControl
from runout.studies.verification_cases.bodies import lattice, particles_at
from runout.studies.verification_cases.closed_forms import GRAVITY
from runout.studies.verification_cases.finding import Bound, Case, Result

SLOPE, FRICTION = math.radians(30.0), math.tan(math.radians(20.0))
ACCELERATION = GRAVITY * (math.sin(SLOPE) - FRICTION * math.cos(SLOPE))
RATE, SPEED, THICKNESS = 0.05, 5.0, 1.0  # [m/s], at the start [m/s], [m]
SAND = DruckerPrager(density=1800.0, youngs_modulus=2e6, poisson_ratio=0.25, friction_angle=35.0)
FIXED = RammsErosion(rate=RATE, critical_stress=0.0, depth_per_stress=1.0)
CELLS, CELL = (24, 50), 2.0  # of the raster
WIDTH = 12.0  # of the layer [m]
GROWTH = 0.02  # [1/m]
FINE = (4, 4, 4)  # births per cell: a quarter of the volume of 2 x 2 x 4


@dataclass
class Layer:
    """A layer over a bed on level ground under gravity inclined by 30 deg."""

    # spacing, length, time: of the grid and of the layer [m]; how long it slides [s]
    spacing: float
    length: float
    time: float
    bed: Bed | None
    backend: str = "scan"
    run: Run = field(init=False)  # once :meth:`slide` has been called

    def slide(self) -> "Layer":
        """This layer at its end."""
        h, gravity = self.spacing, (GRAVITY * math.sin(SLOPE), 0.0, -GRAVITY * math.cos(SLOPE))
        ground = Surface.through(np.zeros((12, 12)), (10.0, 10.0))
        raster = Raster(*CELLS, (CELL, CELL))
        scene = Scene((h, h, h), ground, raster, (SAND,), (FRICTION,), gravity, precision="float64")
        eroding = ErodingBed(self.bed, scene, Terrain.from_array(np.zeros(CELLS), CELL), [], FINE) if self.bed else None
        engine = get_backend(self.backend, threads=1)
        self.run = Run(engine, eroding.scene if eroding else scene, RunControl(self.time, stop=False), None, None, None, eroding)
        self.run.start(self._particles())
        self.run.go()
        return self

    def _particles(self) -> Particles:
        """Particles at the start, stressed by the weight above."""
        x = lattice((self.length, WIDTH, THICKNESS), self.spacing) + np.array([4.0, 18.0, 0.0])
        p = particles_at(x, self.spacing, SAND.density, self.spacing / 4)
        pressure = SAND.density * GRAVITY * math.cos(SLOPE) * (THICKNESS - x[:, 2])
        p.strain[:, 2] = np.expm1(-2.0 * pressure / (SAND.lame_lambda + 2.0 * SAND.shear_modulus))
        p.velocity[:, 0] = SPEED
        return p

    def middle(self) -> tuple[float, float]:
        """Mass per area [kg/m2] and speed [m/s] of the middle of the layer, a third of its length and width."""
        p = self.run.engine.particles()
        x = p.position(np.full(3, self.spacing))
        centre = 4.0 + self.length / 2 + SPEED * self.time + 0.5 * ACCELERATION * self.time**2
        chosen = (np.abs(x[:, 0] - centre) < self.length / 6) & (np.abs(x[:, 1] - 24.0) < WIDTH / 6)
        mass = p.mass[chosen].sum()
        return float(mass / (self.length / 3 * WIDTH / 3)), float((p.mass @ (p.velocity[:, 0] * chosen)) / mass)

    def unbooked(self) -> float:
        """Largest part of the mass that is neither there, nor gone, nor given by the bed [1]."""
        s = self.run.ledger.series()
        return float(np.abs((s["mass"] + s["escaped_mass"] - s["entrained_mass"]) / s["mass"][0] - 1.0).max())


def closed_form(time: float) -> tuple[float, float]:
    """Mass per area [kg/m2] and speed [m/s] of a layer over a bed that it erodes at the fixed rate."""
    m, k = SAND.density * THICKNESS, SAND.density * RATE
    return m + k * time, (m * SPEED + ACCELERATION * (m * time + k * time**2 / 2)) / (m + k * time)


def eroded_layer(spacing: float, length: float, time: float, backend: str = "scan") -> list[Result]:
    """Errors of mass and speed of the middle, and the mass that is not booked."""
    layer = Layer(spacing, length, time, Bed(2.0, FIXED), backend).slide()
    mass, speed = layer.middle()
    exact_mass, exact_speed = closed_form(time)
    return [
        Bound("relative error of the speed of the middle", speed / exact_speed - 1.0, 0.005, -0.005),
        Bound("relative error of the mass of the middle", mass / exact_mass - 1.0, 0.02, -0.02),
        Bound("mass that is not booked", layer.unbooked(), 1e-12),
    ]


def grown_volume(spacing: float, time: float, backend: str = "scan") -> float:
    """Relative error of a volume that grows with the path, V_0 exp(E_s s)."""
    layer = Layer(spacing, 24.0, time, Bed(5.0, GrowthErosion(growth_rate=GROWTH)), backend).slide()
    s, t = layer.run.ledger.series(), np.array(layer.run.ledger.time)
    speed = s["momentum_x"] / s["mass"]
    path = float((0.5 * (speed[1:] + speed[:-1]) * np.diff(t)).sum())
    return float(s["mass"][-1] / (s["mass"][0] * math.exp(GROWTH * path)) - 1.0)


def left_of_a_bed(spacing: float, backend: str = "scan") -> float:
    """Particles that are missing when a layer has passed over a patch of 4 m x 4 m that it takes up whole."""
    depth = np.zeros(CELLS)
    depth[11:13, 8:10] = 0.25
    bed = Bed(depth, RammsErosion(rate=1.0, critical_stress=0.0, depth_per_stress=1.0))
    layer = Layer(spacing, 24.0, 1.0, bed, backend).slide()
    eroding = layer.run.bed
    assert eroding is not None
    return float((depth.sum() * CELL**2 - eroding.booked.entrained_mass / SAND.density) / eroding.volume)


def measure(full: bool) -> list[Result]:
    """All of these, in CI for half a second on cells of 1 m."""
    spacing, time = (0.5, 1.5) if full else (1.0, 0.7)
    return [
        *eroded_layer(spacing, 48.0 if full else 24.0, time),
        Bound("relative error of a volume that grows with the path", grown_volume(spacing, time), 0.01, -0.01),
        Bound("particles left of a bed that is used up", left_of_a_bed(spacing), 1.0, 0.0),
    ]


CASE = Case(
    "bed",
    "layer over an erodible bed",
    f"layer of 1 m, 35 deg, at {SPEED:g} m/s on a slope of 30 deg with a basal friction angle of 20 deg; its bed is eroded at "
    f"{RATE:g} m/s, in proportion to the flux, or used up",
    measure,
)
