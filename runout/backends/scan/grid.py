"""Phase "grid": the calls that fill the nodes and add the impulses of the contacts, with more memory where some is lacking.

The order of the calls is

    particles_to_nodes              early pass: owners and nodes
    particles_to_nodes_over_ground  late pass: nodes that two threads share
    solve_contacts                  early pass, late pass
    substep, solve_contacts         early pass, late pass of each, for every further substep

A kernel sums nodes as soon as their arenas are complete. Where several threads share nodes, the same kernel is called once more for
these alone: all nodes are summed by the same machine code, so that the bits do not depend on the number of threads.
"""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np

from runout.backends.scan.constants import Tables
from runout.backends.scan.contact_detection import _rows_of_thread, _shares_of_thread
from runout.backends.scan.groups import Blocks, Buffers, ContactSearch, Pass, TimeStep
from runout.backends.scan.pore_pressure import Pores
from runout.backends.scan.state import PADDING, Store, stamp_of
from runout.backends.scan.totals import Totals
from runout.backends.scan.workspace import Workspace
from runout.model.scene import Scene
from runout.physics import contact as contact_law
from runout.physics.substeps import time_ahead

SPARE = 16  # blocks that may get contacts before more memory is made


def fill(k: SimpleNamespace, store: Store, blocks: Blocks, workspace: Workspace, tables: Tables) -> None:
    """Mass and velocity of the nodes."""

    def run(schedule: Pass) -> int:
        w = workspace
        return int(k.particles_to_nodes(store.particles, blocks, schedule, w.arenas, w.grid, tables.constants.dv))

    while (wanted := run(workspace.schedule.early)) > workspace.arenas.free.shape[1]:
        workspace.make_arenas(wanted)
    if workspace.schedule.waits:
        run(workspace.schedule.late)


def search_of(scene: Scene, store: Store, max_speed: float, dt: float, substeps: int, before: int) -> ContactSearch:
    """Numbers by which contacts are found for so many ``substeps`` of ``dt`` [s], with ``before`` in the run."""
    band, lasting = scene.contact_band * min(scene.spacing), substeps * dt
    reach = contact_law.reach(store.largest_radius, max_speed, lasting, band)
    real, law, fastest = scene.dtype, scene.basal.law, math.inf
    if law.uses_area:
        fastest = contact_law.fastest_start(min(scene.spacing), math.hypot(*scene.gravity), dt)
    stamp, ahead = stamp_of(before), time_ahead(lasting, dt)
    limit = np.where(scene.basal.limits_start, fastest, math.inf).astype(real) if law.starts_differ else real(fastest)
    return ContactSearch(real(reach), real(band), real(stamp), limit, real(lasting), real(ahead))


def fill_over_ground(
    k: SimpleNamespace, store: Store, blocks: Blocks, workspace: Workspace, tables: Tables, search: ContactSearch
) -> int:
    """The same over a ground; finds the particles that touch it, and returns their number."""

    def run(schedule: Pass) -> Any:
        w = workspace
        return k.particles_to_nodes_over_ground(
            store.particles, blocks, schedule, w.arenas, w.contacts, w.ground, w.grid, w.columns,
            tables.constants, search, tables.step.dt,
        )  # fmt: skip

    while _lacks_memory(workspace, *(found := run(workspace.schedule.early))[:3]):
        pass
    if workspace.schedule.waits:
        run(workspace.schedule.late)
    return int(found[3])


def _lacks_memory(workspace: Workspace, arenas: int, rows: int, shares: int) -> bool:
    """Whether a thread needed more than it had, which is made."""
    threads, enough = len(workspace.arenas.free), True
    if arenas > workspace.arenas.free.shape[1]:
        workspace.make_arenas(arenas)
        enough = False
    if rows > _rows_of_thread(workspace.contacts, threads):
        workspace.make_rows((rows + rows // 8 + PADDING) * threads)
        enough = False
    if shares > _shares_of_thread(workspace.contacts, threads):
        workspace.make_shares((shares + shares // 8 + SPARE) * threads)
        enough = False
    return not enough


def substep(
    k: SimpleNamespace, store: Store, blocks: Blocks, workspace: Workspace, tables: Tables, buffers: Buffers, first: bool
) -> float:
    """One substep of the particles on their grid, the ``first`` one or a later one, up to contacts.

    It needs as many arenas as the transfer did before. Returns the dissipated energy [J].
    """
    step = wet_step(store, tables, workspace, first)

    def run(schedule: Pass) -> float:
        w, dv = workspace, tables.constants.dv
        return float(k.substep(
            store.particles, blocks, schedule, w.arenas, w.contacts, w.grid.nodes, w.columns, dv, step,
            buffers, w.moves.motion, first,
        ))  # fmt: skip

    dissipated = run(workspace.schedule.early)
    if workspace.schedule.waits:
        run(workspace.schedule.late)
    advance_pores(store, workspace, ends=False)
    return dissipated


def drain(k: SimpleNamespace, blocks: Blocks, workspace: Workspace, tables: Tables) -> None:
    """Find how fast pore pressure drains in this transfer, from the mass of the nodes; nothing in a dry scene."""
    w, c, dt = workspace, tables.constants, tables.step.dt
    if w.layers:
        if not (w.layers.noted == dt).any():
            k.thin_layers(blocks, w.grid.masses, w.layers, tables.pores, c, dt)
            w.layers.noted[:] = dt
        w.layers.passed[:] = w.layers.fading


def pores_of(store: Store, tables: Tables, workspace: Workspace, begins: bool) -> Pores | tuple[()]:
    """Pore pressure of the particles as kernels take it, where a transfer ``begins`` or goes on; empty in a dry scene."""
    if not workspace.layers or store.pore_left is None or store.pore_excess is None:
        return ()
    layers = workspace.layers
    return Pores(store.pore_left, store.pore_excess, tables.pores, layers.fading, layers.passed, layers.of_block, begins)


def advance_pores(store: Store, workspace: Workspace, ends: bool) -> None:
    """After a substep: go on to the middle of the next one, or, where the transfer ends, advance what all have of a release."""
    layers = workspace.layers
    if not layers or store.pore_left is None:
        return
    if not ends:
        layers.passed[:] *= layers.fading
        layers.passed[:] *= layers.fading
    elif store.drains_alike:
        store.pore_left *= layers.passed[0, :, 0]
        store.pore_left *= layers.fading[0, :, 0]


def wet_step(store: Store, tables: Tables, workspace: Workspace, begins: bool) -> TimeStep:
    """What follows from the time step, with the pore pressure of the particles (:func:`pores_of`)."""
    return tables.step._replace(pores=pores_of(store, tables, workspace, begins))


def push(
    k: SimpleNamespace, store: Store, blocks: Blocks, workspace: Workspace, tables: Tables, totals: Totals, stamp: Any, begins: bool
) -> None:
    """Add the impulses of the contacts to the velocities of the nodes, and book their work and impulse.

    Those of the first substep of a transfer, which ``begins``, note the pore pressure of their particles.
    """
    w, pores = workspace, pores_of(store, tables, workspace, begins)
    for schedule in (w.schedule.early, w.schedule.late) if w.schedule.waits else (w.schedule.early,):
        k.solve_contacts(
            store.particles, blocks, schedule, w.arenas, w.contacts, w.columns, tables.basal, pores, w.grid, tables.step.dt,
            stamp, w.total,
        )  # fmt: skip
    totals.basal_dissipation -= float(w.total[0])
    totals.basal_impulse += w.total[1:4]
