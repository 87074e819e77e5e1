"""What rests and what truly slumps: heaps below and above the strength in steady shear, slabs with and without a free face.

Sand of 34 degrees carries sin(34 deg) in steady shear, a slope of 29.2 degrees, with the default cone. A free face of height H on a
slope pushes with K H/2 times the weight of a column; friction takes that up over the length K H / (2 (strength - slope)).
"""

import math
from functools import cache

import numpy as np
import pytest

import runout
from runout.backends.protocol import get_backend
from runout.model.numerics import Numerics
from runout.physics import geostatic, substeps
from runout.simulation.scenario import build_scene
from runout.studies.verification_cases.bodies import transfer

INTERNAL_DEG, BASAL_DEG, H = 34.0, 30.0, 2.0
STRENGTH = math.sin(math.radians(INTERNAL_DEG))


def sand(cone="plane_strain"):
    return runout.DruckerPrager(density=2000.0, youngs_modulus=2e7, poisson_ratio=0.3, friction_angle=INTERNAL_DEG, cone=cone)


def followed(terrain, thickness, placement, material, times, substeps=Numerics.substeps):
    """Places (len(times), n, 3) [m] and thickness maps (len(times), rows, columns) [m] of a mass at these times."""
    release = runout.Release(thickness, terrain, placement=placement)
    numerics = Numerics(cell_size=H, particles_per_cell=8, substeps=substeps)
    scene, particles = build_scene(terrain, release, material, BASAL_DEG, numerics)
    engine, spacing, time = get_backend("scan", threads=1), np.array(scene.spacing), 0.0
    engine.load(scene, particles)
    places, maps = [], []
    for end in times:
        while time < end * (1 - 1e-9):
            dt = min(engine.stable_step(), end - time)
            time += dt * transfer(engine, scene, dt, max(1, int((end - time) / dt)))
        found = engine.particles()
        assert len(found) == len(particles)
        places.append(found.position(spacing))
        maps.append(engine.columns().volume / H**2)
    return np.array(places), np.array(maps)


def heap_of(angle_deg):
    """Level ground and a heap on it, 9 m high."""
    x, y = np.meshgrid((np.arange(40) + 0.5) * H, (np.arange(40) + 0.5) * H)
    ground = runout.Terrain.from_array(np.full(x.shape, 100.0), H)
    return ground, np.clip(9.0 - math.tan(math.radians(angle_deg)) * np.hypot(x - 40.0, y - 40.0), 0.0, None)


@cache
def heap(angle_deg, cone):
    """Sinking [mm/s] in 2 to 5 s and in 5 to 10 s, the part of the volume of a heap that moved in 10 s, and that after 2 s."""
    places, maps = followed(*heap_of(angle_deg), "on_surface", sand(cone), (0.0, 2.0, 5.0, 10.0))
    heights = 1e3 * places[:, :, 2].mean(axis=1)
    moved = [0.5 * np.abs(maps[-1] - maps[k]).sum() / maps[0].sum() for k in (0, 1)]
    return (heights[1] - heights[2]) / 3.0, (heights[2] - heights[3]) / 5.0, *moved


def slab_of(slope_deg, thickness=4.0, length=100.0, width=60.0):
    """A slope and a slab on it that thins out over 12 m, and the distances [m] of places from its lower end and middle line."""
    x, y = np.meshgrid((np.arange(90) + 0.5) * H, (np.arange(46) + 0.5) * H)
    ground = runout.Terrain.from_array(400.0 - math.tan(math.radians(slope_deg)) * x, H)
    inside = np.minimum(length / 2 - abs(x - 70.0), width / 2 - abs(y - 46.0))
    return ground, thickness * np.clip(inside / 12.0, 0.0, 1.0), lambda p: (70.0 + length / 2 - p[:, 0], abs(p[:, 1] - 46.0))


@cache
def slab(slope_deg, placement):
    """Distance of particles from the lower end of a slab (n,) [m], and their speed down the slope [mm/s] in 5 to 10 s."""
    ground, thickness, distances = slab_of(slope_deg)
    places, _ = followed(ground, thickness, placement, sand(), (0.0, 5.0, 10.0))
    from_end, from_middle = distances(places[0])
    speed = 1e3 * (places[2, :, 0] - places[1, :, 0]) / 5.0 / math.cos(math.radians(slope_deg))
    return from_end[from_middle < 12.0], speed[from_middle < 12.0]


