"""What a step does more where the transfer is not the packed one, or where F-bar averages: kernels and arrays of such scenes."""

from typing import TYPE_CHECKING, Any

import numpy as np

from runout.backends.scan.state import _zeros
from runout.model.scene import Scene
from runout.physics import transfers

if TYPE_CHECKING:
    from runout.backends.scan.backend import ScanBackend


def uses_gradient_transfer(scene: Scene) -> bool:
    """Whether a scene needs more than the packed transfer, which has kernels of its own."""
    return not scene.packed or scene.f_bar


def bytes_of_gradient_transfer(scene: Scene, slots: int, nodes: int) -> int:
    """Memory [byte] of the arrays of :class:`General` for so many slots and blocks of nodes."""
    rows = 2 if scene.keeps else 1 if uses_gradient_transfer(scene) else 0
    return int(np.dtype(scene.dtype).itemsize * (16 * rows * slots + 256 * nodes * bool(scene.keeps)))


class GradientTransfer:
    """Steps of a scene with transfer apic or aflip, or with F-bar.

    Attributes
    ----------
    rates : (slots, 16)
        See :mod:`runout.backends.scan.gradients`; scratch of a step.
    slips : (slots, 16)
        As well, of aflip alone; else the rates stand for them, times zero.
    given : (nall, 256)
        Mass and velocity of the nodes before any force; of aflip alone.
    """

    def __init__(self, scene: Scene):
        self.scene, real = scene, scene.dtype
        self.averaged, self.keeps = real(scene.f_bar), real(scene.keeps)
        self.still = np.zeros(16, real)  # no gravity
        self.rates = self.slips = self.given = np.zeros((0, 16), real)

    def push(self, engine: "ScanBackend") -> None:
        """Add internal forces to arenas that hold mass and momentum; keep what the particles alone give to the nodes."""
        if self.scene.packed:
            return
        i, s, a, k = engine.index, engine.store, engine.arenas, engine.k
        if self.scene.keeps:
            if self.given.shape != a.grid.shape:
                self.given = np.zeros_like(a.grid)
            k.particles_to_nodes(
                s.rec, s.order, i.starts, i.first, a.giving, 0, *engine.schedule.late, a.number, a.arenas, a.free.shape[1], a.free,
                engine.cursors[: engine.threads], a.reached, i.down, self.given, self.still,
            )  # fmt: skip
            if self.scene.surface is not None:
                k.begin_contacts(s.contacts, s.given, a.place, a.touching, i.nown, a.number, a.arenas)
        k.add_forces(
            s.rec, s.state, s.particle_index, s.label, s.order, i.starts, i.first, i.nown, engine.mats, self._cells(engine),
            a.number, a.arenas, engine.buffers[0],
        )  # fmt: skip

    def take_rates(self, engine: "ScanBackend") -> tuple[Any, ...]:
        """Velocity gradients with their mean dilatation, and velocities that the grid has not seen, as the motion takes them."""
        i, s, a, k, cells = engine.index, engine.store, engine.arenas, engine.k, self._cells(engine)
        if len(self.rates) != len(s.rec):
            self.rates = _zeros(len(s.rec), 16, self.scene.dtype)
            self.slips = _zeros(len(s.rec), 16, self.scene.dtype) if self.scene.keeps else self.rates
        k.take_gradients(s.rec, s.order, i.starts, i.first, i.nown, a.grid, i.up, not self.scene.packed, self.rates)
        if self.scene.f_bar:
            k.spread_dilatation(self.rates, s.state, s.order, i.starts, i.first, i.nown, cells, a.number, a.arenas)
            k.average_dilatation(a.arenas, a.number, a.reached, i.down, i.nall, a.grid)
            k.take_dilatation(self.rates, i.starts, i.first, i.nown, a.grid, i.up)
        if self.scene.keeps:
            k.take_slips(s.rec, s.order, i.starts, i.first, i.nown, self.given, i.up, self.slips)
        return self.rates, self.averaged, self.slips, self.keeps

    def memory(self) -> dict[str, int]:
        """Bytes by array."""
        slips = self.slips.nbytes if self.scene.keeps else 0
        return {"rates": self.rates.nbytes, "slips": slips, "given": self.given.nbytes}

    def _cells(self, engine: "ScanBackend") -> tuple[float, ...]:
        """Factor dt / h [s/m] by axis."""
        real = self.scene.dtype
        return tuple(real(transfers.gradient_slope(float(engine.dt), h)) for h in self.scene.spacing)
