"""Calls every kernel on small scenes, so that it is compiled and cached; runs in processes of its own, see ``precompile``."""

import base64
import gc
import os
import pickle
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from runout.backends.footprints import lattice_columns
from runout.backends.initial_stress import InitialStress, pressed_by
from runout.backends.resting_particles import ReleaseParticles, settled_in
from runout.backends.scan.backend import OF_SUBSTEPS, PARTS, ScanBackend
from runout.backends.scan.deferred_code import make_code_when_called
from runout.backends.scan.precompile import WARM_UP
from runout.backends.scan.shared_parts import complete, share
from runout.model.basal_friction import BasalFriction
from runout.model.friction import FrictionZones
from runout.model.materials import Material
from runout.model.particles import Particles
from runout.model.pore_pressure import PorePressure
from runout.model.release import Release
from runout.model.scene import Raster, Scene
from runout.model.structures import Patches, StructureField
from runout.model.surface import Surface
from runout.model.terrain import Terrain
from runout.processes.imports import collect_rarely
from runout.processes.lifetime import end_with_parent
from runout.release.sample import Sampling

CELLS = 16  # of the small raster on which kernels are tried
STEPS = 60
SUBSTEPS = 3  # of the scenes that have several; every other transfer has one
WET = PorePressure(ratio=0.5, decay_time=1.0)
SPEED = 0.1  # cells a step: the particles leave the raster, blocks move, slots are handed over
WITHOUT_LOAD = "footprints", "release"  # parts that call no kernel of the first
# parts of a transfer whose kernels inline the same functions, for one process; the longest come first
TOGETHER = ("substep", "to_particles"), ("to_grid",), ("sums", "change_step", "unload"), ("contacts",), ("sort", "pack")


def _job() -> tuple[Scene, Particles, str, Path]:
    """The small scene, its particles, the kind of scene and the folder of shared parts; the process ends with its parent."""
    materials, frictions, precision, kind, folder, parent = pickle.loads(base64.b64decode(os.environ[WARM_UP]))
    end_with_parent(parent)
    make_code_when_called()
    gc.freeze()
    collect_rarely()
    scene, particles = small_slope(materials, frictions, precision)
    zones, structures = scene.friction_zones if "zones" in kind else None, side_wall() if "structures" in kind else None
    substeps = SUBSTEPS if "substeps" in kind else 1
    pores = (WET,) * len(materials) if "wet" in kind else ()
    scene = replace(scene, friction_zones=zones, structures=structures, substeps=substeps, pore_pressure=pores)
    return scene, particles, kind, Path(folder)


def warm_up() -> None:
    """Call every kernel on small scenes, so that it is compiled and cached; runs in a process of its own."""
    scene, particles, kind, folder = _job()
    parts = _parts(scene, particles)
    share(parts, folder)
    complete(parts, folder)
    _warm_up(scene, particles, free="free" in kind)


def warm_up_ahead() -> None:
    """Compile parts of the kernels in another process meanwhile. The first process finds them in the cache."""
    scene, particles, _, folder = _job()
    parts = _parts(scene, particles)
    share({name: parts[name] for name in WITHOUT_LOAD}, folder)
    complete({"load": parts["load"]}, folder)  # its kernels are called by all further parts
    share(parts, folder)


def _parts(scene: Scene, particles: Particles) -> dict[str, Callable[[], object]]:
    """Parts of the kernels, by what calls them; the first is called by others, the longest of the others come first."""
    loaded, empty = (cache(partial(_loaded, scene, p)) for p in (particles, Particles.zeros(0)))
    called = (*OF_SUBSTEPS, *PARTS) if scene.substeps > 1 else PARTS
    groups = [[name for name in names if name in called] for names in TOGETHER]
    of_steps = {names[0]: partial(_pass, empty, names, scene.stable_step(SPEED)) for names in groups}
    footprints = partial(lattice_columns, scene, particles, particles.volume[0])
    fill = partial(_fill_release, scene)
    dense = partial(_loaded, scene, particles, "dense")
    return {"load": loaded, **of_steps, "footprints": footprints, "release": fill, "columns": partial(_sum, loaded), "dense": dense}


def _loaded(scene: Scene, particles: Particles, index: str = "sparse") -> ScanBackend:
    engine = ScanBackend(threads=1, index=index)
    engine.load(scene, particles)
    return engine


def _pass(engine: Callable[[], ScanBackend], parts: list[str], dt: float) -> None:
    for part in parts:
        engine().pass_part(part, dt)


def _sum(engine: Callable[[], ScanBackend]) -> None:
    engine().columns(), engine().lattice_columns()


def _warm_up(scene: Scene, particles: Particles, free: bool) -> None:
    engine = ScanBackend(threads=1)
    engine.load(scene, particles)
    for k in range(STEPS):
        engine.step(engine.stable_step() * (1.0 if k % 8 else 0.9), scene.substeps if k % 2 else 1)
        if k % 8 == 0:
            engine.ledger(), engine.columns(), engine.flow_columns(), engine.lattice_columns()
    if scene.basal.law.drags_column and len(scene.materials) > 1:
        engine.share_releases()
    engine.particles()
    ScanBackend(threads=1).restore(scene, engine.checkpoint())
    dense = ScanBackend(threads=1, index="dense")
    dense.load(replace(scene, surface=None) if free else scene, particles)
    if free:
        dense.step(dense.stable_step())


def _fill_release(scene: Scene) -> None:
    """Make the particles of a small release."""
    terrain = Terrain(np.zeros((CELLS, CELLS)), scene.raster.cell_size)
    release, ground = Release(np.ones((CELLS, CELLS)), terrain), scene.ground
    assert ground is not None
    how, settle = Sampling(scene.spacing, (1, 1, 1)), settled_in(scene)
    press = pressed_by(replace(scene, initial_stress=InitialStress.AT_REST), [release])
    for _ in ReleaseParticles([release], scene.materials[:1], ground, how, press=press, settle=settle).chunks():
        pass


def side_wall() -> StructureField:
    """A wall north of the particles of :func:`small_slope`, along which they slide."""
    shape, nodes = (6, 4, 4), (9, 9, 9)
    y = 4.0 * np.indices(shape)[1].reshape(-1, 1, 1, 1) + 0.5 * np.indices(nodes)[1]
    blocks, patch = np.arange(y.shape[0], dtype=np.int32).reshape(shape), np.zeros(y.shape, np.int32)
    one = np.zeros((1, 3))
    return StructureField(
        0.5, (0.0, 0.0, -8.0), blocks, np.clip(9.9 - y, -4.0, 4.0).astype(np.float32), patch, 4.0,
        Patches(one, one, np.ones(1), np.zeros(1, np.int64), np.full(1, 0.1)),
    )  # fmt: skip


def small_slope(materials: tuple[Material, ...], frictions: tuple[BasalFriction, ...], precision: str) -> tuple[Scene, Particles]:
    """A cube of particles that slides over the edge of a plane; the particles belong to the materials in turn."""
    surface = Surface.through(np.fromfunction(lambda i, j: -0.2 * i, (CELLS + 1, CELLS + 1)), (1.0, 1.0))
    zones = FrictionZones(np.ones((CELLS, CELLS)), np.zeros((CELLS, CELLS)), (1.0, 1.0))
    scene = Scene(
        (1.0, 1.0, 1.0), surface, Raster(CELLS, CELLS, (1.0, 1.0)), materials, frictions, precision=precision,
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
