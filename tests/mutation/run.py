"""Changes the code at random places and counts how many of the changes the tests of the package find.

    python tests/mutation/run.py --count 60 --seed 1 [--package runout/physics ...] [--workers 2] [--json mutants.json]

A change that fails a test is killed. So is one with which the tests do not end in time, if without it they then take less than half
of that time. Test files that call the changed function run first, then all of the package. Each change runs in a copy of the tree.
"""

import argparse
import difflib
import json
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from calls import ENVIRONMENT, callers
from mutants import Mutant, sample

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("runout", "pipelines", "tests", "sites", "docs", "pyproject.toml", "README.md")

# Tests of each package. Those of physics compile nothing: they call its plain functions.
TESTS = {
    "runout/physics": ["tests/physics"],
    "runout/hazard": ["tests/hazard", "tests/io/test_outlines.py"],
    "runout/release": ["tests/release", "tests/terrain/test_open_edge.py"],
    "runout/terrain": [
        "tests/terrain",
        "tests/release/test_zone_polygons.py",
        "tests/release/test_other_systems.py",
        "tests/laws/test_friction_rasters.py",
        "tests/structures_input/test_mesh_terrain.py",
    ],
    "runout/scores": ["tests/scores"],
    "runout/friction": ["tests/laws/test_friction_formulas.py", "tests/laws/test_friction_of_a_site.py"],
    "runout/structures": [
        "tests/structures_input",
        "tests/structures/test_pressed_facades.py",
        "tests/structures/test_patch_areas.py",
    ],
    "runout/config": ["tests/config"],
    "runout/io": ["tests/io", "tests/security", "tests/release", "tests/terrain"],
}
COMPILING = ["tests/physics/test_parity.py", "tests/physics/test_compile_cache.py", "tests/physics/test_single_precision_series.py"]
LEFT_OUT = [  # tests that compile kernels in every copy of the tree, or take long beside what they find
    "test_float32_keeps_small_strain",
    "test_a_tapered_mass_leaves_its_scar",
    "test_a_flow_over_an_open_edge",
    "test_an_open_edge_acts_as_the_rim",
    "test_products_pass_the_strict_checker",
]


def package_of(path: str) -> str:
    """The package in TESTS that holds a file."""
    return next(package for package in TESTS if path.startswith(package + "/"))


def tests_of(path: str) -> list[str]:
    """Test files of a source file, those of its own name first."""
    folders = [ROOT / name for name in TESTS[package_of(path)]]
    files = [f for folder in folders for f in ([folder] if folder.is_file() else sorted(folder.glob("test_*.py")))]
    names = [f.relative_to(ROOT).as_posix() for f in files]
    return sorted((n for n in names if n not in COMPILING), key=lambda n: Path(path).stem not in n)


def copy_of_tree(folder: Path) -> Path:
    """A copy of what the tests need."""
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__", "results", "_build"))
        elif (ROOT / name).exists():
            shutil.copy(ROOT / name, folder / name)
    return folder


def run_tests(tree: Path, tests: list[str], limit: float | None, record: Path | None = None) -> tuple[str, str]:
    """The outcome: "passed", "failed" or "timeout", and the first failing test. ``record``: file for the calls of test files."""
    paths = os.pathsep.join([str(tree), str(Path(__file__).parent)])
    environment = os.environ | {"PYTHONPATH": paths, "RUNOUT_CACHE": str(tree / "cache")}
    environment |= {"HYPOTHESIS_STORAGE_DIRECTORY": str(tree / "hypothesis")}
    environment |= {ENVIRONMENT: str(record)} if record else {"PYTHONDONTWRITEBYTECODE": "1"}
    options = ["-x", "-q", "--tb=no", "-p", "calls", "-k", f"not ({' or '.join(LEFT_OUT)})"]
    command = [sys.executable, "-m", "pytest", *options, *tests]
    process = subprocess.Popen(
        command, cwd=tree, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )
    try:
        output, _ = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return "timeout", ""
    failure = next((line for line in output.splitlines() if line.startswith(("FAILED", "ERROR"))), output[-2000:])
    return ("passed", "") if process.returncode == 0 else ("failed", failure)


@dataclass(frozen=True)
class Baseline:
    """Time [s] of the tests of a package without a change, and the functions that each test file calls."""

    seconds: float
    called: dict[str, list[str]]


def baseline(tree: Path, tests: list[str]) -> Baseline:
    """The tests without a change."""
    start, record = time.monotonic(), tree / "calls.json"
    outcome, failure = run_tests(tree, tests, None, record)
    if outcome != "passed":
        sys.exit(f"the tests fail without a change: {failure}")
    return Baseline(time.monotonic() - start, json.loads(record.read_text()))


