"""Looks at a batch between steps: ledger rows, particles, and columns over the raster."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from runout.backends.hash.layout import GONE, NEXT, PARTICLE_LANES, run, run_blocks
from runout.backends.hash.observe import SUMS
from runout.backends.protocol import Columns, LedgerRow
from runout.model.particles import Particles

if TYPE_CHECKING:
    from runout.backends.hash.batch import Batch

ROW_LANES = 4096  # threads of a GPU that share the sums over the particles that have gone
PARTS = 16  # blocks of threads that share the sums over the blocks of a scene
CHUNK = 2**21  # particles that are brought to the host at once
WHOLE = 2.0**62  # sums over columns are whole numbers below this
REACH = 5  # cells from the first of a block that its particles cover


def sums(batch: Batch) -> np.ndarray:
    """Sums (scenes, SUMS) over the particles that are there."""
    i, s = batch.index, batch.store
    found = wp.zeros((i.room, SUMS), dtype=wp.float64)
    run_blocks(
        batch.k.sum_blocks, i.room, PARTICLE_LANES, s.rec, s.release, s.key, s.order, i.cstart, i.tally, i.active, i.coordinates,
        i.member, batch.shift, batch.mats, batch.packed, batch.h, wp.vec3d(*batch.scene.gravity), found,
    )  # fmt: skip
    return _by_scene(batch, found)


def gone(batch: Batch) -> np.ndarray:
    """The same over those that have gone since the last sort."""
    i, s, many = batch.index, batch.store, len(batch.scenes)
    if i.tally.numpy()[GONE] == 0:
        return np.zeros((many, SUMS))
    threads = ROW_LANES // many + 1 if batch.device.is_cuda else 1
    found = wp.zeros((threads * many, SUMS), dtype=wp.float64)
    run(
        batch.k.sum_gone, threads, s.rec, s.release, s.key, i.coordinates, i.member, batch.shift, batch.mats, batch.packed, batch.h,
        wp.vec3d(*batch.scene.gravity), s.n, many, threads, found,
    )  # fmt: skip
    return found.numpy().reshape(threads, many, SUMS).sum(0)  # type: ignore[no-any-return]


def booked(batch: Batch) -> np.ndarray:
    """Dissipation and impulse (scenes, 5) that have been booked since the last sort."""
    return _by_scene(batch, batch.nodes.booked)


def _by_scene(batch: Batch, rows: wp.array) -> np.ndarray:
    """Sums over the blocks of each scene of a row for each block."""
    many, parts = len(batch.scenes), PARTS if batch.device.is_cuda else 1
    found = wp.zeros((many * parts, rows.shape[1]), dtype=wp.float64)
    arguments = [rows, batch.index.member, batch.index.nall, rows.shape[1], parts, found]
    wp.launch_tiled(batch.k.sum_rows, dim=many * parts, inputs=arguments, block_dim=PARTICLE_LANES)
    return found.numpy().reshape(many, parts, -1).sum(1)  # type: ignore[no-any-return]


def ledgers(batch: Batch) -> list[LedgerRow]:
    """Sums of the present state, a row a scene."""
    here, left, done = sums(batch), gone(batch), booked(batch)
    held = batch.index.member.numpy()[batch.index.active.numpy()[: batch.index.tally.numpy()[NEXT]]]
    blocks = np.bincount(held, minlength=len(batch.scenes))
    return [_row(batch, s, here[s], left[s], done[s], int(blocks[s])) for s in range(len(batch.scenes))]


def _row(batch: Batch, scene: int, here: np.ndarray, left: np.ndarray, done: np.ndarray, blocks: int) -> LedgerRow:
    a = batch.accounts[scene]
    left, done = a.escaped + left, a.booked + done
    return LedgerRow(
        mass=float(here[0]),
        escaped_mass=float(left[0]),
        momentum=here[1:4],
        kinetic_energy=float(here[4]),
        potential_energy=float(here[5]),
        elastic_energy=float(here[6]),
        basal_dissipation=-float(done[1]),
        plastic_dissipation=float(done[0]),
        escaped_energy=float(left[4:].sum()),
        basal_impulse=done[2:],
        max_speed=a.max_speed,
        active_blocks=blocks,
        contact_particles=a.contact_particles,
    )


def particles(batch: Batch, scene: int) -> Particles:
    """The particles of a scene as they are, in the order of their identity."""
    places = _places(batch, scene)
    parts = [_brought(batch, scene, places[first : first + CHUNK]) for first in range(0, len(places), CHUNK)]
    if not parts:
        return Particles.zeros(0)
    p = Particles.concatenate([part for part, _ in parts])
    p.identity[:] = batch.identity[np.concatenate([number for _, number in parts])]
    return p.take(np.argsort(p.identity))


def _places(batch: Batch, scene: int) -> np.ndarray:
    """Where in memory the particles of a scene lie that have not gone."""
    s = batch.store
    key = s.key.numpy()[: s.n]
    there = np.flatnonzero(key >= 0).astype(np.int32)
    return there if len(batch.scenes) == 1 else there[batch.index.member.numpy()[key[there] >> 6] == scene]


def _brought(batch: Batch, scene: int, places: np.ndarray) -> tuple[Particles, np.ndarray]:
    """Particles at some places in memory, without identity, and their numbers."""
    i, s, count = batch.index, batch.store, len(places)
    where = wp.array(places, dtype=wp.int32)
    node, affine = wp.zeros((count, 3), dtype=wp.int32), wp.zeros((count, 9), dtype=wp.float64)
    run(
        batch.k.unpack, count, s.rec, s.release, s.key, i.coordinates, i.member, batch.shift, batch.mats, batch.packed, batch.h,
        where, node, affine,
    )  # fmt: skip
    p, number = s.brought(where, node, affine)
    p.release -= np.int32(batch.first_release[scene])
    return p, number


def window(batch: Batch, scene: int) -> tuple[int, int, int, int]:
    """First row, first column, rows and columns of the raster's smallest window that the blocks with particles cover."""
    i, s = batch.index, batch.scenes[scene]
    bounds = wp.array(np.array([2**30, 2**30, -(2**30), -(2**30)]), dtype=wp.int32)
    run(batch.k.bound_blocks, i.room, i.tally, i.active, i.member, scene, i.coordinates, bounds)
    low, high = (4 * b.astype(float) for b in np.split(bounds.numpy(), 2))
    if low[0] > high[0]:
        return 0, 0, 0, 0
    low[1], high[1] = low[1] - batch.shifts[scene], high[1] - batch.shifts[scene]
    r, h, cell = s.raster, np.array(s.spacing[:2]), np.array(s.raster.cell_size)
    most = np.array((r.columns, r.rows)) - 1
    first = np.clip(np.floor(low * h / cell - 1e-6), 0, most).astype(int)
    last = np.clip(np.floor((high + REACH) * h / cell + 1e-6), 0, most).astype(int)
    (west, south), (columns_, rows) = first.tolist(), (last - first + 1).tolist()
    return r.rows - south - rows, west, rows, columns_


