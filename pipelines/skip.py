"""What a run saves by skipping what its scene does not need, and what that changes: each switch on and off, in turn."""

import math
import os
import platform
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.recorded_sites import with_vertical_edges
from pipelines.sloping_layer import Layer
from runout import DruckerPrager, Release, Terrain, __version__, log
from runout.backends.protocol import ResumableBackend, get_backend
from runout.checkpoint import EVERY, Checkpoint
from runout.io.atomic import write_json, write_text
from runout.model.particles import Particles
from runout.model.release import Placement
from runout.model.scene import Scene
from runout.simulation import Course, Run, build_scene

SITE = Path(__file__).parents[1] / "sites" / "jacksboro"
MAPS = ("max_flow_thickness", "max_speed", "max_pressure", "arrival_time", "deposit_thickness")
REPEATS, CHECKPOINTED = 2, 400_000
FLOWING = (15.0, 60.0, False)  # basal friction angle [deg], end time [s], stop rule: a flow that is fast all the time
RESTING = (25.0, 180.0, True)  # and one that comes to rest before the end
Made = tuple[Scene, Particles, Course]


@dataclass(frozen=True)
class Switch:
    """Something that is skipped, in one of the scenes of the study.

    ``off`` is the course of a run that does not skip it, ``on`` what the scene of one that does is given; ``exact`` says that
    no bit may change.
    """

    name: str
    off: Mapping[str, Any]
    exact: bool
    remark: str
    scene: str = "flowing"
    on: Mapping[str, Any] = field(default_factory=dict)


SWITCHES = (
    Switch("crop", {"crop": False}, True, "observe only the cells under the flow / the whole raster"),
    Switch("cadence", {"crossing": 0.0}, False, "observe as the flow crosses half a cell / after every step"),
    Switch("stop rule", {"stop": False}, False, "stop at rest / go on to the end time", "resting"),
    *(
        Switch(f"sleep {speed:g}, {scene}", {}, False, f"rest below {speed:g} m/s / move all", scene, {"sleep_speed": speed})
        for scene, speed in (("bed", 0.05), ("bed", 0.2), ("creeping", 0.05), ("creeping", 0.2))
    ),
)


@dataclass(frozen=True)
class Outcome:
    """One run: its maps, processor time [s], share of its observers in its wall time [1], steps and observations."""

    maps: Mapping[str, np.ndarray]
    seconds: float
    observing: float
    steps: int
    observations: int


def follow(scene: Scene, particles: Particles, course: Course, threads: int | None = None) -> Outcome:
    """Outcome of a run on the scan backend, without its setup."""
    run = Run(get_backend("scan", threads=threads), scene, course, None, None)
    run.start(particles)
    started, wall = time.process_time(), time.perf_counter()
    run.go()
    seconds, wall = time.process_time() - started, time.perf_counter() - wall
    return Outcome(run.peaks.maps(), seconds, run.observing / wall, run.engine.counters.steps, len(run.ledger.time))


def compared(
    scene: Scene, particles: Particles, course: Course, switch: Switch, repeats: int, threads: int | None
) -> dict[str, Any]:
    """One row: runs with and without a switch in turn; times are the shortest of each, as ratios."""
    ways = (replace(scene, **switch.on), course), (scene, replace(course, **switch.off))
    pairs = []
    for _ in range(repeats):
        pairs.append([follow(its_scene, particles, its_course, threads) for its_scene, its_course in ways])
    on, off = pairs[0]
    best = [min(pair[k].seconds for pair in pairs) for k in (0, 1)]
    watching = [min(pair[k].observing for pair in pairs) for k in (0, 1)]
    return {
        "skip": switch.name,
        "remark": switch.remark,
        "time_on_over_off": best[0] / best[1],
        "observers_share_on": watching[0],
        "observers_share_off": watching[1],
        "steps": [on.steps, off.steps],
        "observations": [on.observations, off.observations],
        "exact": switch.exact,
        "same_bits": all(on.maps[name].tobytes() == off.maps[name].tobytes() for name in MAPS),
        "difference": {name: difference(on.maps[name], off.maps[name]) for name in MAPS},
    }


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Relative L1 difference of two maps [1]; cells that only one of them has count as zero in the other."""
    a, b = np.nan_to_num(one), np.nan_to_num(other)
    return float(np.abs(a - b).sum() / max(np.abs(b).sum(), np.finfo(float).tiny))


def jacksboro(friction: float, end_time: float, stop: bool) -> Made:
    """The example site with a basal friction angle [deg] and an end time [s]."""
    with log.muted():
        arguments = with_vertical_edges(SITE).member_arguments()
    arguments["basal_friction_angle"] = friction
    scene, particles = build_scene(
        **{name: value for name, value in arguments.items() if name in signature(build_scene).parameters}
    )
    course = Course(end_time, stop, arguments["arrival_threshold"])
    return scene, particles, course


def fall_on_a_bed(cell_size: float = 2.0, end_time: float = 30.0) -> Made:
    """A slab that slides down a slope of 30 deg onto the western end of a bed, 2 m thick, that rests on a plain."""
    cell, columns, rows = 5.0, 80, 24
    x = cell * (np.arange(columns) + 0.5)
    terrain = Terrain(np.tile(math.tan(math.radians(30.0)) * np.maximum(120.0 - x, 0.0), (rows, 1)), (cell, cell))
    slab, bed = np.zeros(terrain.shape), np.zeros(terrain.shape)
    slab[8:16, 6:14], bed[4:20, 26:70] = 6.0, 2.0
    releases = [Release(thickness, terrain, placement=Placement.ON_SURFACE) for thickness in (slab, bed)]
    soil = DruckerPrager(density=2000.0, youngs_modulus=5e6, friction_angle=30.0, cohesion=5e3)
    return *build_scene(terrain, releases, soil, 22.0, cell_size), Course(end_time, False)


def measure(scenes: Mapping[str, Made], repeats: int = REPEATS, threads: int | None = None) -> dict[str, Any]:
    """All rows, with what they were measured on; the scenes by the names that the switches call them."""
    scene, particles, course = scenes["flowing"]
    follow(scene, particles, replace(course, end_time=1e-3 * course.end_time), threads)  # compile
    rows = [compared(*scenes[switch.scene], switch, repeats, threads) for switch in SWITCHES]
    machine = {
        "processor": platform.processor() or platform.machine(),
        "cores": len(os.sched_getaffinity(0)),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
    raster = [scene.raster.rows, scene.raster.columns]
    scale = {"particles": len(particles), "raster": raster, "cell_size": list(scene.spacing), "bed": len(scenes["bed"][1])}
    return {"version": __version__, "machine": machine, "scene": scale, "repeats": repeats, "rows": rows}


def checkpoint_cost(particles: int = CHECKPOINTED) -> dict[str, Any]:
    """What a checkpoint of the benchmark's layer takes: bytes a particle, and its time over that of a step, here on one thread."""
    scene, p = Layer(particles).build()
    engine = get_backend("scan", threads=1)
    engine.load(scene, p)
    steps = []
    for _ in range(8):
        started = time.perf_counter()
        engine.step(engine.stable_step())
        steps.append(time.perf_counter() - started)
    assert isinstance(engine, ResumableBackend)
    with tempfile.TemporaryDirectory() as folder:
        keep = Checkpoint(Path(folder) / "run.npz", "cost")
        seconds: list[float] = []
        for _ in range(3):
            keep.write(engine.checkpoint())
            seconds.append(keep.seconds - sum(seconds))
        size = keep.path.stat().st_size
    return {"particles": len(p), "bytes_per_particle": size / len(p), "seconds": min(seconds), "steps": min(seconds) / min(steps)}


