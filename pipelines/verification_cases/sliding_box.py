"""T1: an elastic box, pre-stressed, on a plane of any slope, azimuth and place between the nodes."""

from dataclasses import dataclass

import numpy as np

from pipelines.verification_cases.bodies import equal_steps, lattice, loaded, particles_at
from pipelines.verification_cases.closed_forms import GRAVITY, sliding_block, symplectic_excess
from pipelines.verification_cases.finding import Bound, Case, Result
from runout.errors import ConfigError
from runout.model.materials import Elastic, Material
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.physics import elastic

FRICTION_ANGLE = 15.0  # [deg]
FRICTION = float(np.tan(np.radians(FRICTION_ANGLE)))
SIZE = (1.0, 0.5, 0.5)  # [m]
BOX = Elastic(density=1000.0, youngs_modulus=1e7, poisson_ratio=0.3)


@dataclass(frozen=True)
class Plane:
    """The plane and the box's grid: angles in degrees, ``offset`` in cells between nodes, ``spacing`` [m].

    ``aligned`` keeps the plane along the grid and tilts gravity instead.
    """

    slope_deg: float
    azimuth_deg: float = 0.0
    offset: float = 0.35
    spacing: float = 0.1
    friction: float = FRICTION
    aligned: bool = False
    precision: str = "float64"

    def __post_init__(self) -> None:
        for name, low, high in (("slope", 0.0, 60.0), ("azimuth", -360.0, 360.0)):
            value = getattr(self, f"{name}_deg")
            if not low <= value <= high:
                raise ConfigError(f"{name} is {value:g} deg; it must lie between {low:g} and {high:g} deg")
        if not 0.0 <= self.offset <= 1.0:
            raise ConfigError(f"offset is {self.offset:g} cells; it must lie between 0 and 1")


@dataclass(frozen=True)
class Slide:
    """What a box did: mean displacement along the slope [m], its speed at the end [m/s], mean gap of its lowest layer
    [cells], and the step [s]."""

    moved: float
    speed: float
    gap: float
    dt: float


def slide(plane: Plane, time: float = 1.0) -> Slide:
    """A box of 1 m x 0.5 m x 0.5 m, 1000 kg/m3 and 10 MPa after ``time`` [s] on the plane, from rest."""
    h, slope = plane.spacing, np.radians(plane.slope_deg)
    acceleration = GRAVITY * max(np.sin(slope) - plane.friction * np.cos(slope), 0.0)
    extent = 0.5 * acceleration * time**2 + 4.0
    surface, frame = _ground(plane, extent)
    local = lattice(SIZE, h)
    p = _placed(plane, surface, frame, local, extent)
    prestressed(p, SIZE[2] - local[:, 2], frame, BOX, plane.slope_deg, acceleration)
    gravity = GRAVITY * (np.array([np.sin(slope), 0.0, -np.cos(slope)]) if plane.aligned else np.array([0.0, 0.0, -1.0]))
    raster = Raster(100, 100, (extent / 100,) * 2)
    friction, tilt = (plane.friction,), (float(gravity[0]), float(gravity[1]), float(gravity[2]))
    engine = loaded(Scene((h,) * 3, surface, raster, (BOX,), friction, tilt, precision=plane.precision), p)
    steps, dt = equal_steps(time, engine.stable_step())
    for _ in range(steps):
        engine.step(dt)
    end, start = engine.particles(), p.position(np.full(3, h))
    moved, lowest = (end.position(np.full(3, h)) - start) @ frame[0], local[:, 2] < 0.5 * h
    gap = _gap(surface, end.position(np.full(3, h))[lowest], frame[2]) - p.radius[lowest]
    return Slide(float(moved.mean()), float((end.velocity @ frame[0]).mean()), float(gap.mean() / h), dt)


def tilted_plane(slope_deg: float, azimuth_deg: float, extent: float, height: float) -> tuple[Surface, np.ndarray]:
    """Plane that descends towards the azimuth (from east to north), and its frame: down the slope, across, outward normal.

    ``height`` [m] at the middle of a square of ``extent`` [m].
    """
    slope, azimuth = np.radians(slope_deg), np.radians(azimuth_deg)
    x = np.linspace(0.0, extent, 12)
    away = x - extent / 2
    fall = np.tan(slope) * (np.cos(azimuth) * away[:, None] + np.sin(azimuth) * away[None, :])
    down = np.array([np.cos(slope) * np.cos(azimuth), np.cos(slope) * np.sin(azimuth), -np.sin(slope)])
    across = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return Surface.through(height - fall, (x[1], x[1])), np.stack([down, across, np.cross(down, across)])


