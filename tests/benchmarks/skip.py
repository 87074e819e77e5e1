"""Time saved by each kind of skipped work, and its effect on the results: runs with each switch on and off, in turn."""

import os
import platform
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from runout import __version__, log
from runout.backends.protocol import ResumableBackend, get_backend
from runout.io.atomic import write_json
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.model.structures import CELLS, Patches, StructureField
from runout.quantities import member_map_names
from runout.simulation.checkpoint import Checkpoint
from runout.simulation.run import Run, RunControl
from runout.simulation.scenario import build_scene, scene_arguments
from runout.studies.convergence import relative_l1
from runout.studies.sloping_layer import Layer
from runout.studies.work_precision import commit
from tests.benchmarks.recorded_sites import with_vertical_edges

SITE = Path(__file__).parents[2] / "sites" / "jacksboro"
FILE = "skip.json"
MAPS = member_map_names()
REPEATS, CHECKPOINTED = 6, 400_000
FLOWING = (15.0, 60.0, False)  # basal friction angle [deg], end time [s], stop rule: a flow that stays fast
RESTING = (25.0, 180.0, True)  # a flow that comes to rest before the end
Made = tuple[Scene, Particles, RunControl]


@dataclass(frozen=True)
class Switch:
    """One kind of skipped work, in one scene of the study.

    ``off`` holds the settings of a run without it, ``on`` the additional settings of the scene with it, or functions that make them
    of the scene. ``exact`` states that no bit may change.
    """

    name: str
    off: Mapping[str, Any]
    exact: bool
    remark: str
    scene: str = "flowing"
    on: Mapping[str, Any] = field(default_factory=dict)


def wall_out_of_reach(scene: Scene) -> StructureField:
    """A wall beyond the south-western corner of the raster, where no mass comes."""
    edge, nodes, blocks = 0.5 * min(scene.spacing), (CELLS + 1,) * 3, (2, 2, 2)
    row = np.arange(8, dtype=np.int32).reshape(blocks)
    north = edge * (CELLS * np.indices(blocks)[1].reshape(-1, 1, 1, 1) + np.indices(nodes)[1])
    middle, normal = np.full((1, 3), float(CELLS)), np.array([[0.0, 1.0, 0.0]])
    patches = Patches(middle, normal, np.full(1, edge**2), np.zeros(1, np.int64), np.full(1, 0.1))
    corner = tuple(-100.0 * h for h in scene.spacing)
    distance = (north - CELLS * edge).astype(np.float32)
    return StructureField(edge, corner, row, distance, np.zeros(distance.shape, np.int32), 6.0 * edge, patches)  # type: ignore[arg-type]


SWITCHES = (
    Switch("crop", {"crop": False}, True, "observe only the cells under the flow / the whole raster"),
    Switch("cadence", {"crossing": 0.0}, False, "observe as the flow crosses half a grid cell / after every step"),
    Switch("stop rule", {"stop": False}, False, "stop at rest / go on to the end time", "resting"),
    Switch("structures", {}, True, "a wall out of reach / none", on={"structures": wall_out_of_reach}),
)


@dataclass(frozen=True)
class Outcome:
    """One run: its maps, processor time [s], share of its observers in its wall time [1], steps and observations."""

    maps: Mapping[str, np.ndarray]
    seconds: float
    observing: float
    steps: int
    observations: int


def follow(scene: Scene, particles: Particles, control: RunControl) -> Outcome:
    """Outcome of a run on the scan backend, without its setup."""
    run = Run(get_backend("scan"), scene, control, None, None)
    run.start(particles)
    started, wall = time.process_time(), time.perf_counter()
    run.go()
    seconds, wall = time.process_time() - started, time.perf_counter() - wall
    return Outcome(run.peaks.maps(), seconds, run.observing / wall, run.engine.counters.steps, run.peaks.observations)


def compared(scene: Scene, particles: Particles, control: RunControl, switch: Switch, repeats: int) -> dict[str, Any]:
    """One row: runs with and without a switch in turn; times are the shortest of each, as ratios."""
    chosen = {name: value(scene) if callable(value) else value for name, value in switch.on.items()}
    ways = (replace(scene, **chosen), control), (scene, replace(control, **switch.off))
    pairs = []
    for _ in range(repeats):
        pairs.append([follow(its_scene, particles, its_course) for its_scene, its_course in ways])
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
        "difference": {name: relative_l1(on.maps[name], off.maps[name]) for name in MAPS},
    }


def jacksboro(friction: float, end_time: float, stop: bool) -> Made:
    """The example site with a basal friction angle [deg] and an end time [s]."""
    with log.muted():
        arguments = with_vertical_edges(SITE).member_arguments()
    arguments["basal_friction_angle"] = friction
    scene, particles = build_scene(**scene_arguments(arguments))
    control = RunControl(end_time, stop, arguments["arrival_threshold"])
    return scene, particles, control


def measure(scenes: Mapping[str, Made], repeats: int = REPEATS) -> dict[str, Any]:
    """All rows with machine and versions; ``scenes`` by the names that the switches use."""
    scene, particles, control = scenes["flowing"]
    follow(scene, particles, replace(control, end_time=1e-3 * control.end_time))  # compile
    rows = [compared(*scenes[switch.scene], switch, repeats) for switch in SWITCHES]
    machine = {
        "processor": platform.processor() or platform.machine(),
        "cores": len(os.sched_getaffinity(0)),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
    raster = [scene.raster.rows, scene.raster.columns]
    scale = {"particles": len(particles), "raster": raster, "cell_size": list(scene.spacing)}
    return {"version": __version__, "commit": commit(), "machine": machine, "scene": scale, "repeats": repeats, "rows": rows}


def checkpoint_cost(particles: int = CHECKPOINTED) -> dict[str, Any]:
    """Cost of a checkpoint of the benchmark layer: bytes per particle, and time relative to a step on one thread."""
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


def study(out: Path, *, repeats: int = REPEATS, checkpointed: int = CHECKPOINTED) -> Path:
    """Path of the record ``skip.json``, after writing it to the folder ``out``.

    Parameters
    ----------
    out : Path
    repeats : int
        Runs with and without each switch.
    checkpointed : int
        Particles of the layer whose checkpoint is measured.
    """
    scenes = {"flowing": jacksboro(*FLOWING), "resting": jacksboro(*RESTING)}
    content = measure(scenes, repeats) | {"checkpoint": checkpoint_cost(checkpointed)}
    return write_json(content, out / FILE)


if __name__ == "__main__":
    import sys

    print(study(Path(sys.argv[1])))
