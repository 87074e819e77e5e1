"""T5, T6: a block in a round bowl, and one that runs from a ramp through an arc onto a plain."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from runout.backends.protocol import Backend
from runout.materials.elastic import Elastic
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.studies.verification_cases.bodies import lattice, loaded, particles_at, transfer
from runout.studies.verification_cases.closed_forms import GRAVITY
from runout.studies.verification_cases.finding import Bound, Case, Result

LENGTH, WIDTH, HEIGHT = 0.4, 0.2, 0.2  # size of the block [m]
BLOCK = Elastic(density=1000.0, youngs_modulus=2e6, poisson_ratio=0.3)
BOWL_RADIUS, RELEASE_ANGLE = 4.0, np.radians(40.0)
RAMP_LENGTH, RAMP_ANGLE, ARC_RADIUS = 10.0, np.radians(30.0), 5.0
RAMP_FRICTION = float(np.tan(np.radians(15.0)))
Profile = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Arc:
    """A rigid arc-shaped block of :data:`LENGTH` and :data:`HEIGHT` in a cylinder of ``radius`` [m].

    Friction acts at the radius, weight at the centroid, so that its path differs from that of a point mass.
    """

    radius: float
    friction: float

    def acceleration(self, angle: float, rate: float) -> float:
        """Second derivative [1/s2] of the angle from the lowest point, while the block turns towards larger angles."""
        mean, half = self.radius - HEIGHT / 2, LENGTH / (2 * self.radius)
        square = (self.radius**3 - (self.radius - HEIGHT) ** 3) / (3 * HEIGHT)
        weight = GRAVITY * np.sin(half) / half
        hold = self.friction * self.radius * (weight * np.cos(angle) + mean * rate**2)
        return float((-weight * mean * np.sin(angle) - hold) / square)

    def crossing(self, angle: float, rate: float, event: Callable[[float, np.ndarray], float]) -> tuple[float, float, float]:
        """Time [s], angle and rate at which ``event`` falls or rises through zero, from an angle and a rate."""
        event.terminal = True  # type: ignore[attr-defined]
        solution = solve_ivp(
            lambda t, y: [y[1], self.acceleration(y[0], y[1])], (0.0, 10.0), [angle, rate], events=event, rtol=1e-10, atol=1e-12
        )
        return float(solution.t[-1]), float(solution.y[0, -1]), float(solution.y[1, -1])


def turning(friction: float) -> tuple[float, float]:
    """Angle [rad] at which the block in the bowl turns, and when [s]; exact for a rigid block."""
    time, angle, _ = Arc(BOWL_RADIUS, friction).crossing(-RELEASE_ANGLE, 1e-9, lambda t, y: y[1] + 1e-12)
    return angle, time


def runout(friction: float) -> float:
    """Distance [m] of the middle of the block at rest from the foot of the arc; exact for a rigid block."""
    down = 2 * RAMP_LENGTH * GRAVITY * (np.sin(RAMP_ANGLE) - friction * np.cos(RAMP_ANGLE))
    mean = ARC_RADIUS - HEIGHT / 2
    _, _, rate = Arc(ARC_RADIUS, friction).crossing(-RAMP_ANGLE, np.sqrt(down) / mean, lambda t, y: y[0])
    return float((rate * mean) ** 2 / (2 * friction * GRAVITY))


def ramp(s: np.ndarray) -> np.ndarray:
    """Elevation [m] of the plain (s > 0), the arc before it and the ramp before the arc."""
    start = -ARC_RADIUS * np.sin(RAMP_ANGLE)
    arc = ARC_RADIUS - np.sqrt(ARC_RADIUS**2 - np.clip(s, start, 0.0) ** 2)
    return arc - np.tan(RAMP_ANGLE) * np.minimum(s - start, 0.0)  # type: ignore[no-any-return]


def bowl(s: np.ndarray) -> np.ndarray:
    """Elevation [m] of a round bowl, continued straight where it is steep."""
    end = BOWL_RADIUS * np.sin(np.radians(60.0))
    arc = BOWL_RADIUS - np.sqrt(BOWL_RADIUS**2 - np.clip(np.abs(s), 0.0, end) ** 2)
    return arc + np.tan(np.radians(60.0)) * np.maximum(np.abs(s) - end, 0.0)  # type: ignore[no-any-return]


@dataclass(frozen=True)
class Way:
    """A profile drawn along an azimuth [deg] through the middle of a square domain of ``extent`` [m]."""

    profile: Profile
    azimuth_deg: float
    extent: float
    spacing: float
    offset: float  # [cells] of the profile's zero above a node

    @property
    def frame(self) -> np.ndarray:
        """Unit vectors (3, 3): along, across, up."""
        a = np.radians(self.azimuth_deg)
        return np.array([[np.cos(a), np.sin(a), 0.0], [-np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])

    @property
    def origin(self) -> np.ndarray:
        """Where s = 0 lies [m]."""
        cells = np.round(self.extent / 2 / self.spacing) + np.array([0.37, 0.21])
        return np.array([*(cells * self.spacing), (20 + self.offset) * self.spacing])

    def surface(self) -> Surface:
        """The ground on a lattice of the grid's spacing."""
        x = np.arange(int(np.ceil(self.extent / self.spacing)) + 1) * self.spacing
        along = self.frame[0]
        s = (x - self.origin[0])[:, None] * along[0] + (x - self.origin[1])[None, :] * along[1]
        return Surface.through(self.profile(s) + self.origin[2], (self.spacing,) * 2)

    def loaded(self, local: np.ndarray, friction: float) -> tuple[Backend, Scene]:
        """Backend with the block at local places (n, 3) [m]: along, across, up; and its scene."""
        p = particles_at(self.origin + local @ self.frame, self.spacing, BLOCK.density, self.spacing / 4)
        raster = Raster(100, 100, (self.extent / 100,) * 2)
        scene = Scene((self.spacing,) * 3, self.surface(), raster, (BLOCK,), (friction,), precision="float64")
        return loaded(scene, p), scene

    def middle(self, engine: Backend) -> np.ndarray:
        """Centroid (3,) [m]: along, across, up."""
        return (engine.particles().position(np.full(3, self.spacing)).mean(axis=0) - self.origin) @ self.frame.T  # type: ignore[no-any-return]


