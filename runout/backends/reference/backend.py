"""Reference backend: one dense grid around all particles, NumPy in float64.

Slow and simple; the others are tested against it. Quadratic B-splines, APIC with the stress packed into the affine matrix (Hu
et al. 2018, ACM TOG 37:150, eq. 16 to 29), symplectic Euler, one ground impulse per contact particle.
"""

from functools import cache, partial
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from runout.backends import footprints, plan_areas
from runout.backends.compile import array_binding, numba_binding
from runout.backends.loading import require_movable
from runout.backends.plan_areas import begun_impulses, column_drags, contact_areas, layer_thicknesses, slow_columns
from runout.backends.protocol import Counters, LedgerRow, NodeSums, RasterSums, Sinking, box_blocks
from runout.backends.reference import particles as loops_source
from runout.backends.reference.contact import Contacts
from runout.backends.reference.stencils import LARGEST_GRID, Stencils, quotient
from runout.backends.reference.structures import StructureContacts
from runout.backends.state import State, arrays_of, part, put_arrays
from runout.errors import StabilityError
from runout.model.friction_laws import FrictionLaw, numbers_of
from runout.model.laws import Law
from runout.model.particle_source import ParticleSource, gathered
from runout.model.particles import Particles, joined_mean, require_index_range
from runout.model.scene import Scene
from runout.physics import blocks, bspline, contact, substeps
from runout.physics.bed import sunk

MATRIX = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])  # where the components xx, yy, zz, xy, yz, zx stand


@cache
def compiled_loops(law: Law, friction: FrictionLaw) -> SimpleNamespace:
    """Loops over particles for two laws, float64, without fused operations: bitwise what plain Python gives."""
    binding = numba_binding(np.float64, False)
    return binding.kernels(
        loops_source, law_step=binding.law(law).effective_step, impulse=binding.friction(friction).effective_impulse
    )


def create(threads: int | None = None) -> "ReferenceBackend":
    """A reference backend; it runs on one thread, ``threads`` has no effect."""
    return ReferenceBackend()


class _Motion(NamedTuple):
    """Way (n, 3) [m] of the particles since the start of a transfer, and its gradient (n, 9) [1]."""

    way: np.ndarray
    deformation: np.ndarray

    @classmethod
    def none(cls, particles: int) -> "_Motion":
        """That at the start."""
        return cls(np.zeros((particles, 3)), np.zeros((particles, 9)))


