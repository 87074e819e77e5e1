"""U7, U9, T1, T5: elastic bodies with an exact motion."""

from dataclasses import replace

import numpy as np

from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.studies.verification_cases import curved_ground, manufactured, sliding_box
from runout.studies.verification_cases.bodies import equal_steps, filled, free_scene, lattice, particles_at
from runout.studies.verification_cases.closed_forms import AxisAlignedWave, sliding_block, standing_column, symplectic_excess
from runout.studies.verification_cases.column import GRAVITY, LENGTH, MATERIAL, PERIOD, WEIGHT
from tests.benchmarks.error_cases.choice import NODES, March, Outcome, Variation, engine_of

AMPLITUDE = 0.05  # [m] of the waves: large strain, where quadrature shows
OFFSET = 0.37  # [cells] of the column's ground above a node
PLANE = sliding_box.Plane(20.0, 37.0, 0.35)
BOWL_FRICTION, BOWL_AZIMUTH, BOWL_OFFSET = 0.2, 30.0, 0.35


def waves(cells: int, v: Variation) -> Outcome:
    """Largest RMS of displacement over its amplitude in a period of one-dimensional waves (:func:`manufactured.wave_error`)."""
    solution, material = AxisAlignedWave(manufactured.STIFF, (AMPLITUDE, 0.0, 0.0)), manufactured.STIFF
    h, n = 1 / cells, v.per_axis
    side = (np.arange(2 * cells * n) + 0.5) * h / n
    X = np.column_stack([side, np.full_like(side, h / 2), np.full_like(side, h / 2)])
    p = filled(manufactured.BASE + X + solution.displacement(X, 0), h, material.density, h**3 / n)
    p.velocity[:] = solution.velocity(X, 0)
    p.strain[:, :3] = solution.stretch(X, 0) ** 2 - 1
    p.affine[:, 0, 0] = solution.velocity_gradient(X, 0)[:, 0]
    pushed = replace(v, backend="reference", scene={**v.scene, "precision": "float64"})  # the one that takes a body force
    march = March(free_scene(h, material), p, pushed, (2 * cells, 1, 1))
    speed = AMPLITUDE * np.pi * np.sqrt(material.modulus / material.density)
    steps, dt = equal_steps(0.02, march.scene.stable_step(float(speed)))
    errors = []
    end = steps * dt
    while march.now < end * (1 - 1e-9):
        times = march.now + dt * np.arange(march.substeps(dt, end - march.now))
        march.engine.push(np.array([dt * solution.body_force(X, time) for time in times]))
        march.step(dt, end - march.now)
        off = march.positions() - manufactured.BASE - X - solution.displacement(X, march.now)
        errors.append(np.sqrt((off**2).sum(axis=1).mean()) / AMPLITUDE)
    return march.outcome(max(errors))


def column(cells: int, v: Variation) -> Outcome:
    """Mean error of stress over the weight of a column that stands on the ground; value: height of its top [m]."""
    h, n = LENGTH / cells, v.per_axis
    floor = (10 + OFFSET) * h
    Y = (np.arange(n * cells) + 0.5) * h / n
    stretch, exact, height = standing_column(Y, LENGTH, WEIGHT, MATERIAL.modulus)
    side = np.full_like(Y, (np.floor(LENGTH / h) + 0.5) * h)
    p = filled(np.column_stack([side, side, floor + height]), h, MATERIAL.density, h**3 / n)
    p.strain[:, 2] = stretch**2 - 1
    p.radius[:] = stretch * h / (2 * n)
    ground = Surface.through(np.full((12, 12), floor), (10.0, 10.0))
    march = March(free_scene(h, MATERIAL, ground, GRAVITY), p, v)
    steps, dt = equal_steps(2 * PERIOD, march.engine.stable_step())
    errors, tops = [], []
    while march.now < steps * dt * (1 - 1e-9):
        march.step(dt, steps * dt - march.now)
        q = march.engine.particles()
        now = np.sqrt(1 + q.strain[:, 2].astype(float))
        errors.append(np.abs(MATERIAL.modulus * np.log(now) / now - exact).mean() / (WEIGHT * LENGTH))
        tops.append(q.position(np.full(3, h))[-1, 2] - floor)
    return march.outcome(float(np.mean(errors)), float(np.mean(tops)))


def box(cells: int, v: Variation) -> Outcome:
    """Error of the way of a settled box down a plane of 20 degrees over that of a block; value: the way [m]."""
    plane = replace(PLANE, spacing=sliding_box.SIZE[2] / cells, per_axis=v.per_axis)
    at_nodes = v.backend == NODES  # a box rests elsewhere with another contact
    scene, p, frame = sliding_box.prepared(plane, 1.0, engine_of(v) if at_nodes else None)
    march = March(scene, p, v)
    steps, dt = equal_steps(1.0, march.engine.stable_step())
    start = march.positions() @ frame[0]
    while march.now < steps * dt * (1 - 1e-9):
        march.step(dt, steps * dt - march.now)
    moved = float((march.positions() @ frame[0] - start).mean())
    exact = sliding_block(1.0, plane.slope_deg, plane.friction)[0]
    exact += symplectic_excess(1.0, plane.slope_deg, plane.friction, dt)
    return march.outcome(abs(moved / exact - 1), moved)


def bowl(cells: int, v: Variation) -> Outcome:
    """Error of the angle at which a block turns in a bowl with friction 0.2; value: that angle [deg]."""
    size = (curved_ground.LENGTH, curved_ground.WIDTH, curved_ground.HEIGHT)
    h, n, radius = size[2] / cells, v.per_axis, curved_ground.BOWL_RADIUS
    s = lattice(size, h, n) - (size[0] / 2, size[1] / 2, 0.0)
    angle, r = s[:, 0] / radius - curved_ground.RELEASE_ANGLE, radius - s[:, 2]
    local = np.column_stack([r * np.sin(angle), s[:, 1], radius - r * np.cos(angle)])
    way = curved_ground.Way(curved_ground.bowl, BOWL_AZIMUTH, 9.0, h, BOWL_OFFSET)
    p = particles_at(way.origin + local @ way.frame, h, curved_ground.BLOCK.density, h / (2 * n), n)
    scene = Scene((h,) * 3, way.surface(), Raster(100, 100, (0.09, 0.09)), (curved_ground.BLOCK,), (BOWL_FRICTION,))
    march, highest = March(scene, p, v), -np.inf

    def look() -> None:
        nonlocal highest
        at = (march.positions().mean(axis=0) - way.origin) @ way.frame.T
        highest = max(highest, float(np.arctan2(at[0], radius - at[2])))

    exact, when = curved_ground.turning(BOWL_FRICTION)
    march.until(1.1 * when, look)
    return march.outcome(abs(highest / exact - 1), np.degrees(highest))
