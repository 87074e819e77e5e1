"""U9: a column that stands on the ground under its own weight."""

import numpy as np

from runout.materials.elastic import Elastic
from runout.model.surface import Surface
from runout.studies.verification_cases.bodies import equal_steps, filled, free_scene, loaded, transfer
from runout.studies.verification_cases.closed_forms import standing_column
from runout.studies.verification_cases.finding import Bound, Case, Convergence, Result

LENGTH, GRAVITY = 50.0, 10.0
MATERIAL = Elastic(density=160.0, youngs_modulus=2e6, poisson_ratio=0.0)
WEIGHT = MATERIAL.density * GRAVITY
PERIOD = 4 * LENGTH / MATERIAL.wave_speed


def standing(cells: int, offset: float) -> dict[str, float]:
    """Errors of a column that starts in its exact state, after two periods and as means over them.

    ``offset`` [cells] is the height of the ground above a node. Keys: ``stress`` mean error over rho_0 g l_0, over time
    and particles; ``upper`` the same without the lowest cell; ``base`` the lowest particle's stress over its exact one;
    ``place`` the RMS error of height over the length at the end; ``gap`` of the lowest particle [cells].
    """
    h, floor = LENGTH / cells, (10 + offset) * LENGTH / cells
    Y = (np.arange(2 * cells) + 0.5) * h / 2
    stretch, exact, height = standing_column(Y, LENGTH, WEIGHT, MATERIAL.modulus)
    side = np.full_like(Y, (np.floor(LENGTH / h) + 0.5) * h)
    p = filled(np.column_stack([side, side, floor + height]), h, MATERIAL.density, h**3 / 2)
    p.strain[:, 2] = stretch**2 - 1
    p.radius[:] = stretch * h / 4
    ground = Surface.through(np.full((12, 12), floor), (10.0, 10.0))
    scene = free_scene(h, MATERIAL, ground, GRAVITY)
    engine = loaded(scene, p)
    steps, dt = equal_steps(2 * PERIOD, engine.stable_step())
    errors, base = [], []
    while steps:
        steps -= transfer(engine, scene, dt, steps)
        q = engine.particles()
        now = np.sqrt(1 + q.strain[:, 2])
        stress = MATERIAL.modulus * np.log(now) / now
        errors.append(np.abs(stress - exact) / (WEIGHT * LENGTH))
        base.append(stress[0] / exact[0])
    z = q.position(np.full(3, h))[:, 2] - floor
    return {
        "stress": float(np.mean(errors)),
        "upper": float(np.mean([e[2:].mean() for e in errors])),
        "base": float(np.mean(base)),
        "place": float(np.sqrt(np.mean((z - height) ** 2)) / LENGTH),
        "gap": float((z[0] - p.radius[0]) / h),
    }


def measure(full: bool) -> list[Result]:
    """Orders with the ground on a node and off it, and the stress of the lowest half cell."""
    cells = (8, 16, 32, 64) if full else (8, 16, 32)
    results: list[Result] = []
    for offset in (0.0, 0.37):
        errors = [standing(n, offset) for n in cells]
        place = f"ground {offset:g} h above a node" if offset else "ground on a node"
        results += [
            Convergence(f"stress, {place}", cells, tuple(f["stress"] for f in errors), 1.0),
            Convergence(f"stress without the lowest cell, {place}", cells, tuple(f["upper"] for f in errors), 0.75),
            Convergence(f"height, {place}", cells, tuple(f["place"] for f in errors), 1.0),
            Bound(f"stress of the lowest particle over the exact one, {place}", errors[-1]["base"], 1.0, 0.35),
            Bound(f"gap of the lowest particle [h], {place}", errors[-1]["gap"], 1e-3, -1e-3),
        ]
    return results


CASE = Case(
    "U9",
    "column under its weight",
    "AMPLE's column with twice its stiffness and density: "
    "l_0 = 50 m, E = 2 MPa, nu = 0, rho_0 = 160 kg/m3, g = 10 m/s2, 2 particles a cell, from the exact state, "
    "two periods; mean |sigma - exact|/(rho_0 g l_0) over particles and time",
    measure,
    "Order one: the ground pushes on the lowest particles, and the stress in the lowest half cell is 0.4 to 0.5 of the exact "
    "one on every grid. The waves that this starts converge with order 0.7 to 0.8 in the cells above. Where the ground lies "
    "between the nodes makes no difference.",
)
