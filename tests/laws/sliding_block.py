"""A block that slides down a plane on every backend, and the rigid block it is compared with: tests of friction laws."""

import math
from dataclasses import replace

import numpy as np
from scenes import HARD, box, plane, scene
from scipy.integrate import solve_ivp

BLOCK = replace(HARD, poisson_ratio=0.0, youngs_modulus=4e6)  # vibrates little while it slides
SLOPE, GRAVITY, DT = math.radians(25.0), 9.81, 5e-3


def block(engine, friction, time, speed=0.0, **choices):
    """Mean velocity [m/s] of a block down a plane along the grid, and the engine, after a time [s]."""
    gravity = (GRAVITY * math.sin(SLOPE), 0.0, -GRAVITY * math.cos(SLOPE))
    a_scene = scene(plane(), materials=(BLOCK,), friction=(friction,), gravity=gravity, **choices)
    p = box((6.0, 20.0, 0.0), (3.0, 2.0, 1.0), (1.0, 1.0, 1.0), BLOCK.density, surface=a_scene.surface)
    p.strain[:, 2] = -2.0 * BLOCK.density * GRAVITY * math.cos(SLOPE) * (1.0 - p.position(np.ones(3))[:, 2]) / BLOCK.youngs_modulus
    p.velocity[:, 0] = speed
    engine.load(a_scene, p)
    for _ in range(round(time / DT)):
        engine.step(DT)
    return engine.particles().velocity[:, 0].mean(), engine


def speed_of_rigid_block(friction, time, speed=0.0):
    """Speed [m/s] of a point that slides against ``friction(v)`` [1], a function of its speed [m/s]."""

    def acceleration(_, v):
        return [GRAVITY * (math.sin(SLOPE) - friction(v[0]) * math.cos(SLOPE))]

    return solve_ivp(acceleration, (0.0, time), [speed], rtol=1e-10, atol=1e-12).y[0, -1]
