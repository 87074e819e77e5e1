"""The arithmetic of looks at a run in this process and in a worker, with dask's setting of the C library's memory and without.

    python tests/benchmarks/worker_memory.py runout    # as the ensemble starts its workers
    python tests/benchmarks/worker_memory.py dask      # as dask would

Prints seconds for 150 looks at 200 x 200 cells, three times each.
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

LOOKS = 150


def looks() -> list[float]:
    """Seconds for thickness, speed and pressure of some columns, three times."""
    rng, seconds = np.random.default_rng(0), []
    volume, momentum = rng.random((200, 200)), rng.random((200, 200, 3))
    for _ in range(3):
        started = time.perf_counter()
        for _ in range(LOOKS):
            thickness = volume / 64.0
            speed = np.linalg.norm(momentum, axis=-1) / np.maximum(volume, 1e-300)
            _pressure = volume / np.maximum(thickness, 1e-300) * speed**2
        seconds.append(round(time.perf_counter() - started, 3))
    return seconds


def main() -> None:
    """Measure and print."""
    import dask
    from distributed import Client, LocalCluster

    from runout.ensemble.crew import CLUSTER_SETTINGS

    kept = {k: v for k, v in CLUSTER_SETTINGS.items() if sys.argv[1] == "runout" or "nanny" not in k}
    print("here", looks())
    with (
        dask.config.set(kept),
        LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster,
        Client(cluster) as client,
    ):
        print("in a worker", client.submit(looks, pure=False).result())


if __name__ == "__main__":
    main()
