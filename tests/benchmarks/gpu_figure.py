"""Figure of the GPU page from the records of ``gpu_throughput.py``.

python tests/benchmarks/gpu_figure.py docs/benchmarks/gpu.json docs/benchmarks/gpu.png
"""

import json
import sys
from pathlib import Path

import matplotlib.pyplot as plt

STAGES = ("p2g", "nodes and contact", "g2p", "cells")


def main() -> None:
    """Throughput against size, batched scenes beside one; stages of the largest sizes."""
    records = json.loads(Path(sys.argv[1]).read_text())["records"]
    plain = [
        r for r in records if r["graph"] and not r["deterministic"] and r["precision"] == "float32" and "steps_per_sort" not in r
    ]
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for label, chosen in (
        ("one scene", [r for r in plain if "members" not in r and "thin" not in r["name"]]),
        ("scenes of 100 000 particles in one launch", [r for r in plain if "members" in r]),
    ):
        chosen.sort(key=lambda r: r["particles"])
        rates = [r["particle_steps_per_second"] / 1e9 for r in chosen]
        left.semilogx([r["particles"] for r in chosen], rates, "o-", label=label)
    left.set(xlabel="particles", ylabel="10$^9$ particle-steps per second", ylim=(0, None))
    left.legend()
    wanted = [r for r in plain if "members" not in r and r["particles"] > 2e6]  # the stages of smaller ones wait for the host
    below = [0.0] * len(wanted)
    for stage in STAGES:
        share = [1e9 * r["stage_seconds"][stage] / r["particles"] for r in wanted]
        right.bar([r["name"] for r in wanted], share, bottom=below, label=stage)
        below = [a + b for a, b in zip(below, share, strict=True)]
    right.set(ylabel="nanoseconds a particle and step")
    right.legend()
    figure.savefig(sys.argv[2], dpi=120)


if __name__ == "__main__":
    main()
