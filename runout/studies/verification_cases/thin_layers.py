"""Layers one to four cells thick: volume of a layer that spreads, displacement of a layer of sand against its closed form.

Plane strain: the reference backend repeats its grid after one cell across.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from runout.backends.protocol import get_backend
from runout.materials.drucker_prager import DruckerPrager
from runout.model.materials import Material
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.physics import elastic
from runout.studies.verification_cases.bodies import advance, equal_steps, lattice, particles_at
from runout.studies.verification_cases.closed_forms import GRAVITY
from runout.studies.verification_cases.finding import Bound, Case, Result
from runout.studies.verification_cases.sliding_box import FRICTION, tilted_plane

SPACING, EXTENT = 0.05, 8.0  # [m]
SPREADING, STRAIN_RATE, SPREAD_TIME = 2.0, 2.0, 0.35  # length [m], rate [1/s], time [s]
SLIDING, SLIDE_TIME = 2.5, 0.5
LIQUID = DruckerPrager(density=1000.0, youngs_modulus=1e6, poisson_ratio=0.3, friction_angle=0.0, cohesion=1.0)
SAND = DruckerPrager(density=1000.0, youngs_modulus=2e6, poisson_ratio=0.3, friction_angle=35.0)


@dataclass(frozen=True)
class Layer:
    """A layer ``cells`` thick on a plane inclined by ``slope_deg`` against gravity and by ``turn_deg`` against the grid;
    ``offset`` [cells] of the plane above a node."""

    cells: int
    offset: float
    slope_deg: float = 0.0
    turn_deg: float = 0.0

    def placed(self, length: float) -> tuple[Particles, np.ndarray, np.ndarray, Scene]:
        """Particles at rest, their local places (n, 3) [m], the frame (down, across, normal), and a scene of sand."""
        surface, frame = tilted_plane(self.turn_deg, 0.0, EXTENT, (60 + self.offset) * SPACING)
        local = lattice((length, SPACING, self.cells * SPACING), SPACING)
        base = np.round(0.3 * EXTENT / SPACING) * SPACING + np.array([0.37, 0.0]) * SPACING
        corner = np.array([*base, surface.elevation(base[0], base[1])])
        p = particles_at(corner + local @ frame, SPACING, SAND.density, SPACING / 4)
        return p, local, frame, self.scene(surface, SAND, FRICTION)

    def scene(self, surface: object, material: Material, friction: float) -> Scene:
        """Scene with gravity inclined against the plane."""
        tilt = np.radians(self.slope_deg - self.turn_deg)
        gravity = (GRAVITY * np.sin(tilt), 0.0, -GRAVITY * np.cos(tilt))
        raster = Raster(100, 100, (EXTENT / 100,) * 2)
        return Scene((SPACING,) * 3, surface, raster, (material,), (friction,), gravity, precision="float64")  # type: ignore[arg-type]


FULL = (Layer(1, 0.1), Layer(1, 0.6), *(Layer(cells, 0.3, turn_deg=20.0) for cells in (1, 2, 4)))


def spread(layer: Layer) -> float:
    """Relative error of volume in the middle of a liquid layer after it was stretched by 1.35 without friction."""
    p, local, frame, scene = layer.placed(SPREADING)
    scene = layer.scene(scene.surface, LIQUID, 0.0)
    bulk = LIQUID.lame_lambda + 2 * LIQUID.shear_modulus / 3
    pressure = LIQUID.density * GRAVITY * (layer.cells * SPACING - local[:, 2])
    p.strain[:, :3] = np.expm1(-2 * pressure / (3 * bulk))[:, None]
    rate = STRAIN_RATE * np.diag([1.0, 0.0, -1.0])
    p.velocity[:] = (local - (SPREADING / 2, 0.0, 0.0)) @ rate @ frame
    p.affine[:] = frame.T @ rate @ frame
    end = _run(scene, p, SPREAD_TIME)
    b = np.linalg.det(np.eye(3) + end.strain[:, [0, 3, 5, 3, 1, 4, 5, 4, 2]].reshape(-1, 3, 3))
    volume = np.sqrt(b) * np.exp(end.history)
    return float(volume[np.abs(local[:, 0] - SPREADING / 2) < 0.6].mean() - 1)


def slide(layer: Layer) -> tuple[float, float]:
    """Displacement [m] of the middle of a layer of sand from rest, and that of a rigid one."""
    p, local, frame, scene = layer.placed(SLIDING)
    slope = np.radians(layer.slope_deg)
    acceleration = GRAVITY * max(np.sin(slope) - FRICTION * np.cos(slope), 0.0)
    depth = layer.cells * SPACING - local[:, 2]
    strain = np.zeros((len(p), 3, 3))
    strain[:, 2, 2] = -SAND.density * GRAVITY * np.cos(slope) * depth / (SAND.lame_lambda + 2 * SAND.shear_modulus)
    shear = SAND.density * (GRAVITY * np.sin(slope) - acceleration) * depth / (2 * SAND.shear_modulus)
    strain[:, 0, 2] = strain[:, 2, 0] = shear
    for k, h in enumerate(np.einsum("ai,pab,bj->pij", frame, strain, frame)):
        p.strain[k] = elastic.strain_of_log((h[0, 0], h[1, 1], h[2, 2], h[0, 1], h[1, 2], h[2, 0]))
    start = p.position(np.full(3, SPACING))
    end = _run(scene, p, SLIDE_TIME).position(np.full(3, SPACING))
    moved = ((end - start) @ frame[0])[np.abs(local[:, 0] - SLIDING / 2) < 0.5]
    return float(moved.mean()), float(0.5 * acceleration * SLIDE_TIME**2)


def measure(full: bool) -> list[Result]:
    """Volume of spreading layers, displacement of sliding ones."""
    chosen = FULL if full else FULL[1:2]
    results: list[Result] = []
    for layer in chosen:
        results.append(Bound(f"error of volume after spreading, {_words(layer)}", spread(layer), 0.01, -0.01))
    for layer in chosen:
        moved, exact = slide(replace(layer, slope_deg=20.0))
        words = f"relative error of displacement of sand at 20 deg, {_words(layer)}"
        results.append(Bound(words, moved / exact - 1, 0.02, -0.02))
    if full:
        for layer in FULL[2:]:
            moved, _ = slide(replace(layer, slope_deg=13.0))
            results.append(Bound(f"displacement of sand at 13 deg [m], {_words(layer)}", moved, 1e-3, -1e-3))
    return results


def _words(layer: Layer) -> str:
    thickness = "one cell thick" if layer.cells == 1 else f"{layer.cells} cells thick"
    return f"{thickness}, plane turned {layer.turn_deg:g} deg in the grid, {layer.offset:g} h off a node"


def _run(scene: Scene, particles: Particles, time: float) -> Particles:
    engine: Any = get_backend("reference")
    engine.period[1] = 1
    engine.load(scene, particles)
    steps, dt = equal_steps(time, engine.stable_step())
    advance(engine, scene, steps, dt)
    return engine.particles()  # type: ignore[no-any-return]


CASE = Case(
    "layers",
    "thin layers",
    f"plane strain, h = {SPACING:g} m; a liquid layer of 2 m that is stretched by 1.35 without friction, and a layer of sand of "
    "2.5 m with an internal friction angle of 35 deg on ground of 15 deg, pre-stressed, 0.5 s; the middle metre",
    measure,
)
