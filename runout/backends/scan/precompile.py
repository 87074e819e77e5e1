"""Compiles the kernels of a scene in separate processes, so that every run executes the code of the cache.

Numba optimises the body of a parallel loop twice: alone, and as a part of its kernel. The process that compiles executes the first,
the cache holds the second; they round differently where products and sums are fused. A process that compiles would therefore not
repeat the bits of a process that loads from the cache (docs/decisions/01-packaging-and-compilation.md).
"""

import base64
import logging
import os
import pickle
import subprocess
import tempfile
from collections.abc import Sequence
from itertools import cycle, islice
from pathlib import Path
from subprocess import PIPE
from types import ModuleType

from runout.backends.compile import cache_root, source_key
from runout.model.basal_friction import BasalFriction
from runout.model.materials import Material
from runout.model.scene import Scene
from runout.processes.lifetime import import_path, interrupts_kept, python_command

LOGGER = logging.getLogger(__name__)
IN_THIS_PROCESS = "kernels are compiled where they run; the last bits of the results may differ from those of later runs"
WARM_UP = "RUNOUT_REHEARSAL"  # the variable that tells the process which compiles from the others
SOURCE = Path(__file__).with_name("warm_up.py")  # of what that process runs; it imports the backend, which imports this module


def ensure_compiled(scene: Scene, sources: tuple[ModuleType, ...]) -> Path | None:
    """Compile what a scene needs, unless the cache holds it; one process at a time.

    Returns the file in the cache that marks these kernels as compiled. ``sources`` are the modules of kernels and laws, whose
    change makes what is cached stale. Where no process can be started, the kernels are compiled on their first call.
    """
    if WARM_UP in os.environ:
        return None
    import locket

    laws = f"{scene.law.name} {scene.law.fingerprint} {scene.basal.law.name} {scene.basal.law.fingerprint}"
    label = f"{laws} {scene.precision} {len(scene.materials) == 1} {variant(scene)}"
    done = cache_root() / f"{source_key(sources, label, SOURCE.read_text(encoding='utf-8'))}.done"
    if done.exists():
        return done
    with locket.lock_file(str(done.with_suffix(".lock"))):
        if done.exists():
            return done
        LOGGER.info("compiling for %s in %s; this takes a minute, once", scene.law.name, scene.precision)
        if _warm_up_elsewhere(scene, variant(scene)):
            done.touch()
            return done
    return None


def variant(scene: Scene) -> str:
    """What a scene has that some kernels are for: no ground, zones, structures, substeps, pore pressure; "plain" without any."""
    more = {"free": scene.surface is None, "zones": scene.friction_zones, "structures": scene.structures}
    more |= {"substeps": scene.substeps > 1, "wet": scene.is_wet}
    return " ".join(("plain", *(name for name, has in more.items() if has)))


def _warm_up_elsewhere(scene: Scene, kind: str) -> bool:
    """Whether another process has compiled all kernels."""
    try:
        with tempfile.TemporaryDirectory(prefix="runout-") as folder:
            return _warm_up_with(scene, kind, folder)
    except OSError as error:
        LOGGER.warning("no process to compile in (%s); %s", error, IN_THIS_PROCESS)
        return False


def _warm_up_with(scene: Scene, kind: str, folder: str) -> bool:
    """The same; the processes share their work in a folder."""
    environment = {**environment_of_compilation(), WARM_UP: job_of(scene, kind, folder)}
    kernels = ("warm_up", "warm_up_ahead")[: len(os.sched_getaffinity(0))]
    commands = [python_command(f"from {__package__}.warm_up import {name}; {name}()") for name in kernels]
    with interrupts_kept():
        process, *others = [subprocess.Popen(c, env=environment, stdout=PIPE, stderr=PIPE, text=True) for c in commands]
    said, failures = _ended(process, others)
    for failure in failures:
        LOGGER.warning("one of %d processes that compile failed, another one does its work: %s", len(commands), _reason(failure))
    if process.returncode:
        LOGGER.warning("compiling in a process of its own failed: %s; %s", _reason(said), IN_THIS_PROCESS)
    return process.returncode == 0


def environment_of_compilation() -> dict[str, str]:
    """Variables of a process that compiles into the cache of this one."""
    return {**os.environ, "PYTHONPATH": import_path(), "RUNOUT_CACHE": str(cache_root().parent)}


def job_of(scene: Scene, kind: str, folder: str) -> str:
    """What a process that compiles reads: masses, precision and kind of a small scene, the folder, and its parent."""
    return base64.b64encode(pickle.dumps((*_masses(scene), scene.precision, kind, folder, os.getpid()))).decode()


def _masses(scene: Scene) -> tuple[tuple[Material, ...], tuple[BasalFriction, ...]]:
    """Materials and frictions of the masses of a small scene that calls all kernels: one of each law, two if there are several."""
    by_law = {m.law: m for m in reversed(scene.materials)}
    several = len(scene.law.laws) > 1 or len(scene.basal.law.laws) > 1
    materials = tuple(by_law[law.name] for law in scene.law.laws) if several else scene.materials[:2]
    frictions = tuple(law.example for law in scene.basal.law.laws)
    count = max(len(materials), len(frictions), 1 + several)
    return tuple(islice(cycle(materials), count)), tuple(islice(cycle(frictions), count))


def _reason(said: str) -> str:
    """Last line of what a process wrote to its error output."""
    return (said.strip().splitlines() or ["no reason is stated"])[-1]


def _ended(process: "subprocess.Popen[str]", others: "Sequence[subprocess.Popen[str]]" = ()) -> tuple[str, list[str]]:
    """The error output of a process, after it has ended, and of those of the ``others`` that failed before.

    The others then end, and all of them if this process is interrupted.
    """
    failures = []
    with process:
        try:
            said = process.communicate()[1]
        except BaseException:
            process.kill()
            raise
        finally:
            for other in others:
                failed = other.poll()
                other.kill()
                wrote = other.communicate()[1]
                failures += [wrote] if failed else []
    return said, failures
