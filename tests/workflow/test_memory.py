"""Memory is forecast from the releases; what does not fit is refused before anything large is made."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from runout import Bed, DruckerPrager, Hydrograph, Inflow, Release, Terrain, Voellmy, VoellmyBase
from runout.backends.protocol import get_backend
from runout.errors import CapacityError
from runout.forecast.memory import GIGABYTE, MemoryForecast, expected_extent, expected_memory, with_births, with_inflow
from runout.model.numerics import Numerics, Scheme
from runout.release.inlet import mass_at
from runout.release.sample import particles_per_axis
from runout.simulation.observers import PeakMaps
from runout.simulation.scenario import build_scene
from runout.simulation.single import simulate

SAND = DruckerPrager(density=2000.0, youngs_modulus=1e7, friction_angle=30.0)


def valley(cell, thickness, rows=60):
    """Terrain with a slope and a cross profile, and a round release of ``thickness`` [m] on or in it."""
    east, north = np.meshgrid(np.arange(2 * rows) * cell, np.arange(rows) * cell)
    terrain = Terrain(400.0 - 0.5 * east + 0.002 / cell * (north - rows * cell / 2) ** 2, (cell, cell))
    distance = np.hypot(east - 20 * cell, north - rows * cell / 2) / (12 * cell)
    return terrain, Release(np.where(distance < 1, thickness * (1.2 - distance), 0.0), terrain, placement="on_surface")


CASES = {
    "thick, grid finer than the raster": (10.0, 30.0, 5.0, 8),
    "thin, grid finer than the raster": (10.0, 4.0, 3.0, 8),
    "grid coarser than the raster": (2.0, 12.0, 3.0, (3, 3, 3)),
    "flat cells, few particles": (8.0, 20.0, (8.0, 8.0, 4.0), 4),
}


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("case", CASES)
def test_forecast_agrees_with_what_the_scan_backend_holds(case, precision):
    cell, thickness, spacing, per_cell = CASES[case]
    terrain, release = valley(cell, thickness)
    seen = []
    scene, particles = build_scene(
        terrain,
        release,
        SAND,
        20.0,
        Numerics(cell_size=spacing, particles_per_cell=per_cell, precision=precision),
        accept=lambda extent: seen.append(extent),
    )
    engine = get_backend("scan", threads=1)
    engine.load(scene, particles)
    (extent,) = seen
    assert extent.particles == pytest.approx(len(particles), rel=0.05)
    forecast = expected_memory(extent, terrain.elevation.size, Scheme(precision=precision))
    assert forecast.backend == pytest.approx(sum(engine.memory().values()), rel=0.15)


def test_forecast_counts_the_record_of_joint_conditions():
    """On the host, with each backend: 8 bytes a cell of the raster and condition."""
    terrain, release = valley(10.0, 4.0)
    seen = []
    scene, _ = build_scene(terrain, release, SAND, 20.0, Numerics(cell_size=10.0, particles_per_cell=8), accept=seen.append)
    pairs = [{"thickness": 1.0, "speed": 2.0}, {"house_force": 35.3e3, "house_height": 5.6}]
    for engine in (None, OnCard()):
        without, record = (expected_memory(seen[0], terrain.elevation.size, Scheme(), engine, conditions=k) for k in (0, 2))
        assert record.host - without.host == PeakMaps(scene, 0.1, conditions=tuple(pairs)).shares.nbytes
        assert record.backend == without.backend


def test_a_run_counts_its_joint_conditions(monkeypatch):
    totals, pair = [], {"thickness": 1.0, "speed": 2.0}

    def refuse(forecast, *_):
        totals.append(forecast.total)
        raise CapacityError("enough")

    monkeypatch.setattr("runout.simulation.single.require_memory", refuse)
    terrain, release = valley(10.0, 4.0)
    for conditions in ([], [pair], [pair, {"thickness": 2.0, "speed": 1.0}]):
        with pytest.raises(CapacityError, match="enough"):
            simulate(terrain, release, SAND, basal_friction_angle=20.0, cell_size=10.0, end_time=1.0, joint_conditions=conditions)
    assert np.diff(totals).tolist() == [8 * terrain.elevation.size] * 2


def test_release_of_single_cells_between_the_places_that_are_looked_at_is_counted():
    """Squares of two by two grid cells are looked at by their middles; the cells of the raster are smaller than these squares."""
    terrain = Terrain(400.0 - 0.5 * np.arange(40.0) + np.zeros((40, 1)), (1.0, 1.0))
    thickness = np.zeros((40, 40))
    thickness[2:38:4, 2:38:4] = 2.0
    seen = []
    release = Release(thickness, terrain, placement="on_surface")
    _, particles = build_scene(terrain, release, SAND, 20.0, Numerics(cell_size=2.0, particles_per_cell=8), accept=seen.append)
    (extent,) = seen
    assert extent.particles == pytest.approx(len(particles), rel=0.2)
    assert 4 <= extent.occupied <= 60


@pytest.mark.parametrize("friction", [Voellmy(mu=0.2, xi=1000.0), VoellmyBase(mu=0.2, xi=1000.0)], ids=["column", "base"])
def test_forecast_counts_ground_areas_and_drag(friction):
    terrain, release = valley(10.0, 4.0)
    seen = []
    scene, particles = build_scene(
        terrain, release, SAND, 20.0, Numerics(cell_size=3.0, particles_per_cell=8, precision="float64"), accept=seen.append
    )
    engines = [get_backend("scan", threads=1) for _ in range(2)]
    for engine, law in zip(engines, (0.2, friction), strict=True):
        engine.load(replace(scene, friction=(law,)), particles)
    plain, held = (sum(engine.memory().values()) for engine in engines)
    size, scheme = terrain.elevation.size, Scheme(precision="float64")
    extent = replace(seen[0], friction=None)  # of another ground
    forecasts = [expected_memory(extent, size, scheme, friction=law).backend for law in (None, friction)]
    assert forecasts[1] == pytest.approx(held, rel=0.15)
    assert forecasts[1] - forecasts[0] == pytest.approx(held - plain, rel=0.2)


def test_a_run_above_its_memory_is_refused_with_both_numbers_before_it_takes_any():
    terrain, release = valley(10.0, 30.0)
    tracemalloc.start()
    try:
        with pytest.raises(CapacityError) as refused:
            simulate(terrain, release, SAND, cell_size=0.5, particles_per_cell=8, end_time=1.0, memory_gb=2.0)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    text = str(refused.value)
    assert "of memory, memory_gb is 2 GB; use a cell_size" in text
    needed = float(text.split("about ")[1].split(" GB")[0])
    volume = release.thickness.sum() * terrain.cell_area
    assert needed == pytest.approx(volume / 0.5**3 * 8 * (158 + 8) / GIGABYTE, rel=0.3)
    assert peak < 0.1 * needed * GIGABYTE


def test_a_run_that_the_machine_cannot_hold_is_refused(monkeypatch):
    terrain, release = valley(10.0, 30.0)
    monkeypatch.setattr("runout.forecast.memory.available_bytes", lambda: 1e8)
    with pytest.raises(CapacityError, match=r"the memory that is available is 0\.1 GB"):
        simulate(terrain, release, SAND, cell_size=5.0, end_time=1.0)


def test_memory_of_a_device_does_not_count_on_the_host():
    forecast = MemoryForecast(backend=80e9, host=5e9, on_device=True)
    assert forecast.total == 5e9
    forecast.require(6e9, "memory_gb")
    with pytest.raises(CapacityError, match="85 GB"):
        MemoryForecast(backend=80e9, host=5e9).require(6e9, "memory_gb")


class Card:
    is_cuda = True


class OnCard:
    device = Card()


@pytest.mark.parametrize("case", CASES)
def test_forecast_for_a_gpu_agrees_with_what_the_hash_backend_holds(case):
    cell, thickness, spacing, per_cell = CASES[case]
    terrain, release = valley(cell, thickness)
    seen = []
    scene, particles = build_scene(
        terrain,
        release,
        SAND,
        20.0,
        Numerics(cell_size=spacing, particles_per_cell=per_cell),
        accept=lambda extent: seen.append(extent),
    )
    engine = get_backend("hash", "cpu")
    engine.load(scene, particles)
    forecast = expected_memory(seen[0], terrain.elevation.size, Scheme(precision="float32"), OnCard())
    assert forecast.on_device
    assert forecast.backend == pytest.approx(engine.bytes_used(), rel=0.15)


def test_forecast_for_a_gpu_counts_the_masses_of_releases_whose_frictions_differ():
    from runout.backends.hash import contact_area

    terrain, release = valley(10.0, 30.0)
    seen, west = [], np.arange(terrain.shape[1]) < 20
    for xi in (1000.0, 2000.0):
        pair = [
            replace(release, name=str(n), thickness=release.thickness * part, basal_friction=Voellmy(mu=0.2, xi=x))
            for n, (part, x) in enumerate(zip((west, ~west), (1000.0, xi), strict=True))
        ]
        scene, _ = build_scene(terrain, pair, SAND, 20.0, Numerics(cell_size=5.0, particles_per_cell=8), accept=seen.append)
    friction = pair[0].basal_friction
    alike, mixed = (expected_memory(e, 1, Scheme(), OnCard(), friction=friction).backend for e in seen)
    assert [extent.mixed for extent in seen] == [1, scene.basal.mixed] == [1, 2]
    assert mixed - alike >= 2 * contact_area.PLAN * 4 * seen[1].nodes_on_device


def test_forecast_for_a_gpu_is_that_of_its_own_figures():
    terrain, release = valley(10.0, 60.0)
    scene, _ = build_scene(terrain, release, SAND, 20.0, Numerics(cell_size=10.0))
    extent = expected_extent([release], scene.surface, (2.0, 2.0, 2.0), particles_per_axis(8))
    assert 1e6 < extent.particles < 5e6
    cases = (("float32", 1, 140), ("float64", 1, 250), ("float32", 4, 190))  # docs/benchmarks: gpu.md, substeps.md, 1 to 10 million
    for precision, substeps, published in cases:
        scheme = Scheme(precision=precision, substeps=substeps)
        forecast = expected_memory(extent, terrain.elevation.size, scheme, OnCard())
        assert forecast.on_device
        assert forecast.backend / extent.particles == pytest.approx(published, rel=0.25)


def forecast_of(releases, bed=None, inflows=()):
    """Memory of a run in cells of 3 m, with what its bed and inflows bring."""
    terrain, numerics, seen = releases[0].terrain, Numerics(cell_size=3.0, particles_per_cell=8), []
    stiff = replace(SAND, youngs_modulus=1e9)  # carries hundreds of metres
    build_scene(terrain, releases, stiff, 20.0, numerics, bed=bed, inflow=inflows, accept=seen.append, in_chunks=True)
    masses = [*releases, *map(mass_at, inflows)]
    whole = with_inflow(with_births(seen[0], bed, masses, numerics, 20.0), inflows, numerics, 60.0)
    return expected_memory(whole, terrain.elevation.size, numerics)


def inflow_of(release, volume):
    """An inflow of a volume [m3] within 60 s, on the terrain of a release."""
    flow = Hydrograph([0.0, 60.0], [volume / 60.0] * 2, [50.0] * 2)
    return Inflow(release.terrain, flow, line=((400.0, 250.0), (400.0, 350.0)), name="creek")


def beside(release, volume):
    """The same outline 600 m farther east, with another volume [m3]."""
    thickness = np.roll(release.thickness, 60, axis=1) * volume / release.volume
    return Release(thickness, release.terrain, placement="on_surface", name="huge")


SOURCES = {  # by what is said of it: the forecast for a value of its key, and the value that is too much
    "reserved for the bed (bed), 900 m deep": (lambda release, depth: forecast_of([release], Bed(depth)), 900.0),
    "what inflow creek brings until end_time": (lambda release, m3: forecast_of([release], None, [inflow_of(release, m3)]), 1.5e7),
    "of release huge": (lambda release, m3: forecast_of([release, beside(release, m3)]), 1.5e7),
}
LIMIT = 0.6e9


@pytest.mark.parametrize("said", SOURCES)
def test_a_refusal_names_the_source_of_most_particles_and_a_value_that_fits(said):
    """The value in the message is accepted, half as much again is not; of a release blocks too go with the volume, so it is low."""
    _, release = valley(10.0, 4.0)
    of, excess = SOURCES[said]
    with pytest.raises(CapacityError) as refused:
        of(release, excess).require(LIMIT, "memory_gb")
    assert f"particles are {said}" in str(refused.value)
    fitting = float(str(refused.value).split("of at most ")[1].split()[0])
    of(release, fitting).require(LIMIT, "memory_gb")
    with pytest.raises(CapacityError):
        of(release, 1.5 * fitting).require(LIMIT, "memory_gb")


def test_a_refusal_of_one_release_names_no_source():
    _, release = valley(10.0, 4.0)
    assert forecast_of([release]).because(1.0) == ""
    assert forecast_of([release], Bed(900.0)).because(1e6).endswith("the rest alone does not fit either")
