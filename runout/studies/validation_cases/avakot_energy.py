"""Energy that the mass of avaKot loses without basal friction, beside that of single points that land inelastically.

The points have no grid, size or internal friction. Both take the same ground: the raster, or its means over larger cells. What
both lose alike is lost by landing; what only the mass loses, where its parts meet.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import runout
from runout.model.numerics import Scheme
from runout.model.scene import STANDARD_GRAVITY
from runout.model.surface import Surface
from runout.terrain.averaging import averaged
from runout.terrain.sdf import raster_surface

END, STEP = 20.0, 0.01  # [s]: time in which energy is lost, and step of the points
DENSITY, FRICTION_ANGLE = 200.0, 30.0  # [kg/m3], internal [deg]


@dataclass(frozen=True)
class Choice:
    """Size [m] of the cells over which the ground is averaged, cells [m] of the run, particles per cell, and substeps."""

    ground: float
    cell_size: float
    particles_per_cell: tuple[int, int, int]
    substeps: int = Scheme.substeps


FINE, COARSE = (2, 2, 14), (2, 2, 28)  # particles per cell of 5 m and 10 m: the same layers
CHOICES = (
    Choice(5.0, 5.0, FINE),
    Choice(5.0, 5.0, FINE, substeps=1),
    Choice(10.0, 5.0, FINE),
    Choice(10.0, 10.0, COARSE),
    Choice(20.0, 5.0, FINE),
)


def measure_energy(terrain: runout.Terrain, release: Any, choices: Sequence[Choice] = CHOICES) -> list[dict[str, Any]]:
    """Row of each choice: shares [1] of the potential energy that is set free; ``release(terrain)`` makes the mass."""
    return [_lost(chosen, terrain, release) for chosen in choices]


def _lost(chosen: Choice, terrain: runout.Terrain, release: Any) -> dict[str, Any]:
    ground = averaged(terrain, chosen.ground) if chosen.ground > terrain.cell_size[0] else terrain
    mass, snow = release(ground), runout.DruckerPrager(density=DENSITY, friction_angle=FRICTION_ANGLE)
    grid = {"cell_size": chosen.cell_size, "particles_per_cell": chosen.particles_per_cell, "substeps": chosen.substeps}
    result = runout.simulate(ground, mass, snow, basal_friction_angle=0.0, **grid, end_time=END, stop=False, threads=1)  # type: ignore[arg-type]
    energy = {name: float(series[-1] - series[0]) for name, series in result.ledger.items() if series.ndim == 1}
    freed = -energy["potential_energy"]
    return {
        "ground": chosen.ground,
        "cell_size": chosen.cell_size,
        "substeps": chosen.substeps,
        "points": Points.on(mass).slide(END).lost,
        "lost": 1.0 - energy["kinetic_energy"] / freed,
        **{name: energy[f"{name}_dissipation"] / freed for name in ("plastic", "basal", "numerical")},
    }


@dataclass
class Points:
    """Points of equal mass that fall, land without a rebound and slide, each alone."""

    surface: Surface  # the ground
    # place, velocity: (3, n): local [m] and [m/s]
    place: np.ndarray
    velocity: np.ndarray
    start: np.ndarray  # (n,): elevation [m] at the start
    # mu, drag: friction coefficient [1], and drag g / (xi h) [1/m], which acts in flight too
    mu: float = 0.0
    drag: float = 0.0

    @classmethod
    def on(cls, release: runout.Release, mu: float = 0.0, drag: float = 0.0) -> "Points":
        """One at rest in the middle of each cell of a release."""
        terrain = release.terrain
        rows, columns = np.nonzero(release.thickness > 0)
        map_place = np.column_stack([terrain.easting[columns], terrain.northing[rows], np.zeros(len(rows))])
        x, y, _ = terrain.frame.to_local(map_place).T
        surface = raster_surface(terrain, None, terrain.cell_size)
        z = surface.evaluate(x, y)[0]
        return cls(surface, np.array([x, y, z]), np.zeros((3, len(x))), z, mu, drag)

    def slide(self, seconds: float) -> "Points":
        """The same points after a time [s]."""
        for _ in range(round(seconds / STEP)):
            self._step()
        return self

    def _step(self) -> None:
        """Gravity and drag, motion, and a plastic impact of the points that have come below the ground."""
        self.velocity[2] -= STANDARD_GRAVITY * STEP
        self.velocity /= 1.0 + self.drag * STEP * np.linalg.norm(self.velocity, axis=0)
        self.place += STEP * self.velocity
        elevation, normal = self._ground()
        landed = self.place[2] <= elevation
        self.place[2] = np.where(landed, elevation, self.place[2])
        push = np.where(landed, np.maximum(0.0, -(self.velocity * normal).sum(axis=0)), 0.0)
        self.velocity += push * normal
        slip = self.velocity - (self.velocity * normal).sum(axis=0) * normal
        speed = np.maximum(np.linalg.norm(slip, axis=0), np.finfo(float).tiny)
        self.velocity -= slip * np.minimum(1.0, self.mu * push / speed)

    def _ground(self) -> tuple[np.ndarray, np.ndarray]:
        """Elevation (n,) [m] and upward unit normal (3, n) of the ground below."""
        elevation, east, north = self.surface.evaluate(*self.place[:2])
        normal = np.array([-east, -north, np.ones_like(east)])
        return elevation, normal / np.linalg.norm(normal, axis=0)

    @property
    def lost(self) -> float:
        """Share [1] of the potential energy that was set free and is not kinetic."""
        freed = STANDARD_GRAVITY * float((self.start - self.place[2]).sum())
        return 1.0 - 0.5 * float((self.velocity**2).sum()) / freed

    def lifted(self, height: float) -> float:
        """Share [1] of the points more than a height [m] over the ground, normal to it."""
        elevation, normal = self._ground()
        return float(((self.place[2] - elevation) * normal[2] > height).mean())
