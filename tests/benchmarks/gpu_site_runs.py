"""Sites from DEM to hazard map on GPUs by the command that users type, against maps that a CPU made, and members spread over GPUs.

    python tests/benchmarks/gpu_site_runs.py --out gpu_site_runs.json --folder work [--cpu-maps FOLDER]

``--cpu-maps`` holds ``jacksboro.nc`` and ``frank_slide.nc``: ``hazard.nc`` of the same sites (frank_slide with 4 members) made by
``runout run`` on a CPU; maps are compared by the mean difference over the mean of the CPU's (relative L1). Sites with downloaded
rasters take them from ``RUNOUT_DATA``. With two GPUs or more, an ensemble runs on one and on two of them.
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))
COMMAND = [sys.executable, "-c", "import sys; from runout.cli import main; sys.exit(main())", "run"]


def edited(site: str, folder: Path, **values: float) -> Path:
    """Copy of a site with numbers of its site.yaml changed."""
    copy = folder / "_".join([site, *(f"{k}{v:g}" for k, v in values.items())])
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(ROOT / "sites" / site, copy, ignore=shutil.ignore_patterns("results"))
    text = (copy / "site.yaml").read_text()
    for name, value in values.items():
        text, found = re.subn(rf"^(\s*{name}: )\S+", rf"\g<1>{value:g}", text, flags=re.MULTILINE)
        assert found == 1, name
    (copy / "site.yaml").write_text(text)
    return copy


def whole_run(site: Path, device: str) -> dict[str, Any]:
    """Wall time of ``runout run`` without earlier results, and what its members took."""
    from netCDF4 import Dataset

    out = site / f"results_{device.replace(':', '')}"
    started = time.perf_counter()
    done = subprocess.run([*COMMAND, str(site), "--device", device, "--out", str(out)], capture_output=True, text=True)
    record = {"site": site.name, "device": device, "seconds": time.perf_counter() - started, "exit": done.returncode}
    record["ensemble_seconds"] = float((re.findall(r"ensemble: done in ([\d.]+) s", done.stdout + done.stderr) or ["nan"])[0])
    if done.returncode:
        record["output"] = (done.stdout + done.stderr)[-2000:]
    steps = []
    for path in sorted((out / "members").glob("*.nc")):
        with Dataset(path) as file:
            steps.append((int(file.particles), int(file.steps)))
    record |= {"members": len(steps), "particles": [n for n, _ in steps], "particle_steps": sum(n * s for n, s in steps)}
    return record


def differences(site: Path, device: str, expected: Path) -> dict[str, float]:
    """Relative L1 differences of the hazard maps from those of a CPU."""
    from netCDF4 import Dataset

    found = {}
    with Dataset(site / f"results_{device.replace(':', '')}" / "hazard.nc") as a, Dataset(expected) as b:
        for name, values in b.variables.items():
            if values.ndim >= 2 and values.dtype.kind == "f" and name in a.variables and not name.startswith("elevation"):
                x, y = (np.ma.filled(v[name][:].astype(float), 0.0) for v in (a, b))
                if np.abs(y).sum() > 0 and x.shape == y.shape:
                    found[name] = float(np.abs(x - y).sum() / np.abs(y).sum())
    return found


def main() -> None:
    """Run, print and write."""
    from runout.backends.protocol import devices_of

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--cpu-maps", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--scaling-cell", type=float, default=6.0)
    parser.add_argument("--scaling-members", type=int, default=32)
    a = parser.parse_args()
    report: dict[str, Any] = {"commit": a.commit, "runs": []}

    def note(record: dict[str, Any]) -> None:
        report["runs"].append(record)
        print(json.dumps({k: v for k, v in record.items() if k != "particles"}), flush=True)
        a.out.write_text(json.dumps(report, indent=1))

    for site in (edited("jacksboro", a.folder, cell_size=20), edited("frank_slide", a.folder, members=4)):
        record = whole_run(site, "cuda:0")
        expected = a.cpu_maps / f"{site.name.split('_members')[0].split('_cell')[0]}.nc" if a.cpu_maps else None
        if expected and expected.exists() and not record["exit"]:
            record["against_cpu"] = differences(site, "cuda:0", expected)
        note(record)
    many = edited("jacksboro", a.folder, cell_size=a.scaling_cell, members=a.scaling_members)
    for device in ("cuda:0", "cuda") if len(devices_of("cuda")) > 1 else ("cuda:0",):
        note(whole_run(many, device))
    note(whole_run(edited("frank_slide", a.folder, cell_size=5, members=2), "cuda"))


if __name__ == "__main__":
    main()
