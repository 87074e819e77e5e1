"""Whole commands of two versions of runout, in turns on the same machine, with the error of their maps beside the time.

    python tests/benchmarks/whole_commands.py --before CHECKOUT --after CHECKOUT --folder WORK --out whole_commands.json

Each lane has two cores of its own. First a run of each version compiles its kernels; then every case runs ``--pairs`` times.
Both run the sites of the version before. These state the stiffness that it advised (waves ten times the flow); the version after
runs them without it. Errors are
relative L1 differences of the peak thickness, the mean over the members, from members with half the cells by each version (on
``--device``); both references are given. RUNOUT_DATA names the folder of the public rasters.
"""

import argparse
import json
import os
import re
import resource
import shutil
import statistics
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

VERSIONS = ("before", "after")
CORES = 2  # of a lane
MEMBERS = 500  # of the aggregation
ENTRY = "import sys; from runout.cli import main; sys.exit(main())"  # of versions without runout.__main__
AS_BEFORE = "[2, 2, 4]"  # as many particles of the thin slab as in the version before; its default has four times as many
STIFF = {"coulomb_only": 1.6e8}  # [Pa], waves of 1,030 m/s; other sites state theirs in the version before
SNOW = """name: coulomb_only
title: CoulombOnly of ISeeSnow
terrain: {{dem: dem.tif}}
release:
  - {{name: slab, raster: release.tif, placement: on_surface}}
material: {{law: drucker_prager, density: 200, {stiffness}poisson_ratio: 0.3, friction_angle_deg: 34, cohesion: 0}}
basal_friction_angle_deg: 21.8014
simulation: {{cell_size: 10, end_time: 200, stop_when_at_rest: true}}
ensemble: {{members: 1, seed: 1}}
hazard: {{thickness_thresholds: [0.1, 0.5], speed_thresholds: [1], pressure_thresholds: [3.0e3], percentiles: [50]}}
"""


@dataclass(frozen=True)
class Case:
    """A command on a site: ``runout run``, ``check`` or the aggregation of many members."""

    name: str
    site: str = ""
    cell: float = 0.0  # [m]; 0: that of the site
    command: str = "run"
    has_error: bool = True
    particles: str = ""  # of a cell in the version after; empty for the default
    beside: bool = False  # not in the mean of the page
    cell_after: float = 0.0  # [m] of the version after, where its error is that of the version before; 0: the same cells


CASES = (
    Case("jacksboro", "jacksboro"),
    Case("frank_slide, 20 m", "frank_slide"),
    Case("cascades_2021", "cascades_2021"),
    Case("CoulombOnly, 10 m", "coulomb_only", 10.0, particles=AS_BEFORE),
    Case("CoulombOnly, 5 m", "coulomb_only", 5.0, particles=AS_BEFORE),
    Case("CoulombOnly, 10 m, default particles", "coulomb_only", 10.0, beside=True),
    Case("CoulombOnly, 5 m, default particles", "coulomb_only", 5.0, beside=True),
    Case("frank_slide, 20 m and 34 m", "frank_slide", 20.0, cell_after=34.0, beside=True),
    Case("jacksboro, 20 m and 21 m", "jacksboro", 20.0, cell_after=21.0, beside=True),
    Case("CoulombOnly, 10 m and 17 m", "coulomb_only", 10.0, cell_after=17.0, beside=True),
    Case("hazard of 500 members", command="aggregate", has_error=False),
    Case("check jacksboro", "jacksboro", command="check", has_error=False),
)
FIRST = Case("first run of jacksboro", "jacksboro", has_error=False)


