"""Cost of a step: particle-steps per second and bytes per particle against size, threads, precision, depth and sparsity.

Every comparison is a ratio of cases that alternated in one run; docs/benchmarks explains the JSON.
"""

import hashlib
import logging
import os
import platform
import subprocess
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from runout import __version__, log
from runout.backends.protocol import INDEXES
from runout.errors import BudgetError, CapacityError, ConfigError
from runout.model.limits import PARTICLES_PER_CELL
from runout.studies.sloping_layer import PER_CELL, Layer
from runout.studies.timing import Case, TimedRun, take_turns

LOGGER = logging.getLogger("runout.work_precision")
SCHEMA = 2
FILE = "bench.json"
SIZES, FULL_SIZES = (10_000, 100_000, 400_000), (1_000_000, 3_000_000, 10_000_000)
SIZE = 100_000  # of the studies other than that of size
THIN, DEEP = (2, 3), 16  # cells through the depth
UPWARDS = (PARTICLES_PER_CELL[2], PER_CELL)  # particles of a cell above each other: the default, and as many as beside
SPARSITIES = (1.0, 3.0, 10.0, 100.0, 400.0)
NEEDED = 900  # bytes a particle while a scene is loaded, twice for cases that take turns
REAL_NUMBERS = 24  # of the state: position 3, velocity 3, affine 9, strain 6, history, mass, volume
NODE_SUMS = 27 * (4 + 3)  # least multiply-adds of quadratic splines: mass and momentum to the grid, velocity back

Study = dict[str, list[dict[str, Any]]]


@dataclass(frozen=True)
class Choices:
    """What to measure: sizes beyond 4e5 with ``full``, device, threads and precisions."""

    full: bool = False
    device: str = "cpu"
    threads: tuple[int, ...] = (1, 2)
    precision: tuple[str, ...] = ("float32", "float64")
    repetitions: int = 5
    sizes: tuple[int, ...] | None = None
    size: int = SIZE

    def __post_init__(self) -> None:
        if not self.threads or min(self.threads) < 1:
            raise ConfigError(f"--threads is {' '.join(map(str, self.threads))}; give numbers from 1")
        if not self.precision or set(self.precision) - {"float32", "float64"}:
            raise ConfigError(f"--precision is {' '.join(self.precision)}; choose float32, float64 or both")

    @property
    def usable_threads(self) -> tuple[int, ...]:
        """Numbers of threads for which this machine has cores; 1 for a GPU."""
        if self.device != "cpu":
            return (1,)
        cores = available_cores()
        return tuple(t for t in self.threads if t <= cores) or (cores,)


def run(choices: Choices, json_file: Path | None = None) -> dict[str, Any]:
    """Measure, write JSON if requested, and return the content of the JSON.

    Raises ConfigError or DeviceError for a choice that cannot be measured. Raises StorageError for a file that cannot be written.
    """
    from runout.io.atomic import write_json

    content = measured(choices)
    if json_file:
        LOGGER.info("wrote %s", write_json(content, json_file))
    return content


def report(content: dict[str, Any]) -> None:
    """Print stages, memory and ratios."""

    for part in (cost_table(content), table(content)):
        log.output().print(part, end="\n\n", markup=False)


def measured(choices: Choices) -> dict[str, Any]:
    """Measurements of all studies, the machine and the ratios that follow.

    Returns
    -------
    dict
        ``schema`` of this layout, time ``created`` (UTC). ``machine``: cores that may be used, vector bits, architecture.
        ``versions`` with the commit (``+`` and a hash when files differ from it). ``roofline``: bytes copied (read and written)
        and multiply-adds (float32) per second, for each number of threads. ``studies``: for each study its measurements
        (:meth:`runout.studies.timing.TimedRun.measured`). ``ratios`` of the table.
    """
    roofline = measured_roofline(choices)
    studies: Study = {}
    plan = planned(choices)
    with log.progress("bench") as bar:
        for number, (name, cases) in enumerate(plan):
            tick = _ticks(bar, number, len(plan), choices.repetitions)
            studies.setdefault(name, []).extend(take_turns(_timed_runs(cases), choices.repetitions, tick))
    return {
        "schema": SCHEMA,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": machine(),
        "versions": versions(),
        "roofline": roofline,
        "studies": studies,
        "ratios": ratios(studies, roofline),
    }


