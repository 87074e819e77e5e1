"""Small scenes in which transfers differ. Each function takes settings of a scene, such as ``{"transfer": "apic"}``."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np

from runout.backends.protocol import get_backend
from runout.materials.drucker_prager import DruckerPrager
from runout.materials.elastic import Elastic
from runout.model.materials import Material
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.studies.verification_cases.bodies import filled

SAND = DruckerPrager(density=1800.0, youngs_modulus=2e6, poisson_ratio=0.25, friction_angle=30.0)
CLAY = DruckerPrager(density=1000.0, youngs_modulus=2e5, poisson_ratio=0.49, friction_angle=0.0, cohesion=1e3)
SOFT = Elastic(density=1000.0, youngs_modulus=1e3, poisson_ratio=0.0)
GRAVITY = 9.81
Choices = Mapping[str, Any]


def weightless(material: Material = SOFT, spacing: float = 1.0) -> Scene:
    """A scene without ground and gravity."""
    return Scene((spacing,) * 3, None, Raster(100, 100, (1.0, 1.0)), (material,), (0.0,), (0.0, 0.0, 0.0), precision="float64")


def level(material: Material) -> Scene:
    """A level ground with friction 0.4, cells of 1 m."""
    ground = Surface.through(np.zeros((30, 30)), (4.0, 4.0))
    return replace(weightless(material), surface=ground, friction=(0.4,), gravity=(0.0, 0.0, -GRAVITY))


def block(corner: tuple[float, float, float], cells: tuple[float, float, float], density: float) -> Particles:
    """Eight regular particles in each cell of 1 m of a box."""
    axes = [np.arange(0.25, n, 0.5) + c for c, n in zip(corner, cells, strict=True)]
    return filled(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3), 1.0, density, 0.125, 0.25)


def shear_viscosity(cells: int, dt: float, way: Choices, since: int = 60, steps: int = 60) -> float:
    """Numerical viscosity [m2/s] of the transfers for a shear wave of ``cells`` cells with time step ``dt`` [s].

    The velocities that aflip keeps settle within 1 / (1 - ratio) steps; only steps after ``since`` are used.
    """
    p, k, left = block((10.0, 10.0, -1.5 * cells), (1.0, 1.0, 3.0 * cells), 1000.0), 2 * np.pi / cells, []
    z = p.position(np.ones(3))[:, 2]
    p.volume[:] = 1e-15
    p.velocity[:, 0], p.affine[:, 0, 2] = 1e-3 * np.cos(k * z), -1e-3 * k * np.sin(k * z)
    engine, inside = get_backend("reference"), np.abs(z) < cells / 2
    engine.load(replace(weightless(), **way), p)
    for step in range(since + steps + 1):
        engine.step(dt)
        if step in (since, since + steps):
            left.append(float(engine.particles().velocity[inside, 0] @ np.cos(k * z[inside])))
    return -math.log(left[1] / left[0]) / (steps * dt * k**2)


def roughness(p: Particles, material: DruckerPrager) -> float:
    """RMS difference of the pressure from its linear fit over the 20 nearest particles, over its mean; cells of 1 m."""
    from scipy.spatial import cKDTree

    x, b = p.position(np.ones(3)), p.strain[:, [0, 3, 5, 3, 1, 4, 5, 4, 2]].reshape(-1, 3, 3)
    bulk = material.lame_lambda + 2 / 3 * material.shear_modulus
    pressure, rest = -0.5 * bulk * np.log(np.linalg.det(b + np.eye(3))), []
    for n, near in enumerate(cKDTree(x).query(x, k=20)[1]):
        arms = np.column_stack([np.ones(20), x[near] - x[n]])
        rest.append(pressure[n] - np.linalg.lstsq(arms, pressure[near], rcond=None)[0][0])
    return float(np.sqrt(np.mean(np.square(rest))) / np.abs(pressure).mean())


def collapse(way: Choices, steps: int = 130) -> tuple[float, float]:
    """Roughness of the pressure of a collapsing column of sand and its width [m], after ``steps`` at a Courant number of 0.4."""
    engine = get_backend("scan", threads=1)
    engine.load(replace(level(SAND), cfl=0.4, **way), block((50.3, 50.2, 0.0), (6.0, 6.0, 8.0), SAND.density))
    for _ in range(steps):
        engine.step(engine.stable_step())
    p = engine.particles()
    return roughness(p, SAND), float(np.ptp(p.position(np.ones(3))[:, 0]))


class Footing:
    """A rigid rough strip on a slice of clay, one cell thick: half of it, mirrored at x = 0; lengths in widths of the strip.

    The slice repeats after one cell. Nodes in the strip, at the mirror, at the far side and at the bottom are held before contact.
    """

    cells, depth, reach, margin = 3, 2.0, 3.0, 10  # cells of half the strip; of the clay; cells beside it

    def __init__(self, way: Choices, speed: float):
        self.h, self.speed, self.pressed, self.load = 0.5 / self.cells, speed, 0.0, 0.0
        half = self.h / 2
        x, z = np.meshgrid(np.arange(half / 2, self.reach, half), np.arange(half / 2, self.depth, half), indexing="ij")
        place = np.stack([x.ravel(), np.full(x.size, 1.5 * self.h), z.ravel()], axis=1) + self.h * self.margin * np.array([1, 0, 1])
        p = filled(place, self.h, CLAY.density, half**2 * self.h)
        self.engine: Any = cast(Any, get_backend("reference"))
        self.engine.period, self.engine.watch = np.array([10**7, 1, 10**7]), self._hold
        self.engine.load(replace(weightless(CLAY, self.h), **way), p)

    def _hold(self, stencils: Any, mass: np.ndarray, velocity: np.ndarray) -> None:
        p = self.engine.particles()
        shape = np.minimum(p.node.max(axis=0) + 3 - stencils.first, self.engine.period)
        east, _, up = np.unravel_index(np.arange(stencils.size), shape)
        east, up = east + stencils.first[0] - self.margin, up + stencils.first[2] - self.margin
        velocity[(east <= 0) | (east >= round(self.reach / self.h)), 0] = 0.0
        velocity[up <= 0] = 0.0
        strip = (up * self.h >= self.depth - self.pressed - 1e-9) & (east <= self.cells)
        self.load = float(mass[strip] @ (velocity[strip, 2] + self.speed))
        velocity[strip] = (0.0, 0.0, -self.speed)

    def bearing(self, until: float = 0.1) -> float:
        """Load over (2 + pi) c and the strip's width on the grid, the mean over the last third of a settlement of ``until``."""
        loads = []
        while self.pressed < until:
            dt = self.engine.stable_step()
            self.engine.step(dt)
            self.pressed += self.speed * dt
            if self.pressed > 2 / 3 * until:
                loads.append(self.load / (dt * self.h * (self.cells + 0.5) * self.h))
        return float(np.mean(loads)) / ((2 + math.pi) * CLAY.cohesion)


