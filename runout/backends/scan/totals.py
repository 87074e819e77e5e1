"""Sums over a run: what has escaped or been dissipated since the start, and what the last step found."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from runout.backends.protocol import LedgerRow, box_blocks
from runout.backends.scan.constants import Tables
from runout.backends.scan.groups import Blocks
from runout.backends.scan.observe import ELASTIC, KINETIC, MASS, MOMENTUM, POTENTIAL
from runout.backends.scan.state import Store
from runout.backends.scan.workspace import Workspace


@dataclass
class Totals:
    """Sums since the start of the run, and findings of the last step."""

    max_speed: float  # of any particle [m/s]
    # escaped_mass, escaped_energy: [kg], [J]
    escaped_mass: float = 0.0
    escaped_energy: float = 0.0
    # basal_dissipation, plastic_dissipation: [J]
    basal_dissipation: float = 0.0
    plastic_dissipation: float = 0.0
    basal_impulse: np.ndarray = field(default_factory=lambda: np.zeros(3))  # (3,): [N s]
    contact_particles: int = 0  # particles that touch the ground
    moved: bool = False  # whether any particle changed its cell

    def book_escaped(self, sums: np.ndarray) -> None:
        """Add the sums (7,) of particles that left the domain."""
        self.escaped_mass += float(sums[MASS])
        self.escaped_energy += float(sums[KINETIC] + sums[POTENTIAL] + sums[ELASTIC])

    def row(self, sums: np.ndarray, active: np.ndarray) -> LedgerRow:
        """The row of the ledger for the present sums (7,) of all particles and the coordinates (n, 3) of their blocks."""
        return LedgerRow(
            mass=float(sums[MASS]), escaped_mass=self.escaped_mass,
            momentum=sums[MOMENTUM:KINETIC].copy(), kinetic_energy=float(sums[KINETIC]),
            potential_energy=float(sums[POTENTIAL]), elastic_energy=float(sums[ELASTIC]),
            basal_dissipation=self.basal_dissipation, plastic_dissipation=self.plastic_dissipation,
            escaped_energy=self.escaped_energy, basal_impulse=self.basal_impulse.copy(), max_speed=self.max_speed,
            active_blocks=len(active), box_blocks=box_blocks(active), contact_particles=self.contact_particles,
        )  # fmt: skip


def add_up(
    k: SimpleNamespace, kernel: Any, chosen: np.ndarray, store: Store, blocks: Blocks, workspace: Workspace, tables: Tables
) -> np.ndarray:
    """Sums (7,) by a kernel of :mod:`runout.backends.scan.observe` over the ``chosen`` (nown,) particles of each block."""
    dt = tables.constants.h.dtype.type(tables.packed_dt)
    kernel(store.particles, blocks, chosen, tables.constants, tables.moduli, dt, workspace.sums)
    k.total_rows(workspace.sums, blocks.capacity, blocks.nown, workspace.total)
    return workspace.total
