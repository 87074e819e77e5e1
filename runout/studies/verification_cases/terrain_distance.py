"""T8: distance and normal of smooth hills from an elevation raster, refined and as used by contact, and their cost."""

import time

import numpy as np

from runout.materials.elastic import Elastic
from runout.model.surface import Surface
from runout.model.terrain import Terrain
from runout.physics import heightfield
from runout.studies.verification_cases.bodies import filled, free_scene, lattice, loaded
from runout.studies.verification_cases.finding import Bound, Case, Convergence, Result
from runout.terrain.sdf import distance, sliding_surface

AMPLITUDE, WAVELENGTH, SIZE = 30.0, 200.0, 600.0  # [m] of the hills, and of the raster
K = 2 * np.pi / WAVELENGTH
QUERIES = 1_000_000
BODY = Elastic(density=2000.0, youngs_modulus=1e7, poisson_ratio=0.3)
REACH = 0.5  # [cells] from the ground within which contact asks for the distance, with room
CONTACT_BOUNDS = ((10.0, 5.0, 0.0016, 1.15), (10.0, 10.0, 0.0016, 1.15), (5.0, 2.5, 0.0008, 0.6), (5.0, 10.0, 0.001, 0.6))
ABOVE = 12.0  # [cells] of the body that is far from the ground
STEPS = 40