def footing(way: Choices, speed: float) -> float:
    """Load of a strip footing over the exact one."""
    return Footing(way, speed).bearing()


def thrown(way: Choices, speed: float, steps: int = 280) -> float:
    """Relative height after landing of a layer of sand, 4 cells thick and periodic in plan, thrown up at ``speed`` [m/s]."""
    p = block((20.0, 20.0, 0.0), (4.0, 4.0, 4.0), SAND.density)
    z, heights = p.position(np.ones(3))[:, 2], []
    p.strain[:, 2] = np.expm1(-2 * SAND.density * GRAVITY * (4 - z) / (SAND.lame_lambda + 2 * SAND.shear_modulus))
    p.velocity[:, 2], p.affine[:, 2, 2] = speed * z / 4, speed / 4
    engine: Any = cast(Any, get_backend("reference"))
    engine.period = np.array([4, 4, 10**7])
    engine.load(replace(level(SAND), **way), p)
    for step in range(steps):
        engine.step(engine.stable_step())
        if step > 2 / 3 * steps:
            heights.append(engine.particles().position(np.ones(3))[:, 2].mean() / z.mean())
    return float(np.mean(heights))


def parted(way: Choices, gap: float, steps: int = 60) -> float:
    """Share of speed that two separating blocks of sand lose, from a distance of ``gap`` cells between their particles."""
    west, east = (block((x, 30.0, 0.0), (3.0, 3.0, 3.0), SAND.density) for x in (30.0, 32.5 + gap))
    west.velocity[:, 0], east.velocity[:, 0] = -0.5, 0.5
    engine = get_backend("scan", threads=1)
    engine.load(replace(weightless(SAND), **way), Particles.concatenate([west, east]))
    for _ in range(steps):
        engine.step(2e-3)
    q = engine.particles().take(np.arange(len(west)))
    return 1.0 + float(q.mass @ q.velocity[:, 0]) / (0.5 * float(q.mass.sum()))
