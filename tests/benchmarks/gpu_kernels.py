"""Time, bytes and registers of each kernel of a transfer on a GPU, with one and with four substeps, by Nsight Compute.

    python tests/benchmarks/gpu_kernels.py --device cuda:0 --commit COMMIT --out gpu_kernels.json

The layer is that of ``gpu_throughput``, 400 x 400 x 4 cells. ``ncu`` measures two transfers behind a sort, without a graph. Clocks
are as the card sets them.
"""

import argparse
import csv
import ctypes
import json
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from statistics import mean
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

CELLS = (400, 400, 4)
SUBSTEPS = (1, 4)  # of a transfer
TRANSFERS = 2  # that are measured
METRICS = {
    "microseconds": "gpu__time_duration.sum",
    "bytes_read": "dram__bytes_read.sum",
    "bytes_written": "dram__bytes_write.sum",
    "registers": "launch__registers_per_thread",
    "occupancy": "sm__warps_active.avg.pct_of_peak_sustained_active",
    "issue": "smsp__issue_active.avg.pct_of_peak_sustained_active",
}
UNITS = {"ns": 1e-3, "us": 1.0, "ms": 1e3, "Kbyte": 1e3, "Mbyte": 1e6, "Gbyte": 1e9}  # in microseconds and bytes


def run(device: str, cells: tuple[int, int, int], substeps: int) -> None:
    """What ``ncu`` measures: transfers of the layer between start and stop of the profiler."""
    import warp as wp

    from tests.benchmarks.gpu_throughput import STEP, layer, loaded

    scene, particles = layer(*cells)
    backend = loaded(device, replace(scene, substeps=substeps), particles)
    backend.graphs.enabled = False
    dt = STEP * backend.stable_step()
    backend.steps(dt, 8, substeps=substeps)
    backend._rebuild(), backend._settle()
    wp.synchronize_device(backend.device)
    profiler = ctypes.CDLL("libcuda.so.1")
    profiler.cuProfilerStart()
    backend.steps(dt, TRANSFERS, substeps=substeps)
    wp.synchronize_device(backend.device)
    profiler.cuProfilerStop()


def kernels(lines: Iterable[str]) -> list[dict[str, Any]]:
    """Kernels of a table of ``ncu``, the longest first: launches a transfer, and the mean of each metric over the launches."""
    values: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for row in csv.DictReader(line for line in lines if not line.startswith("==")):
        name = row["Kernel Name"].split("_cuda_kernel")[0].rsplit("_", 1)[0]
        number = float(row["Metric Value"].replace(",", "")) * UNITS.get(row["Metric Unit"], 1.0)
        values[name][row["Metric Name"]].append(number)
    rows = []
    for name, of_kernel in values.items():
        means = {key: mean(of_kernel[metric]) for key, metric in METRICS.items()}
        rows.append({"kernel": name, "launches": len(of_kernel[METRICS["registers"]]) / TRANSFERS, **means})
    return sorted(rows, key=lambda row: -row["launches"] * row["microseconds"])


def measured(device: str, substeps: int) -> list[dict[str, Any]]:
    """Kernels of a transfer of so many substeps."""
    with TemporaryDirectory() as folder:
        table = Path(folder) / "kernels.csv"
        profile = ["ncu", "--profile-from-start", "off", "--clock-control", "none", "--csv", "--log-file", str(table)]
        target = [sys.executable, __file__, "--device", device, "--target", str(substeps)]
        subprocess.run([*profile, "--metrics", ",".join(METRICS.values()), *target], check=True)
        return kernels(table.read_text().splitlines())


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--target", type=int, help="substeps of the transfers that ncu measures; they run alone")
    a = parser.parse_args()
    if a.target:
        run(a.device, CELLS, a.target)
        return
    records = {str(number): measured(a.device, number) for number in SUBSTEPS}
    content = {"commit": a.commit, "particles": 8 * int(np.prod(CELLS)), "records": records}
    print(json.dumps(content, indent=1))
    if a.out:
        a.out.write_text(json.dumps(content, indent=1))


if __name__ == "__main__":
    main()
