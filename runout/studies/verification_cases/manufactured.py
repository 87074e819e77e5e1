"""U7 and U8: motions with a known body force, on the reference backend.

Only that backend repeats its grid and takes a body force; the other backends equal it to rounding (tests/backends).
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from runout.backends.protocol import get_backend
from runout.materials.elastic import Elastic
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.studies.verification_cases.bodies import equal_steps, filled, free_scene
from runout.studies.verification_cases.closed_forms import AxisAlignedWave, Vortex
from runout.studies.verification_cases.finding import Bound, Case, Convergence, Result

STIFF = Elastic(density=1024.0, youngs_modulus=1.024e7, poisson_ratio=0.3)
SOFT = Elastic(density=1000.0, youngs_modulus=1000.0, poisson_ratio=0.3)
BASE = np.array([8.0, 8.0, 8.0])  # [m] of the solution's origin on the grid
OPEN = 10**6  # cells: a direction that does not repeat


def pushed(
    scene: Scene, p: Particles, force: Callable[[float], np.ndarray], period: tuple[int, ...], ends: tuple[int, ...], dt: float
) -> Iterator[tuple[float, Particles]]:
    """Time [s] and particles after each transfer under a body force (n, 3) [m/s2] of time.

    ``ends``: numbers of steps at which a transfer ends, the last of them that of all.
    """
    engine: Any = get_backend("reference")
    engine.period = np.array(period)
    engine.load(scene, p)
    done = 0
    for end in ends:
        while done < end:
            count = min(end - done, scene.substep_count(dt, engine.max_speed))
            engine.push(dt * np.stack([force((done + k) * dt) for k in range(count)]))
            engine.step(dt, count)
            done += count
            yield done * dt, engine.particles()


def wave_error(cells: int, amplitude: float, axes: int = 1, per_cell: int = 2, staggered: bool = True) -> tuple[float, ...]:
    """Largest RMS errors over one period of displacement, of stretch and of its mean over the particles of a cell.

    Relative to their amplitudes; the mean is one of cells for a single axis, else one of rows of particles.

    ``cells`` a metre; waves along the first ``axes`` directions, plane strain along the others. Velocities start half a
    step early, at -dt/2, where those of symplectic Euler live, unless ``staggered`` is False.
    """
    waves = AxisAlignedWave(STIFF, tuple(amplitude if k < axes else 0.0 for k in range(3)))  # type: ignore[arg-type]
    h, sides = 1 / cells, [np.arange(2 * cells * per_cell) + 0.5 if k < axes else np.array([per_cell / 2]) for k in range(3)]
    X = np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 3) * h / per_cell
    top_speed = amplitude * np.pi * np.sqrt(STIFF.modulus / STIFF.density)
    steps, dt = equal_steps(0.02, 0.4 * h / (STIFF.wave_speed + top_speed))
    early = -dt / 2 if staggered else 0.0
    p = filled(BASE + X + waves.displacement(X, 0), h, STIFF.density, h**3 / per_cell**axes)
    p.velocity[:] = waves.velocity(X, early)
    p.strain[:, :3] = waves.stretch(X, 0) ** 2 - 1
    for k in range(3):
        p.affine[:, k, k] = waves.velocity_gradient(X, early)[:, k]
    largest = np.zeros(3)
    period = tuple(2 * cells if k < axes else 1 for k in range(3))
    for t, q in pushed(free_scene(h, STIFF), p, lambda t: waves.body_force(X, t), period, (steps,), dt):
        moved = q.position(np.full(3, h)) - BASE - X
        off, strained = moved - waves.displacement(X, t), np.sqrt(1 + q.strain[:, :3]) - waves.stretch(X, t)
        mean = strained.reshape(-1, per_cell, 3).mean(axis=1)
        largest = np.maximum(largest, [_rms(values, axes) for values in (off, strained, mean)])
    return tuple(float(e) for e in largest / (amplitude * np.array([1, np.pi, np.pi])))


def vortex_error(cells: int, amplitude: float, per_cell: int = 4) -> tuple[float, float]:
    """Largest RMS error of place over 1 s (there and back) in the turning ring, and at its largest turn after 0.5 s.

    Relative to the amplitude at R = 1 m; ``cells`` a metre. Material at rest fills 0.5 m < R < 1.5 m.
    """
    vortex, h = Vortex(SOFT, amplitude), 1 / cells
    side = (np.arange(-2 * cells * per_cell, 2 * cells * per_cell) + 0.5) * h / per_cell
    X = np.stack(np.meshgrid(side, side, indexing="ij"), -1).reshape(-1, 2)
    X = X[np.abs(np.hypot(*X.T) - 1) <= 0.5]
    ring = np.abs(np.hypot(*X.T) - 1) < 0.25
    steps, dt = equal_steps(0.5, 0.4 * h / (SOFT.wave_speed + amplitude * np.pi))
    p = filled(np.column_stack([X, np.full(len(X), h / 2)]) + BASE, h, SOFT.density, h**3 / per_cell**2)
    p.velocity[:, :2] = vortex.velocity(X, -dt / 2)
    p.affine[:, :2, :2] = vortex.velocity_gradient(X, -dt / 2)
    errors = {}

    def force(t: float) -> np.ndarray:
        return np.column_stack([vortex.body_force(X, t), np.zeros(len(X))])

    for t, q in pushed(free_scene(h, SOFT), p, force, (OPEN, OPEN, 1), (steps, 2 * steps), dt):
        off = q.position(np.full(3, h))[:, :2] - BASE[:2] - vortex.place(X, t)
        errors[t] = _rms(off[ring], 1) / amplitude
    return max(errors.values()), errors[steps * dt]


def _rms(values: np.ndarray, parts: int) -> float:
    """Root of the mean over rows of the squared length, per component of ``parts``."""
    return float(np.sqrt((values**2).sum() / (len(values) * parts)))


def measure_waves(full: bool) -> list[Result]:
    """Orders in one to three directions, and the floor of large amplitude."""
    line = (8, 16, 32, 64) if full else (8, 16, 32)
    plane, room = ((4, 8, 16), (3, 4, 6, 8)) if full else ((4, 6, 8), (3, 5))
    small, tiny = ([wave_error(n, amplitude) for n in line] for amplitude in (0.005, 0.0005))
    large = [wave_error(n, 0.05, per_cell=4) for n in line]
    floor = 64 if full else 32
    results: list[Result] = [
        Convergence("u, 1D, A = 0.005", line, tuple(e[0] for e in small), 2.0),
        Convergence("F at a particle, 1D, A = 0.0005", line, tuple(e[1] for e in tiny), 1.0),
        Convergence("F as mean of a cell, 1D, A = 0.0005", line, tuple(e[2] for e in tiny), 2.0),
        Convergence("u, 1D, A = 0.05, 4 particles a cell", line, tuple(e[0] for e in large), 2.0),
        Convergence("u, 1D, velocities not staggered", line, tuple(wave_error(n, 0.005, staggered=False)[0] for n in line), 2.0),
        Convergence("u, 2D, A = 0.005", plane, tuple(wave_error(n, 0.005, 2)[0] for n in plane), 2.0),
        Convergence("u, 3D, A = 0.005", room, tuple(wave_error(n, 0.005, 3)[0] for n in room), 2.0),
    ]
    place, stretch, _ = wave_error(floor, 0.05)
    results.append(Bound(f"floor of u, A = 0.05, 2 particles a cell, h = 1/{floor}", place, 1.8e-3 if full else 4.1e-3))
    results.append(Bound(f"floor of F, A = 0.05, 2 particles a cell, h = 1/{floor}", stretch, 2.2e-2))
    return results


def measure_vortex(full: bool) -> list[Result]:
    """Orders for gentle and for strong shear."""
    cells = (8, 12, 16, 24) if full else (8, 12, 16)
    gentle = [vortex_error(n, 0.1) for n in cells]
    results: list[Result] = [
        Convergence("place, largest in 1 s, A = 0.1", cells, tuple(e for e, _ in gentle), 2.0),
        Convergence("place at the largest turn, A = 0.1", cells, tuple(e for _, e in gentle), 2.0),
    ]
    if full:
        strong = tuple(vortex_error(n, 0.3)[1] for n in cells)
        results.append(Convergence("place at the largest turn, A = 0.3 (shear of 1.8)", cells, strong, 2.0))
    return results


WAVES = Case(
    "U7",
    "manufactured waves",
    "axis-aligned waves (Wallstedt & Guilkey 2008), Hencky, E = 10.24 MPa, nu = 0.3, 1024 kg/m3, periodic; largest RMS in a period",
    measure_waves,
    "The stretch converges with order two as the mean over a cell and with order one at a particle: the packed transfer takes the "
    "velocity gradient from the affine matrix, whose error away from the middle of a cell is of first order and changes sign "
    "between the particles of a cell. With an amplitude of 0.05 and two particles a cell the quadrature of moving particles stops "
    "convergence: displacement at 1.5e-3 of its amplitude from h = 1/64 m, stretch at 2.0e-2; with one substep a transfer they are "
    "1.3e-3 and 1.7e-2. With four particles a cell no floor of displacement is met up to h = 1/64 m. Velocities that start at time "
    "zero instead of half a step early cost no order.",
)
VORTEX = Case(
    "U8",
    "manufactured vortex",
    "ring 0.75 m < R < 1.25 m (Kamojjala et al. 2015), Hencky, E = 1 kPa, nu = 0.3, rho = 1000 kg/m3, plane strain, "
    "4 x 4 particles a cell; RMS",
    measure_vortex,
    "With fewer particles a cell the quadrature of moving particles limits the error of four substeps: with 3 x 3 and 8, 12, 16 "
    "and 24 cells the largest in 1 s is 0.084, 0.031, 0.021 and 0.012, where one substep has 0.117, 0.053, 0.028 and 0.013. Not "
    "run: A = 1, the hard form of the literature. Its shear reaches 6, and Hencky's shear stress falls beyond a shear of 3.0: the "
    "solution itself is unstable there, and finer grids fail (29 % error on the way back at h = 1/32 m). The literature's "
    "neo-Hookean solid has no such limit.",
)