class ReferenceBackend:
    """Plain implementation of :class:`runout.backends.protocol.Backend`; ``period``, ``watch`` and ``push`` serve verification."""

    def __init__(self) -> None:
        self.counters = Counters()
        self.period = np.full(3, LARGEST_GRID)  # [cells] after which the grid, not the ground, repeats; may be set
        self.watch: Any = lambda *_: None  # called by substep with stencils, nodal mass, velocity before contact; may be set
        self._pushes: list[np.ndarray] = []

    def load(self, scene: Scene, particles: ParticleSource, more: int = 0) -> None:
        """Load a scene and its particles; sums and counters start at zero."""
        given = gathered(particles)
        require_index_range(given.node, scene.spacing)
        self.counters, self.scene = Counters(), scene
        self.spacing = np.array(scene.spacing, np.float64)
        self.inverse_inertia = bspline.inverse_inertia(self.spacing)
        self.loops = compiled_loops(scene.law, scene.basal.law)
        self.table, self.basal = scene.law.table(scene.materials, cell_size=min(scene.spacing)), scene.basal.table()
        self.pores = scene.pore_table()
        self._p = given.take(np.argsort(given.identity, kind="stable"))
        self.particle_volume, self.loaded = given.sums(scene.densities).mean_volume, len(given)
        self._basal = self._plastic = self._escaped_mass = self._escaped_energy = 0.0
        self._contacts, self._basal_impulse, self._dt = 0, np.zeros(3), 0.0
        self.structures = None
        if scene.structures:
            loops = compiled_loops(scene.law, numbers_of(0.0)[0])  # the law of a friction coefficient
            self.structures = StructureContacts(scene, scene.structures, loops, self._p)

    def add(self, particles: Particles) -> None:
        """Add particles to those that are there; sums and counters go on."""
        require_movable(particles)
        both = self._p.joined(particles)
        require_index_range(both.node, self.scene.spacing)
        more, volume = len(particles), particles.sums(self.scene.densities).mean_volume
        self.particle_volume = joined_mean(self.particle_volume, self.loaded, volume, more)
        self.loaded += more
        self._p = both.take(np.argsort(both.identity, kind="stable"))
        if self.structures:
            self.structures.add(particles.identity)

    def lower(self, first: tuple[int, int], depth: np.ndarray, flow: Sinking | None = None) -> None:
        """Lower the ground at the nodes from the ``first`` on by a ``depth`` (nx, ny) [m]; the ``flow`` above follows."""
        assert self.scene.ground is not None
        self.scene.ground.lower(first, depth)
        if flow is None:
            return
        p, h = self._p, self.spacing
        tables = np.pad(flow.column, ((0, 0), (3, 3), (3, 3)))  # nodes beyond the part do not fall
        i, j = (np.clip(p.node[:, k] - flow.first[k] + 3, 0, tables.shape[k + 1] - 3) for k in range(2))
        nine = [tables[:, i + a, j + b] for a in range(3) for b in range(3)]
        physics = array_binding()
        (fall, ground), east, north = physics.heightfield.surface_at(nine, p.offset[:, 0], p.offset[:, 1])
        touching = p.radius / physics.heightfield.normal_z(east[1] / h[0], north[1] / h[1])
        x, y, z = (p.node + p.offset).T
        chance = physics.bed.chance_at(x, y, flow.turn)
        way = np.array([sunk(*one) for one in zip(z * h[2] - ground, fall, touching, chance, strict=True)])
        p.offset[:, 2] = np.maximum(p.offset[:, 2] - way / h[2], 0.5)  # in its cell

    @property
    def max_speed(self) -> float:
        """Largest speed [m/s] of any particle."""
        return self._max_speed()

    def stable_step(self) -> float:
        """Largest admissible time step [s] from the acoustic and the particle limit."""
        return self.scene.stable_step(self._max_speed())

    def step(self, dt: float, substeps: int = 1) -> None:
        """One transfer of ``substeps`` explicit substeps of ``dt`` [s]."""
        self.scene.require_stable(dt, self._max_speed(), self.counters.steps + 1)
        self.scene.require_substeps(substeps)
        self.counters.add(substeps, len(self._p))
        self._contacts, self._dt, self._share = 0, dt, contact.kept_share(dt, self._dt)
        if not len(self._p):
            return
        self.counters.rebuilds += 1
        stencils = Stencils(self._p, self.spacing, self.period)
        mass, velocity = self._particles_to_grid(stencils, dt)
        thickness = layer_thicknesses(self.scene, self._p, stencils, mass) if self.scene.is_wet else None
        moved, lasting = _Motion.none(len(self._p)), substeps * dt
        on_ground = self._find_ground(stencils, lasting) if self.scene.surface is not None else None
        on_structures = self.structures.find(self._p, lasting) if self.structures else None
        for substep in range(substeps):
            if substep:
                self._grid_to_particles(stencils, velocity, dt, moved)
                velocity = self._pushed_nodes(stencils, mass, velocity, dt, moved)
            self._drain(thickness, dt)
            self.watch(stencils, mass[:, 0], velocity)
            if on_ground:
                self._touch_ground(on_ground, moved.way, stencils, mass, velocity, dt, first=not substep)
            if self.structures and on_structures:
                share = 1.0 if substep else self._share
                self.structures.touch(self._p, on_structures, moved.way, stencils, mass, velocity, dt, share)
        self._grid_to_particles(stencils, velocity, dt, moved)
        self._pushes = []
        self._move(moved.way, lasting)
        self._let_escape()

    def push(self, change: np.ndarray) -> None:
        """Add ``change`` (n, 3) [m/s] to the velocities: a body force of verification; particles ordered by identity.

        With (substeps, n, 3) the further rows act in the further substeps of the next transfer.
        """
        first, *self._pushes = np.reshape(change, (-1, *self._p.velocity.shape))
        self._p.velocity += first

    def particles(self) -> Particles:
        """Present particles, ordered by identity."""
        return self._p.take(np.arange(len(self._p)))

    def checkpoint(self) -> State:
        """The state between two steps."""
        state = (
            arrays_of(self, ("table", "basal", "pores", "_effective"), "own.")
            | arrays_of(self._p, (), "p.")
            | arrays_of(self.counters, (), "done.")
        )
        return state | (self.structures.checkpoint("structures.") if self.structures else {})

    def restore(self, scene: Scene, state: State) -> None:
        """Continue from a state of the same scene."""
        self.load(scene, Particles(**part(state, "p.")))
        put_arrays(self, state, "own.")
        put_arrays(self.counters, state, "done.")
        if self.structures:
            put_arrays(self.structures, state, "structures.")

    def structure_impulses(self) -> np.ndarray:
        """Impulse (patches, 3) [N s] of the mass on each patch since the start."""
        return self.structures.impulses.copy() if self.structures else np.zeros((0, 3))

    def ledger(self) -> LedgerRow:
        """Sums of the present state."""
        p, active, (kinetic, potential, elastic) = self._p, np.unique(blocks.block_of(self._p.node), axis=0), self._energies()
        return LedgerRow(
            mass=float(p.mass.sum()), escaped_mass=self._escaped_mass, momentum=p.mass @ p.velocity,
            kinetic_energy=float(kinetic.sum()), potential_energy=float(potential.sum()), elastic_energy=float(elastic.sum()),
            basal_dissipation=self._basal, plastic_dissipation=self._plastic, escaped_energy=self._escaped_energy,
            basal_impulse=self._basal_impulse.copy(),
            structure_dissipation=self.structures.dissipation if self.structures else 0.0, max_speed=self._max_speed(),
            active_blocks=len(active), box_blocks=box_blocks(active), contact_particles=self._contacts,
        )  # fmt: skip

    def memory_bytes(self) -> int:
        """Memory [byte] of the particles; the grid lives for one step."""
        return sum(values.nbytes for values in vars(self._p).values())

    def columns(self) -> RasterSums:
        """Sums over the columns of the raster's cells."""
        return footprints.columns_of(self.scene, self._p, self.particle_volume)

    def flow_columns(self) -> RasterSums:
        """The same: this backend knows no window."""
        return self.columns()

    def lattice_columns(self) -> RasterSums:
        """Sums over the cells of the lattice of footprints."""
        return footprints.lattice_columns(self.scene, self._p, self.particle_volume)

    def node_columns(self) -> NodeSums | None:
        """Sums around nodes of the plan."""
        return footprints.node_columns(self.scene, self._p)

    def plan_masses(self, first: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
        """Masses (releases, 2, nx, ny) by release around nodes of the plan."""
        return plan_areas.weighed_particles(self.scene, self._p, first, shape)

    def _drain(self, thickness: np.ndarray | None, dt: float) -> None:
        """Drain pore pressure over a substep, and note the shares (n,) of the normal stress that grains carry in its middle."""
        p, self._effective = self._p, np.ones(len(self._p))
        if thickness is not None:
            self.loops.drain(p.pore_excess, p.pore_left, thickness, p.release, self.pores, dt, self._effective)

    def _particles_to_grid(self, stencils: Stencils, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Nodal mass (nodes, 1) [kg], and velocity (nodes, 3) [m/s] as given by particles, with internal force and gravity."""
        p, (stress, _) = self._p, self._stress_and_energy()
        impulse = (-dt * p.volume)[:, None, None] * stress[:, MATRIX]
        affine = p.mass[:, None, None] * p.affine + impulse * self.inverse_inertia
        momentum = (p.mass[:, None] * p.velocity)[:, None, :] + np.einsum("pij,pnj->pni", affine, stencils.arm)
        mass = stencils.scatter(p.mass[:, None])
        return mass, quotient(stencils.scatter(momentum), mass) + dt * np.array(self.scene.gravity)

    def _pushed_nodes(self, stencils: Stencils, mass: np.ndarray, velocity: np.ndarray, dt: float, moved: "_Motion") -> np.ndarray:
        """Nodal velocities with the internal force of the present stress, gravity and a body force over a substep."""
        (stress, _), at_start = self._stress_and_energy(), np.zeros((len(self._p), 9))
        self.loops.refer_stress(stress, moved.deformation, at_start)
        impulse = (-dt * self._p.volume)[:, None, None] * at_start.reshape(-1, 3, 3) * self.inverse_inertia
        velocity = velocity + quotient(stencils.scatter(np.einsum("pij,pnj->pni", impulse, stencils.arm)), mass)
        velocity += dt * np.array(self.scene.gravity)
        if self._pushes:
            velocity += quotient(stencils.scatter(self._p.mass[:, None] * self._pushes.pop(0)), mass)
        return velocity

    def _find_ground(self, stencils: Stencils, lasting: float) -> Contacts:
        """Particles that touch the ground within a transfer, which is ``lasting`` [s]."""
        x, touches = self._p.position(self.spacing), np.zeros(len(self._p), np.bool_)
        elevation, east, north = self.scene.ground.evaluate(x[:, 0], x[:, 1])  # type: ignore[union-attr]
        gap, normal = x[:, 2] - elevation, np.column_stack([east, north, np.ones(len(x))])
        band = self.scene.contact_band * self.spacing.min()
        self.loops.find_contacts(self._p.velocity, self._p.radius, lasting, band, gap, normal, touches)
        self._contacts = len(chosen := np.flatnonzero(touches))
        way = substeps.time_ahead(lasting, self._dt) * self._p.velocity[chosen]
        gap, normal = self._ground_ahead(self._p.take(chosen), x[chosen], way)
        area = contact_areas(self.scene, stencils, chosen, normal[:, 2])
        basal = self.basal[self.scene.basal.rows(self._p.release[chosen], *(x[chosen] + way).T[:2])]
        return Contacts(chosen, gap, normal, area, basal)

    def _ground_ahead(self, p: Particles, x: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gap [m] of particles at ``x`` (n, 3) [m] from the tangent plane of the ground at the end of a ``way`` (n, 3) [m], and
        its unit normal."""
        elevation, east, north = self.scene.ground.evaluate(x[:, 0], x[:, 1], (way[:, 0], way[:, 1]))  # type: ignore[union-attr]
        gap, normal, referred = (x + way)[:, 2] - elevation, np.column_stack([east, north, np.ones(len(x))]), np.zeros(len(x))
        self.loops.find_contacts(p.velocity, p.radius, 0.0, 0.0, gap, normal, np.zeros(len(x), np.bool_))
        self.loops.move_gaps(gap, normal, -way, referred)
        return referred, normal

    def _touch_ground(
        self, contacts: Contacts, way: np.ndarray, stencils: Stencils, mass: np.ndarray, velocity: np.ndarray, dt: float,
        *, first: bool,
    ) -> None:  # fmt: skip
        """Change nodal velocities by one impulse of the ground per contact particle; the ``first`` substep starts from a share."""
        chosen, _, _, area, basal = contacts
        p, gap = self._p.take(chosen), contacts.moved(self.loops, way)
        given = self._share * begun_impulses(self.scene, p, dt) if first else dt * p.ground_force
        solve = partial(self.loops.take_impulses, gap, basal, area, self._effective[chosen], dt)
        u, impulses, work, compliance = contacts.push(self._p, given, stencils, mass, velocity, solve)
        self._p.ground_force[:], self._p.ground_force[chosen] = 0.0, impulses / dt
        self._basal -= float(work.sum())
        self._basal_impulse += impulses.sum(axis=0)
        if self.scene.basal.law.drags_column:
            drags = column_drags(self.scene, u, contacts, impulses, compliance, dt)
            done, push = slow_columns(self.scene, self._p, stencils, mass, velocity, stencils.scatter(drags, chosen), dt)
            self._basal, self._basal_impulse = self._basal - done, self._basal_impulse + push

    def _grid_to_particles(self, stencils: Stencils, velocity: np.ndarray, dt: float, moved: "_Motion") -> None:
        """Velocities and strain of the particles after a substep; adds it to what they have ``moved`` in the transfer."""
        p, work, seen = self._p, np.zeros(len(self._p)), velocity[stencils.node]
        p.velocity = stencils.gather(velocity)
        p.affine = np.einsum("pn,pni,pnj->pij", stencils.weight, seen, stencils.arm) * self.inverse_inertia
        gradient = dt * p.affine.reshape(-1, 9)
        moved.way[:] += dt * p.velocity
        self.loops.follow_deformation(gradient, moved.deformation)
        self.scene.law.set_step(self.table, dt)
        self.loops.follow_law(p.strain, gradient, p.history, p.release, self.table, self._effective, work)
        self._plastic += float(p.volume @ work)

    def _move(self, way: np.ndarray, lasting: float) -> None:
        p, cells = self._p, way / self.spacing
        if not np.abs(cells).max() < 1.0:  # not a number is refused too
            moved = f"{np.abs(cells).max():.3g} cells in step {self.counters.steps} of {lasting:.3g} s"
            raise StabilityError(f"a particle moved {moved}; use a smaller cfl")
        offset = p.offset + cells
        shift = np.floor(offset - 0.5)
        p.offset = offset - shift
        p.node = (p.node + shift).astype(p.node.dtype)

    def _let_escape(self) -> None:
        """Remove particles that have left the domain and book their mass and energy."""
        inside = self.scene.holds(*self._p.position(self.spacing).T[:2])
        if inside.all():
            return
        self._escaped_mass += float(self._p.mass[~inside].sum())
        self._escaped_energy += float(sum(energy[~inside].sum() for energy in self._energies()))
        self._p = self._p.take(inside)

    def _stress_and_energy(self) -> tuple[np.ndarray, np.ndarray]:
        """Kirchhoff stress (n, 6) [Pa] and stored energy (n,) [J/m3]."""
        stress, energy = np.zeros((len(self._p), 6)), np.zeros(len(self._p))
        self.loops.take_stress(self._p.strain, self._p.release, self.table, stress, energy)
        return stress, energy

    def _energies(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Kinetic (with the affine part), potential and elastic energy (n,) [J] of each particle."""
        p = self._p
        affine = (p.affine**2 / self.inverse_inertia).sum(axis=(1, 2))
        kinetic = 0.5 * p.mass * ((p.velocity**2).sum(axis=1) + affine)
        potential = -p.mass * (p.position(self.spacing) @ np.array(self.scene.gravity))
        return kinetic, potential, p.volume * self._stress_and_energy()[1]

    def _max_speed(self) -> float:
        return float(np.linalg.norm(self._p.velocity, axis=1).max(initial=0.0))
