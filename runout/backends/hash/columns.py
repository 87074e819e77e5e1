"""Columns over windows of the lattices of scenes: one graph adds them up and spreads them, one copy brings them to the host.

    windows, numbers -> packed   | steps of each scene | columns, or on a CPU sums, of all windows one behind the other |

A window of a scene holds all its mass. The arrays stay from look to look and grow with the windows; what a look covers is told to
the device only where it is not what the last one covered.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from runout.backends import footprints
from runout.backends.hash.account import Account
from runout.backends.hash.layout import run
from runout.backends.hash.limits import require_index
from runout.backends.hash.spreading import LANES, NUMBERS
from runout.backends.protocol import RasterSums
from runout.model.scene import Scene

if TYPE_CHECKING:
    from runout.backends.hash.parts import Parts

WHOLE = 2.0**62  # sums over columns are whole numbers below this
FASTEST = 1024.0  # [m/s] of a column; sums of momentum have bits that do not depend on when the host last read the speed
ORDER = [0, 2, 3, 4, 1]  # of sums by column, in the order of footprints: volume, momentum, mass
SHARING = np.column_stack([footprints.SHARING, footprints.AREAS]).ravel()  # of the extent, then of the thickness
LEAST_ROOM, LEAST_SHARE = 2**14, 2**10  # cells of all scenes, of each: small flows spread without new arrays
LOOKS_BEFORE = 3  # for either place of the rows and since arrays were made anew, before a look is recorded as a graph


class ColumnSums:
    """Arrays on the device of the scope for columns over windows of the lattices of ``many`` scenes.

    Attributes
    ----------
    room, widest : int
        Cells of all windows, and of one, for which there is room.
    values : (5, room)
        Sums before they are spread [m3], [kg m/s], [kg]; only where the device spreads them.
    """

    def __init__(self, many: int):
        self.covered, self.described = np.full((many, 3), -1, np.int32), np.zeros((many, NUMBERS))
        self.windows, self.numbers = wp.array(self.covered, dtype=wp.int32), wp.array(self.described, dtype=wp.float64)
        self.known: dict[int, tuple[Any, ...]] = {}  # of each scene, what its numbers follow from
        self.spreads = spreads_on(self.windows.device)
        self.room = self.widest = 0
        self.latest: LaunchedColumns | None = None

    @property
    def lanes(self) -> int:
        """Numbers of a cell that the host reads."""
        return LANES + self.spreads

    def launch(
        self, parts: Parts, accounts: Sequence[Account], lattices: Mapping[int, footprints.Lattice],
        steps: Mapping[int, int] | None = None,
    ) -> LaunchedColumns:  # fmt: skip
        """Launch the columns over windows by scene; ``steps`` are those that the scenes should have made by then. Nothing waits."""
        windows, cells, widest = np.full_like(self.covered, -1), 0, 0
        windows[:, 1:] = 0
        for n, (columns, rows) in ((n, lattice.shape) for n, lattice in lattices.items()):
            windows[n] = cells, columns, rows
            cells, widest = cells + columns * rows, max(widest, columns * rows)
        require_index(self.lanes * cells + len(windows), "sums of maps")
        if cells > self.room or widest > self.widest:
            self._make_room(cells, widest)
        if not np.array_equal(windows, self.covered):
            self.covered = windows
            self.windows.assign(windows)
        self._describe(accounts, lattices, parts.scenes.scenes)
        if cells:
            if self.latest and not self.latest.released:
                self.latest.keep_boxes()
            name = "columns", parts.store.turn, parts.generation, self.room, self.widest
            parts.launch(name, lambda: self._enqueue(parts), LOOKS_BEFORE)
        self.latest = LaunchedColumns(self, parts, accounts, lattices, steps or {}, cells)
        return self.latest

    def _describe(
        self, accounts: Sequence[Account], lattices: Mapping[int, footprints.Lattice], scenes: Sequence[Scene]
    ) -> None:  # fmt: skip
        """Bring the numbers of the scenes to the device, where they are not what they were."""
        sources = {n: (lattice, accounts[n].particle_volume, units_of(accounts[n], scenes[n])) for n, lattice in lattices.items()}
        changed = [n for n, source in sources.items() if source != self.known.get(n)]
        for n in changed:
            lattice, volume, units = self.known[n] = sources[n]
            self.described[n] = *units, volume / footprints.HALVES**2, *SHARING, footprints.HALVES, *lattice.first
        if changed:
            self.numbers.assign(self.described)

    def _make_room(self, cells: int, widest: int) -> None:
        many = len(self.covered)
        least = max(LEAST_ROOM // many, LEAST_SHARE)
        self.room, self.widest = (max(before, _rounded(n, least)) for before, n in ((self.room, cells), (self.widest, widest)))
        self.packed = wp.zeros(many + self.lanes * self.room, dtype=wp.int64)
        if not self.spreads:
            self.raster = self.packed[many:]
            return
        self.raster, self.spread = wp.empty(LANES * self.room, dtype=wp.int64), self.packed[many:].view(wp.float64)
        self.values, self.scales, self.inside = (wp.empty((n, self.room), dtype=wp.float64) for n in (LANES, 3, 1))
        self.flowing = wp.empty(self.room, dtype=wp.float64)

    def _enqueue(self, parts: Parts) -> None:
        """Launches of a look."""
        k, many, size = parts.k, len(self.covered), (len(self.covered), self.widest)
        self.raster.zero_()
        groups = parts.status.group, parts.store.group, parts.index.block_group, parts.scenes.group
        run(k.add_columns, parts.store.size, *groups, self.windows, self.numbers, self.raster)
        run(k.note_step, many, parts.scenes.group, self.packed)
        if self.spreads:
            arguments = self.windows, self.numbers, self.values
            run(k.scale_columns, size, self.windows, self.numbers, self.raster, self.values)
            run(k.find_flowing, size, *arguments, self.scales, self.flowing)
            run(k.find_covered, size, self.windows, self.numbers, self.scales, self.inside)
            run(k.find_scales, size, *arguments, self.inside, self.scales)
            run(k.spread_columns, size, self.windows, self.values, self.inside, self.scales, self.flowing, LANES, self.spread)


class LaunchedColumns:
    """Columns that a launch brings; :meth:`arrived` waits until they are on the host, and for no later launch."""

    def __init__(
        self, sums: ColumnSums, parts: Parts, accounts: Sequence[Account], lattices: Mapping[int, footprints.Lattice],
        steps: Mapping[int, int], cells: int,
    ):  # fmt: skip
        self.lattices, self.expected, self.windows, self.lanes = lattices, steps, sums.covered, sums.lanes
        self.scenes, self.accounts, self.buffers, self.described = parts.scenes.scenes, accounts, parts.buffers, sums.described
        size, is_cuda = len(self.windows) + self.lanes * cells, sums.windows.device.is_cuda
        self.host = self.buffers.lend(size, is_cuda)
        if cells:
            wp.copy(self.host, sums.packed, count=size)
        self.values: Any = sums.values if cells and sums.spreads else None
        self.released = False
        self.event = wp.record_event() if is_cuda else None

    def arrived(self) -> dict[int, tuple[int, RasterSums]]:
        """Steps that a scene had made, and its columns over a window of the lattice, by scene.

        They may lie in memory that :meth:`release` gives back.
        """
        if self.event is not None:
            wp.synchronize_event(self.event)
        numbers = self.host.numpy()
        return {n: (int(numbers[n]), self._columns(n, numbers)) for n in self.lattices}

    def _columns(self, n: int, numbers: np.ndarray) -> RasterSums:
        """Columns of a scene, of which the host spreads the sums unless the device has."""
        lattice, raster = self.lattices[n], self.scenes[n].raster
        first, columns, rows = self.windows[n].tolist()
        part = numbers[len(self.windows) + self.lanes * first :][: self.lanes * rows * columns]
        if self.values is not None:
            spread = part.view(np.float64).reshape(-1, rows, columns)
            return footprints.with_mass(footprints.placed(spread, lambda: self._boxes(n), lattice, raster))
        units = np.repeat(self.described[n, :3], (1, 1, 3))
        sums = np.ascontiguousarray(np.moveaxis((part.reshape(rows, columns, LANES) / units)[..., ORDER], -1, 0))
        return footprints.with_mass(footprints.spread(sums, lattice, raster, self.accounts[n].particle_volume))

    def _boxes(self, n: int) -> np.ndarray:
        """Sums (5, rows, columns) of a scene before they are spread; the host waits for the device."""
        first, columns, rows = self.windows[n].tolist()
        return self.values.numpy()[:, first : first + rows * columns].reshape(LANES, rows, columns)

    def keep_boxes(self) -> None:
        """Keep the sums before they are spread beyond the next look, which takes their place."""
        if self.values is not None:
            self.values = wp.clone(self.values)

    def release(self) -> None:
        """Give the memory of the host back; to be called once, when nobody reads the columns any more."""
        self.buffers.take_back(self.host)
        self.released = True


def units_of(a: Account, scene: Scene) -> tuple[float, float, float]:
    """Whole numbers for a unit of volume [1/m3], mass [1/kg] and momentum [1/(kg m/s)], so that no sum overflows."""
    light = min(m.density for m in scene.materials)
    mass = max(a.mass, 1e-30)
    return WHOLE / (mass / light), WHOLE / mass, WHOLE / (mass * max(FASTEST, 2.0 * a.max_speed))


def spreads_on(device: wp.Device) -> bool:
    """Whether a device spreads sums itself: on a CPU the host does it in a tenth of the time."""
    return bool(device.is_cuda)


def _rounded(cells: int, least: int) -> int:
    """Cells with some room, in steps of up to a quarter but not less than the ``least``: a look is recorded anew as arrays grow."""
    step = max(1 << max(cells.bit_length() - 3, 0), least)
    return -(-cells // step) * step
