"""Share of an erodible bed in the deposit, from the particles at the end of a run.

Particles that are born of the bed are known by their identity. All particles are laid on the lattice of
:mod:`runout.backends.footprints` once, as the thickness of the deposit is; the mass of the bed goes with them through the same
footprints, as if it were their momentum. Shares therefore lie between 0 and 1, and the integral of share times mass is the mass of
the bed that is left, to rounding.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from runout.backends import footprints
from runout.model.particles import Particles
from runout.model.scene import Scene

CHUNK = 2**18  # particles whose boxes are laid out at once


@dataclass(frozen=True)
class DepositMass:
    """Mass at the end of a run by cell of the raster."""

    # total, of_bed (rows, columns): all mass, and that which is born of the bed [kg]
    total: np.ndarray
    of_bed: np.ndarray

    @classmethod
    def of(cls, scene: Scene, particles: Particles, is_of_bed: np.ndarray) -> "DepositMass":
        """Mass of the particles, some of which (n,) are born of the bed, over the footprints of the thickness of the deposit."""
        raster, cell = scene.raster, footprints.lattice_cell(scene)
        if not len(particles):
            return cls(*np.zeros((2, raster.rows, raster.columns)))
        node = particles.node[:, :2]
        lattice = footprints.Lattice.around(scene, node.min(axis=0), node.max(axis=0) + 2)
        sums = _box_sums(particles, is_of_bed, scene.densities, lattice)
        on_lattice = footprints.spread(sums, lattice, raster, particles.sums(scene.densities).mean_volume)
        whole = footprints.on_whole(footprints.on_raster(on_lattice, raster, cell), raster)
        return cls(whole.mass, whole.momentum[..., 0])

    @property
    def share(self) -> np.ndarray:
        """Mass of the bed over all mass [1], 0 to 1 (rows, columns); NaN without mass."""
        share = np.full(self.total.shape, np.nan)
        np.divide(self.of_bed, self.total, out=share, where=self.total > 0.0)
        return np.clip(share, 0.0, 1.0)


def _box_sums(particles: Particles, is_of_bed: np.ndarray, densities: np.ndarray, lattice: footprints.Lattice) -> np.ndarray:
    """Sums (5, rows from the south, columns) on a lattice: volume [m3], mass of the bed [kg], 0, 0, and mass [kg].

    A particle is a box of a grid cell. It covers three cells of the lattice along each axis, the middle one whole.
    """
    columns, rows = lattice.shape
    sums = np.zeros((5, rows * columns))
    for chunk in (slice(first, first + CHUNK) for first in range(0, len(particles), CHUNK)):
        mass = particles.mass[chunk]
        lanes = {0: mass / densities[particles.release[chunk]], 1: mass * is_of_bed[chunk], 4: mass}
        along, across = (list(_shares(particles, chunk, d, lattice.first[d])) for d in (1, 0))
        for row, part in along:
            for column, other in across:
                for lane, values in lanes.items():
                    sums[lane] += np.bincount(row * columns + column, values * part * other, rows * columns)
    return sums.reshape(5, rows, columns)


def _shares(particles: Particles, chunk: slice, axis: int, first: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The three cells of the lattice (n,), counted from ``first``, that boxes cover along an axis, and their shares (n,)."""
    edge = footprints.HALVES * particles.offset[chunk, axis] - 1.0  # of the box, from the node of the particle
    cell = np.floor(edge).astype(np.int64)
    beyond = edge - cell
    cell += footprints.HALVES * particles.node[chunk, axis].astype(np.int64) - first
    for k, part in enumerate((0.5 * (1.0 - beyond), np.full(len(beyond), 0.5), 0.5 * beyond)):
        yield cell + k, part
