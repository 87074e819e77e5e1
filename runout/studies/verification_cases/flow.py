"""Runs of a flow with records of thickness and energy, in plane strain on a periodic grid or in three dimensions.

Plane strain takes a slice of :data:`ACROSS` cells with one particle a cell across, whose grid repeats. A wall that reflects is the
mirror image of the body.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from runout.backends.protocol import LedgerRow, get_backend
from runout.model.materials import Material
from runout.model.particles import Particles
from runout.model.scene import Raster, Scene
from runout.model.surface import Surface
from runout.physics import elastic
from runout.release import arrangement
from runout.studies.verification_cases.bodies import filled, transfer
from runout.studies.verification_cases.closed_forms import GRAVITY

ACROSS = 4  # cells across a slice: the shortest period of the grid
PERIOD = 4  # cells along an endless slope
CHUNK = 12  # steps of one length: whole transfers
BASE = 40.35  # [cells] of a level floor above the origin


@dataclass(frozen=True)
class Energies:
    """Energy budget since the start, as shares of the drop of potential energy [1].

    ``kinetic`` and ``elastic`` gained, ``basal`` and ``internal`` dissipated, ``transfer``: kinetic energy that the transfers
    between particles and grid lost. ``basal`` is the ground's work on the nodes, of which ``unbooked`` is missing in the ledger.
    """

    drop: float  # [J]
    kinetic: float
    elastic: float
    basal: float
    internal: float
    transfer: float
    unbooked: float

    @property
    def residual(self) -> float:
        """Share that is not accounted for."""
        return 1 - self.kinetic - self.elastic - self.basal - self.internal - self.transfer


@dataclass(frozen=True)
class Frame:
    """A flow at one time [s]: particles (of one layer of a slice), thickness [m] on the raster (rows, columns), energies."""

    time: float
    particles: Particles
    thickness: np.ndarray
    energies: Energies


def level_scene(
    spacing: float,
    size: tuple[float, float],
    material: Material,
    friction: float,
    slope_deg: float = 0.0,
    precision: str = "float64",
    height: float | None = None,
) -> Scene:
    """A level floor under gravity that leans east by ``slope_deg``; ``size`` of the domain [m], zero across for a slice.

    Cells are ``spacing`` [m] wide, and as high unless ``height`` [m] is given.
    """
    height = spacing if height is None else height
    slope, columns = np.radians(slope_deg), round(size[0] / spacing)
    rows = max(1, round(size[1] / spacing))
    raster = Raster(rows, columns, (spacing, spacing if rows > 1 else (ACROSS + 1) * spacing))
    surface = Surface.through(np.full((12, 12), BASE * height), (size[0] / 11, size[0] / 11))
    gravity = (GRAVITY * float(np.sin(slope)), 0.0, -GRAVITY * float(np.cos(slope)))
    return Scene((spacing, spacing, height), surface, raster, (material,), (friction,), gravity, precision=precision)


def slice_of(plane: np.ndarray, volume: float | np.ndarray, scene: Scene) -> Particles:
    """A slice from particles at places (n, 2) [m] along the floor and above it; ``volume`` [m3] of each, in a slice of one cell."""
    h, n = scene.spacing[0], len(plane)
    across = np.repeat((np.arange(ACROSS) + 1.0) * h, n)  # on nodes: half way between them rounding chooses the cell
    along, above = np.tile(plane[:, 0], ACROSS), np.tile(plane[:, 1], ACROSS)
    volumes = np.tile(np.broadcast_to(volume, n), ACROSS)
    p = filled(np.column_stack([along, across, BASE * h + above]), h, scene.materials[0].density, 1.0, h / 4)
    p.volume *= volumes
    p.mass *= volumes
    return p


def staggered(along: np.ndarray, thickness: np.ndarray, width: float, layer: float, scene: Scene) -> tuple[Particles, np.ndarray]:
    """Slice filled like a release (:mod:`runout.release.arrangement`), and how deep below the surface its particles lie (n,) [m].

    ``along`` (n,) [m]: columns of a ``width`` [m] along the floor, filled up to ``thickness`` (n,) [m] in layers of ``layer`` [m].
    """
    h, columns = scene.spacing[0], len(along)
    index = np.stack(np.meshgrid(np.arange(ACROSS), np.arange(columns), indexing="ij"), axis=-1).reshape(-1, 2)[:, ::-1]
    column, above, height = arrangement.layered(index, np.tile(thickness, ACROSS), layer)
    across = (index[column, 1] + 1.0) * h  # on nodes, as in slice_of
    place = np.column_stack([along[index[column, 0]], across, BASE * scene.spacing[2] + above])
    p = filled(place, scene.spacing, scene.materials[0].density, 1.0)
    p.volume *= width * h * height
    p.mass *= width * h * height
    p.radius[:] = arrangement.half_size(height)
    return p, np.tile(thickness, ACROSS)[column] - above


def rectangle(length: float, height: float, spacing: float, start: float = 0.0) -> np.ndarray:
    """Places (n, 2) [m] of particles in a rectangle that begins at ``start`` [m], two of a cell along each axis."""
    x, z = (np.arange(round(2 * s / spacing)) * spacing / 2 + spacing / 4 for s in (length, height))
    return np.stack(np.meshgrid(start + x, z, indexing="ij"), axis=-1).reshape(-1, 2)


def endless_slope(
    material: Material, depth: float, cells: int, slope_deg: float, profile: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
) -> tuple[Scene, Particles, np.ndarray]:
    """A layer in steady flow down an endless slope, on a floor that holds, and the heights (n,) [m] of its particles.

    Along the slope it repeats after :data:`PERIOD` cells. Normal stresses are equal. ``profile`` returns speeds [m/s] and shear
    rates [1/s] at heights [m].
    """
    h, slope = depth / cells, np.radians(slope_deg)
    scene = level_scene(h, ((PERIOD + 1) * h, 0.0), material, 10.0, slope_deg)
    plane = rectangle(PERIOD * h, depth, h, 0.5 * h)
    p = slice_of(plane, h**3 / 4, scene)
    height = np.tile(plane[:, 1], ACROSS)
    bulk = material.lame_lambda + 2 * material.shear_modulus / 3
    for k, stress in enumerate(material.density * GRAVITY * np.cos(slope) * (depth - height)):
        mean, shear = -stress / (3 * bulk), stress * np.tan(slope) / (2 * material.shear_modulus)
        p.strain[k] = elastic.strain_of_log((mean, mean, mean, 0.0, 0.0, shear))
    p.velocity[:, 0], p.affine[:, 0, 2] = profile(height)
    return scene, p, height


def press(p: Particles, depth: np.ndarray, scene: Scene, at_rest: float = 1.0) -> None:
    """Give particles the stress of their weight ``depth`` (n,) [m] below the surface; ``at_rest``: horizontal over vertical."""
    m = scene.materials[0]
    vertical = m.density * scene.gravity[2] * depth
    mean = vertical * (1 + 2 * at_rest) / 3
    bulk = m.lame_lambda + 2 * m.shear_modulus / 3
    strain = mean / (3 * bulk) + np.stack([at_rest * vertical - mean] * 2 + [vertical - mean]) / (2 * m.shear_modulus)
    p.strain[:, :3] = np.expm1(2 * strain).T


def run(
    scene: Scene,
    particles: Particles,
    times: Sequence[float],
    samples: int = 40,
    threads: int = 1,
    along: int = 0,
    alike: bool = True,
) -> list[Frame]:
    """The flow at ``times`` [s]; a scene as wide as a slice repeats across, and ``along`` [cells] if that is not zero.

    The layers of a slice are ``alike``, unless it was :func:`staggered`.

    ``samples`` transfers, spread evenly, are taken by the reference backend too, which counts what they lose.
    """
    engine, shadow = get_backend("scan", threads=threads, index="dense"), _Shadow(scene, along, alike)
    engine.period = (along, ACROSS * (scene.raster.rows == 1), 0)  # type: ignore[attr-defined]
    engine.load(scene, particles)
    start, now, frames, done, dt = engine.ledger(), 0.0, list[Frame](), 0, 0.0
    for end in times:
        while now < end * (1 - 1e-12):
            if done % CHUNK == 0 or now + dt > end:
                dt = min(0.95 * engine.stable_step(), end - now)
            if now * samples >= shadow.taken * times[-1]:
                shadow.look(engine.particles(), now, 0.95 * engine.stable_step(), engine.max_speed)
            steps = transfer(engine, scene, dt, min(CHUNK - done % CHUNK, max(1, int((end - now) / dt))))
            now, done = now + steps * dt, done + steps
        p = engine.particles()
        shadow.look(p, now, 0.95 * engine.stable_step(), engine.max_speed)  # the last step may be of the order of rounding
        columns, cell = engine.columns(), scene.raster.cell_size
        energies = _energies(start, engine.ledger(), shadow.lost)
        frames.append(Frame(now, shadow.layer(p), columns.volume / (cell[0] * min(cell[1], ACROSS * cell[0])), energies))
    return frames


class _Shadow:
    """Losses at transfers and ground that the ledger does not contain, from single transfers of the reference backend."""

    def __init__(self, scene: Scene, along: int, alike: bool):
        self.scene = scene
        self.sliced = scene.raster.rows == 1
        self.layers = ACROSS if self.sliced and alike else 1  # identical layers, of which one is used
        self.losses = TransferLoss((along, ACROSS // self.layers * self.sliced, 0))
        self.taken, self.time, self.lost, self.rates = 0, 0.0, np.zeros(2), np.zeros(2)

    def layer(self, p: Particles) -> Particles:
        """One layer of a slice; all particles in three dimensions."""
        return p.take(np.flatnonzero(p.identity < len(p) // ACROSS)) if self.sliced else p

    def look(self, p: Particles, now: float, dt: float, speed: float) -> None:
        """Take a transfer of steps of ``dt`` [s] at time ``now`` [s] from particles ``p``, the fastest at ``speed`` [m/s]."""
        seen = p if self.layers == 1 else self.layer(p)
        rates = np.array(self.losses.rates(self.scene, seen, dt, self.scene.substep_count(dt, speed))) * self.layers
        self.lost += (now - self.time) * 0.5 * (rates + self.rates)
        self.taken, self.time, self.rates = self.taken + 1, now, rates


def _energies(start: LedgerRow, end: LedgerRow, lost: np.ndarray) -> Energies:
    drop = start.potential_energy - end.potential_energy
    kinetic, stored = end.kinetic_energy - start.kinetic_energy, end.elastic_energy - start.elastic_energy
    basal = end.basal_dissipation - start.basal_dissipation + lost[1]
    internal = end.plastic_dissipation - start.plastic_dissipation
    return Energies(drop, *(float(e / drop) for e in (kinetic, stored, basal, internal, lost[0], lost[1])))


class TransferLoss:
    """Loss of the transfers from particles to nodes without forces, and back. ``period`` (3,) [cells] of the grid."""

    _given: np.ndarray  # velocities [m/s] of nodes as given by particles
    _pushed: list[tuple[np.ndarray, np.ndarray]]  # by substep: those with forces, and, once it is done, with contact

    def __init__(self, period: tuple[int, int, int] = (0, 0, 0)):
        engine: Any = cast(Any, get_backend("reference"))
        engine.watch = self._look
        for axis, cells in enumerate(period):
            if cells:
                engine.period[axis] = cells
        self._engine = engine

    def rates(self, scene: Scene, particles: Particles, dt: float, substeps: int = 1) -> tuple[float, float]:
        """Loss [W] in a transfer of steps of ``dt`` [s]: in passing velocities, and at the ground beyond what is booked there.

        The ground's work on the nodes takes the mean of their velocities before and after each step. What is booked follows from
        the particles, with lumped compliances.
        """
        self._engine.load(scene, particles)
        self._particles, self._pushed = self._engine.particles(), []
        before = self._engine.ledger().kinetic_energy
        self._engine.step(dt, substeps)
        after, mass, begin = self._engine.ledger(), self._mass, self._given
        energy_on_nodes = 0.5 * float(mass @ (begin**2).sum(axis=1))
        ground = 0.0
        for pushed, end in self._pushed:
            ground -= 0.5 * float((mass[:, None] * (end - pushed) * (begin + end)).sum())
            begin = end
        energy_left = 0.5 * float(mass @ (begin**2).sum(axis=1))
        lost = before - energy_on_nodes + energy_left - after.kinetic_energy - after.escaped_energy
        return lost / (substeps * dt), (ground - after.basal_dissipation) / (substeps * dt)

    def _look(self, stencils: Any, mass: np.ndarray, velocity: np.ndarray) -> None:
        """Note the velocities of nodes before contact; the array itself has those after it once the substep is done."""
        self._pushed.append((velocity.copy(), velocity))
        if len(self._pushed) > 1:
            return
        p = self._particles
        momentum = p.mass[:, None, None] * (p.velocity[:, None, :] + np.einsum("pij,pnj->pni", p.affine, stencils.arm))
        occupied = mass > 0.0
        self._given = np.zeros_like(velocity)
        self._given[occupied] = stencils.scatter(momentum)[occupied] / mass[occupied, None]
        self._mass = mass
