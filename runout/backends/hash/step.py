"""One transfer: its launches in their order.

    particles to grid -> contact detection -> contact solution -> nodes -> grid to particles -> lists by cell

Behind the nodes come further substeps, if there are any; the kernels that differ there are those of ``parts.k.later``:

    strain in place -> contact solution -> nodes

Every launch reads on the device how much there is to do, so the host does not wait.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.contact_area import COLUMNS, PLAN
from runout.backends.hash.layout import CELL_LANES, FIRST, PARTICLE_LANES, WARP, run, run_blocks, run_each
from runout.backends.hash.parts import Parts
from runout.backends.hash.pore_pressure import COLUMNS as LAYERS


def enqueue(parts: Parts, substeps: int = 1) -> None:
    """Launches of a transfer of at most so many ``substeps``."""
    particles_to_grid(parts)
    measure_layers(parts)
    find_contacts(parts)
    move_nodes(parts, 1, substeps)
    for turn in range(FIRST, substeps + 1):
        strain_in_place(parts, turn)
        move_nodes(parts, turn, substeps)
    grid_to_particles(parts, parts.k.later if substeps > 1 else parts.k)
    parts.scenes.unknown.let_escape(parts)
    list_cells(parts)


def particles_to_grid(parts: Parts) -> None:
    """Open the step; mass and momentum of the particles to the nodes."""
    i, k, n, status = parts.index, parts.k, parts.nodes, parts.status.group
    arguments = status, parts.store.group, i.block_group, n.grid_group, parts.scenes.group, parts.scenes.constants
    run_each(k.particles_to_grid, i.launched + 1, CELL_LANES, *arguments, n.contact_group, n.column_group, i.launched)
    if parts.ordered:
        run(k.note_held, i.capacity, i.block_group, n.grid_group)
        run(k.sum_nodes, i.capacity * 64, status, i.block_group, n.grid_group)
    if parts.ground is not None and parts.drags_column and parts.scenes.mixed > 1:
        weigh_releases(parts)


def measure_layers(parts: Parts) -> None:
    """The layers in which pore pressure drains, from the mass of the nodes; nothing in a dry batch."""
    i, n, h = parts.index, parts.nodes, parts.scenes.constants.h
    if parts.scenes.wet:
        groups = i.block_group, n.grid_group, n.ground_group, n.pore_group
        run(parts.k.measure_layers, i.capacity * LAYERS, parts.status.group, *groups, h, int(parts.ground is not None))


def strain_in_place(parts: Parts, turn: int) -> None:
    """Law of the particles in substep number ``turn``, and momentum of the nodes."""
    i, k, n, scenes, status = parts.index, parts.k.later, parts.nodes, parts.scenes, parts.status.group
    beside = parts.structures.grounded if parts.structures else n.nothing
    groups = parts.store.group, i.block_group, n.grid_group, n.contact_group, scenes.group
    more = scenes.constants, scenes.materials, n.pore_group, beside, turn, i.launched
    run_each(k.strain_in_place, i.launched + 1, PARTICLE_LANES, status, *groups, *more)
    arrays = status, i.block_group, n.grid_group
    if parts.ordered:
        run(k.resume_nodes, i.capacity * 64, *arrays, scenes.group)
    if parts.ground is not None and parts.drags_column:
        run(k.sum_columns, i.capacity * COLUMNS, *arrays, n.ground_group, n.contact_group, n.column_group)


def find_contacts(parts: Parts) -> None:
    """Contacts of the transfer with the ground, and the impulses from which they start."""
    i, k, n, status = parts.index, parts.k, parts.nodes, parts.status.group
    if parts.ground is None:
        return
    groups = status, i.block_group, n.grid_group, n.ground_group, n.contact_group
    run_each(k.find_contacts, n.places, WARP, status, parts.store.group, *groups[1:], parts.scenes.group, parts.scenes.constants)
    if parts.ordered:
        run(k.sum_contacts, i.capacity * 64, *groups, 0)
    if parts.ordered and parts.uses_area:
        run(k.sum_columns, i.capacity * COLUMNS, *groups, n.column_group)


def move_nodes(parts: Parts, turn: int = 1, substeps: int = 1) -> None:
    """Velocities of the nodes after the impulses of the ground, in substep ``turn`` of a transfer of so many ``substeps``."""
    i, n, k = parts.index, parts.nodes, parts.k.later if turn > 1 else parts.k
    status, blocks, groups = parts.status.group, i.block_group, (n.grid_group, n.ground_group, n.contact_group)
    if parts.ground is not None:
        arguments = status, parts.store.group, blocks, *groups, parts.scenes.group, parts.scenes.constants
        run_each(k.solve_contacts, n.places, WARP, *arguments, n.ground_group, parts.scenes.friction, n.pore_group, 0)
        if parts.ordered:
            run(k.sum_contacts, i.capacity * 64, status, blocks, *groups, 1)
        if parts.ordered and parts.drags_column:
            run_each(k.slow_columns, i.capacity, WARP, status, blocks, n.grid_group, n.contact_group, *drag_of(parts))
    slowing = not touch_structures(parts, k) and parts.ground is not None
    given = status, blocks, *groups, *drag_of(parts)
    if substeps > 1:
        run(parts.k.later.end_substep, i.capacity * 64, *given, wp.vec3i(turn, substeps, int(slowing)))
    else:
        run(parts.k.update_nodes, i.capacity * 64, *given, int(slowing))


def weigh_releases(parts: Parts) -> None:
    """Masses of the releases in the blocks."""
    i, scenes = parts.index, parts.scenes
    groups = parts.status.group, parts.store.group, i.block_group, parts.nodes.column_group
    run(parts.k.weigh_releases, i.capacity * PLAN * scenes.mixed, *groups, scenes.releases, scenes.mixed)


def drag_of(parts: Parts) -> tuple[Any, ...]:
    """Arguments of the kernels that find the drag on columns of nodes."""
    n, scenes = parts.nodes, parts.scenes
    return scenes.group, scenes.constants, scenes.friction, n.column_group, scenes.releases, scenes.mixed


def touch_structures(parts: Parts, k: Any) -> bool:
    """Impulses of the structures on the nodes, which take those of the ground first; nothing where no mass is beside one.

    Returns whether the nodes have taken the drag on their columns too.
    """
    i, n, s, status = parts.index, parts.nodes, parts.structures, parts.status.group
    if s is None or not s.slots:
        return False
    blocks, ground, settled = i.block_group, (n.ground_group, n.contact_group), (s.ground_group, s.contact_group)
    arguments = status, parts.store.group, blocks, n.grid_group, *settled, parts.scenes.group, parts.scenes.constants, s.group
    settle = k.settle_impulses, i.capacity * 64, status, blocks, n.grid_group
    if parts.ground is not None:
        run(*settle, *ground, parts.scenes.group, s.grounded, 0)
    slowing = parts.drags_column and parts.ground is not None
    if slowing:
        run(k.slow_nodes, i.capacity * 64, status, blocks, n.grid_group, n.contact_group, *drag_of(parts))
    for entering in range(2):
        launches = (k.find_structure_contacts, ()), (k.solve_structure_contacts, (s.friction, n.pore_group))
        for part, (kernel, more) in enumerate(launches):
            run_each(kernel, s.places, WARP, *arguments, *more, entering)
            if parts.ordered:
                run(k.sum_contacts, i.capacity * 64, status, blocks, n.grid_group, *settled, part)
        run(*settle, *settled, parts.scenes.group, s.grounded, entering)
    return slowing


def grid_to_particles(parts: Parts, k: Any = None) -> None:
    """Velocities to the particles, the law, and motion."""
    i, scenes = parts.index, parts.scenes
    groups = parts.status.group, parts.store.group, i.block_group, parts.nodes.grid_group, scenes.group
    kernel, pieces = (k or parts.k).grid_to_particles, i.launched + i.more_pieces
    run_blocks(kernel, pieces, CELL_LANES, *groups, scenes.constants, scenes.materials, parts.nodes.pore_group)


def list_cells(parts: Parts) -> None:
    """The particles of each cell, after they have moved."""
    parts.index.list_cells(parts.nodes)
    parts.store.place(parts.k, parts.index)
