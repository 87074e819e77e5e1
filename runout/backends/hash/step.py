"""One step: its launches in their order.

    particles to grid -> contact detection -> contact solution -> nodes -> grid to particles -> lists by cell

Every launch reads on the device how much there is to do, so the host does not wait.
"""

from __future__ import annotations

from typing import Any

from runout.backends.hash import gradient_transfer
from runout.backends.hash.contact_area import COLUMNS, PLAN
from runout.backends.hash.layout import CELL_LANES, WARP, run, run_blocks, run_each
from runout.backends.hash.parts import Parts


def enqueue(parts: Parts) -> None:
    """Launches of one step."""
    particles_to_grid(parts)
    gradient_transfer.push(parts)
    move_nodes(parts)
    gradient_transfer.average(parts)
    grid_to_particles(parts)
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


def move_nodes(parts: Parts) -> None:
    """Velocities of the nodes, after the impulses of the ground."""
    i, k, n = parts.index, parts.k, parts.nodes
    status, blocks, groups = parts.status.group, i.block_group, (n.grid_group, n.ground_group, n.contact_group)
    if parts.ground is not None:
        if parts.drags_column and parts.scenes.mixed > 1:
            weigh_releases(parts)
        arguments = status, parts.store.group, blocks, *groups, parts.scenes.group, parts.scenes.constants
        solution = *arguments, parts.scenes.friction
        for round_, (kernel, inputs) in enumerate(((k.find_contacts, arguments), (k.solve_contacts, solution))):
            run_each(kernel, n.places, WARP, *inputs)
            if parts.ordered:
                run(k.sum_contacts, i.capacity * 64, status, blocks, *groups, round_)
            if parts.ordered and parts.uses_area and round_ == 0:
                run(k.sum_columns, i.capacity * COLUMNS, status, blocks, *groups, n.column_group)
        if parts.ordered and parts.drags_column:
            run_each(k.slow_columns, i.capacity, WARP, status, blocks, n.grid_group, n.contact_group, *drag_of(parts))
    slowing = not touch_structures(parts) and parts.ground is not None
    run(k.update_nodes, i.capacity * 64, status, blocks, *groups, *drag_of(parts), int(slowing))


def weigh_releases(parts: Parts) -> None:
    """Masses of the releases in the blocks."""
    i, scenes = parts.index, parts.scenes
    groups = parts.status.group, parts.store.group, i.block_group, parts.nodes.column_group
    run(parts.k.weigh_releases, i.capacity * PLAN * scenes.mixed, *groups, scenes.releases, scenes.mixed)


def drag_of(parts: Parts) -> tuple[Any, ...]:
    """Arguments of the kernels that find the drag on columns of nodes."""
    n, scenes = parts.nodes, parts.scenes
    return scenes.group, scenes.constants, scenes.friction, n.column_group, scenes.releases, scenes.mixed


def touch_structures(parts: Parts) -> bool:
    """Impulses of the structures on the nodes, which take those of the ground first; nothing where no mass is beside one.

    Returns whether the nodes have taken the drag on their columns too.
    """
    i, k, n, s, status = parts.index, parts.k, parts.nodes, parts.structures, parts.status.group
    if s is None or not s.slots:
        return False
    blocks, ground, settled = i.block_group, (n.ground_group, n.contact_group), (s.ground_group, s.contact_group)
    arguments = status, parts.store.group, blocks, n.grid_group, *settled, parts.scenes.group, parts.scenes.constants, s.group
    settle = k.settle_impulses, i.capacity * 64, status, blocks, n.grid_group
    if parts.ground is not None:
        run(*settle, *ground, s.grounded, 1)
    slowing = parts.drags_column and parts.ground is not None
    if slowing:
        run(k.slow_nodes, i.capacity * 64, status, blocks, n.grid_group, n.contact_group, *drag_of(parts))
    for ended, (find, solve, more) in enumerate(
        ((k.find_structure_contacts, k.solve_structure_contacts, (s.friction,)), (k.find_entering, k.stop_entering, ()))
    ):
        for part, (kernel, inputs) in enumerate(((find, arguments), (solve, (*arguments, *more)))):
            run_each(kernel, s.places, WARP, *inputs)
            if parts.ordered:
                run(k.sum_contacts, i.capacity * 64, status, blocks, n.grid_group, *settled, part)
        run(*settle, *settled, s.grounded, ended)
    return slowing


def grid_to_particles(parts: Parts) -> None:
    """Velocities to the particles, the law, and motion."""
    i, scenes = parts.index, parts.scenes
    run_blocks(
        parts.k.grid_to_particles, i.launched + i.more_pieces, CELL_LANES, parts.status.group, parts.store.group, i.block_group,
        parts.nodes.grid_group, scenes.group, scenes.constants, scenes.materials,
    )  # fmt: skip


def list_cells(parts: Parts) -> None:
    """The particles of each cell, after they have moved."""
    parts.index.list_cells(parts.nodes)
    parts.store.place(parts.k, parts.index)
