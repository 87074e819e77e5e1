"""Looks at a batch between steps: ledger rows, particles, and columns over the raster."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
import warp as wp

from runout.backends import footprints
from runout.backends.hash.layout import PARTICLE_LANES, run, run_blocks
from runout.backends.hash.observe import BOOKED, SUMS
from runout.backends.protocol import LedgerRow, RasterSums
from runout.model.particles import Particles
from runout.model.scene import Scene

if TYPE_CHECKING:
    from runout.backends.hash.batch import Batch

ROW_LANES = 4096  # threads of a GPU that share the sums over the particles that have gone
PARTS = 256  # blocks of threads that share the sums over the blocks of all scenes
CHUNK = 2**21  # particles that are brought to the host at once
WHOLE = 2.0**62  # sums over columns are whole numbers below this
KEPT = BOOKED + SUMS  # numbers of a scene that a sort keeps
LEDGER_NUMBERS = KEPT + SUMS + 5  # numbers that are told of a scene; the last are blocks with particles and their extent in plan
NO_BLOCKS = np.array([0, 2**29, 2**29, -(2**29), -(2**29)])
Window: TypeAlias = tuple[int, int, int, int]
REACH = 5  # cells from the first of a block that its particles cover


class Report:
    """Memory of sums over blocks and particles on the device of the scope, for so many scenes.

    Attributes
    ----------
    kept : (scenes, KEPT) float64
        Dissipation and impulse booked, and sums over the particles that have gone, up to the last sort.
    """

    def __init__(self, scenes: int, is_cuda: bool):
        self.parts, self.threads = (PARTS // scenes + 1, ROW_LANES // scenes + 1) if is_cuda else (1, 1)
        self.kept, self.ledger = (wp.zeros((scenes, n), dtype=wp.float64) for n in (KEPT, LEDGER_NUMBERS))
        self.booked, self.here = (wp.zeros((scenes * self.parts, n), dtype=wp.float64) for n in (BOOKED, SUMS))
        self.gone = wp.zeros((scenes * self.threads, SUMS), dtype=wp.float64)
        self.bounds = wp.zeros((scenes, len(NO_BLOCKS)), dtype=wp.int32)
        self.no_blocks = wp.array(np.tile(NO_BLOCKS, (scenes, 1)), dtype=wp.int32)


def keep(batch: Batch) -> None:
    """Launches that keep what has been booked by block since the last sort, and what particles that have gone took along."""
    r, many = batch.report, len(batch.scenes)
    _sum_since_sort(batch)
    tally = batch.device_status.tally
    run(batch.k.keep_sums, (many, KEPT), r.booked, r.parts, r.gone, r.threads, many, tally, r.kept)
    batch.nodes.booked.zero_()


def _sum_since_sort(batch: Batch) -> None:
    i, s, r, many = batch.index, batch.store, batch.report, len(batch.scenes)
    _sum_rows(batch, batch.nodes.booked, r.booked)
    run(
        batch.k.sum_gone, r.threads, s.rec, s.release, s.key, i.coordinates, i.member, batch.shift, batch.mats, batch.packed,
        batch.h, wp.vec3d(*batch.scene.gravity), i.tally, many, r.threads, r.gone,
    )  # fmt: skip


def _sum_rows(batch: Batch, rows: wp.array, sums: wp.array) -> None:
    """Sums over the blocks of each scene of a row for each block."""
    arguments = [rows, batch.index.member, batch.index.tally, rows.shape[1], batch.report.parts, sums]
    wp.launch_tiled(batch.k.sum_rows, dim=sums.shape[0], inputs=arguments, block_dim=PARTICLE_LANES)


def told(batch: Batch) -> np.ndarray:
    """All sums of the present state (scenes, TOLD), see :func:`runout.backends.hash.observe.tell_sums`; the host waits once."""
    if batch.cached_ledger is None:
        i, s, r, many = batch.index, batch.store, batch.report, len(batch.scenes)
        found = wp.zeros((i.capacity, SUMS), dtype=wp.float64)
        wp.copy(r.bounds, r.no_blocks)
        run_blocks(
            batch.k.sum_blocks, i.capacity, PARTICLE_LANES, s.rec, s.release, s.key, s.order, i.cstart, i.tally, i.active,
            i.coordinates, i.member, batch.shift, batch.mats, batch.packed, batch.h, wp.vec3d(*batch.scene.gravity), found,
            r.bounds,
        )  # fmt: skip
        _sum_rows(batch, found, r.here)
        _sum_since_sort(batch)
        arguments = r.here, r.booked, r.parts, r.gone, r.threads, many, i.tally, r.kept, r.bounds, r.ledger
        run(batch.k.write_sums, (many, LEDGER_NUMBERS), *arguments)
        batch.cached_ledger = r.ledger.numpy()
    return batch.cached_ledger


def ledgers(batch: Batch) -> list[LedgerRow]:
    """Sums of the present state, a row a scene."""
    rows = told(batch)
    return [_row(batch, s, rows[s, KEPT:], rows[s, BOOKED:KEPT], rows[s, :BOOKED]) for s in range(len(batch.scenes))]


def _row(batch: Batch, scene: int, here: np.ndarray, left: np.ndarray, done: np.ndarray) -> LedgerRow:
    a = batch.accounts[scene]
    return LedgerRow(
        mass=float(here[0]), escaped_mass=float(left[0]), momentum=here[1:4].copy(), kinetic_energy=float(here[4]),
        potential_energy=float(here[5]), elastic_energy=float(here[6]), basal_dissipation=-float(done[1]),
        plastic_dissipation=float(done[0] + done[5]), escaped_energy=float(left[4:].sum()), basal_impulse=done[2:5].copy(),
        max_speed=a.max_speed, active_blocks=int(here[SUMS]), contact_particles=a.contact_particles,
    )  # fmt: skip


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
    p, number = s.brought(where, node, affine, int(batch.step_counts.numpy()[scene]))
    p.release -= np.int32(batch.first_release[scene])
    return p, number


def whole(batch: Batch, scene: int) -> RasterSums:
    """Sums over all cells of a scene's raster."""
    s = batch.scenes[scene]
    if footprints.apply_to(s):
        return footprints.on_whole(around_flow(batch, [scene])[scene], s.raster)
    every = (0, 0, s.raster.rows, s.raster.columns)
    return _columns_of(_sums(batch, {scene: _raster_window(s, every)})[scene], every)