def page(found: Mapping[str, Any]) -> str:
    """The results as a page of the documentation."""
    scene = found["scene"]
    lines = [
        "# What is skipped",
        "",
        f"Site jacksboro on the scan backend: {scene['particles']:,} particles, cells of {scene['cell_size'][0]:g} m, a raster of "
        f"{scene['raster'][0]} x {scene['raster'][1]} cells; {FLOWING[1]:g} s with a basal friction angle of {FLOWING[0]:g} deg, "
        f"for the stop rule {RESTING[1]:g} s with {RESTING[0]:g} deg, the same to the end time for sleep (creeping). Bed: "
        f"{scene['bed']:,} particles, a slab that slides onto a bed at rest, 30 s. Runs with and without each switch took turns; "
        f"times are processor time, the shortest of {found['repeats']}, without setup, as ratios within the study. "
        f"runout {found['version']}, Python {found['machine']['python']}, numpy {found['machine']['numpy']}; "
        f"{found['machine']['cores']} cores ({found['machine']['processor']}), not idle otherwise.",
        "",
        "    python -m pipelines.skip docs/benchmarks",
        "",
        "| skip | on / off | time on : off | observers' share on, off | steps on, off | observations on, off | same bits | "
        + " | ".join(name.replace("_", " ") for name in MAPS)
        + " |",
        "|" + "---|" * (7 + len(MAPS)),
    ]
    for row in found["rows"]:
        numbers = " | ".join(f"{100 * row['difference'][name]:.2g} %" if row["difference"][name] else "0" for name in MAPS)
        lines.append(
            f"| {row['skip']} | {row['remark']} | {row['time_on_over_off']:.2f} | {100 * row['observers_share_on']:.0f} %, "
            f"{100 * row['observers_share_off']:.0f} % | {row['steps'][0]}, {row['steps'][1]} | {row['observations'][0]}, "
            f"{row['observations'][1]} | {'yes' if row['same_bits'] else 'no'}{' (must)' if row['exact'] else ''} | {numbers} |"
        )
    cost = found["checkpoint"]
    lines += [
        "",
        "The last columns are relative L1 differences of the maps, on against off. Observers' shares are of wall time.",
        "",
        "## Checkpoints",
        "",
        f"A checkpoint of {cost['particles']:,} particles in float32 takes {cost['bytes_per_particle']:.0f} bytes a particle and "
        f"as long as {cost['steps']:.1f} steps on one thread ({cost['seconds']:.2g} s here); by default one is written every "
        f"{EVERY:g} s of wall time.",
    ]
    return "\n".join(lines) + "\n"


def study(out: Path, *, repeats: int = REPEATS, threads: int | None = None, checkpointed: int = CHECKPOINTED) -> str:
    """The page ``skip.md`` and its numbers ``skip.json`` in the folder ``out``; returns the page.

    Parameters
    ----------
    out : Path
    repeats : int
        Runs with and without each switch.
    threads : int, optional
    checkpointed : int
        Particles of the layer whose checkpoint is measured.
    """
    resting = jacksboro(*RESTING)
    creeping = (*resting[:2], replace(resting[2], stop=False))
    scenes = {"flowing": jacksboro(*FLOWING), "resting": resting, "creeping": creeping, "bed": fall_on_a_bed()}
    found = measure(scenes, repeats, threads) | {"checkpoint": checkpoint_cost(checkpointed)}
    write_json(found, out / "skip.json")
    text = page(found)
    write_text(text, out / "skip.md")
    return text


if __name__ == "__main__":
    import sys

    print(study(Path(sys.argv[1])))