def snow_site(folder: Path, version: str) -> None:
    """CoulombOnly of ISeeSnow as a site; its release thickness, measured across the slope, is made vertical."""
    import rasterio

    data = Path(os.environ["RUNOUT_DATA"]) / "iseesnow" / "CoulombOnly"
    with rasterio.open(data / "DEM_CoulombOnly.tif") as dem, rasterio.open(data / "release1HSField5m.tif") as slab:
        profile, z, across = dem.profile, dem.read(1).astype(float), slab.read(1).astype(float).clip(0)
    north, east = np.gradient(z, profile["transform"].a)
    vertical = np.nan_to_num(across * np.sqrt(1 + north**2 + east**2))
    for name, values in (("dem.tif", z), ("release.tif", vertical)):
        with rasterio.open(folder / name, "w", **{**profile, "nodata": -9999.0, "dtype": "float32"}) as file:
            file.write(np.where(np.isfinite(values), values, -9999.0).astype("f4"), 1)
    stiffness = f"youngs_modulus: {STIFF['coulomb_only']:g}, " if version == "before" else ""
    (folder / "site.yaml").write_text(SNOW.format(stiffness=stiffness))


def site_folder(case: Case, version: str, folder: Path, finer: float = 1.0) -> Path:
    """Folder of the site of a case."""
    few = "_few" if version == "after" and case.particles else ""
    cell = case.cell_after if version == "after" and case.cell_after else case.cell
    return folder / f"{case.site}_{cell:g}_{case.command}_{version}_{finer:g}{few}"


def site_of(case: Case, version: str, root: Path, folder: Path, finer: float = 1.0) -> Path:
    """The site of a case as ``root`` has it, with cells smaller by ``finer``; the version after chooses the stiffness."""
    copy = site_folder(case, version, folder, finer)
    shutil.rmtree(copy, ignore_errors=True)
    if case.site == "coulomb_only":
        copy.mkdir(parents=True)
        snow_site(copy, version)
    else:
        shutil.copytree(root / "sites" / case.site, copy, ignore=shutil.ignore_patterns("results"))
    text = (copy / "site.yaml").read_text()
    if version == "after":
        text = re.sub(r"^ *youngs_modulus:.*\n", "", text, flags=re.MULTILINE)
    if version == "after" and case.particles:
        text = text.replace("simulation: {", f"simulation: {{particles_per_cell: {case.particles}, ")
    size = case.cell_after if version == "after" and case.cell_after else case.cell
    cell = (size or float(re.findall(r"cell_size: ([\d.]+)", text)[0])) / finer
    text = re.sub(r"cell_size: [\d.]+", f"cell_size: {cell:g}", text)
    text = re.sub(r"^budget: .*$", "", text, flags=re.MULTILINE)
    (copy / "site.yaml").write_text(text)
    return copy