def prestressed(
    p: Particles, depth: np.ndarray, frame: np.ndarray, material: Material, slope_deg: float, acceleration: float
) -> None:
    """Give particles the stress of a sliding slab with free sides: normal and basal traction at ``depth`` [m] below its top."""
    slope = np.radians(slope_deg)
    stress = np.zeros((len(p), 3, 3))
    stress[:, 2, 2] = -material.density * GRAVITY * np.cos(slope) * depth
    stress[:, 0, 2] = stress[:, 2, 0] = material.density * (GRAVITY * np.sin(slope) - acceleration) * depth
    E, nu = material.youngs_modulus, material.poisson_ratio
    strain = ((1 + nu) * stress - nu * np.trace(stress, axis1=1, axis2=2)[:, None, None] * np.eye(3)) / E
    strain = np.einsum("ai,pab,bj->pij", frame, strain, frame)
    for k, h in enumerate(strain):
        p.strain[k] = elastic.strain_of_log((h[0, 0], h[1, 1], h[2, 2], h[0, 1], h[1, 2], h[2, 0]))


def summary(plane: Plane, time: float = 1.0) -> dict[str, float | None]:
    """The errors of one plane by the names that the command prints.

    ``relative_displacement_error`` against a rigid block (None where that stays at rest), ``residual_speed`` [m/s] beyond
    that block's, ``mean_gap`` [cells] of the lowest layer, ``displacement`` [m].
    """
    found = slide(plane, time)
    exact, speed = sliding_block(time, plane.slope_deg, plane.friction)
    exact += symplectic_excess(time, plane.slope_deg, plane.friction, found.dt)
    return {
        "relative_displacement_error": float(found.moved / exact - 1) if exact > 0 else None,
        "residual_speed": float(found.speed - speed),
        "mean_gap": found.gap,
        "displacement": found.moved,
        "time_step": found.dt,
    }


def bounds(plane: Plane) -> list[Result]:
    """What must hold on a plane: half a percent from 30 degrees, 2 % from 20, rest below 14.5 degrees."""
    found, place = summary(plane), f"{plane.slope_deg:g} deg, azimuth {plane.azimuth_deg:g} deg, {plane.offset:g} h off a node"
    error, results = found["relative_displacement_error"], list[Result]()
    if error is not None:
        limit = 0.005 if plane.slope_deg >= 30 else 0.02 if plane.slope_deg >= 20 else np.inf
        results.append(Bound(f"relative displacement error, {place}", error, limit, -limit))
    still = 1e-3 if plane.slope_deg <= FRICTION_ANGLE - 0.5 else np.inf
    results.append(Bound(f"residual speed [m/s], {place}", float(found["residual_speed"] or 0.0), still, -still))
    results.append(Bound(f"mean gap [h], {place}", float(found["mean_gap"] or 0.0), 0.25, -0.25))
    return results


def measure(full: bool) -> list[Result]:
    """Rest, sliding, on the axes of the grid and across them."""
    spacing = 0.05 if full else 0.1
    planes = [Plane(s, 37.0, 0.35, spacing) for s in ((14.0, 20.0, 25.0, 30.0) if full else (14.0, 20.0))]
    if full:
        planes += [Plane(20.0, 0.0, 0.85, spacing), Plane(27.0, 63.0, 0.37, spacing)]
    return [bound for plane in planes for bound in bounds(plane)]


def _ground(plane: Plane, extent: float) -> tuple[Surface, np.ndarray]:
    slope, azimuth = (0.0, 0.0) if plane.aligned else (plane.slope_deg, plane.azimuth_deg)
    return tilted_plane(slope, azimuth, extent, (40 + plane.offset) * plane.spacing)


def _placed(plane: Plane, surface: Surface, frame: np.ndarray, local: np.ndarray, extent: float) -> Particles:
    """The box on the plane, so that the middle of its way is about the middle of the ground."""
    h, way = plane.spacing, frame[0, :2] * (extent - 4.0 + SIZE[0]) / 2 + frame[1, :2] * SIZE[1] / 2
    base = np.round((extent / 2 - way) / h) * h + np.array([0.37, 0.21]) * h
    origin = np.array([*base, surface.elevation(base[0], base[1])])
    return particles_at(origin + local @ frame, h, BOX.density, h / 4)


def _gap(surface: Surface, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
    return (position[:, 2] - surface.elevation(position[:, 0], position[:, 1])) * normal[2]


CASE = Case(
    "sliding-box",
    "sliding box (T1)",
    "box of 1 m x 0.5 m x 0.5 m, E = 10 MPa, nu = 0.3, 1000 kg/m3, friction angle 15 deg, pre-stressed, 1 s, against a rigid block",
    measure,
    "Near the friction angle the elastic vibration of the start counts: at 20 degrees 0.4 % too far with h = 0.1 m and 0.7 % with "
    "h = 0.05 m, so that this error does not fall with the grid; at 30 degrees 0.03 and 0.04 %.",
)
