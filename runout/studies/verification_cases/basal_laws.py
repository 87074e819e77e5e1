"""voellmy, weakening: an endless layer on a plane against friction that depends on its speed."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.backends.protocol import get_backend
from runout.friction.velocity_weakening import VelocityWeakening
from runout.friction.voellmy import Voellmy
from runout.materials.drucker_prager import DruckerPrager
from runout.model.basal_friction import BasalFriction
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.release import arrangement
from runout.studies.verification_cases.bodies import advance, equal_steps
from runout.studies.verification_cases.closed_forms import GRAVITY
from runout.studies.verification_cases.finding import Bound, Case, Result

PER_CELL = 2  # particles along an axis
PERIOD = 8  # cells along and across the slope
SNOW = DruckerPrager(density=200.0, youngs_modulus=1e6, poisson_ratio=0.3, friction_angle=50.0)
VOELLMY = Voellmy(mu=0.2, xi=1000.0)
WEAK = VelocityWeakening(static_friction=0.4, dynamic_friction=0.15, weakening_speed=4.0)
WEAK_START = 4.0  # [m/s]; near rest the closed form hardly determines the motion
SLOPE_DEG = 30.0


@dataclass(frozen=True)
class Layer:
    """An endless layer on a plane along the grid; gravity is inclined in place of the plane."""

    friction: BasalFriction
    thickness: float = 2.0  # normal to the slope [m]
    cells: int = 2  # through the thickness
    slope_deg: float = SLOPE_DEG
    material: DruckerPrager = SNOW
    strength: tuple[float, ...] = ()  # of the scene; empty for no limit
    start: float = 0.0  # speed at the start [m/s]

    @property
    def spacing(self) -> float:
        """Of the grid [m]."""
        return self.thickness / self.cells

    def scene(self) -> Scene:
        """The plane below the layer, as long as it slides."""
        h, slope = self.spacing, math.radians(self.slope_deg)
        floor = Surface.through(np.full((8, 8), 10.0 * h), (PERIOD * h, PERIOD * h))
        gravity = (GRAVITY * math.sin(slope), 0.0, -GRAVITY * math.cos(slope))
        raster, chosen = Raster(4000, 4000, (h, h)), {"precision": "float64", "strength": self.strength}
        return Scene((h,) * 3, floor, raster, (self.material,), (self.friction,), gravity, **chosen)  # type: ignore[arg-type]

    def particles(self) -> Particles:
        """At rest under their own weight; staggered levels above each other, half a cell from the end of the period."""
        h, columns = self.spacing, PERIOD * PER_CELL
        counts = (columns, columns, self.cells * PER_CELL)
        index = np.stack(np.unravel_index(np.arange(math.prod(counts)), counts), axis=1)
        q = np.column_stack([index[:, :2] + 0.5 + 0.5 * PER_CELL, index[:, 2] + arrangement.shares(index[:, :2])])
        x = q * h / PER_CELL
        weight = self.material.density * GRAVITY * math.cos(math.radians(self.slope_deg)) * (self.thickness - x[:, 2])
        p = Particles.at(x + np.array([0.0, 0.0, 10.0 * h]), np.full(3, h))
        p.volume[:] = (h / PER_CELL) ** 3
        p.mass[:] = self.material.density * p.volume
        p.radius[:] = arrangement.half_size(np.array(h / PER_CELL))
        p.velocity[:, 0] = self.start
        p.strain[:, 2] = np.expm1(-2.0 * weight / (self.material.lame_lambda + 2.0 * self.material.shear_modulus))
        return p

    def engine(self, backend: str = "scan") -> Any:
        """A backend with the layer on a grid that repeats along and across the slope."""
        engine: Any = get_backend("scan", threads=1, index="dense") if backend == "scan" else get_backend(backend)
        engine.period = (PERIOD, PERIOD, 0) if backend == "scan" else np.array([PERIOD, PERIOD, 10**7])
        engine.load(self.scene(), self.particles())
        return engine

    def speeds(self, times: tuple[float, ...], backend: str = "scan") -> list[float]:
        """Mean speeds [m/s] down the slope after some times [s]."""
        engine, scene, before, speeds = self.engine(backend), self.scene(), 0.0, []
        for time in times:
            while before < time:
                span = min(1.0, time - before)
                steps, dt = equal_steps(span, 0.9 * engine.stable_step())
                advance(engine, scene, steps, dt)
                before += span
            p = engine.particles()
            speeds.append(float(p.mass @ p.velocity[:, 0] / p.mass.sum()))
        return speeds


def voellmy_speed(time: float, layer: Layer) -> float:
    """Speed [m/s] of a rigid layer from rest: v_inf tanh(a t / v_inf) with v_inf^2 = xi H (sin - mu cos)."""
    slope, law = math.radians(layer.slope_deg), layer.friction
    assert isinstance(law, Voellmy)
    surplus = math.sin(slope) - law.mu * math.cos(slope)
    most = math.sqrt(surplus * layer.thickness / (1.0 / law.xi + law.forest_drag / GRAVITY))
    return most * math.tanh(GRAVITY * surplus * time / most)


def weakening_time(speed: float, layer: Layer) -> float:
    """Time [s] in which a rigid layer comes from its start to a speed [m/s] against friction that falls with it."""
    slope, law = math.radians(layer.slope_deg), layer.friction
    assert isinstance(law, VelocityWeakening)
    a = GRAVITY * (math.sin(slope) - law.dynamic_friction * math.cos(slope))
    b = GRAVITY * math.cos(slope) * (law.static_friction - law.dynamic_friction)
    begin, end = (1.0 + v / law.weakening_speed for v in (layer.start, speed))
    return law.weakening_speed / a * (end - begin + b / a * math.log((a * end - b) / (a * begin - b)))


def measure_voellmy(full: bool) -> list[Result]:
    """Error of the speed of layers, and of one below forest."""
    results: list[Result] = []
    times = (2.0, 5.0, 10.0, 20.0) if full else (2.0, 5.0)
    for thickness, cells in ((2.0, 1), (2.0, 2), (2.0, 4), (4.0, 1), (4.0, 2), (4.0, 4)) if full else ((2.0, 1), (2.0, 2)):
        layer = Layer(VOELLMY, thickness, cells)
        for time, speed in zip(times, layer.speeds(times), strict=True):
            words = f"error of the speed after {time:g} s, {thickness:g} m thick in {cells} cell{'s' * (cells > 1)}"
            results.append(Bound(words, speed / voellmy_speed(time, layer) - 1, 0.003, -0.003))
    wood = Layer(Voellmy(mu=0.2, xi=1000.0, forest_drag=0.01))
    error = wood.speeds((5.0,))[0] / voellmy_speed(5.0, wood) - 1
    results.append(Bound("error of the speed after 5 s with a forest drag of 0.01", error, 0.003, -0.003))
    return results


def measure_weakening(full: bool) -> list[Result]:
    """Error of the time to a speed."""
    layer, times = Layer(WEAK, start=WEAK_START), (1.0, 2.0, 5.0) if full else (1.0, 2.0)
    results: list[Result] = []
    for time, speed in zip(times, layer.speeds(times), strict=True):
        error = time / weakening_time(speed, layer) - 1
        results.append(Bound(f"error of the time to the speed after {time:g} s", error, 0.005, -0.005))
    return results


SETUP = f"endless layer on {SLOPE_DEG:g} deg, 200 kg/m3, E = 1 MPa, internal friction angle 50 deg"
DRAG = Case("voellmy", "Voellmy drag", f"{SETUP}; mu = 0.2, xi = 1000 m/s2; from rest; v_inf tanh(a t / v_inf)", measure_voellmy)
WEAKENING = Case(
    "weakening",
    "velocity weakening",
    f"{SETUP}; from {WEAK_START:g} m/s; friction falls from 0.4 to 0.15, half of this at 4 m/s; 2 cells thick",
    measure_weakening,
)
