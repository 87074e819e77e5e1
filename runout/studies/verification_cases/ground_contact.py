"""T2, T3, T4: angle at which a box starts to slide, direction of friction, and gap above the ground at rest."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from runout.model.friction_laws import DEFAULT_FRICTION, FRICTIONS
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.studies.verification_cases import sliding_box
from runout.studies.verification_cases.bodies import advance, equal_steps, lattice, loaded, particles_at, relaxed
from runout.studies.verification_cases.closed_forms import GRAVITY, sliding_block, symplectic_excess
from runout.studies.verification_cases.finding import Bound, Case, Result
from runout.studies.verification_cases.sliding_box import (
    BOX,
    DAMPING,
    FRICTION,
    FRICTION_ANGLE,
    SETTLING,
    SIZE,
    Plane,
    tilted_plane,
)

OFFSETS = tuple(k / 8 + 0.06 for k in range(8))  # [cells] of the ground above a node
DROPPED = (0.5, 0.3, 0.3)  # size of the dropped box [m]


def creep(plane: Plane, time: float) -> tuple[float, float]:
    """Displacement [m] and mean speed in the last third [m/s] of a box that gravity, ramped up with damping, has loaded.

    The box starts without stress; the ramp lasts 20 periods 4 H/c. Free afterwards, for ``time`` [s].
    """
    scene, p, frame = sliding_box.prepared(replace(plane, settled=False), time)
    p.strain[:] = 0.0
    slides = frame[0] if plane.slope_deg > FRICTION_ANGLE else None
    p = relaxed(scene, p, 1.25 * SETTLING, DAMPING, slides, ramp=SETTLING)
    engine, start = loaded(scene, p), p.position(np.array(scene.spacing))
    steps, dt = equal_steps(time, engine.stable_step())
    advance(engine, scene, steps - steps // 3, dt)
    late = engine.particles().position(np.array(scene.spacing))
    advance(engine, scene, steps // 3, dt)
    end = engine.particles().position(np.array(scene.spacing))
    return float(((end - start) @ frame[0]).mean()), float(((end - late) @ frame[0]).mean() / (steps // 3 * dt))


def oblique(azimuth_deg: float, spacing: float, time: float = 0.25, speed: float = 1.0) -> tuple[float, float]:
    """Relative error of the speed that friction takes, and error of direction [deg], of a box that slides on level ground."""
    scene, p, _ = sliding_box.prepared(Plane(0.0, 0.0, 0.35, spacing, settled=False), 1.0)
    way = np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg)), 0.0])
    p.velocity[:] = 2.0 * speed * way
    p = relaxed(scene, p, SETTLING, DAMPING, way)
    p.velocity[:] = speed * way
    engine = loaded(scene, p)
    steps, dt = equal_steps(time, engine.stable_step())
    advance(engine, scene, steps, dt)
    moved = (engine.particles().position(np.array(scene.spacing)) - p.position(np.array(scene.spacing))).mean(axis=0)
    lost = speed * time - float(np.linalg.norm(moved))
    exact = 0.5 * FRICTION * GRAVITY * time * (time + dt)
    turned = np.degrees(np.arctan2(moved[1], moved[0])) - azimuth_deg
    return lost / exact - 1, float((turned + 180) % 360 - 180)


def rest(slope_deg: float, offset: float, spacing: float) -> tuple[float, float]:
    """Gap [cells] at the ground's first push on a box dropped from 2.3 cells, and its gap at rest, both of the lowest layer."""
    extent = 8.0
    surface, frame = tilted_plane(slope_deg, 0.0, extent, (40 + offset) * spacing)
    base = np.round(np.array([0.4, 0.45]) * extent / spacing) * spacing + np.array([0.37, 0.21]) * spacing
    local = lattice(DROPPED, spacing)
    foot = np.array([*base, surface.elevation(base[0], base[1])]) + 2.3 * spacing * frame[2]
    p = particles_at(foot + local @ frame, spacing, BOX.density, spacing / 4)
    scene = Scene((spacing,) * 3, surface, Raster(100, 100, (extent / 100,) * 2), (BOX,), (1.0,), precision="float64")
    layer = local[:, 2] < 0.5 * spacing
    first, touching = _first_push(scene, p, frame, layer)
    still = relaxed(scene, touching, 0.3, 20.0)
    return first, float(sliding_box.gaps(scene, still, frame[2])[layer].mean() / spacing)


def _first_push(scene: Scene, p: Particles, frame: np.ndarray, layer: np.ndarray) -> tuple[float, Particles]:
    """Smallest gap [cells] before the step in which the ground pushes first, and the particles after it; a step a transfer."""
    engine, gap = loaded(scene, p), np.inf
    fall = np.sqrt(2 * 2.3 * scene.spacing[2] / GRAVITY)  # on a slope it takes longer
    for _ in range(int(0.9 * fall / engine.stable_step())):
        engine.step(engine.stable_step())
    while not np.any(engine.ledger().basal_impulse):
        gap = float(sliding_box.gaps(scene, engine.particles(), frame[2])[layer].min() / scene.spacing[2])
        engine.step(engine.stable_step())
    return gap, engine.particles()


