"""Further launches of a step with transfer apic or aflip, or with F-bar."""

from __future__ import annotations

from runout.backends.hash.layout import CELL_LANES, run, run_blocks
from runout.backends.hash.parts import Parts
from runout.model.scene import Scene


def uses_gradient_transfer(scene: Scene) -> bool:
    """Whether a scene needs more than the packed transfer, which has kernels of its own."""
    return not scene.packed or scene.f_bar


def push(parts: Parts) -> None:
    """Launches that add internal forces to nodes with mass and momentum, once what particles alone gave is noted."""
    i, n, k, scenes, status = parts.index, parts.nodes, parts.k, parts.scenes, parts.status.group
    if scenes.scenes[0].packed:
        return
    particles, blocks = parts.store.group, i.block_group
    if n.kept:
        run(k.note_given, i.capacity * 64, status, blocks, n.grid_group)
    run(k.take_stresses, parts.store.size, status, particles, scenes.materials)
    run_blocks(
        k.add_forces, i.launched, CELL_LANES, status, particles, blocks, n.grid_group, scenes.group, scenes.constants,
        n.contact_group, n.column_group,
    )  # fmt: skip
    if parts.ordered:
        run(k.add_nodes, i.capacity * 64, status, blocks, n.grid_group)


def average(parts: Parts) -> None:
    """Launches that average the dilatation of this step over the nodes, whose velocities are known."""
    i, n, k, scenes, status = parts.index, parts.nodes, parts.k, parts.scenes, parts.status.group
    if not uses_gradient_transfer(scenes.scenes[0]):
        return
    particles, blocks = parts.store.group, i.block_group
    if scenes.scenes[0].f_bar:
        run_blocks(
            k.spread_dilatation, i.launched, CELL_LANES, status, particles, blocks, n.grid_group, scenes.group, scenes.constants
        )
        run(k.average_dilatation, i.capacity * 64, status, blocks, n.grid_group)
    run(k.close_step, i.capacity * 64, status, blocks, n.grid_group, n.ground_group, n.contact_group, scenes.group)
