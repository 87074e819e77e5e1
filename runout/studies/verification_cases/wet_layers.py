"""pore-pressure: layers whose pore pressure decays slide down a slope; the pressure below a layer at rest drains.

The closed forms are

    v = g ((sin - mu cos) t + mu cos lambda_0 t_d (1 - exp(-t/t_d))),
    p/p_0 = sum over odd k of 4/(pi k) (-1)^((k-1)/2) exp(-k^2 pi^2 D t/(4 H^2))        (Terzaghi 1943, ch. 13)

for the speed of a layer from rest on a slope, where lambda_0 is the ratio at the start and t_d the time of decay, and for the
excess pressure at the base of a layer of thickness H that drains at its top.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.backends.protocol import Backend, get_backend
from runout.materials.drucker_prager import DruckerPrager
from runout.materials.elastic import Elastic
from runout.model.materials import Material
from runout.model.particles import Particles
from runout.model.pore_pressure import PorePressure
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.studies.verification_cases.bodies import advance, equal_steps, lattice, particles_at
from runout.studies.verification_cases.closed_forms import GRAVITY
from runout.studies.verification_cases.finding import Bound, Case, Result

SLOPE_DEG, FRICTION_DEG, DENSITY = 20.0, 25.0, 2000.0
RATIO, DECAY_TIME = 0.7, 5.0
SPACING, CELL, FLOOR = 0.5, 2.0, 2.175  # of the grid, of the raster [m]; height of the ground [m]
PERIOD = 4  # cells after which the grid of an endless layer repeats
STIFF = Elastic(density=DENSITY, youngs_modulus=2e6, poisson_ratio=0.0)
SAND = DruckerPrager(density=DENSITY, youngs_modulus=2e6, friction_angle=35.0)
MU = math.tan(math.radians(FRICTION_DEG))
TERMS = 2.0 * np.arange(2000) + 1.0


def speed_of_layer(time: float) -> float:
    """Speed [m/s] of a layer with the ratio and the decay time of this module, from rest."""
    slope, lost = math.radians(SLOPE_DEG), RATIO * DECAY_TIME * (1.0 - math.exp(-time / DECAY_TIME))
    return GRAVITY * ((math.sin(slope) - MU * math.cos(slope)) * time + MU * math.cos(slope) * lost)


def pressure_at_base(time: float) -> float:
    """Excess pressure at the base over that at the start [1] after a ``time`` D t/H^2 [1]."""
    signs = np.where(np.arange(len(TERMS)) % 2, -1.0, 1.0)
    return float(np.sum(4.0 / (np.pi * TERMS) * signs * np.exp(-(TERMS**2) * np.pi**2 / 4.0 * time)))


@dataclass(frozen=True)
class Layer:
    """A slab on a plane along the grid with gravity inclined, or a part of an endless layer."""

    pore: PorePressure
    size: tuple[float, float, float]  # down the slope, across and normal to it [m]
    slope_deg: float = SLOPE_DEG  # [deg]
    material: Material = STIFF
    substeps: int = 1  # of a transfer, at most

    def scene(self) -> Scene:
        """The plane."""
        slope = math.radians(self.slope_deg)
        floor = Surface.through(np.full((41, 13), FLOOR), (CELL, CELL))
        gravity = (GRAVITY * math.sin(slope), 0.0, -GRAVITY * math.cos(slope))
        return Scene(
            (SPACING,) * 3, floor, Raster(12, 40, (CELL, CELL)), (self.material,), (MU,), gravity, precision="float64",
            substeps=self.substeps, pore_pressure=(self.pore,),
        )  # fmt: skip

    def particles(self) -> Particles:
        """The layer at rest, with the normal stress of its weight and, if it slides, the shear stress that friction asks for."""
        local, ratio = lattice(self.size, SPACING), float(self.pore.ratio)
        p = particles_at(local + np.array([4.0, 8.0, FLOOR]), SPACING, DENSITY, SPACING / 4)
        weight = DENSITY * GRAVITY * math.cos(math.radians(self.slope_deg)) * (self.size[2] - local[:, 2])
        p.strain[:, 2] = np.expm1(-2.0 * weight / (self.material.lame_lambda + 2.0 * self.material.shear_modulus))
        if self.slope_deg > 0.0 and self.material is SAND:
            p.strain[:, 5] = MU * (1.0 - ratio) * weight / self.material.shear_modulus
        p.pore_excess[:], p.pore_left[:] = ratio - self.pore.equilibrium(DENSITY), 1.0
        return p


def states(layer: Layer, engine: Backend, times: Sequence[float]) -> list[Particles]:
    """Particles at some ``times`` [s]."""
    scene, states, before = layer.scene(), list[Particles](), 0.0
    engine.load(scene, layer.particles())
    for time in times:
        steps, dt = equal_steps(time - before, 0.9 * engine.stable_step())
        advance(engine, scene, steps, dt)
        states.append(engine.particles())
        before = time
    return states


def speed_error(layer: Layer, engine: Backend, times: Sequence[float]) -> float:
    """Largest relative error of the mean speed at some ``times`` [s]."""
    speeds = [p.velocity[:, 0].mean() for p in states(layer, engine, times)]
    return float(np.abs(np.array(speeds) / [speed_of_layer(time) for time in times] - 1.0).max())


def consolidation_errors(layer: Layer, engine: Backend, times: Sequence[float]) -> list[float]:
    """Errors of the excess pressure below the middle of a slab at rest, over that at the start, at some ``times`` D t/H^2 [1]."""
    assert layer.pore.diffusivity is not None
    seconds = [time * layer.size[2] ** 2 / layer.pore.diffusivity for time in times]
    errors = []
    for time, p in zip(times, states(layer, engine, seconds), strict=True):
        x, y, _ = p.position(np.full(3, SPACING)).T
        middle = np.hypot(x - 4.0 - layer.size[0] / 2, y - 8.0 - layer.size[1] / 2) < SPACING
        record = layer.scene().pore_table()[0]
        left = np.minimum(1.0, record["closure"] * p.pore_left[middle])
        errors.append(float(left.mean()) - pressure_at_base(time))
    return errors


def endless() -> Any:
    """The reference backend whose grid repeats, for a part of an endless layer."""
    engine: Any = get_backend("reference")
    engine.period[:2] = PERIOD
    return engine


DECAYS = PorePressure(ratio=RATIO, decay_time=DECAY_TIME)
DRAINS = PorePressure(ratio=0.8, saturation=0.5, diffusivity=1.0)


def measure(full: bool) -> list[Result]:
    """Speeds of layers whose pore pressure decays, and excess pressure below a layer that drains."""
    until = 8 if full else 2
    times = np.arange(1.0, until + 1.0).tolist()
    results: list[Result] = []
    for substeps in (1, 4):
        slab = Layer(DECAYS, (6.0, 1.0, 0.5), substeps=substeps)
        error = speed_error(slab, get_backend("scan", threads=1), times)
        results.append(Bound(f"largest error of the speed to {until} s, stiff slab, substeps {substeps}", error, 0.005))
    for cells in (2, 4) if full else (2,):
        side = PERIOD * SPACING
        layer = Layer(DECAYS, (side, side, cells * SPACING), material=SAND)
        quantity = f"the same, endless layer of sand, {cells} cells"
        results.append(Bound(quantity, speed_error(layer, endless(), times), 0.005 if cells == 2 else 0.012))
    stages = (0.1, 0.2, 0.5, 1.0)
    slab = Layer(DRAINS, (5.0, 5.0, 1.0), slope_deg=0.0, substeps=4)
    for time, error in zip(stages, consolidation_errors(slab, get_backend("scan", threads=1), stages), strict=True):
        results.append(Bound(f"error of the excess pressure at the base, D t/H2 = {time:g}", error, 0.05, -0.05))
    return results


CASE = Case(
    "pore-pressure",
    "pore pressure of layers",
    f"{SLOPE_DEG:g} deg, ground of {FRICTION_DEG:g} deg, ratio {RATIO:g}, decay time {DECAY_TIME:g} s: elastic slab of 6 m x 1 m x "
    f"0.5 m, and a layer of sand of 35 deg whose grid repeats; h = {SPACING:g} m; a slab of 1 m at rest, D = 1 m2/s, against the "
    "whole series of Terzaghi",
    measure,
    "The layer of sand starts with the shear stress of its friction. Without it the mass shears first, which costs some percent of "
    "the speed in the first second. The closure of the drainage has one term of the series, bounded by the pressure at the start: "
    "4.8 % of the excess is its own error at D t/H2 = 0.1.",
)
