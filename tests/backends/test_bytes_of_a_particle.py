"""Memory of the host at the peak of a run, in bytes a particle."""

import tracemalloc
from functools import cache
from unittest.mock import patch

import numpy as np
import pytest

from runout import DruckerPrager, Release, Terrain
from runout.model.particle_source import CompactParticles, gathered, slices
from runout.simulation import simulate, single
from runout.simulation.scenario import build_scene, scene_arguments

SAND = DruckerPrager(density=2000.0, friction_angle=30.0)
SMALL, LARGE = 300_000, 600_000  # the terrain takes 26 MB before there are particles
MOST = {"scan": 260, "hash": 60}  # bytes a particle


def slope(particles):
    """A slab 25 m thick on a slope, and the cell size for so many particles of it."""
    east, north = np.meshgrid(np.arange(60) * 20.0, np.arange(40) * 20.0)
    terrain = Terrain(800.0 - 0.5 * east + 0.0004 * (north - 400.0) ** 2, (20.0, 20.0))
    thickness = np.where((east > 100) & (east < 500) & (north > 200) & (north < 600), 25.0, 0.0)
    release = Release(thickness, terrain, placement="on_surface")
    return {"terrain": terrain, "release": release, "material": SAND, "cell_size": (release.volume * 16 / particles) ** (1 / 3)}


@cache
def peak_bytes(particles, backend):
    """Largest traced memory of a run of one step, beside what was there before, that of its forecast, and its particles."""
    simulate(**slope(2_000), end_time=1e-4, backend=backend, device="cpu")  # compiled code and caches are fixed costs
    stated = slope(particles)
    said, expected = [], single.expected_memory
    with patch.object(single, "expected_memory", lambda *a, **k: said.append(expected(*a, **k)) or said[-1]):
        tracemalloc.start()
        try:
            result = simulate(**stated, end_time=1e-4, backend=backend, device="cpu")
            return tracemalloc.get_traced_memory()[1], said[0].total, result.n_particles
        finally:
            tracemalloc.stop()


@pytest.mark.parametrize("backend", MOST)
def test_a_run_takes_few_bytes_of_the_host_for_each_particle(backend):
    (small, _, few), (large, _, many) = (peak_bytes(n, backend) for n in (SMALL, LARGE))
    assert many > 1.8 * few
    assert large / many < MOST[backend]
    assert (large - small) / (many - few) < MOST[backend]


def test_forecast_of_the_memory_is_that_of_the_peak():
    (small, less, _), (large, more, _) = (peak_bytes(n, "scan") for n in (SMALL, LARGE))
    assert more - less == pytest.approx(large - small, rel=0.2)


def test_particles_in_chunks_are_those_made_at_once_and_the_same_each_time():
    stated = slope(30_000)
    scene, at_once = build_scene(**scene_arguments(stated | {"seed": 4}))
    _, source = build_scene(**scene_arguments(stated | {"seed": 4}), in_chunks=True)
    assert len(source) == len(at_once) > 25_000
    for _ in range(2):
        chunks = list(slices(source))
        assert len(chunks) > 2
        for part, chunk in chunks:
            for name, values in vars(chunk).items():
                np.testing.assert_array_equal(values, getattr(at_once, name)[part], err_msg=name)
    assert source.sums(scene.densities) == at_once.sums(scene.densities)
    for (_, bare), (_, chunk) in zip(slices(source, stressed=False), slices(source), strict=True):
        np.testing.assert_array_equal(bare.offset, chunk.offset)
        assert not bare.strain.any()
        assert chunk.strain.any()


def test_compact_particles_are_the_particles_in_the_precision_of_the_run():
    stated = slope(30_000)
    scene, source = build_scene(**scene_arguments(stated), in_chunks=True)
    compact = CompactParticles.of(source, scene.densities, np.float32)
    held = sum(sum(a.nbytes for a in arrays.values()) + release.nbytes for arrays, release in compact.parts)
    assert held / len(compact) < 61
    one, other = gathered(compact), gathered(source)
    for name, values in vars(one).items():
        wanted = getattr(other, name)
        np.testing.assert_array_equal(values, wanted.astype(np.float32) if wanted.dtype == np.float64 else wanted, err_msg=name)
    assert compact.sums(scene.densities) == source.sums(scene.densities)