def columns(batch: Batch, scene: int, covered: tuple[int, int, int, int]) -> Columns:
    """Sums over a window (first row, first column, rows, columns) of a scene's raster that holds all mass."""
    s, i, p = batch.scenes[scene], batch.index, batch.store
    row, column, rows, width = covered
    raster = wp.zeros(rows * width * 5, dtype=wp.int64)
    scale = _units(batch, scene)
    h, cell = wp.vec3d(*s.spacing), wp.vec2d(*s.raster.cell_size)
    if rows * width:
        run(
            batch.k.add_columns, p.n, p.rec, p.release, p.key, i.coordinates, i.member, scene, batch.shift, batch.density, h, cell,
            s.raster.rows, s.raster.columns, row, column, width, wp.vec3d(*scale), raster,
        )  # fmt: skip
    found = raster.numpy().reshape(rows, width, 5) / scale[[0, 1, 2, 2, 2]]
    return Columns(found[..., 0], found[..., 1], found[..., 2:], row, column)


def _units(batch: Batch, scene: int) -> np.ndarray:
    """Whole numbers for a unit of volume [1/m3], mass [1/kg] and momentum [1/(kg m/s)], so that no sum overflows."""
    a = batch.accounts[scene]
    light = min(m.density for m in batch.scenes[scene].materials)
    mass = max(a.mass, 1e-30)
    return WHOLE / np.array([mass / light, mass, mass * max(a.max_speed, 1e-9)])
