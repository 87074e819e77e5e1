"""Sites from DEM to hazard map on GPUs by the command that users type, against maps that a CPU made, and members spread over GPUs.

    python tests/benchmarks/gpu_site_runs.py --out gpu_site_runs.json --folder work [--cpu-maps FOLDER]

``--cpu-maps`` holds ``hazard.nc`` of the same sites under their names here (``frank_slide_members4.nc`` and so on), and
``structures.nc`` where there is one, which this script made with ``--write-cpu-maps`` by ``runout run`` on a CPU. Maps and
largest forces are compared by the mean difference over the mean of the CPU's (relative L1). Sites with downloaded rasters take them
from ``RUNOUT_DATA``. With two GPUs or more, an ensemble runs on one and on two of them, with one worker a GPU and with several.
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))
ENSEMBLE = """
import sys, time
from pathlib import Path
import runout
from runout.ensemble.run import run_ensemble
site = runout.read_site(Path(sys.argv[1])).on_device(sys.argv[2])
started = time.perf_counter()
report = run_ensemble(site, Path(sys.argv[3]), workers=int(sys.argv[4]))
print("seconds", time.perf_counter() - started, "failed", len(report.failed))
"""
PRODUCTS = ("hazard", "structures")
REPEATED, REPEATS = "dam_demo", 3  # site whose runs on a GPU are compared with each other, and how many more there are
SCALING = (("cuda:0", "1"), ("cuda", "2"), ("cuda:0", "4"), ("cuda", "8"))  # devices, and workers that share them
COMMAND = [sys.executable, "-c", "import sys; from runout.cli import main; sys.exit(main())", "run"]


def edited(site: str, folder: Path, **values: float) -> Path:
    """Copy of a site with numbers of its site.yaml changed."""
    copy = folder / "_".join([site, *(f"{k}{v:g}" for k, v in values.items())])
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(ROOT / "sites" / site, copy, ignore=shutil.ignore_patterns("results"))
    text = (copy / "site.yaml").read_text()
    for name, value in values.items():
        text, count = re.subn(rf"^(\s*{name}: )\S+", rf"\g<1>{value:g}", text, flags=re.MULTILINE)
        assert count == 1, name
    (copy / "site.yaml").write_text(text)
    return copy


def whole_run(site: Path, device: str) -> dict[str, Any]:
    """Wall time of ``runout run`` without earlier results, and what its members took."""
    out = site / f"results_{device.replace(':', '')}"
    started = time.perf_counter()
    done = subprocess.run([*COMMAND, str(site), "--device", device, "--out", str(out)], capture_output=True, text=True)
    record = {"site": site.name, "device": device, "seconds": time.perf_counter() - started, "exit": done.returncode}
    record["ensemble_seconds"] = float((re.findall(r"ensemble: done in ([\d.]+) s", done.stdout + done.stderr) or ["nan"])[0])
    if done.returncode:
        record["output"] = (done.stdout + done.stderr)[-2000:]
    return record | of_members(out)


def members_alone(site: Path, device: str, workers: int) -> dict[str, Any]:
    """Wall time of the members of a site, workers and scenes included, without the stages before and after."""
    out = site / f"members_{device.replace(':', '')}_{workers}"
    command = [sys.executable, "-c", ENSEMBLE, str(site), device, str(out), str(workers)]
    done = subprocess.run(command, capture_output=True, text=True)
    match = re.search(r"seconds ([\d.]+) failed (\d+)", done.stdout)
    record = {"site": site.name, "device": device, "workers": workers, "exit": done.returncode, "stage": "members"}
    if not match:
        return record | {"output": (done.stdout + done.stderr)[-2000:]}
    return record | {"ensemble_seconds": float(match[1]), "failed": int(match[2])} | of_members(out)


def of_members(out: Path) -> dict[str, Any]:
    """Particles and steps of the members with a result."""
    from netCDF4 import Dataset

    steps = []
    for path in sorted((out / "members").glob("*.nc")):
        with Dataset(path) as file:
            steps.append((int(file.particles), int(file.steps)))
    return {"members": len(steps), "particles": [n for n, _ in steps], "particle_steps": sum(n * s for n, s in steps)}


def differences(site: Path, device: str, maps: Path) -> dict[str, float]:
    """Relative L1 differences of the hazard maps, and of the largest forces on facades by member, from those of a CPU."""
    differences: dict[str, float] = {}
    for product in PRODUCTS:
        here, expected = site / f"results_{device.replace(':', '')}" / f"{product}.nc", kept(maps, site.name, product)
        if here.exists() and expected.exists():
            differences |= differences_of_file(here, expected)
    return differences


def spread(site: Path, device: str) -> dict[str, float]:
    """Largest relative L1 differences of products between the present run and a few more: a GPU adds in no fixed order."""
    out, runs = site / f"results_{device.replace(':', '')}", {}
    first = out.rename(out.with_name("first"))
    for _ in range(REPEATS):
        shutil.rmtree(out, ignore_errors=True)
        whole_run(site, device)
        for product in PRODUCTS:
            for name, difference in differences_of_file(out / f"{product}.nc", first / f"{product}.nc").items():
                runs[name] = max(difference, runs.get(name, 0.0))
    return runs


def kept(maps: Path, site: str, product: str) -> Path:
    """File in which a product of a CPU is kept."""
    return maps / (f"{site}.nc" if product == "hazard" else f"{site}_{product}.nc")


def differences_of_file(here: Path, expected: Path) -> dict[str, float]:
    """Relative L1 differences of the variables with two dimensions or more that two files share, of equal size."""
    from netCDF4 import Dataset

    rows = {}
    with Dataset(here) as a, Dataset(expected) as b:
        for name, values in b.variables.items():
            if values.ndim >= 2 and values.dtype.kind == "f" and name in a.variables and not name.startswith("elevation"):
                x, y = (np.ma.filled(v[name][:].astype(float), 0.0) for v in (a, b))
                if np.abs(y).sum() > 0 and x.shape == y.shape:
                    rows[name] = float(np.abs(x - y).sum() / np.abs(y).sum())
    return rows


def main() -> None:
    """Run, print and write."""
    from runout.backends.protocol import devices_of
    from runout.studies.work_precision import available_cores
    from tests.benchmarks.gpu_throughput import driver
    from tests.benchmarks.seed_cases.memory_peak import card_name

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--cpu-maps", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--scaling-cell", type=float, default=6.0)
    parser.add_argument("--scaling-members", type=int, default=64)
    parser.add_argument("--scaling", nargs="*", default=SCALING, type=lambda text: text.split("="), metavar="DEVICE=WORKERS")
    parser.add_argument("--write-cpu-maps", type=Path)
    parser.add_argument("--scaling-only", action="store_true", help="only the ensemble on one and two GPUs")
    a = parser.parse_args()
    report: dict[str, Any] = {"driver": driver(), "warp": version("warp-lang"), "runs": []}

    def note(record: dict[str, Any]) -> None:
        record |= {"commit": a.commit, "card": card_name() if record["device"] != "cpu" else f"{available_cores()} cores"}
        report["runs"].append(record)
        print(json.dumps({k: v for k, v in record.items() if k != "particles"}), flush=True)
        a.out.write_text(json.dumps(report, indent=1))

    sites: tuple[tuple[str, dict[str, float], str], ...] = (
        ("dam_demo", {}, "cuda:0"),
        ("jacksboro", {"cell_size": 20}, "cuda:0"),
        ("frank_slide", {"members": 4}, "cuda:0"),
        ("frank_slide", {"cell_size": 10, "members": 2}, "cuda:0"),
        ("frank_slide", {"cell_size": 5, "members": 2}, "cuda"),
    )
    if a.write_cpu_maps:
        for name, values, _ in sites[:-1]:
            site = edited(name, a.folder, **values)
            note(whole_run(site, "cpu"))
            for product in PRODUCTS:
                made = site / "results_cpu" / f"{product}.nc"
                if made.exists():
                    shutil.copy(made, kept(a.write_cpu_maps, site.name, product))
        return
    for name, values, device in () if a.scaling_only else sites:
        site = edited(name, a.folder, **values)
        record = whole_run(site, device)
        if a.cpu_maps and not record["exit"]:
            record["against_cpu"] = differences(site, device, a.cpu_maps)
        if name == REPEATED and not record["exit"]:
            record["against_gpu"] = spread(site, device)
        note(record)
    many = edited("jacksboro", a.folder, cell_size=a.scaling_cell, members=a.scaling_members)
    if len(devices_of("cuda")) > 1:
        members_alone(edited("jacksboro", a.folder, cell_size=20, members=2), "cuda", 2)  # compiles
        for device, workers in a.scaling:
            note(members_alone(many, device, int(workers)))


if __name__ == "__main__":
    main()