def around_flow(batch: Batch, scenes: Iterable[int]) -> dict[int, RasterSums]:
    """Sums over the smallest windows of the rasters of some scenes that hold all mass; the host waits once for all."""
    found, fine, coarse = {}, {}, {}
    for n in scenes:
        s, bounds = batch.scenes[n], _bounds(batch, n)
        if bounds is None:
            found[n] = footprints.nothing()
        elif footprints.apply_to(s):
            fine[n] = footprints.Lattice.around(s, *bounds)
        else:
            coarse[n] = _window(s, *bounds)
    windows = {n: _lattice_window(batch.scenes[n], lattice) for n, lattice in fine.items()}
    sums = _sums(batch, windows | {n: _raster_window(batch.scenes[n], window) for n, window in coarse.items()})
    found |= {n: _columns_of(sums[n], window) for n, window in coarse.items()}
    for n, lattice in fine.items():
        found[n] = footprints.on_raster(sums[n], lattice, batch.scenes[n].raster, batch.accounts[n].particle_volume)
    return found


def _bounds(batch: Batch, scene: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Lowest and highest node (2,) in plan that the particles of a scene cover; None without particles."""
    low, high = np.split(4 * told(batch)[scene, -4:], 2)
    if low[0] > high[0]:
        return None
    return low - (0, batch.shifts[scene]), high - (0, batch.shifts[scene]) + REACH


def _window(s: Scene, low: np.ndarray, high: np.ndarray) -> Window:
    """First row, first column, rows and columns of the raster's smallest window between two nodes."""
    r, h, cell = s.raster, np.array(s.spacing[:2]), np.array(s.raster.cell_size)
    most = np.array((r.columns, r.rows)) - 1
    first = np.clip(np.floor(low * h / cell - 1e-6), 0, most).astype(int)
    last = np.clip(np.floor(high * h / cell + 1e-6), 0, most).astype(int)
    (west, south), (columns, rows) = first.tolist(), (last - first + 1).tolist()
    return r.rows - south - rows, west, rows, columns


class _PlanWindow(NamedTuple):
    """A window of plan cells: place and size in the whole, the whole, grid cells over plan cells, and where the whole begins."""

    window: Window
    rows: int
    columns: int
    wide: tuple[float, float]
    begin: tuple[int, int] = (0, 0)


def _raster_window(s: Scene, window: Window) -> _PlanWindow:
    cell = s.raster.cell_size
    return _PlanWindow(window, s.raster.rows, s.raster.columns, (s.spacing[0] / cell[0], s.spacing[1] / cell[1]))


def _lattice_window(s: Scene, lattice: footprints.Lattice) -> _PlanWindow:
    columns, rows = lattice.shape
    wide = s.spacing[0] / lattice.cell[0], s.spacing[1] / lattice.cell[1]
    return _PlanWindow((0, 0, rows, columns), rows, columns, wide, lattice.first)


def _columns_of(sums: np.ndarray, window: Window) -> RasterSums:
    """Columns from sums (rows, columns, 5) over a window of the raster."""
    return RasterSums(sums[..., 0], sums[..., 1], sums[..., 2:], *window[:2])


def _sums(batch: Batch, covered: Mapping[int, _PlanWindow]) -> dict[int, np.ndarray]:
    """Volume, mass and momentum (rows, columns, 5) over windows of plan cells of some scenes; windows hold all mass."""
    i, p, many = batch.index, batch.store, len(batch.scenes)
    windows, scales = np.full((many, 6), -1, np.int32), np.zeros((many, 7))
    begin, found = 0, {}
    for n, plan in covered.items():
        row, column, rows, width = plan.window
        windows[n] = begin, plan.rows, plan.columns, row, column, width
        scales[n] = *plan.wide, *_units(batch, n), *plan.begin
        begin += 5 * rows * width
    raster = wp.zeros(begin, dtype=wp.int64)
    if begin:
        run(
            batch.k.add_columns, p.n, p.rec, p.release, p.key, i.coordinates, i.member, batch.shift, batch.density,
            wp.array(windows, dtype=wp.int32), wp.array(scales, dtype=wp.float64), raster,
        )  # fmt: skip
    sums = raster.numpy()
    for n, plan in covered.items():
        _, _, rows, width = plan.window
        part = sums[windows[n, 0] :][: 5 * rows * width].reshape(rows, width, 5)
        found[n] = part / np.repeat(scales[n, 2:5], (1, 1, 3))
    return found


def _units(batch: Batch, scene: int) -> np.ndarray:
    """Whole numbers for a unit of volume [1/m3], mass [1/kg] and momentum [1/(kg m/s)], so that no sum overflows."""
    a = batch.accounts[scene]
    light = min(m.density for m in batch.scenes[scene].materials)
    mass = max(a.mass, 1e-30)
    return WHOLE / np.array([mass / light, mass, mass * max(a.max_speed, 1e-9)])
