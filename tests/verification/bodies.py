"""Bodies in the state in which a verification starts."""

import numpy as np

from runout import DruckerPrager, Elastic
from runout.backends.protocol import get_backend
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.physics import elastic

GRAVITY = 9.81


def lattice(size, spacing, per_cell=2):
    """Positions (n, 3) [m] of regular particles in a box with one corner at the origin."""
    axes = [np.arange(round(s * per_cell / spacing)) * spacing / per_cell + spacing / per_cell / 2 for s in size]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def particles_at(position, spacing, density, radius, per_cell=2):
    """Particles of equal volume at positions (n, 3) [m] of a cubic grid."""
    p = Particles.at(position, np.full(3, spacing))
    p.volume[:] = (spacing / per_cell) ** 3
    p.mass[:] = density * p.volume
    p.radius[:] = radius
    return p


def tilted_plane(slope_deg, azimuth_deg, extent, height):
    """Plane that descends towards the azimuth (from east to north), and its frame: down the slope, across, outward normal."""
    slope, azimuth = np.radians(slope_deg), np.radians(azimuth_deg)
    x = np.linspace(0.0, extent, 12)
    fall = np.tan(slope) * (np.cos(azimuth) * x[:, None] + np.sin(azimuth) * x[None, :])
    surface = Surface.through(height - fall, (x[1], x[1]))
    down = np.array([np.cos(slope) * np.cos(azimuth), np.cos(slope) * np.sin(azimuth), -np.sin(slope)])
    across = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return surface, np.stack([down, across, np.cross(down, across)])


def prestressed(particles, depth, frame, material, slope_deg, acceleration):
    """Give particles the stress of a sliding slab with free sides: normal and basal traction at ``depth`` below its top."""
    slope = np.radians(slope_deg)
    stress = np.zeros((len(particles), 3, 3))
    stress[:, 2, 2] = -material.density * GRAVITY * np.cos(slope) * depth
    stress[:, 0, 2] = stress[:, 2, 0] = material.density * (GRAVITY * np.sin(slope) - acceleration) * depth
    E, nu = material.youngs_modulus, material.poisson_ratio
    strain = ((1 + nu) * stress - nu * np.trace(stress, axis1=1, axis2=2)[:, None, None] * np.eye(3)) / E
    strain = np.einsum("ai,pab,bj->pij", frame, strain, frame)
    for p, h in enumerate(strain):
        particles.strain[p] = elastic.strain_of_log((h[0, 0], h[1, 1], h[2, 2], h[0, 1], h[1, 2], h[2, 0]))


def slide(slope_deg, friction, *, spacing, time, azimuth_deg=0.0, aligned=False, offset=0.35, precision="float64"):
    """Mean displacement along the slope [m], its speed [m/s] at the end and the step [s] of an elastic box.

    The box is 1 m long, 0.5 m wide and high, of 1000 kg/m3 and 10 MPa. ``aligned`` keeps the plane along the grid and tilts
    gravity instead; ``offset`` [cells] is the height of the plane between its nodes.
    """
    size = (1.0, 0.5, 0.5)
    material = Elastic(density=1000.0, youngs_modulus=1e7, poisson_ratio=0.3)
    slope = np.radians(slope_deg)
    acceleration = GRAVITY * max(np.sin(slope) - friction * np.cos(slope), 0.0)
    extent = 0.5 * acceleration * time**2 + 4.0
    plane_slope, plane_azimuth = (0.0, 0.0) if aligned else (slope_deg, azimuth_deg)
    surface, frame = tilted_plane(plane_slope, plane_azimuth, extent, (40 + offset) * spacing)
    gravity = GRAVITY * np.array([np.sin(slope), 0.0, -np.cos(slope)]) if aligned else np.array([0.0, 0.0, -GRAVITY])
    local = lattice(size, spacing)
    base = np.array([1.0 + 0.37 * spacing, 1.0 + 0.21 * spacing])
    origin = np.array([*base, surface.elevation(*base)])
    p = particles_at(origin + local @ frame, spacing, material.density, spacing / 4)
    prestressed(p, size[2] - local[:, 2], frame, material, slope_deg, acceleration)
    raster = Raster(100, 100, (extent / 100,) * 2)
    scene = Scene((spacing,) * 3, surface, raster, (material,), (friction,), tuple(gravity), precision=precision)
    end, dt = _run(scene, p, time)
    moved = (end.position(np.full(3, spacing)) - p.position(np.full(3, spacing))) @ frame[0]
    return float(moved.mean()), float((end.velocity @ frame[0]).mean()), dt


def _run(scene, particles, time):
    """Particles after equal steps, and the step [s]."""
    backend = get_backend("scan", threads=1)
    backend.load(scene, particles)
    steps = int(np.ceil(time / (0.95 * backend.stable_step())))
    for _ in range(steps):
        backend.step(time / steps)
    return backend.particles(), time / steps


def collapsed_column(aspect, friction_angle, *, basal_friction_angle=22.0, radius=8.0, spacing=1.0):
    """Run-out (R_99 - R_0)/R_0 and final height H_f/R_0 of a sand column of H_0/R_0 = ``aspect`` on a flat floor.

    R_99 holds 99 % of the mass. The column starts at rest under its own weight in uniaxial strain.
    """
    height = aspect * radius
    sand = DruckerPrager(density=2000.0, youngs_modulus=8e6 * aspect, poisson_ratio=0.3, friction_angle=friction_angle)
    floor, centre = 5.0 + 0.35 * spacing, np.array([50.0 + 0.13 * spacing, 50.0 + 0.27 * spacing])
    local = lattice((2 * radius, 2 * radius, height), spacing) - (radius, radius, 0.0)
    local = local[np.hypot(local[:, 0], local[:, 1]) < radius]
    p = particles_at(local + np.array([*centre, floor]), spacing, sand.density, spacing / 4)
    stiffness = sand.lame_lambda + 2 * sand.shear_modulus
    vertical = sand.density * GRAVITY * (local[:, 2] - height) / stiffness
    p.strain[:, 2] = np.expm1(2 * vertical)
    surface = Surface.through(np.full((12, 12), floor), (10.0, 10.0))
    friction = float(np.tan(np.radians(basal_friction_angle)))
    scene = Scene((spacing,) * 3, surface, Raster(100, 100, (1.0, 1.0)), (sand,), (friction,), precision="float64")
    end = _settled(scene, p, 3.5 * np.sqrt(height / GRAVITY)).position(np.full(3, spacing))
    distance = np.hypot(*(end[:, :2] - centre).T)
    top = end[distance < spacing, 2].max() + spacing / 4 - floor
    return float(np.quantile(distance, 0.99) / radius - 1), float(top / radius)


def _settled(scene, particles, time):
    """Particles after as many stable steps as ``time`` [s] takes."""
    backend, now = get_backend("scan", threads=1), 0.0
    backend.load(scene, particles)
    while now < time:
        dt = backend.stable_step()
        backend.step(dt)
        now += dt
    return backend.particles()
