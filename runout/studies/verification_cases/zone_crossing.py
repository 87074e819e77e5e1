"""zones: a stiff slab slides down a plane over zones of friction; its centre of mass against a closed form.

The closed form has the same pressure everywhere below the slab. Friction acts at the lowest particles, a lever b below the centre
of mass, so the slab presses harder on the ground below its front: the centre of pressure lies mu b ahead, and the slab meets each
border that much earlier. The error grows with the thickness, and finer grids do not lower it. The closed form with that lever has
no such part.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from runout.backends.protocol import Backend, get_backend
from runout.friction.voellmy import Voellmy
from runout.materials.elastic import Elastic
from runout.model.friction import FrictionZones
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.studies.verification_cases.bodies import advance, equal_steps, lattice, particles_at
from runout.studies.verification_cases.closed_forms import GRAVITY, ZonesDownSlope
from runout.studies.verification_cases.finding import Bound, Case, Result

SLOPE_DEG = 25.0
CELL, CELLS = 2.0, (40, 12)  # of the raster of zones [m], and their number
CORNER = (4.0, 10.0)  # of the slab at the start [m]
RIM = 0.46  # cells that a rim counts too much in the ground area of law voellmy (docs/theory.md)
LOOKS = 40
SLAB = Elastic(density=2000.0, youngs_modulus=2e6, poisson_ratio=0.0)


@dataclass(frozen=True)
class Crossing:
    """A slab on a plane along the grid, with gravity inclined, that crosses zones of friction."""

    mu: tuple[float, ...] = (0.1, 0.35, 0.6)  # Coulomb coefficient of each zone [1]
    borders: tuple[float, ...] = (20.6, 35.4)  # places [m] down the slope at which zones end, in order, one less than zones
    xi: tuple[float, ...] = ()  # turbulence coefficient of each zone [m/s2], for law `voellmy`; empty for Coulomb friction
    # whether a cell takes the friction at its centre, as from a raster, or the mean by area, as from polygons
    sampled: bool = False
    size: tuple[float, float, float] = (12.0, 1.0, 0.5)  # of the slab, down the slope, across and normal to it [m]
    spacing: float = 0.5  # of the grid [m]
    # start, time: speed at the start [m/s]; duration [s]
    start: float = 4.0
    time: float = 4.0

    @property
    def edges(self) -> tuple[float, ...]:
        """Borders [m] at which the friction of the cells changes: of zones that are sampled, those of the cells."""
        return tuple(CELL * round(border / CELL) for border in self.borders) if self.sampled else self.borders

    def closed_form(self) -> ZonesDownSlope:
        """The zones as they are meant; drag on the ground area that law ``voellmy`` counts."""
        length, width, thickness = self.size
        more = (1.0 + 2.0 * RIM * self.spacing / length) * (1.0 + 2.0 * RIM * self.spacing / width)
        return ZonesDownSlope(self.edges, self.mu, tuple(GRAVITY * more / (xi * thickness) for xi in self.xi))

    def zones(self) -> FrictionZones:
        """Zones that replace all friction of the slab."""
        nothing = np.zeros(CELLS)
        if not self.xi:
            return FrictionZones(nothing, self._on_cells(self.mu), (CELL, CELL))
        own = {"mu": self.mu, "inverse_xi": tuple(1.0 / xi for xi in self.xi)}
        replaced = {name: (nothing, self._on_cells(values)) for name, values in own.items()}
        return FrictionZones(np.ones(CELLS), nothing, (CELL, CELL), replaced=replaced)

    def _on_cells(self, values: tuple[float, ...]) -> np.ndarray:
        """Values (nx, ny) of the cells: means by area, of zones between :attr:`edges`."""
        east = CELL * np.arange(1, CELLS[0] + 1)
        beyond = np.clip((east[:, None] - np.array(self.edges)) / CELL, 0.0, 1.0)
        return np.repeat((values[0] + beyond @ np.diff(values))[:, None], CELLS[1], axis=1)

    def scene(self) -> Scene:
        """The plane with its zones."""
        h, slope = self.spacing, math.radians(SLOPE_DEG)
        floor = Surface.through(np.full((CELLS[0] + 1, CELLS[1] + 1), 4.35 * h), (CELL, CELL))
        gravity = (GRAVITY * math.sin(slope), 0.0, -GRAVITY * math.cos(slope))
        friction = Voellmy(mu=2.0, xi=1.0) if self.xi else 2.0  # of no cell
        raster = Raster(CELLS[1], CELLS[0], (CELL, CELL))
        chosen = {"precision": "float64", "friction_zones": self.zones()}
        return Scene((h,) * 3, floor, raster, (SLAB,), (friction,), gravity, **chosen)  # type: ignore[arg-type]

    def particles(self) -> Particles:
        """The slab, under its own weight and with its speed."""
        h, local = self.spacing, lattice(self.size, self.spacing)
        p = particles_at(local + np.array([*CORNER, 4.35 * h]), h, SLAB.density, h / 4)
        weight = SLAB.density * GRAVITY * math.cos(math.radians(SLOPE_DEG)) * (self.size[2] - local[:, 2])
        p.strain[:, 2] = np.expm1(-2.0 * weight / SLAB.modulus)
        p.velocity[:, 0] = self.start
        return p

    def motion(self, engine: Backend | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Places [m] and speeds [m/s] of the centre of mass down the slope at the start and at :data:`LOOKS` times."""
        engine = engine or get_backend("scan", threads=1)
        scene = self.scene()
        engine.load(scene, self.particles())
        centres = [self._centre(engine)]
        for _ in range(LOOKS):
            steps, dt = equal_steps(self.time / LOOKS, 0.95 * engine.stable_step())
            advance(engine, scene, steps, dt)
            centres.append(self._centre(engine))
        places, speeds = np.array(centres).T
        return places, speeds

    def _centre(self, engine: Backend) -> tuple[float, float]:
        p = engine.particles()
        return float(p.position(np.full(3, self.spacing))[:, 0].mean()), float(p.velocity[:, 0].mean())

    @property
    def lever(self) -> float:
        """Height [m] of the centre of mass above the lowest particles, at which friction acts."""
        return self.size[2] / 2 - self.spacing / 4

    def errors(self, places: np.ndarray, speeds: np.ndarray, lever: float = 0.0) -> np.ndarray:
        """Relative errors of the speeds of a :meth:`motion`, with the same pressure everywhere unless a ``lever`` [m] is given."""
        exact = self.closed_form().speeds(places, self.size[0], SLOPE_DEG, self.start, lever)
        return speeds / exact - 1.0  # type: ignore[no-any-return]


