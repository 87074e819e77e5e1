"""The benchmark of the hash backend and its control, small and on the CPU: they use inner parts, which may move."""

from tests.benchmarks import gpu_kernels
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


def test_kernels_of_a_profile_have_launches_a_transfer_and_means_in_microseconds_and_bytes():
    def rows(kernel, time, unit):
        values = {**dict.fromkeys(gpu_kernels.METRICS.values(), ("1", "")), gpu_kernels.METRICS["microseconds"]: (time, unit)}
        values[gpu_kernels.METRICS["bytes_read"]] = "1,500", "Kbyte"
        return [f'"{kernel}_0a1b2c3d_cuda_kernel_forward","{name}","{unit}","{value}"' for name, (value, unit) in values.items()]

    lines = ["==PROF== Connected", '"Kernel Name","Metric Name","Metric Unit","Metric Value"']
    lines += [
        *rows("move_nodes", "2", "us"),
        *rows("move_nodes", "4,000", "ns"),
        *rows("sort", "0.1", "ms"),
        *rows("sort", "0.1", "ms"),
    ]
    sort, nodes = gpu_kernels.kernels(lines)
    assert (sort["kernel"], sort["launches"], sort["microseconds"]) == ("sort", 1.0, 100.0)
    assert (nodes["kernel"], nodes["launches"], nodes["microseconds"]) == ("move_nodes", 1.0, 3.0)
    assert nodes["bytes_read"] == 1.5e6