def hills(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Elevation [m]; the radius of curvature is 33.8 m or more."""
    return AMPLITUDE * np.sin(K * x) * np.cos(K * y)


def points(spacing: float, count: int = 5000, reach: float = 2.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (3, n) [m] within ``reach`` [cells] of the hills, their exact distances [m] and unit normals (n, 3) at the foot."""
    random = np.random.default_rng(0)
    u, v = random.uniform(WAVELENGTH, 2 * WAVELENGTH, (2, count))
    exact = random.uniform(-reach * spacing, reach * spacing, count)
    east, north = AMPLITUDE * K * np.cos(K * u) * np.cos(K * v), -AMPLITUDE * K * np.sin(K * u) * np.sin(K * v)
    normal = np.stack([-east, -north, np.ones(count)], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.stack([u, v, hills(u, v)]) + exact * normal.T, exact, normal


def raster(cell: float) -> Terrain:
    """The hills on square cells [m]."""
    x = (np.arange(int(SIZE / cell)) + 0.5) * cell
    return Terrain.from_array(hills(x[None, :], x[::-1, None]), (cell, cell))


def errors(spacing: float, cell: float) -> tuple[float, float, float]:
    """RMS and largest error of distance [cells of the grid], RMS error of the normal's direction [deg]."""
    places, exact, normal = points(spacing)
    distances, direction = distance(sliding_surface(raster(cell), None, (spacing, spacing)), *places)
    off = (distances - exact) / spacing
    turned = np.degrees(np.arccos(np.clip((direction * normal).sum(-1), -1, 1)))
    return float(np.sqrt(np.mean(off**2))), float(np.abs(off).max()), float(np.sqrt(np.mean(turned**2)))


def errors_of_contact(spacing: float, cell: float) -> tuple[float, float]:
    """RMS error of the distance [cells of the grid] and of the normal's direction [deg] that a backend takes for contact.

    That is the distance of first order, from the surface on the nodes of the grid, within :data:`REACH` of the ground.
    """
    places, exact, normal = points(spacing, reach=REACH)
    ground = sliding_surface(raster(cell), None, (spacing, spacing))
    height, east, north = ground.evaluate(places[0], places[1])
    direction = np.stack([-east, -north, np.ones_like(east)]) / np.sqrt(1.0 + east**2 + north**2)
    off = (heightfield.distance(places[2] - height, direction[2]) - exact) / spacing
    turned = np.degrees(np.arccos(np.clip((direction.T * normal).sum(-1), -1, 1)))
    return float(np.sqrt(np.mean(off**2))), float(np.sqrt(np.mean(turned**2)))


def of_a_plane() -> float:
    """Largest error [m] for a plane of 400 m."""
    terrain = Terrain.from_array(np.add.outer(-0.2 * np.arange(60.0)[::-1] * 10, 0.35 * np.arange(60.0) * 10), (10.0, 10.0))
    x, y = np.random.default_rng(1).uniform(0, SIZE, (2, 2000))
    height = np.random.default_rng(2).uniform(-20, 20, 2000)
    ground = 0.35 * (x - 5.0) - 0.2 * (y - 5.0)
    distances, _ = distance(sliding_surface(terrain, None, (10.0, 10.0)), x, y, ground + height)
    return float(np.abs(distances - height / np.sqrt(1 + 0.35**2 + 0.2**2)).max())


def seconds_of_queries(count: int) -> float:
    """Time [s] of a million distances with normals, from ``count`` places near the hills."""
    surface = sliding_surface(raster(5.0), None, (10.0, 10.0))
    places, _, _ = points(10.0, count)
    best = np.inf
    for _ in range(3):
        started = time.process_time()
        distance(surface, *places)
        best = min(best, time.process_time() - started)
    return best * 1e6 / count


def contact_cost(above: float, cells: int) -> tuple[float, int]:
    """Time of the contact stage [ns per particle-step], and particles in contact, of a block ``above`` [cells] level ground."""
    h = 1.0
    places = lattice((cells * h, cells * h, 4 * h), h) + np.array([40.0, 40.0, 20.0 + above * h])
    p = filled(places, h, BODY.density, h**3 / 8, h / 4)
    ground = Surface.through(np.full((20, 20), 20.0), (10.0, 10.0))
    engine, costs, touched = loaded(free_scene(h, BODY, ground, 9.81), p), [], 0
    dt = 0.5 * engine.stable_step()
    for _ in range(STEPS):
        before = engine.counters.seconds.get("contact", 0.0)
        engine.step(dt)
        costs.append(engine.counters.seconds["contact"] - before)
        touched = max(touched, engine.ledger().contact_particles)
    return float(1e9 * min(costs) / len(p)), touched


def measure(full: bool) -> list[Result]:
    """Errors, their order, and costs."""
    results: list[Result] = []
    for h, cell, worst in ((10.0, 5.0, 0.0014), (10.0, 10.0, 0.0014), (5.0, 2.5, 0.0002), (5.0, 10.0, 0.0012)):
        rms, largest, degrees = errors(h, cell)
        place = f"h = {h:g} m, raster of {cell:g} m"
        results += [
            Bound(f"distance, RMS [h], {place}", rms, worst),
            Bound(f"distance, largest error [h], {place}", largest, 8 * worst),
            Bound(f"normal, RMS [deg], {place}", degrees, 1.2 if h > 5 else 0.35),
        ]
    sizes = (10.0, 5.0, 2.5)
    relative = tuple(errors(h, 1.25)[0] * h / WAVELENGTH for h in sizes)
    results.append(Convergence("distance, RMS over the wavelength", tuple(WAVELENGTH / h for h in sizes), relative, 3.0))
    for h, cell, rms, degrees in CONTACT_BOUNDS:
        distance_off, turned = errors_of_contact(h, cell)
        place = f"h = {h:g} m, raster of {cell:g} m"
        results.append(Bound(f"distance of first order that contact takes, RMS [h], {place}", distance_off, rms))
        results.append(Bound(f"normal that contact takes, RMS [deg], {place}", turned, degrees))
    results.append(Bound("distance to a plane, largest error [m]", of_a_plane(), 1e-12))
    near, touched = contact_cost(0.0, 64 if full else 16)
    far, none = contact_cost(ABOVE, 64 if full else 16)
    results += [
        Bound(
            "particles in contact, block of 4 cells on the ground, share of its lowest layer",
            touched / (128 if full else 32) ** 2,
            1.0,
            0.99,
        ),
        Bound(f"particles in contact, the same block {ABOVE:g} cells above", float(none), 0.0),
        Bound("time of the contact stage, block on the ground [ns per particle-step]", near),
        Bound(f"time of the contact stage, {ABOVE:g} cells above [ns per particle-step]", far),
        Bound("time of a million distances with normals, NumPy [s]", seconds_of_queries(QUERIES if full else 50_000)),
    ]
    return results


CASE = Case(
    "T8",
    "distance to terrain",
    f"hills z = {AMPLITUDE:g} sin(2 pi x/{WAVELENGTH:g}) cos(2 pi y/{WAVELENGTH:g}) m on a raster; 5000 points within two cells h"
    f" of it, for what contact takes within {REACH:g} h; costs on one thread,"
    " contact on a block four cells high with eight particles a cell, in float64",
    measure,
    "The refined distance, to the tangent plane at a foot point, is that of `runout.terrain.sdf.distance`. Contact takes the"
    " distance of first order, gap times n_z, and the normal under the particle, from the surface on the nodes of the grid. "
    "The backends ask only for particles below a bound of the ground in their column of cells: above it the stage costs a look at "
    "the bounds of each block. Times are the shortest of one machine and bind nothing.",
)
