"""Pore pressure on all backends: closed forms, agreement with the reference, bits, memory and checkpoints."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scenes import SAND, assert_close_states, assert_same_numbers, engine_of, loaded, on_cpu

from runout import Voellmy
from runout.backends.scan import state
from runout.backends.scan.backend import ScanBackend
from runout.model.particles import Particles
from runout.model.pore_pressure import PorePressure
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.studies.verification_cases import wet_layers
from runout.studies.verification_cases.bodies import lattice, particles_at

BACKENDS = ("reference", "scan", "hash")
GRAVITY, DENSITY, CELL = 9.81, 2000.0, 0.5
DRAINS = PorePressure(ratio=0.7, saturation=0.5, diffusivity=0.05)
FRICTIONS = {"coulomb": (0.4, 0.3), "drag": (Voellmy(mu=0.3, xi=500.0), Voellmy(mu=0.2, xi=300.0))}


def tilted(pore, slope_deg=20.0, friction=(0.4,), materials=(SAND,), **choices):
    """Level ground along the grid, with gravity inclined by a slope."""
    slope = math.radians(slope_deg)
    floor = Surface.through(np.full((41, 13), 4.35 * CELL), (2.0, 2.0))
    gravity = (GRAVITY * math.sin(slope), 0.0, -GRAVITY * math.cos(slope))
    pores = (pore,) * len(materials) if isinstance(pore, PorePressure) else pore
    choices = {"precision": "float64", "substeps": 1, **choices}
    return Scene((CELL,) * 3, floor, Raster(12, 40, (2.0, 2.0)), materials, friction, gravity, pore_pressure=pores, **choices)


def slab(scene, size, ratio):
    """A slab on that ground under its own weight, with a pore pressure ratio (a number, or one for each particle)."""
    local = lattice(size, CELL)
    p = particles_at(local + np.array([4.0, 8.0, 4.35 * CELL]), CELL, DENSITY, CELL / 4)
    material, weight = scene.materials[0], -scene.gravity[2] * DENSITY * (size[2] - local[:, 2])
    p.strain[:, 2] = np.expm1(-2.0 * weight / (material.lame_lambda + 2.0 * material.shear_modulus))
    if scene.is_wet:
        p.pore_excess[:], p.pore_left[:] = ratio - scene.pore_pressure[0].equilibrium(DENSITY), 1.0
    return p


def two_masses(law="coulomb", substeps=4, precision="float64"):
    """Two masses of sand beside each other with other densities, frictions and pore pressures, which slide and collapse."""
    pores = (DRAINS, PorePressure(ratio=0.5, decay_time=0.7))
    materials = SAND, replace(SAND, density=0.9 * DENSITY)
    scene = tilted(pores, friction=FRICTIONS[law], materials=materials, substeps=substeps, precision=precision, strength=(0.5, 0.5))
    p = slab(scene, (4.0, 3.0, 1.5), 0.7)
    second = p.position(np.full(3, CELL))[:, 0] > 6.0
    p.release[second], p.mass[second], p.pore_excess[second] = 1, 0.9 * p.mass[second], 0.5
    p.pore_excess += 0.01 * np.arange(len(p)) / len(p)
    p.velocity[:, 0] = 1.0
    return scene, p


def after(engine, scene, p, transfers=25):
    """The backend after transfers, every fifth of one substep."""
    loaded(engine, scene, p)
    for k in range(transfers):
        engine.step(0.9 * engine.stable_step(), scene.substeps if k % 5 else 1)
    return engine


@pytest.mark.parametrize("substeps", [1, 4])
@pytest.mark.parametrize("name", BACKENDS)
def test_layer_whose_pressure_decays_slides_as_its_closed_form(name, substeps):
    layer = wet_layers.Layer(wet_layers.DECAYS, (6.0, 1.0, 0.5), substeps=substeps)
    assert wet_layers.speed_error(layer, engine_of(name), (0.5, 1.0)) < 0.005


@pytest.mark.parametrize("name", BACKENDS)
def test_pressure_below_a_layer_consolidates_as_terzaghi_says(name):
    """In the middle of a slab of 1 m at rest; saturation 0.5 keeps a quarter of the weight on the water."""
    layer = wet_layers.Layer(wet_layers.DRAINS, (3.0, 3.0, 1.0), slope_deg=0.0, substeps=4)
    assert np.abs(wet_layers.consolidation_errors(layer, engine_of(name), (0.1, 0.2, 0.5, 1.0))).max() < 0.05


@cache
def moved_by_the_reference(law, substeps):
    """Particles and ledger of two masses, once for all backends."""
    engine = after(engine_of("reference"), *two_masses(law, substeps))
    return engine.particles(), engine.ledger()


@pytest.mark.parametrize("law", FRICTIONS)
@pytest.mark.parametrize("substeps", [1, 4])
@pytest.mark.parametrize("name", ["scan", "hash", "hash in order"])
def test_two_wet_masses_move_as_on_the_reference(name, substeps, law):
    scene, p = two_masses(law, substeps)
    a, ledger = moved_by_the_reference(law, substeps)
    engine = on_cpu(deterministic=True) if name == "hash in order" else engine_of(name)
    found = after(engine, scene, p)
    b = found.particles()
    assert_close_states(a, b, 1e-10, scene.spacing)
    np.testing.assert_allclose(b.pore_left, a.pore_left, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(b.pore_excess, a.pore_excess)
    for name in ("kinetic_energy", "plastic_dissipation", "basal_dissipation"):
        assert getattr(found.ledger(), name) == pytest.approx(getattr(ledger, name), rel=1e-9)


@pytest.mark.parametrize("name", ["scan", "hash"])
def test_single_precision_follows_double_precision(name):
    runs = [after(engine_of(name), *two_masses(precision=precision)).particles() for precision in ("float64", "float32")]
    np.testing.assert_allclose(runs[1].pore_left, runs[0].pore_left, atol=2e-4)
    assert runs[1].velocity[:, 0].mean() == pytest.approx(runs[0].velocity[:, 0].mean(), rel=1e-4)


@pytest.mark.parametrize("name", BACKENDS)
def test_mass_without_pore_pressure_has_the_bits_and_the_memory_of_a_dry_scene(name):
    found = []
    for pores in ((), (None,)):
        scene = tilted(pores, materials=(SAND,), substeps=4)
        engine = after(engine_of(name), scene, slab(scene, (4.0, 3.0, 1.0), 0.0))
        found.append((engine.particles(), engine.ledger(), engine.memory_bytes()))
    assert_same_numbers(found[0][0], found[1][0])
    assert_same_numbers(found[0][1], found[1][1])
    assert found[0][2] == found[1][2]
    assert not found[0][0].pore_left.any()


@pytest.mark.parametrize("name", BACKENDS)
def test_wet_mass_without_pressure_moves_as_a_dry_one(name):
    runs = []
    for pore in ((), PorePressure(ratio=0.0, decay_time=1.0)):
        scene = tilted(pore, materials=(SAND,), substeps=4)
        runs.append(after(engine_of(name), scene, slab(scene, (4.0, 3.0, 1.0), 0.0)).particles())
    assert_close_states(*runs, 1e-11, scene.spacing)


@pytest.mark.parametrize(
    ("name", "precision"), [("reference", "float64"), ("scan", "float32"), ("hash", "float32"), ("hash", "float64")]
)
def test_a_restored_backend_goes_on_with_its_pore_pressure_bit_by_bit(name, precision):
    scene, p = two_masses(precision=precision)
    engine, other = after(engine_of(name), scene, p), engine_of(name)
    state = {key: np.array(values) for key, values in engine.checkpoint().items()}
    other.restore(scene, state)
    for one in (engine, other):
        for k in range(20):
            one.step(0.9 * one.stable_step(), 4 if k % 3 else 1)
    assert_same_numbers(engine.particles(), other.particles())
    assert_same_numbers(engine.ledger(), other.ledger())


@pytest.mark.parametrize("name", BACKENDS)
def test_particles_that_are_loaded_again_keep_their_pore_pressure(name):
    """As after a change of the ground: positions, ratios and what remains of them go through the form that backends exchange."""
    scene, p = two_masses()
    engine = after(engine_of(name), scene, p)
    before, again = engine.particles(), engine_of(name)
    after_loading = loaded(again, scene, before).particles()
    for key in ("pore_left", "pore_excess"):
        np.testing.assert_array_equal(getattr(after_loading, key), getattr(before, key))
    again.step(0.5 * again.stable_step())
    assert (again.particles().pore_left < before.pore_left).all()


def test_bits_do_not_depend_on_the_number_of_threads():
    scene = tilted(DRAINS, materials=(SAND,), precision="float32", substeps=4)
    p, found = slab(scene, (24.0, 7.0, 2.0), 0.7), []
    for threads in (1, 2):
        engine = after(ScanBackend(threads), scene, p, 10)
        assert engine.threads == threads
        found.append(engine.particles())
    assert_same_numbers(*found)


@pytest.mark.parametrize(("pore", "summed"), [(DRAINS, True), (PorePressure(ratio=0.7, decay_time=0.7), False)])
def test_only_drainage_by_thickness_sums_the_columns_of_nodes(pore, summed):
    scene = tilted(pore, materials=(SAND,), precision="float32", substeps=4)
    engine = after(ScanBackend(1), scene, slab(scene, (4.0, 3.0, 1.0), 0.7), 2)
    assert engine.workspace.layers.areal.any() == summed
    assert 0.0 < engine.particles().pore_left.max() < 1.0


def test_substeps_leave_what_remains_with_the_particles_as_single_steps_do():
    """A decay depends on time alone: every order of substeps and slots gives its closed form, also across blocks."""
    scene = tilted(PorePressure(ratio=0.7, decay_time=0.7), materials=(SAND,), precision="float32", substeps=4)
    p = slab(scene, (4.0, 3.0, 1.0), 0.7)
    p.velocity[:, 0] = 3.0
    engine, time = loaded(ScanBackend(1), scene, p), 0.0
    for k in range(60):
        dt, count = 0.9 * engine.stable_step(), (4, 1, 3)[k % 3]
        engine.step(dt, count)
        time += count * dt
    np.testing.assert_allclose(engine.particles().pore_left, math.exp(-time / 0.7), rtol=2e-5)
    assert engine.counters.rebuilds > 0


def decaying(ratio=0.7, precision="float32"):
    """One slab whose pressure decays in a time, with a ratio or one for each particle."""
    scene = tilted(PorePressure(ratio=0.7, decay_time=0.7), materials=(SAND,), precision=precision, substeps=4)
    return scene, slab(scene, (6.0, 4.0, 1.0), ratio)


def test_a_ratio_takes_no_memory_of_particles_where_it_is_that_of_all():
    """Excess and what remains of it: 4 bytes a slot each, nothing by slot where they are the same."""
    ratios, held = np.linspace(0.6, 0.7, len(decaying()[1])), []
    for pore, ratio in ((DRAINS, 0.7), (DRAINS, ratios), (None, 0.7), (None, ratios)):
        scene, p = decaying(ratio)
        engine = loaded(ScanBackend(1), replace(scene, pore_pressure=(pore,)) if pore else scene, p)
        held.append(engine.memory().get("Particles.pores", 0) / engine.store.particles.pores.shape[1])
    assert held == [4, 8, 0, 4]


@pytest.mark.parametrize("releases", [1, 2])
@pytest.mark.parametrize("ratio", ["one", "many"])
def test_one_number_for_a_release_gives_the_bits_of_a_number_for_each_particle(monkeypatch, ratio, releases):
    scene, p = decaying(0.7) if releases == 1 else two_masses(precision="float32")
    pores = (PorePressure(ratio=0.7, decay_time=0.7), PorePressure(ratio=0.5, decay_time=0.3))
    scene = replace(scene, pore_pressure=pores[:releases])
    p.pore_excess[:] = 0.6 if ratio == "one" else np.linspace(0.5, 0.7, len(p))
    found = []
    for shared in (True, False):
        if not shared:
            monkeypatch.setattr(state, "_parts_by_release", lambda *of_particles: None)
        engine = after(ScanBackend(1), scene, p, 10)
        assert engine.store.drains_alike == shared
        assert len(engine.store.pore_left) == (releases if shared else 0)
        found.append((engine.particles(), engine.ledger()))
    assert_same_numbers(found[0][0], found[1][0])
    assert_same_numbers(found[0][1], found[1][1])


def test_particles_that_join_later_keep_their_own_part_of_the_excess():
    scene, p = decaying()
    engine = after(ScanBackend(1), scene, p, 4)
    before = float(engine.store.pore_left[0])
    more = slab(scene, (1.0, 1.0, 0.5), 0.3)
    more.node[:, 2] += 6
    more.identity += len(p)
    engine.add(more)
    found = engine.particles()
    assert 0.0 < before < 1.0
    np.testing.assert_array_equal(found.pore_left, np.where(np.arange(len(found)) < len(p), np.float32(before), 1.0))
    np.testing.assert_array_equal(np.unique(found.pore_excess), np.unique(np.float32([0.3, 0.7])))
    dt = 0.5 * engine.stable_step()
    engine.step(dt, 4)
    np.testing.assert_allclose(engine.particles().pore_left, found.pore_left * math.exp(-4.0 * dt / 0.7), rtol=1e-5)


def test_one_number_for_all_goes_on_from_a_checkpoint_bit_by_bit():
    engine, other = after(ScanBackend(1), *decaying(), 4), ScanBackend(1)
    other.restore(decaying()[0], {key: np.array(values) for key, values in engine.checkpoint().items()})
    for one in (engine, other):
        one.step(0.9 * one.stable_step(), 4)
    assert len(other.store.pore_left) == 1
    assert_same_numbers(engine.particles(), other.particles())


def test_dry_and_wet_releases_share_a_flow():
    scene, p = two_masses()
    scene = replace(scene, pore_pressure=(DRAINS, None))
    p.pore_excess[p.release == 1] = p.pore_left[p.release == 1] = 0.0
    runs = [after(engine_of(name), scene, p).particles() for name in BACKENDS]
    for other in runs[1:]:
        assert_close_states(runs[0], other, 1e-10, scene.spacing)
    assert not runs[0].pore_left[runs[0].release == 1].any()


def test_a_chunk_of_particles_has_the_arrays_of_pore_pressure():
    assert not Particles.zeros(3).pore_left.any()
    assert not Particles.at_rest(3).pore_excess.any()