def swing(friction: float, spacing: float, azimuth_deg: float, offset: float) -> tuple[float, float]:
    """Angle [rad] at which an elastic block turns in the bowl, and when [s]."""
    s = lattice((LENGTH, WIDTH, HEIGHT), spacing) - (LENGTH / 2, WIDTH / 2, 0.0)
    angle, r = s[:, 0] / BOWL_RADIUS - RELEASE_ANGLE, BOWL_RADIUS - s[:, 2]
    way = Way(bowl, azimuth_deg, 9.0, spacing, offset)
    engine, scene = way.loaded(np.column_stack([r * np.sin(angle), s[:, 1], BOWL_RADIUS - r * np.cos(angle)]), friction)
    time, highest, when = 0.0, -np.inf, 0.0
    latest = 1.1 * turning(friction)[1]
    while time < latest:
        for _ in range(10):
            dt = engine.stable_step()
            time += dt * transfer(engine, scene, dt)
        at = way.middle(engine)
        now = float(np.arctan2(at[0], BOWL_RADIUS - at[2]))
        if now > highest:
            highest, when = now, time
    return highest, when


def slide_off(spacing: float, azimuth_deg: float, offset: float) -> float:
    """Distance [m] from the foot of the arc at which an elastic block comes to rest."""
    local = lattice((LENGTH, WIDTH, HEIGHT), spacing) - (LENGTH / 2, WIDTH / 2, 0.0)
    along, up = np.array([np.cos(RAMP_ANGLE), -np.sin(RAMP_ANGLE)]), np.array([np.sin(RAMP_ANGLE), np.cos(RAMP_ANGLE)])
    start = -ARC_RADIUS * np.sin(RAMP_ANGLE) - RAMP_LENGTH * along[0]
    foot = np.array([start, float(ramp(np.array(start)))])
    place = foot + local[:, :1] * along + local[:, 2:] * up
    way = Way(ramp, azimuth_deg, 44.0, spacing, offset)
    engine, scene = way.loaded(np.column_stack([place[:, 0], local[:, 1], place[:, 1]]), RAMP_FRICTION)
    time, before = 0.0, -np.inf
    while time < 8.0:
        started = time
        while time < started + 200 * engine.stable_step():
            dt = engine.stable_step()
            time += dt * transfer(engine, scene, dt)
        now = float(way.middle(engine)[0])
        if time > 3.0 and now - before < 1e-4 * (time - started):
            break
        before = now
    return now


def measure_bowl(full: bool) -> list[Result]:
    """Turning angle with and without friction, time of the turn without."""
    spacing, places = (0.05, ((0.0, 0.1), (0.0, 0.6), (30.0, 0.35))) if full else (0.1, ((30.0, 0.35),))
    results: list[Result] = []
    for friction in (0.0, 0.1, 0.2):
        exact, when = turning(friction)
        for azimuth, offset in places:
            angle, time = swing(friction, spacing, azimuth, offset)
            place = f"mu = {friction:g} (exact {np.degrees(exact):.2f} deg), azimuth {azimuth:g} deg, {offset:g} h off a node"
            most = 1.02 if friction else 1.001  # a ground without friction gives no energy
            results.append(Bound(f"turning angle over the exact one, {place}", angle / exact, most, 0.98))
            if friction == 0.0:
                results.append(Bound(f"half a period over the exact one, azimuth {azimuth:g} deg", time / when, 1.01, 0.99))
    return results


def measure_ramp(full: bool) -> list[Result]:
    """Run-out on the plain."""
    spacing, places = (0.05, ((0.0, 0.1), (0.0, 0.6), (30.0, 0.35))) if full else (0.1, ((30.0, 0.35),))
    exact, results = runout(RAMP_FRICTION), list[Result]()
    for azimuth, offset in places:
        words = f"run-out over the exact one ({exact:.2f} m), azimuth {azimuth:g} deg, {offset:g} h off a node"
        results.append(Bound(words, slide_off(spacing, azimuth, offset) / exact, 1.02, 0.98))
    return results


SETUP = f"elastic block of {LENGTH:g} m x {WIDTH:g} m x {HEIGHT:g} m, E = 2 MPa"
BOWL = Case(
    "T5",
    "bowl",
    f"{SETUP}, released at 40 deg in a bowl (cylinder) of radius 4 m, against a rigid block on which friction acts at the base "
    "and weight at the centroid",
    measure_bowl,
)
RAMP = Case(
    "T6",
    "ramp, arc and plain",
    f"{SETUP}, slides 10 m down 30 deg, through an arc of radius 5 m, onto a plain; mu = tan 15 deg",
    measure_ramp,
)