VOELLMY = Crossing((0.1, 0.3, 0.05), (13.6, 20.4), (400.0, 150.0, 800.0), size=(8.0, 3.0, 0.5), start=6.0, time=3.5)
THICK = Crossing(size=(12.0, 1.0, 1.0))
SLABS = {
    "Coulomb, means by area": (Crossing(), 0.004),
    "Coulomb, friction at the centres of cells": (Crossing(sampled=True), 0.004),
    "Coulomb, slab of 1 m": (THICK, np.inf),
    "Voellmy, means by area": (VOELLMY, 0.025),
    "Voellmy, friction at the centres of cells": (replace(VOELLMY, sampled=True), 0.025),
}


def measure(full: bool) -> list[Result]:
    """Largest errors of the speed on the way; also with half the grid spacing if ``full``."""
    results: list[Result] = []
    for words, (slab, most) in SLABS.items():
        for part in (1, 2) if full else (1,):
            one = replace(slab, spacing=slab.spacing / part)
            motion, quantity = one.motion(), f"largest error of the speed, {words}, h = {one.spacing:g} m"
            results.append(Bound(quantity, _largest(one.errors(*motion)), most))
            if not slab.xi:
                results.append(Bound(f"{quantity}, with the lever", _largest(one.errors(*motion, one.lever)), 0.003))
    return results


def _largest(errors: np.ndarray) -> float:
    """Largest of the ``errors`` (looks,) as means of two looks, about the period 4 H/c_s of a slab of 1 m in shear."""
    return float(np.abs(0.5 * (errors[1:] + errors[:-1])).max())


CASE = Case(
    "zones",
    "zones of friction",
    f"stiff slab on {SLOPE_DEG:g} deg, 0.5 m thick, borders inside cells of 2 m; Coulomb: 12 m long, mu = 0.1, 0.35, 0.6; "
    "Voellmy: 8 m long, mu = 0.1, 0.3, 0.05, xi = 400, 150, 800 m/s2; "
    "d(v^2)/dX = 2 g (sin - mean(mu) cos) - 2 g v^2 mean(1/xi)/H",
    measure,
    "The closed form has the same pressure everywhere below the slab. Friction acts below the centre of mass and presses the front "
    "down, so the slab meets each border early by mu times that lever: the error grows with the thickness, and a finer grid does "
    "not lower it. The slab is elastic and vibrates while it slides, from look to look where the friction is largest; fewer "
    "transfers damp it less (0.6 % of the speed with 4 substeps and h = 0.25 m, 0.3 % with one). A rigid slab does not: errors "
    "are means of two looks, 0.2 s. With the linear pressure of a rigid body on that lever 0.3 % remain for both thicknesses. "
    "The closed form of "
    f"Voellmy has the ground area that the law counts, {RIM:g} cells more at each rim.",
)
