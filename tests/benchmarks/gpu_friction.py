"""Time of a step with Voellmy friction over that with Coulomb friction: the layer of ``gpu_throughput`` at several sizes.

    python tests/benchmarks/gpu_friction.py --device cuda:0 --commit COMMIT --out gpu_friction.json

The laws take turns on the same device, so that its clock and its host are alike for all. The JSON holds a record a size: the
median seconds of a step by law of friction.
"""

import argparse
import json
import statistics
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).parents[2]))

from runout import Voellmy, VoellmyBase
from tests.benchmarks.gpu_additions import FRICTION
from tests.benchmarks.gpu_throughput import LAYERS, STEP, layer, loaded, record_sorts

LAWS = {"coulomb": FRICTION, "voellmy_base": VoellmyBase(mu=FRICTION, xi=1500.0), "voellmy": Voellmy(mu=FRICTION, xi=1500.0)}
STEPS = {"0.1M": 512, "0.3M": 512, "1M": 256, "10M": 64}  # of a turn
TURNS = 7


def prepared(device: str, size: str, friction: Any) -> tuple[Any, float]:
    """A backend that has recorded its graphs, and its time step [s]."""
    scene, p = layer(*LAYERS[size])
    backend = loaded(device, replace(scene, friction=(friction,)), p)
    dt = STEP * backend.stable_step()
    backend.steps(dt, 4 + STEPS[size] // 4)
    record_sorts(backend)
    backend.steps(dt, STEPS[size] // 4)
    return backend, dt


def seconds_of_step(backend: Any, dt: float, steps: int) -> float:
    """Seconds of a step, the device idle before and after."""
    wp.synchronize_device(backend.device)
    started = time.perf_counter()
    backend.steps(dt, steps)
    wp.synchronize_device(backend.device)
    return (time.perf_counter() - started) / steps


def measure(device: str, size: str) -> dict[str, Any]:
    """The record of a size."""
    batches = {law: prepared(device, size, friction) for law, friction in LAWS.items()}
    turns = [{law: seconds_of_step(*one, STEPS[size]) for law, one in batches.items()} for _ in range(TURNS)]
    seconds = {law: statistics.median(turn[law] for turn in turns) for law in batches}
    return {"name": size, "particles": 8 * int(np.prod(LAYERS[size])), "seconds_of_step": seconds}


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--sizes", nargs="*", default=list(STEPS), choices=list(STEPS))
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    report: dict[str, Any] = {"device": wp.get_device(a.device).name, "warp": wp.__version__, "commit": a.commit, "records": []}
    for size in a.sizes:
        report["records"].append(measure(a.device, size))
        print(size, {law: f"{1e6 * s:.1f} us" for law, s in report["records"][-1]["seconds_of_step"].items()}, flush=True)
        if a.out:
            a.out.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
