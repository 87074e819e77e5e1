"""Compiles the kernels of a scene in separate processes, so that every run executes the code of the cache.

Numba optimises the body of a parallel loop twice: alone, and as a part of its kernel. The process that compiles executes the first,
the cache holds the second; they round differently where products and sums are fused. A process that compiles would therefore not
repeat the bits of a process that loads from the cache (docs/decisions/01-packaging-and-compilation.md).
"""

import base64
import inspect
import logging
import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from subprocess import PIPE
from types import ModuleType
from typing import Any

import numpy as np

from runout.backends.compile import cache_root, source_key
from runout.backends.scan.gradient_transfer import uses_gradient_transfer
from runout.lifetime import end_with_parent, interrupts_kept
from runout.model.basal_friction import BasalFriction
from runout.model.friction import FrictionZones
from runout.model.materials import Material
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface

LOGGER = logging.getLogger(__name__)
WARM_UP = "RUNOUT_REHEARSAL"  # the variable that tells the process which compiles from the others
CELLS = 16  # of the small raster on which kernels are tried
STEPS = 60
SPEED = 0.1  # cells a step: the particles leave the raster, blocks move, slots are handed over
VARIANTS: dict[str, tuple[dict[str, Any], ...]] = {  # scenes that call kernels which the others do not
    "plain": ({},),
    "gradient_transfer": ({"f_bar": True}, {"f_bar": True, "transfer": "aflip"}),
    "sleeping": ({}, {"sleep_speed": 1e3, "gravity": (0.0, 0.0, 0.0)}),
}


def ensure_compiled(scene: Scene, sources: tuple[ModuleType, ...]) -> None:
    """Compile what a scene needs, unless the cache holds it; one process at a time.

    ``sources`` are the modules of kernels and laws, whose change makes what is cached stale. Where no process can be started, the
    kernels are compiled on their first call.
    """
    if WARM_UP in os.environ:
        return
    import locket

    laws = f"{scene.law.name} {scene.law.fingerprint} {scene.basal.law.name} {scene.basal.law.fingerprint}"
    label = f"{laws} {scene.precision} {len(scene.materials) == 1} {variant(scene)}"
    done = cache_root() / f"{source_key(sources, label, *map(_stamp, sources))}.done"
    if done.exists():
        return
    with locket.lock_file(str(done.with_suffix(".lock"))):
        if done.exists():
            return
        LOGGER.info("compiling for %s in %s; this takes a minute, once", scene.law.name, scene.precision)
        if _warm_up_elsewhere(scene, variant(scene)):
            done.touch()


def variant(scene: Scene) -> str:
    """Which of the ``VARIANTS`` a scene is, and what else it has that some kernels are for: no ground, or friction zones."""
    kind = "gradient_transfer" if uses_gradient_transfer(scene) else "sleeping" if scene.sleep_speed else "plain"
    return " ".join((kind, *["free"] * (scene.surface is None), *["zones"] * (scene.friction_zones is not None)))


def _stamp(source: ModuleType) -> str:
    """What numba compares before it loads a kernel from its cache: path, time and size of the source."""
    path = inspect.getfile(source)
    status = os.stat(path)
    return f"{path} {status.st_mtime_ns} {status.st_size}"


def _warm_up_elsewhere(scene: Scene, kind: str) -> bool:
    """Whether another process has compiled all kernels."""
    friction = scene.basal.law.example
    job = base64.b64encode(pickle.dumps((scene.materials[:2], friction, scene.precision, kind, os.getpid()))).decode()
    places = os.pathsep.join(p or os.getcwd() for p in sys.path)
    environment = {**os.environ, WARM_UP: job, "PYTHONPATH": places, "RUNOUT_CACHE": str(cache_root().parent)}
    kernels = ("warm_up", "warm_up_ahead")[: len(os.sched_getaffinity(0))]
    commands = [[sys.executable, "-P", "-c", f"from {__name__} import {name}; {name}()"] for name in kernels]
    try:
        with interrupts_kept():
            process, *others = [subprocess.Popen(c, env=environment, stdout=PIPE, stderr=PIPE, text=True) for c in commands]
        said = _ended(process, others)
    except OSError as error:
        LOGGER.debug("no process to compile in: %s", error)
        return False
    if process.returncode:
        LOGGER.debug("compiling in a process of its own failed: %s", said)
    return process.returncode == 0


