"""Particles to nodes and what touches the ground, with room made where it is lacking: what a step calls of these kernels.

A kernel sums nodes as soon as it has what they need; where several threads share them, it is called once more for these alone, so
that every node is summed by the same machine code, and the same bits come out of any number of threads.
"""

from typing import TYPE_CHECKING, Any

from runout.backends.scan.state import PADDING, stamp_of
from runout.physics import contact as contact_law

if TYPE_CHECKING:
    from runout.backends.scan.backend import ScanBackend

SPARE = 16  # blocks that may get contacts before more memory is made


def fill(engine: "ScanBackend") -> None:
    """Mass and velocity of the nodes; again where arenas are lacking."""
    i, a, kernel = engine.index, engine.arenas, engine.k.particles_to_nodes
    before, behind = _arguments(engine)
    while (wanted := int(kernel(*before, i.nown, *engine.schedule.early, *behind))) > a.free.shape[1]:
        a.make_arenas(wanted)
        before, behind = _arguments(engine)
    if engine.gradient_transfer:
        engine.gradient_transfer.push(engine)
    if engine.schedule.waits:
        kernel(*before, 0, *engine.schedule.late, *behind)


def _arguments(engine: "ScanBackend") -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """What the kernel takes before the number of owners and behind the schedule."""
    i, s, a = engine.index, engine.store, engine.arenas
    return (s.rec, s.order, i.starts, i.first, a.giving), (
        *(a.number, a.arenas, a.free.shape[1], a.free, engine.cursors[: engine.threads]),
        *(a.reached, i.down, a.grid, engine.dv),
    )


def fill_over_ground(engine: "ScanBackend", dt: float) -> None:
    """The same over a ground, and the particles that touch it; again where rows, shares or arenas are lacking."""
    s, a, threads, kernel = engine.store, engine.arenas, engine.threads, engine.k.particles_to_nodes_over_ground
    while True:
        before, behind = _arguments_over_ground(engine, dt)
        arenas, rows, shares, touching = kernel(*before, engine.index.nown, *engine.schedule.early, *behind)
        enough = True
        if arenas > a.free.shape[1]:
            a.make_arenas(arenas)
            enough = False
        if rows > _rows(engine):
            s.make_contacts((rows + rows // 8 + PADDING) * threads)
            enough = False
        if shares > _shares(engine):
            a.make_shares((shares + shares // 8 + SPARE) * threads)
            enough = False
        if enough:
            break
    engine.contact_particles = touching
    if engine.gradient_transfer:
        engine.gradient_transfer.push(engine)
    if engine.schedule.waits:
        kernel(*before, 0, *engine.schedule.late, *behind)


def _rows(engine: "ScanBackend") -> int:
    """Rows of contacts that a thread has."""
    return len(engine.store.felt) // engine.threads & ~15


def _shares(engine: "ScanBackend") -> int:
    """Places for shares that a thread has."""
    return max(len(engine.arenas.shares) - 1, 0) // engine.threads


def _arguments_over_ground(engine: "ScanBackend", dt: float) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """What the kernel takes before the number of owners and behind the schedule."""
    i, s, a, scene = engine.index, engine.store, engine.arenas, engine.scene
    band = scene.contact_band * min(scene.spacing)
    reach = scene.dtype(contact_law.reach(engine.largest_radius, engine.max_speed, dt, band))
    radius = s.radius[:1] if engine.of_one_size else s.radius
    return (s.rec, s.particle_index, radius, s.label, s.cell, s.order, i.starts, i.first, a.giving), (
        *(a.tiles, a.planes, a.bounds, engine.friction, s.force, _stamp(engine, -1), not scene.keeps),
        *(reach, engine.dt, engine.h, scene.dtype(band)),
        *(a.number, a.arenas, a.free.shape[1], a.free, engine.cursors[: engine.threads], a.reached),
        *(s.listed, a.candidates, a.touching, a.pressed, s.contacts, s.measured, s.given, _rows(engine), a.shares, _shares(engine)),
        *(a.place, a.sharer, i.down, a.grid, a.shared, a.inverse, engine.dv),
    )


def _stamp(engine: "ScanBackend", later: int) -> Any:
    """Stamp of the present step, or of one so much later."""
    return engine.scene.dtype(stamp_of(engine.counters.steps + later))


def push(engine: "ScanBackend") -> None:
    """Add the impulses of the contacts to the velocities of the nodes; their sums are in ``room.total``."""
    i, s, a, kernel = engine.index, engine.store, engine.arenas, engine.k.solve_contacts
    before = (
        *(s.contacts, s.measured, s.felt, s.given, a.place, a.touching, a.pressed),
        *(s.listed, i.first, s.particle_index, s.force, _stamp(engine, 0)),
    )
    behind = (
        *(a.grid, i.up, i.down, engine.dt, a.lent, a.arenas, a.free.shape[1], a.free, engine.cursors[: engine.threads]),
        *(a.shared, a.inverse, a.asleep, a.ground),
    )
    kernel(*before, i.nown, *engine.schedule.early, *behind, a.total)
    if engine.schedule.waits:
        kernel(*before, 0, *engine.schedule.late, *behind, a.nothing)
