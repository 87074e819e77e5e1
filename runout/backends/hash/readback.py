"""Read back a batch between steps: ledger rows, particles, and columns over the raster."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from copy import deepcopy
from types import SimpleNamespace
from typing import TypeAlias

import numpy as np
import warp as wp

from runout.backends import footprints
from runout.backends.hash.account import Account
from runout.backends.hash.columns import WHOLE
from runout.backends.hash.groups import filled
from runout.backends.hash.layout import PARTICLE_LANES, run, run_blocks, run_each
from runout.backends.hash.limits import require_index
from runout.backends.hash.observe import BOOKED, NOWHERE, REACH, SUMS
from runout.backends.hash.parts import Parts
from runout.backends.protocol import LedgerRow, RasterSums
from runout.model.particles import ARRAYS, Particles

ROW_LANES, FEWEST_LANES = 2**14, 2**11  # threads of a GPU that look for particles that have gone: for one scene, for many
PARTS = 256  # blocks of threads that share the sums over the blocks of all scenes
ROWS_BEFORE = 3  # for either place of the particles and since arrays were made anew, before the sums are recorded as a graph
CHUNK = 2**18  # particles that are brought to the host at once
KEPT = BOOKED + SUMS  # numbers of a scene that a sort keeps
LEDGER_NUMBERS = KEPT + SUMS + 7  # numbers of a scene; the last are blocks with particles and their extent
NO_BLOCKS = np.array([0, *[NOWHERE] * 3, *[-NOWHERE] * 3])
Bounds: TypeAlias = tuple[np.ndarray, np.ndarray]


class Report:
    """Sums over blocks and particles of so many scenes, on the device of the scope, and what the host has read of them.

    Attributes
    ----------
    kept : (scenes, KEPT) float64
        Dissipation and impulse booked, and sums over the particles that have gone, up to the last sort.
    group : SumGroup
        Holds ``kept`` and the other arrays.
    by_block : (blocks, SUMS) float64
        Sums over the particles of each block.
    cached_ledger, cached_columns
        Sums of the present state, and those by column of a scene, once they have been read; see :meth:`forget`.
    """

    def __init__(self, groups: SimpleNamespace, scenes: int, is_cuda: bool):
        self.parts, self.threads = (PARTS // scenes + 1, max(ROW_LANES // scenes, FEWEST_LANES)) if is_cuda else (1, 1)
        self.no_blocks = wp.array(np.tile(NO_BLOCKS, (scenes, 1)), dtype=wp.int32)
        rows = {"kept": (scenes, KEPT), "ledger": (scenes, LEDGER_NUMBERS), "gone": (scenes * self.threads, SUMS)}
        rows |= {"booked": (scenes * self.parts, BOOKED), "here": (scenes * self.parts, SUMS)}
        arrays = {name: wp.zeros(shape, dtype=wp.float64) for name, shape in rows.items()}
        self.group = filled(groups.SumGroup, self, bounds=wp.zeros((scenes, len(NO_BLOCKS)), dtype=wp.int32), **arrays)
        self.kept, self.by_block = self.group.kept, wp.empty((0, SUMS), dtype=wp.float64)
        self.forget()

    def forget(self) -> None:
        """The state changes: what has been read is no longer that of the present."""
        self.cached_ledger: np.ndarray | None = None
        self.cached_columns: dict[int, RasterSums] = {}

    def keep(self, parts: Parts) -> None:
        """Launches that keep what has been booked by block since the last sort, and what particles that have gone took along."""
        self._sum_since_sort(parts)
        run_each(parts.k.keep_sums, self.kept.size, PARTICLE_LANES, parts.status.group, self.group)

    def rows(self, parts: Parts) -> np.ndarray:
        """All sums of the present state (scenes, LEDGER_NUMBERS), see ``write_sums`` of ``observe``; the host waits once."""
        if self.cached_ledger is None:
            capacity = parts.index.capacity
            if len(self.by_block) != capacity:
                self.by_block = wp.empty((capacity, SUMS), dtype=wp.float64)
            parts.launch(("ledger", parts.store.turn, parts.generation), lambda: self._enqueue(parts), ROWS_BEFORE)
            self.cached_ledger = self.group.ledger.numpy()
        return self.cached_ledger

    def _enqueue(self, parts: Parts) -> None:
        """Launches of a row of the ledger of each scene."""
        index, scenes, status = parts.index, parts.scenes, parts.status.group
        self.by_block.zero_()
        wp.copy(self.group.bounds, self.no_blocks)
        run_blocks(
            parts.k.sum_blocks, index.capacity, PARTICLE_LANES, status, parts.store.group, index.block_group, scenes.group,
            scenes.constants, scenes.materials, self.group, self.by_block,
        )  # fmt: skip
        self._sum_rows(parts, self.by_block, self.group.here)
        self._sum_since_sort(parts)
        run_each(parts.k.write_sums, self.group.ledger.size, PARTICLE_LANES, status, self.group)

    def _sum_since_sort(self, parts: Parts) -> None:
        scenes = parts.scenes
        self._sum_rows(parts, parts.nodes.booked, self.group.booked)
        run(
            parts.k.sum_gone, self.threads, parts.status.group, parts.store.group, parts.index.block_group, scenes.group,
            scenes.constants, scenes.materials, self.group,
        )  # fmt: skip

    def _sum_rows(self, parts: Parts, rows: wp.array, sums: wp.array) -> None:
        """Sums over the blocks of each scene of a row for each block."""
        arguments = parts.status.group, parts.index.block_group, rows, self.parts, sums
        run_each(parts.k.sum_rows, sums.shape[0], PARTICLE_LANES, *arguments)


def ledgers(parts: Parts, report: Report, accounts: Sequence[Account]) -> list[LedgerRow]:
    """Sums of the present state, a row a scene."""
    rows = report.rows(parts)
    taken = np.zeros(len(rows)) if parts.structures is None else parts.structures.dissipation()
    return [_row(*one) for one in zip(accounts, rows, rows.tolist(), taken.tolist(), strict=True)]


def _row(a: Account, row: np.ndarray, numbers: list[float], taken: float) -> LedgerRow:
    done, left, here, blocks = (numbers[begin:] for begin in (0, BOOKED, KEPT, KEPT + SUMS))
    sides = [max(int(high - low) + 1, 0) for low, high in zip(blocks[1:4], blocks[4:7], strict=True)]
    return LedgerRow(
        mass=here[0], escaped_mass=left[0], momentum=row[KEPT + 1 : KEPT + 4].copy(), kinetic_energy=here[4],
        potential_energy=here[5], elastic_energy=here[6], basal_dissipation=-done[1], plastic_dissipation=done[0] + done[5],
        escaped_energy=sum(left[4:SUMS]), basal_impulse=row[2:5].copy(), max_speed=a.max_speed, active_blocks=int(blocks[0]),
        box_blocks=math.prod(sides), contact_particles=a.contact_particles, structure_dissipation=taken,
    )  # fmt: skip


def particles(parts: Parts, scene: int) -> Particles:
    """The particles of a scene as they are, in the order of their identity."""
    places = _places(parts, scene)
    found, rank = Particles.zeros(len(places)), np.empty(len(places), np.int32)
    identity = parts.store.identity[parts.store.number.numpy()[places]]
    rank[np.argsort(identity)] = np.arange(len(places), dtype=np.int32)
    for first in range(0, len(places), CHUNK):
        part = slice(first, first + CHUNK)
        p = _brought(parts, scene, places[part])
        p.identity = identity[part]
        for name in ARRAYS:
            getattr(found, name)[rank[part]] = getattr(p, name)
    return found


def _places(parts: Parts, scene: int) -> np.ndarray:
    """Where in memory the particles of a scene lie that have not gone."""
    s = parts.store
    key = s.key.numpy()[: s.n]
    there = np.flatnonzero(key >= 0).astype(np.int32)
    return there if len(parts.scenes.scenes) == 1 else there[parts.index.member.numpy()[key[there] >> 6] == scene]


def _brought(parts: Parts, scene: int, places: np.ndarray) -> Particles:
    """Particles at some places in memory, without identity."""
    store, scenes, count = parts.store, parts.scenes, len(places)
    where = wp.array(places, dtype=wp.int32)
    node, affine = wp.zeros((count, 3), dtype=wp.int32), wp.zeros((count, 9), dtype=wp.float64)
    groups = store.group, parts.index.block_group, scenes.group, scenes.constants, scenes.materials
    run(parts.k.unpack, count, *groups, where, node, affine)
    p = store.brought(where, node, affine, int(scenes.group.step_counts.numpy()[scene]))
    p.release -= np.int32(scenes.first_release[scene])
    return p


def whole(parts: Parts, report: Report, accounts: Sequence[Account], scene: int) -> RasterSums:
    """Sums over all cells of a scene's raster."""
    s = parts.scenes.scenes[scene]
    found = around_flow(parts, report, accounts, [scene])[scene]
    return footprints.on_whole(footprints.on_raster(found, s.raster, footprints.lattice_cell(s)), s.raster)