def planned(choices: Choices) -> list[tuple[str, list[Case]]]:
    """Each study with its alternating cases; large sizes run alone."""

    def case(particles: int = choices.size, threads: int = choices.usable_threads[0], **layer: Any) -> Case:
        return Case(Layer(particles, **{"precision": choices.precision[0], **layer}), threads, device=choices.device)

    sizes = choices.sizes or (*SIZES, *(s for s in FULL_SIZES if choices.full and _fits(s, len(choices.usable_threads))))
    small, large = [s for s in sizes if s <= max(SIZES)], [s for s in sizes if s > max(SIZES)]
    plan = [("size", [case(s, t) for s in group if s for t in choices.usable_threads]) for group in (small, *([s] for s in large))]
    plan.append(("precision", [case(precision=p) for p in choices.precision]))
    plan.append(("depth", [case(depth=d, upwards=u) for u in UPWARDS for d in (*THIN, DEEP)]))
    apart = [Layer(choices.size, sparsity=s, precision=choices.precision[0], aligned=True) for s in SPARSITIES]
    one = choices.usable_threads[0]
    plan.append(("sparsity", [Case(a, one, kind, choices.device, observed=False) for a in apart for kind in INDEXES]))
    return [(name, cases) for name, cases in plan if cases]


def _timed_runs(cases: Sequence[Case]) -> list[TimedRun]:
    """Courses of the cases that a backend does not refuse for their size, such as a dense index over a very large box."""
    timed_runs = []
    for case in cases:
        try:
            timed_runs.append(TimedRun(case))
        except (BudgetError, CapacityError, MemoryError) as error:
            LOGGER.warning("%s index at sparsity %g is left out: %s", case.index, case.layer.sparsity, error)
    return timed_runs


def _fits(particles: int, cases: int) -> bool:
    import psutil

    fits = bool(NEEDED * particles * cases < psutil.virtual_memory().available)
    if not fits:
        LOGGER.warning("%d particles are left out: too little memory is free", particles)
    return fits


def _ticks(bar: Callable[[float], None], number: int, total: int, repetitions: int) -> Callable[[], None]:
    done = iter(range(1, repetitions + 1))
    return lambda: bar((number + next(done) / repetitions) / total)


def measured_roofline(choices: Choices) -> list[dict[str, float]]:
    """Copy bandwidth [bytes/s] and multiply-adds [1/s] of the processor, for each number of threads; none for a GPU."""
    if choices.device != "cpu":
        return []
    from runout.backends.roofline import copy_bandwidth, multiply_add_rate

    best = choices.repetitions
    return [
        {"threads": t, "copy_bytes_per_second": copy_bandwidth(t, best), "multiply_adds_per_second": multiply_add_rate(t, best)}
        for t in choices.usable_threads
    ]


def ratios(studies: Study, roofline: Sequence[dict[str, float]]) -> dict[str, Any]:
    """Ratios of rates within a study; each pair took turns in one run."""
    content: dict[str, Any] = {}
    sizes, one = studies.get("size", []), min((m["case"]["threads"] for m in studies.get("size", [])), default=1)
    alone = {m["case"]["particles"]: m["rate"] for m in sizes if m["case"]["threads"] == one}
    content["threads"] = [
        {"particles": m["particles"], "threads": m["case"]["threads"], "ratio": m["rate"] / alone[m["case"]["particles"]]}
        for m in sizes
        if m["case"]["threads"] != one
    ]
    double = {m["case"]["precision"]: m["rate"] for m in studies.get("precision", [])}
    if len(double) == 2:
        content["float64_over_float32"] = double["float64"] / double["float32"]
    depth = {(m["case"]["depth"], m["case"]["upwards"]): m["rate"] for m in studies.get("depth", [])}
    content["thin_over_deep"] = [
        {"depth": d, "deep": DEEP, "upwards": u, "ratio": depth[d, u] / depth[DEEP, u]} for u in UPWARDS for d in THIN
    ]
    content["sparsity"] = _sparsity_ratios(studies.get("sparsity", []))
    content["roofline"] = [share for m in sizes for share in _bounds(m, roofline)]
    return content


