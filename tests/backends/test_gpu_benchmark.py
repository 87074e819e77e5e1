"""The benchmark of the hash backend and its control, small and on the CPU: they use inner parts, which may move."""

from tests.benchmarks.gpu_naive import measure_naive
from tests.benchmarks.gpu_throughput import STAGES, layer, measure

CELLS = (10, 10, 4)


def test_a_record_of_the_benchmark_tells_all_stages_and_its_memory():
    record = measure("cpu", "small", CELLS, 8, graph=False, deterministic=False, precision="float32")
    assert (record["particles"], record["steps"]) == (3200, 8)
    assert set(STAGES) < set(record["stage_seconds"])
    assert all(seconds > 0 for seconds in record["stage_seconds"].values())
    assert record["contact_particles"] >= 100  # the lowest level
    assert record["bytes_per_particle"] > 100


def test_the_control_steps_the_same_layer():
    scene, p = layer(*CELLS)
    record = measure_naive("cpu", scene, p, 2)
    assert record["control"]
    assert record["particle_steps_per_second"] > 0