def around_flow(parts: Parts, report: Report, accounts: Sequence[Account], chosen: Iterable[int]) -> dict[int, RasterSums]:
    """Sums over windows of the lattice that hold all mass of chosen scenes; the host waits once for all."""
    scenes = parts.scenes.scenes
    bounds = {n: bounds_of(parts, report, n) for n in chosen}
    windows = {n: footprints.Lattice.around(scenes[n], *b) for n, b in bounds.items() if b is not None}
    sums = parts.columns.launch(parts, accounts, windows)
    columns = {n: deepcopy(of_scene) for n, (_, of_scene) in sums.arrived().items()}
    sums.keep_boxes()
    sums.release()
    return dict.fromkeys(bounds, footprints.nothing()) | columns


def _brought_down(parts: Parts, sums: wp.array) -> np.ndarray:
    """Whole numbers on the host; they stay there until the next are brought."""
    held = parts.buffers.lend(len(sums), sums.device.is_cuda)
    wp.copy(held, sums, count=len(sums))
    if sums.device.is_cuda:
        wp.synchronize_event(wp.record_event())
    parts.buffers.take_back(held)
    return held.numpy()[: len(sums)]  # type: ignore[no-any-return]


def plan_masses(
    parts: Parts, accounts: Sequence[Account], scene: int, first: tuple[int, int], shape: tuple[int, int]
) -> np.ndarray:
    """Mass, and mass times pore pressure ratio, (releases, 2, nx, ny) of a scene by release around nodes of the plan."""
    scenes = parts.scenes
    begin, end = (int(n) for n in scenes.first_release[scene : scene + 2])
    size = (end - begin) * 2 * shape[0] * shape[1]
    require_index(size, "masses around nodes")
    window = wp.array(np.array([*first, *shape, scene, begin, int(scenes.wet)], np.int32), dtype=wp.int32)
    sums, scale = wp.zeros(size, dtype=wp.int64), WHOLE / max(accounts[scene].mass, 1e-30)
    groups = parts.store.group, parts.index.block_group, scenes.group, parts.nodes.pore_group
    run(parts.k.weigh_plan, parts.store.size, *groups, window, wp.float64(scale), sums)
    return _brought_down(parts, sums).reshape(end - begin, 2, *shape) / scale  # type: ignore[no-any-return]


def bounds_of(parts: Parts, report: Report, scene: int, margin: int = 0) -> Bounds | None:
    """Lowest and highest node (2,) in plan that the particles cover, ``margin`` nodes farther out; None without particles."""
    return bounds_in(parts, scene, report.rows(parts)[scene, -7:], margin)


def bounds_in(parts: Parts, scene: int, row: np.ndarray, margin: int = 0) -> Bounds | None:
    """The same from number and extent (7,) of the blocks of the scene."""
    low, high = 4 * row[1:].reshape(2, 3)[:, :2].astype(np.int64)
    if low[0] > high[0]:
        return None
    shift = (0, parts.scenes.shifts[scene])
    return low - shift - margin, high - shift + REACH + margin
