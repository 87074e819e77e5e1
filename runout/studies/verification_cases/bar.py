"""U6: a bar that vibrates."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from runout.materials.elastic import Elastic
from runout.model.limits import CFL
from runout.model.particles import Particles
from runout.studies.verification_cases.bodies import filled, free_scene, loaded
from runout.studies.verification_cases.finding import Bound, Case, Convergence, Result

LENGTH, SPEED = 25.0, 0.1
SUBSTEPS = (1, 2, 4, 8, 16)
VISCOSITY = 0.95  # of the transfers over (h/wave length)^2 h^2 / length of a transfer (docs/theory.md, eq. viscosity)
MATERIAL = Elastic(density=1024.0, youngs_modulus=102400.0, poisson_ratio=0.0)
PERIOD = 4 * LENGTH / MATERIAL.wave_speed
WAVE = np.pi / (2 * LENGTH)


def bar(cells: int, offset: float) -> tuple[Particles, np.ndarray]:
    """The bar and its mirror image beyond the fixed end, one particle thick, and its mode sin(pi x / 2 L)."""
    h = LENGTH / cells
    x = (np.arange(4 * cells) + 0.5) * h / 2 - LENGTH
    p = filled(np.column_stack([x + (cells + 8 + offset) * h, *[np.full_like(x, 8.5 * h)] * 2]), h, MATERIAL.density, h**3 / 2)
    p.velocity[:, 0] = SPEED * np.sin(WAVE * x)
    p.affine[:, 0, 0] = SPEED * WAVE * np.cos(WAVE * x)
    return p, np.sin(WAVE * x)


def vibration(
    cells: int, cfl: float = CFL, offset: float = 0.0, periods: int = 10, transfer: Mapping[str, Any] | None = None,
    backend: str = "scan",
) -> tuple[float, float]:  # fmt: skip
    """Relative error of the period over ten periods, and the remaining share of the initial amplitude.

    ``offset`` [cells] is where the free end lies between two nodes, ``transfer`` the choices of the scene besides the usual ones.
    Transfers have as many substeps as these state, though the bar is so slow that a run would take one.
    """
    p, mode = bar(cells, offset)
    h = np.full(3, LENGTH / cells)
    scene = replace(free_scene(h[0], MATERIAL, cfl=cfl), **(transfer or {}))
    engine, start = loaded(scene, p, backend), p.position(h)[:, 0]
    each = int(np.ceil(PERIOD * MATERIAL.wave_speed / (0.98 * cfl * h[0])))
    dt, swing, substeps = PERIOD / each, [0.0], scene.substeps  # a transfer need not end with a period
    for _ in range(int(each * (periods + 1.1)) // substeps):
        engine.step(dt, substeps)
        swing.append(float((engine.particles().position(h)[:, 0] - start) @ mode / (mode @ mode)))
    rises = [k - a / (b - a) for k, (a, b) in enumerate(pairwise(swing)) if a < 0 <= b]
    period = rises[periods - 1] / periods  # [transfers]
    first, last = (amplitude(np.array(swing), start, period) for start in (0.0, rises[periods - 1]))
    return period * substeps * dt / PERIOD - 1, last / first


def amplitude(swing: np.ndarray, start: float, period: float) -> float:
    """Amplitude of the sine through the samples of the ``period`` that begins at ``start``, both counted in samples."""
    at = np.arange(int(np.ceil(start)), min(len(swing), int(start + period) + 1))
    turn = 2 * np.pi * (at - start) / period
    return float(np.hypot(*np.linalg.lstsq(np.column_stack([np.sin(turn), np.cos(turn)]), swing[at], rcond=None)[0]))


def damping(cells: int, cfl: float, substeps: int, periods: int = 10) -> float:
    """Share of the amplitude that the viscosity nu of the transfers takes in so many periods: half of nu (2 pi/wave length)^2 t."""
    transfers = periods * np.ceil(4 * cells / (0.98 * cfl)) / substeps
    return float(0.5 * VISCOSITY * (2 * np.pi) ** 2 * (4.0 * cells) ** -4 * transfers)


def measure(full: bool) -> list[Result]:
    """Period and amplitude on finer grids, and amplitude against the length of the step and the substeps of a transfer."""
    sizes = (8, 16, 32, 64) if full else (8, 16, 32)
    aligned = [vibration(n) for n in sizes]
    shifted = [vibration(n, offset=0.37) for n in sizes]
    results: list[Result] = [
        Convergence("period, free end on a node", sizes, tuple(abs(e) for e, _ in aligned), 2.0),
        Convergence("period, free end 0.37 h off", sizes, tuple(abs(e) for e, _ in shifted), 2.0),
        Convergence("loss of amplitude in 10 periods", sizes, tuple(1 - a for _, a in aligned), 2.0),
    ]
    for cfl in (0.5, 0.1):
        for k in SUBSTEPS:
            left, least = vibration(16, cfl, transfer={"substeps": k})[1], 1.0 - 2.0 * damping(16, cfl, k)
            results.append(Bound(f"amplitude left, 16 cells, CFL {cfl:g}, substeps {k}", left, 1.0, least))
    return results


CASE = Case(
    "U6",
    "vibrating bar",
    "L = 25 m, E = 102.4 kPa, nu = 0, rho = 1024 kg/m3, v_0 = 0.1 m/s, 2 particles a cell, ten periods, fixed and free end",
    measure,
    "The free end costs no order here: the mode has no strain there, and the period converges with order two wherever the end lies "
    "between the nodes. A transfer damps whatever its length: a smaller step loses more, more substeps lose less. The bounds allow "
    "twice the loss by the viscosity of the transfers (docs/theory.md); the free end adds to it. The bar is so slow that a run "
    "would give it one substep; here each transfer has as many as stated, 4 for the orders.",
)