def creep(thickness, most):
    """Mean speed [mm/s] in 3 to 6 s of the middle of a slab on 20 degrees, in transfers of at most so many substeps."""
    ground, mass, distances = slab_of(20.0, thickness, 60.0, 40.0)
    places, _ = followed(ground, mass, "excavated", sand(), (0.0, 3.0, 6.0), most)
    from_end, from_middle = distances(places[0])
    inside = (from_end > 15.0) & (from_end < 45.0) & (from_middle < 8.0)
    return 1e3 * np.linalg.norm(places[2, inside] - places[1, inside], axis=1).mean() / 3.0


def run_to_rest(ground, thickness, placement, end_time):
    """Reason and time [s] of the end of a run that stops at rest."""
    release = runout.Release(thickness, ground, placement=placement)
    chosen = {"basal_friction_angle": BASAL_DEG, "cell_size": H, "particles_per_cell": 8, "threads": 1}
    result = runout.simulate(ground, release, sand(), end_time=end_time, **chosen)
    return result.stop_reason, float(result.ledger.time[-1])


def reach(slope_deg, thickness):
    """Length [m] over which the push of a free face of this height [m] is taken up."""
    tangent = math.tan(math.radians(slope_deg))
    ratio = geostatic.lateral_ratio(1 - STRENGTH, tangent, math.sqrt(3.0) * STRENGTH, 0.0)
    return ratio * thickness / (2 * (min(STRENGTH, math.tan(math.radians(BASAL_DEG))) - tangent))


@pytest.mark.parametrize(("angle_deg", "cone", "limit"), [(28.0, "plane_strain", 0.4), (33.0, "triaxial_compression", 0.2)])
def test_heap_less_steep_than_its_strength_in_steady_shear_rests(angle_deg, cone, limit):
    _, late, moved, _ = heap(angle_deg, cone)
    assert abs(late) < limit  # [mm/s]
    assert moved < 0.0012


def test_heap_steeper_than_its_strength_in_steady_shear_slumps_slowly_and_ever_slower():
    early, late, moved, _ = heap(33.0, "plane_strain")
    assert 0.0 < late < 0.8 * early < 1.2  # [mm/s]
    assert moved < 0.006


@pytest.mark.parametrize(("slope_deg", "limit"), [(20.0, 0.25), (25.0, 0.8)])
def test_slab_whose_ends_are_held_rests(slope_deg, limit):
    assert abs(slab(slope_deg, "excavated")[1].mean()) < limit  # [mm/s]


@pytest.mark.parametrize(("thickness", "limit"), [(3.0, 0.15), (8.0, 0.5)])
def test_slab_at_rest_creeps_no_faster_with_substeps_since_slow_mass_takes_one(monkeypatch, thickness, limit):
    """The loss of each transfer stops creep: with a quarter of the transfers a slab creeps faster."""
    one, four = (creep(thickness, most) for most in (1, 4))
    assert four <= 1.001 * one  # rounding: the kernels are compiled for another number of substeps
    assert one < limit
    monkeypatch.setattr(substeps, "SLOWEST", 0.0)
    assert creep(thickness, 4) > 1.1 * one


def test_slab_with_a_free_face_slumps_there_and_rests_beyond_its_reach():
    distance, speed = slab(25.0, "on_surface")
    face = reach(25.0, 4.0)
    assert face == pytest.approx(17.0, abs=0.1)
    assert speed[distance < face].mean() > 100.0  # [mm/s]: no face of 43 degrees stands
    assert abs(speed[distance > 3 * face].mean()) < 1.5


def test_stop_rule_ends_what_rests_and_little_moves_after():
    for ground, thickness, placement in (
        (*heap_of(28.0), "on_surface"),
        (*heap_of(33.0), "on_surface"),
        (*slab_of(25.0)[:2], "excavated"),
    ):
        reason, time = run_to_rest(ground, thickness, placement, 10.0)
        assert reason == "at rest"
        assert time < 3.0
    assert heap(33.0, "plane_strain")[3] < 0.003  # of the volume, from 2 to 10 s


def test_stop_rule_leaves_a_face_that_slumps_alone():
    reason, _ = run_to_rest(*slab_of(25.0)[:2], "on_surface", 4.0)
    assert reason == "end time"