def measure_threshold(full: bool) -> list[Result]:
    """Rest half a degree below the friction angle, motion half a degree above, and no damping left at 20 degrees."""
    spacing, time = (0.05, 3.0) if full else (0.1, 0.6)
    results: list[Result] = []
    for slope, azimuth, offset in ((14.5, 63.0, 0.6), (14.5, 0.0, 0.85))[: 2 if full else 1]:
        moved, speed = creep(Plane(slope, azimuth, offset, spacing), time)
        place = f"{slope:g} deg, azimuth {azimuth:g} deg, {offset:g} h off a node"
        results += [Bound(f"creep [m/s], {place}", speed, 2e-4, -2e-4), Bound(f"displacement [m], {place}", moved, 1e-3, -1e-3)]
    for slope in (15.5, 16.0, 20.0) if full else (15.5, 20.0):
        plane = Plane(slope, 37.0, 0.35, spacing)
        span = min(time, 1.0)
        moved, _ = creep(plane, span)
        exact = sliding_block(span, slope, FRICTION)[0] + symplectic_excess(span, slope, FRICTION, 3e-3 * spacing)
        words = f"displacement over that of a rigid block, {slope:g} deg, azimuth 37 deg, 0.35 h off a node"
        results.append(Bound(words, moved / exact, 1.01 if slope == 20 else np.inf, 0.99 if slope == 20 else 0.9))
    return results


def measure_oblique(full: bool) -> list[Result]:
    """One particle, and boxes that slide across the grid."""
    law, record = FRICTIONS.find(DEFAULT_FRICTION), SimpleNamespace(friction=0.5)
    push = law.impulse((1.0, 1.0, -1.0), (0.0, 0.0, 1.0), 0.0, 1.0, record, 0.01, (0.0, 0.0, 0.0), 0.0)
    left = np.array([1.0 + push[0], 1.0 + push[1], -1.0 + push[2]])
    exact = np.sqrt(2) - 0.5
    results: list[Result] = [
        Bound("one particle, v_n = -1, v_t = (1, 1), mu = 0.5: error of speed", float(abs(np.linalg.norm(left) - exact)), 1e-14),
        Bound("one particle: error of direction", float(abs(left[0] - left[1])), 1e-14),
    ]
    for azimuth in (0.0, 37.0, 45.0, 63.0) if full else (37.0,):
        lost, turned = oblique(azimuth, 0.05 if full else 0.1)
        results.append(Bound(f"error of the path that friction takes, azimuth {azimuth:g} deg", lost, 0.005, -0.005))
        results.append(Bound(f"error of direction [deg], azimuth {azimuth:g} deg", turned, 0.05, -0.05))
    return results


def measure_gap(full: bool) -> list[Result]:
    """Mean and spread of the gap over places of the ground between the nodes."""
    spacing, offsets, results = (0.05, OFFSETS, list[Result]()) if full else (0.1, OFFSETS[2::4], list[Result]())
    for slope in (0.0, 20.0):
        gaps = np.array([rest(slope, offset, spacing) for offset in offsets])
        for k, what in enumerate(("first push", "rest")):
            words = f"{slope:g} deg, {len(offsets)} offsets, at {what}"
            results.append(Bound(f"mean gap [h], {words}", float(gaps[:, k].mean()), 0.05, -0.05))
            results.append(Bound(f"spread of the gap [h], {words}", float(np.ptp(gaps[:, k])), 0.05))
    return results


SETUP = f"box of 1 m x {SIZE[1]:g} m x {SIZE[2]:g} m, E = 10 MPa, nu = 0.3, 1000 kg/m3, friction angle 15 deg"
THRESHOLD = Case(
    "T2",
    "stick threshold",
    f"{SETUP}, without stress; gravity ramped up over 20 periods 4 H/c with damping, then free for 3 s (1 s where it slides); "
    "creep is the mean speed in the last third",
    measure_threshold,
    "Half a degree above the friction angle the box slides too far: its elastic vibration grows while it slides (see sliding-box), "
    "and while a part of its base sticks for a moment friction does not act in full.",
)
OBLIQUE = Case(
    "T3", "oblique friction", f"{SETUP}, settled, thrown at 1 m/s on level ground across the grid, 0.25 s", measure_oblique
)
GAP = Case(
    "T4",
    "gap to the ground",
    "box of 0.5 m x 0.3 m x 0.3 m dropped from 2.3 h on planes of 0 and 20 deg, mu = 1, then damped to rest; gap of the lowest "
    "layer of particles beyond half their size",
    measure_gap,
)
