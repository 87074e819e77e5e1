"""Errors of float32: equal runs in both precisions, compared with closed forms if there are any."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.studies.sloping_layer import SPACING as LAYER_SPACING
from runout.studies.sloping_layer import Layer
from runout.studies.verification_cases.bodies import advance, equal_steps, free_scene, lattice, loaded, particles_at
from runout.studies.verification_cases.closed_forms import GRAVITY, symplectic_free_fall
from runout.studies.verification_cases.finding import Bound, Case, Result
from runout.studies.verification_cases.rigid import ROCK
from runout.studies.verification_cases.sliding_box import BOX, Plane, prepared

H = 0.1  # [m]
FAR = 26_270_000  # nodes of 0.1 m from the origin: an easting of 2627 km


def both(scene: Scene, p: Particles, time: float) -> tuple[Particles, Particles]:
    """Particles in float64 and in float32 after the same steps of ``time`` [s]."""
    steps, dt = 0, 0.0
    ends = []
    for precision in ("float64", "float32"):
        engine = loaded(replace(scene, precision=precision), p)
        if not steps:
            steps, dt = equal_steps(time, 0.9 * engine.stable_step())
        advance(engine, scene, steps, dt)
        ends.append(engine.particles())
    return ends[0], ends[1]


def places(p: Particles, spacing: float) -> np.ndarray:
    """Positions (n, 3) [m] of particles on a cubic grid."""
    return p.position(np.full(3, spacing))


def difference(ends: tuple[Particles, Particles], start: Particles, spacing: float) -> float:
    """Root mean square distance of the float32 particles from the float64 ones over the mean path [1]."""
    exact, computed, from_ = (places(p, spacing) for p in (*ends, start))
    apart = np.sqrt(((computed - exact) ** 2).sum(1).mean())
    return float(apart / np.linalg.norm(exact - from_, axis=1).mean())


def fall() -> float:
    """Error of the height that a cube far from the origin has fallen through in 2000 steps, over that height [1]."""
    p = particles_at(lattice((0.2, 0.2, 0.2), H) + np.array([5.013, 5.027, 3.041]), H, ROCK.density, 0.0)
    p.node[:] += np.array([FAR, FAR, 0])
    scene, dt = replace(free_scene(H, ROCK, gravity=GRAVITY), precision="float32"), 5e-4
    scene = replace(scene, raster=replace(scene.raster, cell_size=(1e5, 1e5)))
    engine = loaded(scene, p)
    advance(engine, scene, 2000, dt)
    height, _ = symplectic_free_fall(2000, dt)
    q = engine.particles()
    moved = (q.node[:, 2] - p.node[:, 2] + (q.offset[:, 2] - p.offset[:, 2])) * H
    return float(np.abs(moved / height - 1).max())


def spin() -> tuple[float, float]:
    """Difference of places over the mean path, and largest difference of strain [1], of a cube after half a turn."""
    local = lattice((0.6, 0.6, 0.6), H) - 0.3
    p = particles_at(local + np.array([10.0, 10.0, 0.0]), H, ROCK.density, 0.0)
    whirl = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    p.velocity[:] = local @ whirl.T
    p.affine[:] = whirl
    ends = both(free_scene(H, ROCK), p, np.pi)
    return difference(ends, p, H), float(np.abs(ends[1].strain - ends[0].strain).max())


def box(slope: float, time: float) -> tuple[float, float]:
    """Difference of the way of a box on a plane over the way in float64, and its way in float32 [m]."""
    scene, p, frame = prepared(Plane(slope, 37.0), time)
    start = places(p, scene.spacing[0])
    way = [float(((places(end, scene.spacing[0]) - start) @ frame[0]).mean()) for end in both(scene, p, time)]
    return abs(way[1] / way[0] - 1), way[1]


def layer(seconds: float) -> Iterator[Result]:
    """Differences of a layer of sand that slides, yields and spreads at its edges."""
    scene, p = Layer(4000, depth=4).build()
    ends = both(scene, p, seconds)
    yield Bound("sand layer: distance of particles over their mean path", difference(ends, p, LAYER_SPACING), 1e-3)
    way = [(places(end, LAYER_SPACING) - places(p, LAYER_SPACING)).mean(0) for end in ends]
    yield Bound("sand layer: way of the centre of mass", float(np.abs(way[1] - way[0]).max() / np.abs(way[0]).max()), 1e-5)
    front = [float(np.quantile(places(end, LAYER_SPACING)[:, 0], 0.99)) for end in ends]
    yield Bound("sand layer: front of 99 % of the mass, over the path", abs(front[1] - front[0]) / float(way[0][0]), 1e-4)


def measure(full: bool) -> list[Result]:
    """Differences between the precisions, relative."""
    turned, strain = spin()
    moving, _ = box(25.0, 1.0 if full else 0.3)
    lasting = 3.0 if full else 0.5
    _, creep = box(14.0, lasting)
    return [
        Bound("free fall 2627 km from the origin: height, 2000 steps", fall(), 1e-5),
        Bound("spinning cube, half a turn: distance of particles over their path", turned, 2e-5),
        Bound("spinning cube, half a turn: strain (absolute)", strain, 2e-6),
        Bound("box on 25 deg: way", moving, 1e-4),
        Bound("box that sticks on 14 deg, in float32 alone: mean speed [m/s]", abs(creep) / lasting, 2e-4),
        *layer(3.0 if full else 2.0),
    ]


CASE = Case(
    "float32",
    "single precision",
    f"The same steps in float32 and float64: bodies of U4, U5 and T1 ({BOX.modulus:g} Pa), and the sand layer of the "
    "benchmark (4000 particles, four cells deep). Differences are relative; free fall is held against its closed form",
    measure,
)