def _sparsity_ratios(measurements: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rate of the steps over that of one body with the sparse index."""
    first = next((m["rate_of_steps"] for m in measurements if m["case"]["index"] == "sparse"), 1.0)
    return [
        {"sparsity": m["case"]["sparsity"], "index": m["case"]["index"], "ratio": m["rate_of_steps"] / first} for m in measurements
    ]


def _bounds(m: dict[str, Any], roofline: Sequence[dict[str, float]]) -> list[dict[str, float]]:
    """Shares of what bandwidth and arithmetic allow a code that reads and writes each state once and visits 27 nodes twice."""
    state = 2 * REAL_NUMBERS * (4 if m["case"]["precision"] == "float32" else 8)
    return [
        {
            "particles": m["particles"],
            "threads": m["case"]["threads"],
            "of_bandwidth": m["rate"] * state / r["copy_bytes_per_second"],
            "of_arithmetic": m["rate"] * NODE_SUMS / r["multiply_adds_per_second"],
        }
        for r in roofline
        if r["threads"] == m["case"]["threads"]
    ]


def available_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def machine() -> dict[str, Any]:
    """Cores, bits of a vector register and architecture: nothing that names the machine."""
    from llvmlite.binding import get_host_cpu_features

    features = get_host_cpu_features()
    bits = next((b for name, b in (("avx512f", 512), ("avx2", 256)) if features.get(name)), 128)
    return {"cores": available_cores(), "vector_bits": bits, "architecture": platform.machine()}


def versions() -> dict[str, str | None]:
    """Versions of what compiles and runs the kernels, and the commit where the code stands in a repository."""
    packages = {name: metadata.version(name) for name in ("numpy", "numba", "llvmlite", "warp-lang")}
    return {"runout": __version__, "commit": commit(), "python": platform.python_version(), **packages}


def commit() -> str | None:
    """Commit of the source, with a hash of what has been changed since; None outside a repository."""

    def git(*arguments: str) -> str:
        done = subprocess.run(["git", *arguments], cwd=Path(__file__).parent, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    try:
        head, changed = git("rev-parse", "--short=12", "HEAD"), git("diff", "HEAD", "--", ".", "../runout")
    except (OSError, subprocess.CalledProcessError):
        return None
    return f"{head}+{hashlib.sha256(changed.encode()).hexdigest()[:8]}" if changed else head


def markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown, without a line break at its end."""
    lines = [heads, ["---"] * len(heads), *([cell.replace("|", "/") for cell in row] for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def table(content: dict[str, Any]) -> str:
    """The ratios as a table in Markdown."""
    r, studies = content["ratios"], content["studies"]
    rows = [(f"{x['threads']} threads over {fewest(content)}", x["particles"], x["ratio"]) for x in r["threads"]]
    if "float64_over_float32" in r:
        rows.append(("float64 over float32", studies["precision"][0]["particles"], r["float64_over_float32"]))
    thin, layer = studies["depth"][0]["particles"], "layer of {depth} cells over one of {deep}, {upwards} particles upwards"
    rows += [(layer.format(**x), thin, x["ratio"]) for x in r["thin_over_deep"]]
    apart = studies["sparsity"][0]["particles"]
    rows += [(f"{x['index']}, sparsity {x['sparsity']:g}, over sparse 1", apart, x["ratio"]) for x in r["sparsity"][1:]]
    rows += [(f"runout over the prototype, threads: {x['threads']}", x["particles"], x["ratio"]) for x in r.get("against", ())]
    for bound in ("bandwidth", "arithmetic"):
        rows += [(f"of the {bound} bound, threads: {x['threads']}", x["particles"], x[f"of_{bound}"]) for x in r["roofline"]]
    return markdown(("rate of particle-steps", "particles", "ratio"), [(a, count(b), f"{c:.3g}") for a, b, c in rows])


def cost_table(content: dict[str, Any]) -> str:
    """Share of each stage in a step, and the memory, against the number of particles, in Markdown."""
    alone = [m for m in content["studies"]["size"] if m["case"]["threads"] == fewest(content)]
    stages = list(dict.fromkeys(name for m in alone for name in m["ns_per_particle_step"]))
    rows = []
    for m in alone:
        ns = m["ns_per_particle_step"]
        shares = [f"{100 * ns.get(name, 0.0) / sum(ns.values()):.0f} %" for name in stages]
        rows.append((count(m["particles"]), *shares, f"{m['memory']['bytes_per_particle']:.0f}"))
    return markdown(("particles", *stages, "bytes a particle"), rows)


def fewest(content: dict[str, Any]) -> int:
    """Smallest number of threads of the study of size."""
    return int(min(m["case"]["threads"] for m in content["studies"]["size"]))


def count(particles: int) -> str:
    """Number of particles as text: 10 k, 0.4 M."""
    return f"{particles / 1e6:.2g} M" if particles >= 200_000 else f"{particles / 1e3:.3g} k"
