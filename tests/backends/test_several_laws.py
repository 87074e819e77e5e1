"""Masses of several laws in one run: each moves as in a run of its own, backends agree where they meet, runs go on."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import HASH_DEVICE, SAND, assert_close_states, box, engine_of, loaded, plane, scene
from test_checkpoint import resumable, same_bits

from runout import Coulomb, HerschelBulkley, Voellmy
from runout.backends.protocol import get_batch
from runout.model.friction import FrictionZones
from runout.model.particles import Particles

UNIT, DT, STEPS = (1.0, 1.0, 1.0), 2e-3, 50
MUD = HerschelBulkley(density=1500.0, youngs_modulus=2e6, poisson_ratio=0.3, yield_stress=800.0, consistency=300.0)
MATERIALS, FRICTIONS = (SAND, MUD), (Coulomb(friction_angle=25.0), Voellmy(mu=0.1, xi=300.0))
GROUND = plane(slope_x=-0.4, height=40.0)
APART, MEETING = (8.0, 44.0), (30.0, 34.0)  # [m] north, of the two masses
SPEED = np.array([6.0, 0.0, -2.4])  # [m/s], beyond that up to which contacts of the second law start from a force
TOLERANCE = 1e-11


def masses(places, towards=0.0):
    """A slab of each material that slides down the plane, the second one ``towards`` the first [m/s]."""
    slabs = []
    for number, (material, north) in enumerate(zip(MATERIALS, places, strict=True)):
        slab = box((10.0, north, 0.0), (5.0, 4.0, 2.0), UNIT, material.density, surface=GROUND)
        slab.release[:], slab.velocity[:] = number, SPEED - np.array([0.0, towards * number, 0.0])
        slabs.append(slab)
    return slabs


def together(slabs):
    """All particles in one run."""
    both = {name: np.concatenate([getattr(slab, name) for slab in slabs]) for name in vars(slabs[0])}
    return Particles(**both | {"identity": np.arange(sum(map(len, slabs)))})


def two_laws(**choices):
    """Both masses, without kernels of substeps, which are compiled for each mixture of laws."""
    return scene(GROUND, materials=MATERIALS, friction=FRICTIONS, **{"substeps": 1, **choices})


def advance(engine, steps=STEPS, dt=DT):
    for _ in range(steps):
        engine.step(dt)
    return engine


def test_each_of_two_separate_masses_moves_as_in_a_run_of_its_own(backend):
    slabs = masses(APART)
    found = advance(loaded(backend, two_laws(), together(slabs)))
    states, row, begin, dissipated = found.particles(), found.ledger(), 0, []
    for number, slab in enumerate(slabs):
        choices = {"substeps": 1} if number else {}  # kernels of substeps are compiled for sand alone
        own = scene(GROUND, materials=MATERIALS[number : number + 1], friction=FRICTIONS[number : number + 1], **choices)
        slab.release[:] = 0
        alone = advance(loaded(engine_of(name_of(backend)), own, slab))
        part = states.take(np.arange(begin, begin + len(slab)))
        assert_close_states(alone.particles(), part, TOLERANCE, UNIT)
        dissipated.append((alone.ledger().basal_dissipation, alone.ledger().plastic_dissipation))
        begin += len(slab)
    sums = np.sum(dissipated, axis=0)
    assert (row.basal_dissipation, row.plastic_dissipation) == pytest.approx(sums, rel=1e-9)
    assert np.ptp(states.velocity[:, 0]) > 0.1  # the laws differ


def name_of(engine):
    """Name of a backend."""
    return type(engine).__module__.split(".")[2]


@pytest.mark.parametrize("name", ["scan", "hash"])
def test_backends_agree_on_two_masses_that_meet(name):
    expected, found = (advance(loaded(engine_of(n), two_laws(), together(masses(MEETING, 3.0)))) for n in ("reference", name))
    assert_close_states(expected.particles(), found.particles(), 1e-9, UNIT)
    velocity = expected.particles().velocity
    mud = np.arange(len(velocity)) >= len(velocity) // 2
    assert velocity[mud, 1].mean() > -2.7  # the first mass has slowed it
    assert found.ledger().basal_dissipation == pytest.approx(expected.ledger().basal_dissipation, rel=1e-9)


def test_a_run_of_several_laws_goes_on_from_its_checkpoint_bit_by_bit(backend):
    resumable(backend)
    advance(loaded(backend, two_laws(), together(masses(MEETING, 3.0))))
    state = {name: values.copy() for name, values in backend.checkpoint().items()}
    other = engine_of(name_of(backend))
    other.restore(two_laws(), state)
    advance(backend, dt=0.9 * DT), advance(other, dt=0.9 * DT)
    assert same_bits(other.particles(), backend.particles())
    assert same_bits(other.ledger(), backend.ledger())


def test_releases_may_stand_in_any_order(backend):
    slabs = masses(MEETING, 3.0)
    found = advance(loaded(backend, two_laws(), together(slabs)), 10)
    turned = replace(two_laws(), materials=MATERIALS[::-1], friction=FRICTIONS[::-1])
    for slab in slabs:
        slab.release[:] = 1 - slab.release
    other = advance(loaded(engine_of(name_of(backend)), turned, together(slabs)), 10)
    for name in ("velocity", "strain", "history"):
        np.testing.assert_array_equal(getattr(other.particles(), name), getattr(found.particles(), name))


@pytest.mark.parametrize("name", ["scan", "hash"])
def test_zones_change_each_law_alike_on_all_backends(name):
    factor = np.ones((40, 30))
    factor[6:9] = 2.0  # its edge is below both masses
    outside = (factor == 1.0).astype(float)
    zones = FrictionZones(factor, np.zeros_like(factor), (2.0, 2.5), replaced={"inverse_xi": (outside, 0.02 * (1.0 - outside))})
    zoned = two_laws(friction_zones=zones)
    steps = 16  # a sheared slab of sand doubles differences every third step
    expected, found = (advance(loaded(engine_of(n), zoned, together(masses(APART))), steps) for n in ("reference", name))
    assert_close_states(expected.particles(), found.particles(), 1e-9, UNIT)
    plain = advance(loaded(engine_of("reference"), two_laws(), together(masses(APART))), steps).particles()
    half = len(plain) // 2
    for part in (slice(None, half), slice(half, None)):
        assert expected.particles().velocity[part, 0].mean() < plain.velocity[part, 0].mean() - 1e-3


def test_members_of_several_laws_share_a_launch():
    scenes = [(two_laws(), together(masses(APART))), (two_laws(), together(masses(MEETING, 3.0)))]
    launch = get_batch(scenes, HASH_DEVICE)
    for _ in range(10):
        launch.advance([DT] * 2, [1] * 2)
    for number, (a_scene, particles) in enumerate(scenes):
        alone = advance(loaded(engine_of("hash"), a_scene, particles), 10)
        assert_close_states(alone.particles(), launch.particles_of(number), TOLERANCE, UNIT)
