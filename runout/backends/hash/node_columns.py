"""Sums around nodes of the plan, which a bed erodes by: two launches and one copy bring them to the host.

    add     particles -> sums (nodes of the window, 5)         whole numbers; blocks with particles -> their extent
    take    sums, extent -> found   | extent: 7 | volume | momentum (3) | mass | of the nodes that hold the mass, in SI

The sums are zero again afterwards. Where the sums of a scene are asked for after a series, they are launched behind its last
transfer: they are on the host with the status, and nobody waits for them alone.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from runout.backends import footprints
from runout.backends.hash.account import Account
from runout.backends.hash.columns import units_of
from runout.backends.hash.layout import Filled, run
from runout.backends.hash.limits import require_index
from runout.backends.hash.observe import BOUNDS
from runout.backends.hash.readback import NO_BLOCKS, Bounds, bounds_in
from runout.backends.hash.spreading import LANES
from runout.backends.protocol import NodeSums
from runout.model.scene import Raster, Scene

if TYPE_CHECKING:
    from runout.backends.hash.parts import Parts


class NodeColumns:
    """Sums around nodes of scenes, from which they are launched to where the host takes them.

    Attributes
    ----------
    wanted : collection of int
        Scenes of which they are launched behind the present series.
    """

    def __init__(self) -> None:
        self.arrays: dict[int, _SumArrays] = {}
        self.launched: dict[int, LaunchedNodes] = {}
        self.lent: dict[int, Any] = {}
        self.wanted: Collection[int] = ()

    def begin(self, wanted: Collection[int]) -> None:
        """A series begins: what has been launched is no longer that of the present."""
        self.launched, self.wanted = {}, wanted

    def launch(self, parts: Parts, accounts: Sequence[Account], scene: int, wide: Bounds) -> None:
        """Launch the sums of a scene over a ``wide`` window of nodes that holds its mass. Nothing waits.

        What :meth:`take` gave stays until the launch after the next.
        """
        s = parts.scenes.scenes[scene]
        cells = half_cells(s)
        (i, j), (nx, ny) = nodes_within(wide, cells)
        require_index(LANES * nx * ny, "sums around nodes")
        arrays = self.arrays.get(scene)
        if arrays is None or arrays.room < nx * ny:
            arrays = self.arrays[scene] = _SumArrays(parts.k.groups, nx * ny)
        group = arrays.window(scene, (i, j, nx, ny, *cells), units_of(accounts[scene], s))
        groups = parts.status.group, parts.store.group, parts.index.block_group, parts.scenes.group
        run(parts.k.add_around_nodes, max(parts.store.size, parts.index.capacity), *groups, group)
        run(parts.k.take_around_nodes, LANES * nx * ny, parts.scenes.group, group)
        size, is_cuda = BOUNDS + LANES * nx * ny, arrays.packed.device.is_cuda
        host = parts.buffers.lend(size, is_cuda)
        if scene in self.lent:
            parts.buffers.take_back(self.lent[scene])
        self.lent[scene] = host
        wp.copy(host, arrays.packed, count=size)
        self.launched[scene] = LaunchedNodes(host, cells, wp.record_event() if is_cuda else None)

    def take(self, parts: Parts, scene: int) -> tuple[NodeSums, Bounds] | None:
        """The sums of a scene that are launched, once they are on the host, and the nodes that it covers; None without any."""
        return self.launched.pop(scene).arrived(parts, scene)


class _SumArrays:
    """Arrays of a scene on the device of the scope, with room for so many nodes."""

    def __init__(self, groups: SimpleNamespace, room: int):
        self.room = room + room // 4
        self.packed = wp.empty(BOUNDS + LANES * self.room, dtype=wp.int64)
        bounds = wp.array(np.stack([NO_BLOCKS, NO_BLOCKS]), dtype=wp.int32)
        self.group: Any = Filled(groups.AroundGroup)
        self.group.turn = 0
        self.group.sums, self.group.bounds = wp.zeros(LANES * self.room, dtype=wp.int64), bounds
        self.group.found = self.packed.view(wp.float64)

    def window(self, scene: int, nodes: tuple[int, ...], units: tuple[float, float, float]) -> Any:
        """The arrays with a window of a scene: first nodes, nodes, half cells of the raster; units; the other row of bounds."""
        group = self.group
        group.scene, group.turn = scene, 1 - group.turn
        group.east, group.north, group.columns, group.rows, group.cells_east, group.cells_north = nodes
        group.volume, group.mass, group.momentum = units
        return group


class LaunchedNodes:
    """Sums that a launch brings to ``host``."""

    def __init__(self, host: Any, cells: tuple[int, int], event: Any):
        self.host, self.cells, self.event = host, cells, event

    def arrived(self, parts: Parts, scene: int) -> tuple[NodeSums, Bounds] | None:
        """The sums and the nodes that the scene covers, once they are on the host; None without any."""
        if self.event is not None:
            wp.synchronize_event(self.event)
        numbers = self.host.numpy().view(np.float64)
        bounds = bounds_in(parts, scene, numbers[:BOUNDS])
        if bounds is None:
            return None
        first, (nx, ny) = nodes_within(bounds, self.cells)
        return NodeSums(first, numbers[BOUNDS : BOUNDS + LANES * nx * ny].reshape(LANES, nx, ny)), bounds


def half_cells(scene: Scene) -> tuple[int, int]:
    """Half cells of the raster of a scene east and north."""
    raster: Raster = scene.raster
    rows, columns = footprints.lattice_shape(raster, footprints.lattice_cell(scene))
    return columns, rows


def nodes_within(bounds: Bounds, cells: tuple[int, int]) -> tuple[tuple[int, int], tuple[int, int]]:
    """First node and number of nodes east and north of a window, as far as it lies on a lattice of so many half cells."""
    (low, high), (x, y) = ([int(n) for n in end] for end in bounds), (n // 2 for n in cells)
    i, j = min(max(low[0], 0), x), min(max(low[1], 0), y)
    return (i, j), (max(min(high[0], x) - i, 0) + 1, max(min(high[1], y) - j, 0) + 1)