def timed(command: list[str], root: Path, cores: tuple[int, ...], cache: Path) -> dict[str, Any]:
    """Wall and processor time [s] of a command and its children, by the system's account of them."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])}
    environment |= {"NUMBA_CACHE_DIR": str(cache)}
    wrapped = [sys.executable, str(Path(__file__).resolve()), "--account", ",".join(map(str, cores)), *command]
    done = subprocess.run(wrapped, capture_output=True, text=True, env=environment, cwd=root)
    try:
        record: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    except (IndexError, json.JSONDecodeError):
        record = {"exit": done.returncode}
    return record | ({"output": (done.stdout + done.stderr)[-1500:]} if record["exit"] else {})


def account(cores: str, command: list[str]) -> None:
    """Run a command on some cores; print what it took as JSON."""
    os.sched_setaffinity(0, [int(core) for core in cores.split(",")])
    started = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    sys.stderr.write(done.stdout[-1000:] + done.stderr[-1000:])
    seconds = {"wall": time.perf_counter() - started, "processor": used.ru_utime + used.ru_stime, "exit": done.returncode}
    print(json.dumps(seconds | {"largest_process_mb": used.ru_maxrss / 1e3}))


def command_of(case: Case, site: Path, out: Path, root: Path, device: str = "cpu") -> list[str]:
    """The command of a case by the version in ``root``."""
    how = ["-m", "runout"] if (root / "runout" / "__main__.py").exists() else ["-c", ENTRY]
    if case.command == "check":
        return [sys.executable, *how, "check", str(site)]
    return [sys.executable, *how, "run", str(site), "--device", device, "--out", str(out)]


def peak_maps(results: Path) -> np.ndarray:
    """Peak thickness (members, rows, columns) [m] of a results folder."""
    from netCDF4 import Dataset

    with Dataset(results / "members.nc") as file:
        return np.ma.filled(file["max_flow_thickness"][:].astype(float), 0.0)


def error(results: Path, reference: Path) -> float:
    """Mean over the members of the relative L1 difference of peak thickness."""
    a, b = np.nan_to_num(peak_maps(results)), np.nan_to_num(peak_maps(reference))
    return float(np.mean(np.abs(a - b).sum((1, 2)) / b.sum((1, 2))))


class Study:
    """Both versions, their folders and the lanes of cores."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self.a = arguments
        self.roots = {"before": arguments.before.resolve(), "after": arguments.after.resolve()}
        self.folder = arguments.folder.resolve()
        self.started = time.perf_counter()
        self.lanes = [tuple(range(k, k + CORES)) for k in range(0, len(os.sched_getaffinity(0)) - CORES + 1, CORES)]

    def cache(self, version: str) -> Path:
        """Folder of the compiled kernels of a version."""
        return self.folder / f"kernels_{version}"

    def run(self, case: Case, version: str, cores: tuple[int, ...]) -> dict[str, Any]:
        """One run of a case by a version, from a folder without results."""
        root = self.roots[version]
        if case.command == "aggregate":
            return timed(self.aggregation(version), root, cores, self.cache(version))
        site = site_of(case, version, self.roots["before"], self.folder)
        return timed(command_of(case, site, site / "results", root), root, cores, self.cache(version))

    def aggregation(self, version: str) -> list[str]:
        """Command that writes the members of the aggregation where they are missing, and aggregates them."""
        return [sys.executable, str(self.a.members_script), str(self.folder / f"members_{version}"), str(MEMBERS)]

    def write_members(self, version: str) -> None:
        """Members of the aggregation; the command ends once the last one is there."""
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(self.roots[version]), os.environ.get("PYTHONPATH", "")])}
        writing = subprocess.Popen(self.aggregation(version), env=environment, cwd=self.roots[version], stdout=subprocess.DEVNULL)
        while writing.poll() is None and not (self.folder / f"members_{version}" / f"{MEMBERS - 1:04d}.nc").exists():
            time.sleep(0.2)
        writing.kill()
        writing.wait()

    def first(self) -> list[dict[str, Any]]:
        """The first run, with empty folders of kernels, of both versions side by side where the machine has two lanes."""
        lanes = (self.lanes * len(VERSIONS))[: len(VERSIONS)]
        with ThreadPoolExecutor(min(len(VERSIONS), len(self.lanes))) as pool:
            runs = list(pool.map(lambda v: self.run(FIRST, *v), zip(VERSIONS, lanes, strict=True)))
        return [{"case": FIRST.name, **dict(zip(VERSIONS, runs, strict=True))}]

    def pairs(self, case: Case, cores: tuple[int, ...]) -> list[dict[str, Any]]:
        """Runs of both versions in turns."""
        if case.command == "aggregate":
            for version in VERSIONS:
                self.write_members(version)
        rows = []
        for turn in range(self.a.pairs):
            if turn and time.perf_counter() - self.started > self.a.last_start:
                break
            order = VERSIONS if turn % 2 == 0 else VERSIONS[::-1]
            rows.append({"case": case.name, **{version: self.run(case, version, cores) for version in order}})
            print(json.dumps(rows[-1]), flush=True)
        return rows

    def of_lane(self, cases: list[Case], cores: tuple[int, ...]) -> list[dict[str, Any]]:
        """Runs of the cases that share a lane, one after the other."""
        return [row for case in cases for row in self.pairs(case, cores)]

    def references(self) -> dict[str, dict[str, Path]]:
        """Results with half the cells by each version on the device, by case."""
        paths: dict[str, dict[str, Path]] = {}
        for case in (c for c in CASES if c.has_error and c.name in self.a.cases):
            for version in VERSIONS:
                site = site_of(replace(case, particles=""), version, self.roots["before"], self.folder, 2.0)
                command = command_of(case, site, site / "results", self.roots[version], self.a.device)
                done = timed(command, self.roots[version], self.lanes[-1], self.cache(version))
                print("reference", case.name, version, json.dumps(done), flush=True)
                if not done["exit"]:
                    paths.setdefault(case.name, {})[version] = site / "results"
        return paths

    def errors(self, case: Case, references: dict[str, Path]) -> dict[str, dict[str, float]]:
        """Errors of each version against the reference of each version."""
        differences: dict[str, dict[str, float]] = {}
        for version in VERSIONS:
            results = site_folder(case, version, self.folder) / "results"
            differences[version] = {name: error(results, path) for name, path in references.items()}
        return differences

    def record(self) -> dict[str, Any]:
        """Everything, as JSON."""
        cases = [c for c in CASES if c.name in self.a.cases]
        for version in VERSIONS if FIRST.name in self.a.cases else ():
            shutil.rmtree(self.cache(version), ignore_errors=True)
        with ThreadPoolExecutor(len(self.lanes) + 1) as pool:
            references = pool.submit(self.references) if self.a.device else None
            runs = self.first() if FIRST.name in self.a.cases else []
            lanes = self.lanes[:-1] if self.a.device else self.lanes
            shares = [cases[k :: len(lanes)] for k in range(len(lanes))]
            runs += [row for rows in pool.map(self.of_lane, shares, lanes) for row in rows]
            halves = references.result() if references else {}
        errors = {c.name: self.errors(c, halves[c.name]) for c in cases if c.name in halves}
        beside = [c.name for c in cases if c.beside]
        return {"runs": runs, "errors": errors, "beside": beside, "machine": self.a.machine, "commits": self.a.commits}


