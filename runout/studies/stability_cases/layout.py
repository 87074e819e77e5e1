"""One case of the stress test: a mass on a small terrain, with every setting of the run as a number."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from runout.materials.drucker_prager import DruckerPrager
from runout.materials.elastic import Elastic
from runout.model.bed import Bed
from runout.model.erosion_laws import EROSIONS
from runout.model.inflow import Hydrograph, Inflow
from runout.model.limits import CFL
from runout.model.materials import Material
from runout.model.numerics import Numerics, Scheme
from runout.model.particles import Particles
from runout.model.pore_pressure import PorePressure, RatioBlocks
from runout.model.release import Placement, Release
from runout.model.scene import Scene
from runout.model.terrain import Terrain
from runout.simulation.entering import Entering
from runout.simulation.erosion import ErodingBed, eroding_bed
from runout.simulation.inflow import sources_of
from runout.simulation.scenario import build_scene

CELLS = 40  # of the terrain, an axis
FIRST, WIDTH = 8, 8  # cells of the release, counted from the west
EDGE = 18.0  # of the cliffs [cells]
GAP, PATH = 2, 12.0  # of an inflow: from the release to it, and what enters along the flow [cells]


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Choices of one run; lengths in cells of ``h`` [m], angles in degrees, the rest in SI units.

    ``terrain`` names one of :data:`TERRAINS`; ``keep`` is how many particles stay, all when None; ``speed`` [m/s] is that of
    the mass at the start, down the slope; ``rests`` says that it must end at rest, ``passes`` that it must leave the plane above
    a cliff. ``pore_blocks`` are the lowest and highest ratio and the size of blocks [cells] in place of ``pore_ratio``. A
    ``bed_depth`` [cells] above 0 is eroded by a law with ``erosion_numbers``, the others of which have their defaults. An
    ``inflow_thickness`` [cells] above 0 enters with ``inflow_speed`` [m/s] below the release, at a line as wide as that or over a
    polygon.
    """

    terrain: str = "plane"
    h: float = 1.0
    flatness: float = 1.0
    cfl: float = CFL
    youngs_modulus: float = 1e7
    poisson_ratio: float = 0.3
    density: float = 2000.0
    friction_angle: float = 30.0
    cohesion: float = 0.0
    elastic: bool = False
    per_cell: tuple[int, int, int] = (2, 2, 2)
    thickness: float = 2.0
    slope: float = 30.0
    basal: float = 20.0
    pore_ratio: float = 0.0
    pore_blocks: tuple[float, float, float] | None = None
    saturation: float = 0.0
    diffusivity: float = 1e-2
    decay_time: float | None = None
    bed_depth: float = 0.0
    bed_density: float | None = None
    bed_ratio: float | None = None
    erosion: str = "ramms"
    erosion_numbers: tuple[tuple[str, float], ...] = ()
    inflow_thickness: float = 0.0
    inflow_speed: float = 5.0
    inflow_over: str = "line"
    speed: float = 0.0
    precision: str = "float32"
    substeps: int = Scheme.substeps
    placement: str = "on_surface"
    origin: tuple[float, float] = (0.0, 0.0)
    keep: int | None = None
    steps: int = 400
    rests: bool = False
    passes: bool = False

    def material(self) -> Material:
        """The material of the mass."""
        if self.elastic:
            return Elastic(density=self.density, youngs_modulus=self.youngs_modulus, poisson_ratio=self.poisson_ratio)
        return DruckerPrager(
            density=self.density,
            youngs_modulus=self.youngs_modulus,
            poisson_ratio=self.poisson_ratio,
            friction_angle=self.friction_angle,
            cohesion=self.cohesion,
        )

    def ground(self) -> Terrain:
        """The terrain (CELLS x CELLS), which falls towards the east."""
        x, y = np.meshgrid((np.arange(CELLS) + 0.5), (np.arange(CELLS) + 0.5), indexing="xy")
        elevation = TERRAINS[self.terrain](x, y, np.tan(np.radians(self.slope)))
        return Terrain.from_array(self.h * elevation, self.h, origin=self.origin)

    def bed(self) -> Bed | None:
        """The erodible bed; None without one."""
        if self.bed_depth == 0.0:
            return None
        erosion = replace(EROSIONS.find(self.erosion).example, **dict(self.erosion_numbers))
        return Bed(self.bed_depth * self.h, erosion, self.bed_density, pore_pressure_ratio=self.bed_ratio)

    def pore_pressure(self) -> PorePressure | None:
        """Pore pressure of the mass; None for a dry one."""
        low, high, block = self.pore_blocks or (0.0, 0.0, 0.0)
        ratio = RatioBlocks(low=low, high=high, block=block * self.h) if self.pore_blocks else self.pore_ratio
        if not (self.pore_ratio or self.pore_blocks or self.saturation):
            return None
        diffusivity = self.diffusivity if self.decay_time is None else None
        return PorePressure(ratio=ratio, saturation=self.saturation, diffusivity=diffusivity, decay_time=self.decay_time)

    def inflow(self, terrain: Terrain) -> Inflow | None:
        """The inflow below the release, which ends when it has gone :data:`PATH`; None without one."""
        if self.inflow_thickness == 0.0:
            return None
        east, south = FIRST + WIDTH + GAP, (CELLS - WIDTH) // 2
        corners = np.array([[east, south], [east, south + WIDTH], [east + GAP, south + WIDTH], [east + GAP, south]], np.float64)
        place, speed = corners * self.h + self.origin, self.inflow_speed
        seconds, discharge = PATH * self.h / speed, WIDTH * self.inflow_thickness * self.h**2 * speed
        if self.inflow_over == "line":
            return Inflow(terrain, Hydrograph([0.0, seconds], [discharge, discharge], [speed, speed]), line=place[:2])
        from shapely import Polygon

        return Inflow(terrain, Hydrograph([0.0, seconds], [discharge, discharge], [speed, speed]), polygon=Polygon(place))

    def built(self) -> tuple[Scene, Particles, ErodingBed | None, Entering | None]:
        """Scene, particles, bed and inflow; raises the error that refuses the settings."""
        terrain, thickness = self.ground(), np.zeros((CELLS, CELLS))
        start = CELLS - 3 - WIDTH if self.terrain == "edge" else FIRST
        middle = (CELLS - WIDTH) // 2
        thickness[middle : middle + WIDTH, start : start + WIDTH] = self.thickness * self.h
        release = Release.from_array(thickness, terrain, Placement(self.placement), pore_pressure=self.pore_pressure())
        sizes = (self.h, self.h, self.h * self.flatness)
        numerics = Numerics.of({**vars(self), "cell_size": sizes, "particles_per_cell": self.per_cell})
        bed, inflow = self.bed(), self.inflow(terrain)
        inflows = [inflow] if inflow else []
        scene, p = build_scene(terrain, release, self.material(), self.basal, numerics, bed=bed, inflow=inflows)
        if self.keep is not None:
            p = p.take(np.arange(self.keep) * (len(p) // self.keep))
            p.strain[:] = 0.0  # no mass remains above them
        slope = np.radians(self.slope)
        p.velocity[:] = self.speed * np.array([np.cos(slope), 0.0, -np.sin(slope)])
        eroding = eroding_bed(bed, scene, terrain, [release], self.per_cell)
        scene = eroding.scene if eroding else scene
        entering = Entering(sources_of(inflows, 1, scene.spacing, self.per_cell, np.inf, 0)) if inflow else None
        return scene, p, eroding, entering


def _plane(x: np.ndarray, y: np.ndarray, tangent: float) -> np.ndarray:
    return -tangent * x


def _ramp(x: np.ndarray, y: np.ndarray, tangent: float) -> np.ndarray:
    return -tangent * np.minimum(x, 20.0)


def _bumps(x: np.ndarray, y: np.ndarray, tangent: float) -> np.ndarray:
    return -tangent * x + np.sin(1.1 * x) * np.cos(0.9 * y)


def _cliff(drop: float, width: float) -> Callable[[np.ndarray, np.ndarray, float], np.ndarray]:
    def elevation(x: np.ndarray, y: np.ndarray, tangent: float) -> np.ndarray:
        return -tangent * x - drop * np.clip((x - EDGE) / width, 0.0, 1.0)

    return elevation


def _wall(x: np.ndarray, y: np.ndarray, tangent: float) -> np.ndarray:
    return -tangent * np.minimum(x, 20.0) + 12.0 * np.clip((x - 22.0) / 2.0, 0.0, 1.0)


def _pit(x: np.ndarray, y: np.ndarray, tangent: float) -> np.ndarray:
    hole = (np.abs(x - 18.5) < 0.5) & (np.abs(y - 19.5) < 0.5)
    return -tangent * x - 3.0 * hole  # type: ignore[no-any-return]


def _unknown(value: float) -> Callable[[np.ndarray, np.ndarray, float], np.ndarray]:
    def elevation(x: np.ndarray, y: np.ndarray, tangent: float) -> np.ndarray:
        return np.where((np.abs(x - 18.5) < 1.0) & (np.abs(y - 19.5) < 1.0), value, -tangent * x)

    return elevation


TERRAINS: dict[str, Callable[[np.ndarray, np.ndarray, float], np.ndarray]] = {
    "plane": _plane,
    "ramp": _ramp,
    "bumps": _bumps,
    "cliff of 80 deg": _cliff(11.34, 2.0),
    "cliff of 87 deg": _cliff(19.08, 1.0),
    "step down in one cell": _cliff(6.0, 1e-3),
    "wall of 80 deg": _wall,
    "pit of one cell": _pit,
    "edge": _plane,
    "unknown cells": _unknown(np.nan),
    "cells of -9999": _unknown(-9999.0),
}
CLIFFS = ("cliff of 80 deg", "cliff of 87 deg", "step down in one cell")
NARROW = (*CLIFFS, "wall of 80 deg", "pit of one cell")
