"""Additional kernels and arrays of a step with transfer apic or aflip, or with F-bar."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from runout.backends.scan.constants import Tables
from runout.backends.scan.groups import Blocks, Gradients
from runout.backends.scan.state import Store, _zeros
from runout.backends.scan.workspace import Workspace
from runout.model.scene import Scene
from runout.physics import transfers


@cache
def without_gradients(real: Any) -> Gradients:
    """What the packed transfer passes in their place."""
    return Gradients(np.zeros((0, 16), real), real(0), np.zeros((0, 16), real), real(0))


def uses_gradient_transfer(scene: Scene) -> bool:
    """Whether a scene needs more than the packed transfer."""
    return not scene.packed or scene.f_bar


def bytes_of_gradient_transfer(scene: Scene, slots: int, nodes: int) -> int:
    """Memory [byte] of the arrays of :class:`GradientTransfer` for so many slots and blocks of nodes."""
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

    def push(self, k: SimpleNamespace, store: Store, blocks: Blocks, workspace: Workspace, tables: Tables, buffer: Any) -> None:
        """Add internal forces to arenas that hold mass and momentum; keep what the particles alone give to the nodes.

        ``buffer`` (threads, rows, 16) has a row for each particle of the fullest block.
        """
        if self.scene.packed:
            return
        w, particles = workspace, store.particles
        if self.scene.keeps:
            if self.given.shape != w.grid.nodes.shape:
                self.given = np.zeros_like(w.grid.nodes)
            k.particles_to_nodes(particles, blocks, w.schedule.late, w.arenas, self.given, self.still)
            if self.scene.surface is not None:
                k.begin_contacts(w.contacts, blocks.nown, w.arenas.number, w.arenas.values)
        k.add_forces(particles, blocks, tables.moduli, self._cells(tables), w.arenas, buffer)

    def take_rates(self, k: SimpleNamespace, store: Store, blocks: Blocks, workspace: Workspace, tables: Tables) -> Gradients:
        """Velocity gradients with their mean dilatation, and velocities that the grid has not seen."""
        w, particles, cells = workspace, store.particles, self._cells(tables)
        if len(self.rates) != len(particles.rec):
            self.rates = _zeros(len(particles.rec), 16, self.scene.dtype)
            self.slips = _zeros(len(particles.rec), 16, self.scene.dtype) if self.scene.keeps else self.rates
        k.take_gradients(particles, blocks, w.grid.nodes, not self.scene.packed, self.rates)
        if self.scene.f_bar:
            k.spread_dilatation(self.rates, particles, blocks, cells, w.arenas)
            k.average_dilatation(w.arenas, blocks.down, blocks.nall, w.grid.nodes)
            k.take_dilatation(self.rates, blocks, w.grid.nodes)
        if self.scene.keeps:
            k.take_slips(particles, blocks, self.given, self.slips)
        return Gradients(self.rates, self.averaged, self.slips, self.keeps)

    def memory(self) -> dict[str, int]:
        """Bytes by array."""
        slips = self.slips.nbytes if self.scene.keeps else 0
        return {"rates": self.rates.nbytes, "slips": slips, "given": self.given.nbytes}

    def _cells(self, tables: Tables) -> tuple[float, ...]:
        """Factor dt / h [s/m] by axis."""
        return tuple(self.scene.dtype(transfers.gradient_slope(float(tables.step.dt), h)) for h in self.scene.spacing)
