"""Contact with structures: one impulse per contact particle, after those of the ground, with the velocities that the grid has then.

A second one stops the few particles that would still enter a structure within the step.
"""

from functools import partial
from types import SimpleNamespace

import numpy as np

from runout.backends.reference.contact import Contacts
from runout.backends.reference.stencils import Stencils
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

    def add(self, identity: np.ndarray) -> None:
        """Particles with other identities (n,) join, without a force from a step before."""
        both = np.concatenate([self.identity, identity])
        order = np.argsort(both)
        self.identity, self.force = both[order], np.concatenate([self.force, np.zeros((len(identity), 3))])[order]

    def touch(
        self, p: Particles, found: tuple[Contacts, np.ndarray], way: np.ndarray, stencils: Stencils, mass: np.ndarray,
        velocity: np.ndarray, dt: float, share: float,
    ) -> None:  # fmt: skip
        """Change nodal velocities (nodes, 3) [m/s] in a substep of ``dt`` [s]; it starts from a ``share`` [1] of the last forces.

        ``way`` (n, 3) [m] is that of the particles since the contacts were found.
        """
        contacts, patch = found
        rows = np.searchsorted(self.identity, p.identity)[contacts.chosen]
        given = share * dt * self.force[rows]
        self.force[:] = 0.0
        if not len(patch):
            return
        moved, gap = contacts.moved(self.loops, way), np.zeros(len(patch))
        self.loops.gaps_of(moved, p.radius[contacts.chosen], gap)
        solve = partial(self.loops.take_impulses, gap, contacts.basal, contacts.area, np.ones(len(gap)), dt)
        _, impulses, work, _ = contacts.push(p, given, stencils, mass, velocity, solve)
        self.force[rows] = impulses / dt
        self._book(patch, impulses, work)
        u, enters = stencils.gather(velocity, contacts.chosen), np.zeros(len(patch), np.bool_)
        self.loops.find_entering(u, contacts.normal, moved, dt, self.band, enters)
        if enters.any():
            solve = partial(self.loops.stop_entering, moved[enters], dt, self.band)
            stopped, none = Contacts(*(values[enters] for values in contacts)), np.zeros((int(enters.sum()), 3))
            self._book(patch[enters], *stopped.push(p, none, stencils, mass, velocity, solve)[1:3])

    def _book(self, patch: np.ndarray, impulses: np.ndarray, work: np.ndarray) -> None:
        self.dissipation -= float(work.sum())
        np.subtract.at(self.impulses, patch, impulses)

    def find(self, p: Particles, lasting: float) -> tuple[Contacts, np.ndarray]:
        """Particles that touch within a transfer, which is ``lasting`` [s], and their patches (m,)."""
        field, position = self.field, p.position(np.array(self.scene.spacing))
        near, cell, inside = self._cells(position)
        row = field.blocks[tuple(physics.lattice_block(cell).T)]
        place = physics.lattice_place(*cell.T)
        of_nodes = row[:, None], place[:, None] + CORNERS
        corners = field.distance.reshape(len(field.distance), -1)[of_nodes].astype(np.float64)
        patches = field.patch.reshape(len(field.patch), -1)
        distance, normal = np.zeros(len(near)), np.zeros((len(near), 3))
        self.loops.measure_structures(corners, inside, place, distance, normal)
        patch, touches = patches[row, place], np.zeros(len(near), np.bool_)
        self._take_patch(position[near], patches[of_nodes], distance, normal, patch)
        self.loops.touch_structures(p.velocity[near], p.radius[near], lasting, self.band, distance, normal, touches)
        near, distance, normal, patch = (a[touches] for a in (near, distance, normal, patch))
        basal = np.zeros(len(near), [("friction", np.float64)])
        basal["friction"] = self.friction[p.release[near], patch]
        return Contacts(near, distance, normal, np.zeros(len(near)), basal), patch

    def _take_patch(self, x: np.ndarray, nearest: np.ndarray, distance: np.ndarray, normal: np.ndarray, patch: np.ndarray) -> None:
        """Put the patch that faces the contact most; where the trilinear distance is cut short, the closest plane.

        ``nearest`` (n, 9) are the patches of the nodes.
        """
        patches, spacing = self.field.patches, self.field.spacing
        closest, least, most = patch.copy(), np.full(len(patch), np.inf), (patches.normal[patch] * normal).sum(axis=1)
        for candidate in (patch.copy(), *nearest[:, :8].T):
            plane = ((x - patches.centre[candidate]) * patches.normal[candidate]).sum(axis=1)
            closer = physics.is_closer(plane, least, spacing)
            closest[closer], least[closer] = candidate[closer], plane[closer]
            more = physics.faces_more(facing := (patches.normal[candidate] * normal).sum(axis=1), most)
            patch[more], most[more] = candidate[more], facing[more]
        short = physics.is_closer(distance, least, spacing)
        distance[short], patch[short], normal[short] = least[short], closest[short], patches.normal[closest[short]]

    def _cells(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Particles in a block of the lattice, their cell there and their place in it, 0 to 1 along each axis."""
        q = (position - self.field.origin) / self.field.spacing
        cell = np.floor(q).astype(np.int64)
        within = ((cell >= 0) & (cell < CELLS * np.array(self.field.blocks.shape))).all(axis=1)
        near = np.flatnonzero(within)
        near = near[self.field.blocks[tuple(physics.lattice_block(cell[near]).T)] >= 0]
        return near, cell[near], q[near] - cell[near]