def _ended(process: "subprocess.Popen[str]", others: "Sequence[subprocess.Popen[str]]" = ()) -> str:
    """The error output of a process, after it has ended; ``others`` then end, and all of them if this process is interrupted."""
    with process:
        try:
            return process.communicate()[1]
        except BaseException:
            process.kill()
            raise
        finally:
            for other in others:
                other.kill()
                other.communicate()


def _job() -> tuple[Scene, Particles, str]:
    """The small scene, its particles and the kind of scene of a process that compiles; the process ends with its parent."""
    materials, friction, precision, kind, parent = pickle.loads(base64.b64decode(os.environ[WARM_UP]))
    end_with_parent(parent)
    scene, particles = _small_slope(materials, friction, precision)
    return (scene if "zones" in kind else replace(scene, friction_zones=None)), particles, kind


def warm_up() -> None:
    """Call every kernel on small scenes, so that it is compiled and cached; runs in a process of its own."""
    scene, particles, kind = _job()
    for choices in VARIANTS[kind.split()[0]]:
        if "sleep_speed" in choices:
            particles.velocity[:] = 0.0
        _warm_up(replace(scene, **choices), particles, free="free" in kind)


def warm_up_ahead() -> None:
    """Compile the kernels of the second half of a step in another process meanwhile: they are called without particles.

    The first process finds them in the cache.
    """
    from runout.backends.scan.backend import ScanBackend

    scene, _, kind = _job()
    engine = ScanBackend(threads=1)
    engine.load(replace(scene, **VARIANTS[kind.split()[0]][0]), Particles.zeros(0))
    engine.pass_second_half(scene.stable_step(SPEED))


def _warm_up(scene: Scene, particles: Particles, free: bool) -> None:
    from runout.backends.scan.backend import ScanBackend

    engine = ScanBackend(threads=1)
    engine.load(scene, particles)
    for k in range(STEPS):
        engine.step(engine.stable_step() * (1.0 if k % 8 else 0.9))
        if k % 8 == 0:
            engine.ledger(), engine.columns(), engine.flow_columns()
    engine.particles()
    ScanBackend(threads=1).restore(scene, engine.checkpoint())
    dense = ScanBackend(threads=1, index="dense")
    dense.load(replace(scene, surface=None) if free else scene, particles)
    if free:
        dense.step(dense.stable_step())


def _small_slope(materials: tuple[Material, ...], friction: BasalFriction, precision: str) -> tuple[Scene, Particles]:
    """A cube of particles that slides over the edge of a plane."""
    surface = Surface.through(np.fromfunction(lambda i, j: -0.2 * i, (CELLS + 1, CELLS + 1)), (1.0, 1.0))
    zones = FrictionZones(np.ones((CELLS, CELLS)), np.zeros((CELLS, CELLS)), (1.0, 1.0))
    scene = Scene(
        (1.0, 1.0, 1.0), surface, Raster(CELLS, CELLS, (1.0, 1.0)), materials, (friction,) * len(materials), precision=precision,
        friction_zones=zones,
    )  # fmt: skip
    axis = (np.arange(12) + 0.5) / 2
    place = np.stack(np.meshgrid(axis + CELLS - 8, axis + 4, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    place[:, 2] -= 0.2 * place[:, 0]
    particles = Particles.at(place, np.ones(3))
    particles.volume[:], particles.radius[:] = 0.125, 0.25
    particles.release[:] = np.arange(len(particles)) % len(materials)
    particles.mass[:] = 0.125 * materials[0].density
    particles.velocity[:, 0] = SPEED / scene.stable_step(0.0)
    return scene, particles