def try_mutant(tree: Path, mutant: Mutant, unchanged: Baseline, margin: float) -> dict[str, object]:
    """What the tests say of one mutant."""
    file = tree / mutant.path
    source = file.read_bytes()
    changed = mutant.apply(source)
    shutil.rmtree(file.parent / "__pycache__", ignore_errors=True)  # bytecode of the original would hide the change
    start, tests, limit = time.monotonic(), tests_of(mutant.path), 3.0 * unchanged.seconds + margin
    near = callers(unchanged.called, mutant.path, source, mutant.line)
    stages = [part for part in ([n for n in tests if n in near], [n for n in tests if n not in near]) if part]
    while stages:
        try:
            file.write_bytes(changed)
            outcome, failure = run_tests(tree, stages[0], limit)
        finally:
            file.write_bytes(source)
        seconds = baseline(tree, stages[0]).seconds if outcome == "timeout" else 0.0
        if 2.0 * seconds > limit:  # the machine has become slower: this says nothing of the change
            limit = 4.0 * seconds
        else:
            stages = stages[1:] if outcome == "passed" else []
    lines = [text.decode().splitlines() for text in (source, changed)]
    diff = [line for line in difflib.unified_diff(*lines, lineterm="", n=0) if line[:3] not in ("---", "+++") and line[:2] != "@@"]
    state = {"passed": "survived", "failed": "killed", "timeout": "killed (timeout)"}[outcome]
    record = {"file": mutant.path, "line": mutant.line, "operator": mutant.operator, "diff": diff, "state": state}
    return record | {"by": failure, "seconds": round(time.monotonic() - start, 1)}


def parsed(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60, help="number of mutants (60)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample (0)")
    parser.add_argument("--package", nargs="+", default=list(TESTS), help="folders or files to change (all of these packages)")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="mutants at a time (all cores)")
    parser.add_argument("--limit", type=float, default=60.0, help="seconds added to three times the time without a change (60)")
    parser.add_argument("--json", type=Path, help="file of the results")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> float:
    """Share of the sample that is killed."""
    options = parsed(arguments)
    places = [ROOT / name for name in options.package]
    files = [f.relative_to(ROOT).as_posix() for p in places for f in ([p] if p.is_file() else sorted(p.rglob("*.py")))]
    chosen = sample(ROOT, files, options.count, options.seed)
    with tempfile.TemporaryDirectory(prefix="runout-mutation-") as folder, ThreadPoolExecutor(options.workers) as pool:
        trees: queue.Queue[Path] = queue.Queue()
        for number in range(options.workers):
            trees.put(copy_of_tree(Path(folder) / str(number)))
        try:
            results = run_all(chosen, trees, pool, options.limit)
        except BaseException:  # an interrupt as well: what runs is finished, the rest is left
            pool.shutdown(cancel_futures=True)
            raise
    killed = sum(result["state"] != "survived" for result in results)
    print(f"seed {options.seed}: {killed} of {len(results)} mutants killed ({100.0 * killed / len(results):.0f} %)")
    if options.json:
        options.json.write_text(json.dumps({"seed": options.seed, "killed": killed, "mutants": results}, indent=1))
    return killed / len(results)


def run_all(chosen: list[Mutant], trees: "queue.Queue[Path]", pool: ThreadPoolExecutor, margin: float) -> list[dict[str, object]]:
    """Results of all mutants, printed as they come."""
    packages = sorted({package_of(mutant.path) for mutant in chosen})
    first = {package: next(m.path for m in chosen if package_of(m.path) == package) for package in packages}

    def in_a_tree(function, *values):
        tree = trees.get()
        try:
            return function(tree, *values)
        finally:
            trees.put(tree)

    found = dict(zip(packages, pool.map(lambda p: in_a_tree(baseline, tests_of(first[p])), packages), strict=True))
    print("without a change: " + ", ".join(f"{package} {base.seconds:.0f} s" for package, base in found.items()), flush=True)

    def one(mutant: Mutant) -> dict[str, object]:
        result = in_a_tree(try_mutant, mutant, found[package_of(mutant.path)], margin)
        print(f"{result['state']}: {mutant.path}:{mutant.line} ({mutant.operator})", flush=True)
        if result["state"] == "survived":
            print("\n".join(f"    {line}" for line in result["diff"]), flush=True)
        return result

    return list(pool.map(one, chosen))


if __name__ == "__main__":
    main()