def summary(record: dict[str, Any]) -> str:
    """Medians and ratios as a short table."""
    rows = []
    for name in dict.fromkeys(run["case"] for run in record["runs"]):
        runs = [run for run in record["runs"] if run["case"] == name and not run["before"]["exit"] + run["after"]["exit"]]
        if runs:
            wall = [statistics.median(run[v]["wall"] for run in runs) for v in VERSIONS]
            used = [statistics.median(run[v]["processor"] for run in runs) for v in VERSIONS]
            seconds = (f"{a:7.1f} {b:7.1f} {b / a:5.2f}" for a, b in (wall, used))
            rows.append(" ".join([f"{name:26s}", *seconds, json.dumps(record["errors"].get(name))]))
    return "\n".join(rows)


def main() -> None:
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", type=Path, required=True)
    parser.add_argument("--after", type=Path, required=True)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--members-script", type=Path, required=True, help="script that writes and aggregates synthetic members")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--last-start", type=float, default=np.inf, help="seconds after which no further pair starts")
    parser.add_argument("--device", default="", help="that makes the references, such as cuda:0; without it no errors are measured")
    parser.add_argument("--cases", nargs="*", default=[c.name for c in (*CASES, FIRST)])
    parser.add_argument("--commits", nargs=2, default=["an earlier version", "this version"])
    parser.add_argument("--machine", default="not stated", help="for the page")
    study = Study(parser.parse_args())
    study.folder.mkdir(parents=True, exist_ok=True)
    record = study.record()
    study.a.out.write_text(json.dumps(record, indent=1))
    print(summary(record))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--account"]:
        account(sys.argv[2], sys.argv[3:])
    else:
        main()
