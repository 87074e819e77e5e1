"""Control of the GPU benchmark: a step as it is most often written, a thread a particle and scalar atomic sums to the nodes.

The same law, records and weights as the backend hash, on a dense grid: without index, sort, contact and observers.
"""

from __future__ import annotations

import time
from functools import cache
from sys import modules
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from runout.backends.compile import law_record, warp_binding, warp_kernels
from runout.backends.hash import deform, grid_to_particles, natives, stencil
from runout.backends.hash.deform import _slopes, _store, _strain_of
from runout.backends.hash.grid_to_particles import _in_cell
from runout.backends.hash.groups import argument_types, packing_of
from runout.backends.hash.kernels import OPTIONS, _local_types
from runout.backends.hash.layout import (
    AFFINE,
    HISTORY,
    MASS,
    MOMENTUM,
    OFFSET,
    VOLUME,
    Materials,
    Reals,
    Rows,
    Table2,
    Vector,
    run,
)
from runout.backends.hash.state import Store
from runout.backends.hash.stencil import _arms
from runout.model.laws import LAWS
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.physics.bspline import weights
from runout.physics.elastic import kirchhoff_stress
from runout.physics.moments import affine_columns, stress_columns, velocity_gradient
from runout.physics.plastic import step as law_update
from runout.physics.tensors import real, vec


def sum_to_nodes(rec: Rows, node: Table2, ny: int, nz: int, grid: Reals):
    """Mass and momentum of a particle to its 27 nodes, number by number."""
    p = wp.tid()
    first = (node[p, 0] * ny + node[p, 1]) * nz + node[p, 2]
    f = vec(rec[OFFSET, p], rec[OFFSET + 1, p], rec[OFFSET + 2, p])
    wx = weights(f[0])
    wy = weights(f[1])
    wz = weights(f[2])
    dx = _arms(f[0])
    dy = _arms(f[1])
    dz = _arms(f[2])
    for i in range(3):
        for j in range(3):
            for k in range(3):
                w = wx[i] * wy[j] * wz[k]
                n = 4 * (first + (i * ny + j) * nz + k)
                wp.atomic_add(grid, n, w * rec[MASS, p])
                for d in range(3):
                    affine = dx[i] * rec[AFFINE + d, p] + dy[j] * rec[AFFINE + 3 + d, p] + dz[k] * rec[AFFINE + 6 + d, p]
                    wp.atomic_add(grid, n + 1 + d, w * (rec[MOMENTUM + d, p] + affine))


def to_velocity(grid: Reals, dv: Vector):
    """Momentum of a node to velocity, after gravity."""
    n = 4 * wp.tid()
    if grid[n] > real(0.0):
        for d in range(3):
            grid[n + 1 + d] = grid[n + 1 + d] / grid[n] + dv[d]


def move_particles(rec: Rows, node: Table2, ny: int, nz: int, grid: Reals, mats: Materials, dt: Any, h: Vector):
    """Velocity, law, motion and next record of a particle from its 27 nodes."""
    p = wp.tid()
    first = (node[p, 0] * ny + node[p, 1]) * nz + node[p, 2]
    f = vec(rec[OFFSET, p], rec[OFFSET + 1, p], rec[OFFSET + 2, p])
    wx = weights(f[0])
    wy = weights(f[1])
    wz = weights(f[2])
    v = vec(real(0.0), real(0.0), real(0.0))
    x = vec(real(0.0), real(0.0), real(0.0))
    y = vec(real(0.0), real(0.0), real(0.0))
    z = vec(real(0.0), real(0.0), real(0.0))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                n = 4 * (first + (i * ny + j) * nz + k)
                u = (wx[i] * wy[j] * wz[k]) * vec(grid[n + 1], grid[n + 2], grid[n + 3])
                v += u
                x += (real(i) - f[0]) * u
                y += (real(j) - f[1]) * u
                z += (real(k) - f[2]) * u
    slopes = _slopes(dt, h)
    mat = mats[0]
    m = rec[MASS, p] * real(1.0)
    volume = rec[VOLUME, p] * real(1.0)
    B, log, history, _ = law_update(_strain_of(rec, p), velocity_gradient(x, y, z, slopes), rec[HISTORY, p], mat)
    packed = stress_columns(kirchhoff_stress(log, mat), volume, slopes)
    _store(rec, p, m, v, affine_columns(m, x, y, z), packed, B, history)
    for d in range(3):
        g = f[d] + dt / h[d] * v[d]
        node[p, d] = node[p, d] + int(wp.floor(g - real(0.5)))
        rec[OFFSET + d, p] = _in_cell(g)


@cache
def _kernels(law: str) -> SimpleNamespace:
    physics = warp_binding(wp.float32)
    own, others = (wp.get_module(f"runout.naive.{law}{part}") for part in ("", ".unused"))
    own.options.update(OPTIONS)
    record = law_record(LAWS.find(law), wp.float32)
    update = physics.law(LAWS.find(law)).step
    kernels = warp_kernels(
        physics, (stencil, deform, grid_to_particles, modules[__name__]),
        lambda name: others if name in vars(grid_to_particles) else own, packing_of(wp.float32),
        **argument_types(wp.float32), **_local_types(wp.float32),
        Materials=wp.array(dtype=record),
        **natives.of("float32"), law_update=update,
    )  # fmt: skip
    kernels.record = record
    return kernels


def measure_naive(device: str, scene: Scene, particles: Particles, steps: int) -> dict[str, Any]:
    """A record of the benchmark: steps of the control with the particles in the order of their cells, as a graph."""
    low, high = particles.node.min(0) - 4, particles.node.max(0) + 8
    nx, ny, nz = (high - low).tolist()
    order = np.lexsort(particles.node.T[::-1])
    with wp.ScopedDevice(device):
        k = _kernels(scene.law.name)
        arranged = particles.take(order)
        store = Store(arranged.identity, wp.float32)
        store.put(slice(0, len(arranged)), arranged, 0, scene.spacing, np.float32)
        node = wp.array(np.ascontiguousarray(particles.node[order] - low, np.int32), dtype=wp.int32)
        grid = wp.zeros(4 * nx * ny * nz, dtype=wp.float32)
        mats = wp.array(scene.law.table(scene.materials, np.dtype(np.float32)), dtype=k.record)
        dt = 0.5 * scene.stable_step(5.0)
        vec3 = wp.types.vector(length=3, dtype=wp.float32)
        h, dv = vec3(*scene.spacing), vec3(*(dt * np.array(scene.gravity)))

        def step() -> None:
            grid.zero_()
            run(k.sum_to_nodes, len(particles), store.rec, node, ny, nz, grid)
            run(k.to_velocity, nx * ny * nz, grid, dv)
            run(k.move_particles, len(particles), store.rec, node, ny, nz, grid, mats, wp.float32(dt), h)

        step()
        mass = float(grid.numpy()[::4].sum(dtype=np.float64))
        assert abs(mass / particles.mass.sum() - 1) < 1e-4, mass
        wp.synchronize_device(device)
        started = time.perf_counter()
        for _ in range(steps):
            step()
        wp.synchronize_device(device)
        taken = time.perf_counter() - started
        assert np.isfinite(store.rec[MOMENTUM].numpy()).all()
    return {
        "name": "naive control", "particles": len(particles), "particle_steps_per_second": len(particles) * steps / taken,
        "steps": steps, "seconds": taken, "bytes_per_particle": (store.memory.capacity + grid.capacity) / len(particles),
        "precision": "float32", "graph": False, "deterministic": False, "control": True, "stage_seconds": {},
    }  # fmt: skip
