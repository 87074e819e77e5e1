"""Contact with structures: one impulse per contact particle, after those of the ground, with the velocities that the grid has then.

A second one stops the few particles that would still enter a structure within the step.
"""

from types import SimpleNamespace

import numpy as np

from runout.backends.reference.stencils import Stencils, quotient
from runout.backends.state import State, arrays_of
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.model.structures import CELLS, StructureField
from runout.physics import structures as physics

NODE = ((CELLS + 1) ** 2, CELLS + 1, 1)  # step of the place in a block along each axis
CORNERS = np.array([i * NODE[0] + j * NODE[1] + k for i in (0, 1) for j in (0, 1) for k in (0, 1)] + [0])  # and none


class StructureContacts:
    """Contacts of a run with the structures of its scene.

    Attributes
    ----------
    impulses : (patches, 3)
        Of the mass on each patch since the start [N s].
    dissipation : float
        Work that the structures took [J].
    force : (n, 3)
        Of the structures on each particle in the last step [N], by identity; from it the next step starts.
    """

    def __init__(self, scene: Scene, field: StructureField, loops: SimpleNamespace, particles: Particles):
        self.scene, self.field, self.loops = scene, field, loops
        self.friction, self.band = scene.structure_friction(), scene.contact_band * min(scene.spacing)
        self.impulses, self.dissipation = np.zeros((len(field.patches.area), 3)), 0.0
        self.identity, self.force = particles.identity.copy(), np.zeros((len(particles), 3))

    def checkpoint(self, prefix: str) -> State:
        """What the next step needs, by name."""
        return arrays_of(self, ("friction",), prefix)

    def touch(self, p: Particles, stencils: Stencils, mass: np.ndarray, velocity: np.ndarray, dt: float) -> None:
        """Change nodal velocities (nodes, 3) [m/s] by the impulses of the structures in a step of ``dt`` [s]."""
        rows = np.searchsorted(self.identity, p.identity)
        chosen, gap, normal, patch = self._found(p, dt)
        given = dt * self.force[rows[chosen]]
        self.force[:] = 0.0
        if not len(chosen):
            return
        compliance = stencils.gather(quotient(stencils.scatter(np.ones((len(chosen), 1)), chosen), mass), chosen)[:, 0]
        velocity += quotient(stencils.scatter(given, chosen), mass)
        u, impulses, work = stencils.gather(velocity, chosen), given.copy(), np.zeros(len(chosen))
        basal = np.zeros(len(chosen), [("friction", np.float64)])
        basal["friction"] = self.friction[p.release[chosen], patch]
        area = np.zeros(len(chosen))
        self.loops.take_impulses(p.velocity[chosen], u, normal, gap, compliance, basal, area, dt, impulses, work)
        velocity += quotient(stencils.scatter(impulses - given, chosen), mass)
        self.force[rows[chosen]] = impulses / dt
        self._book(patch, impulses, work)
        self._stop(p, stencils, mass, velocity, dt, (chosen, gap, normal, patch))

    def _stop(
        self, p: Particles, stencils: Stencils, mass: np.ndarray, velocity: np.ndarray, dt: float, contacts: tuple[np.ndarray, ...]
    ) -> None:
        """Keep the centres of all particles outside."""
        chosen, gap, normal, patch = contacts
        inverse = quotient(np.ones(mass.shape), mass)[stencils.node[chosen], 0]
        compliance = physics.own_compliance(0.0, stencils.weight[chosen], inverse).sum(axis=1)
        impulses, work, u = np.zeros((len(chosen), 3)), np.zeros(len(chosen)), stencils.gather(velocity, chosen)
        stops = self.loops.stop_before_structures
        stops(p.velocity[chosen], u, normal, gap, p.radius[chosen], dt, self.band, compliance, impulses, work)
        if impulses.any():
            velocity += quotient(stencils.scatter(impulses, chosen), mass)
            self._book(patch, impulses, work)

    def _book(self, patch: np.ndarray, impulses: np.ndarray, work: np.ndarray) -> None:
        self.dissipation -= float(work.sum())
        np.subtract.at(self.impulses, patch, impulses)

    def _found(self, p: Particles, dt: float) -> tuple[np.ndarray, ...]:
        """Particles that touch, with their gap [m], normal and patch."""
        field, spacing = self.field, np.array(self.scene.spacing)
        near, cell, inside = self._cells(p.position(spacing))
        block = tuple(physics.lattice_block(cell).T)
        row, place = field.blocks[block], physics.lattice_place(*cell.T)
        corners = field.distance.reshape(len(field.distance), -1)[row[:, None], place[:, None] + CORNERS].astype(np.float64)
        gap, normal, touches = np.zeros(len(near)), np.zeros((len(near), 3)), np.zeros(len(near), np.bool_)
        finds = self.loops.find_structure_contacts
        finds(p.velocity[near], p.radius[near], dt, self.band, corners, inside, place, gap, normal, touches)
        patch = field.patch.reshape(len(field.patch), -1)[row, place]
        return near[touches], gap[touches], normal[touches], patch[touches]

    def _cells(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Particles in a block of the lattice, their cell there and their place in it, 0 to 1 along each axis."""
        q = (position - self.field.origin) / self.field.spacing
        cell = np.floor(q).astype(np.int64)
        within = ((cell >= 0) & (cell < CELLS * np.array(self.field.blocks.shape))).all(axis=1)
        near = np.flatnonzero(within)
        near = near[self.field.blocks[tuple(physics.lattice_block(cell[near]).T)] >= 0]
        return near, cell[near], q[near] - cell[near]
