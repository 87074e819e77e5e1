"""Memory of the scan backend from numbers of particles and blocks: the sizes are those of small arrays of the same makers."""

from collections.abc import Callable

import numpy as np

from runout.backends.scan.domain import domain_of
from runout.backends.scan.index import Index
from runout.backends.scan.schedule import Schedule
from runout.backends.scan.slots import _spacious
from runout.backends.scan.state import Store, bytes_of, capacity, empty_slots
from runout.backends.scan.workspace import Workspace
from runout.model.basal_friction import BasalFriction
from runout.model.friction_laws import FrictionLaw
from runout.model.materials import Material
from runout.model.scene import Raster, Scene

SAMPLE = 4096  # slots or blocks that are made to learn their size
LEVELS = 4  # blocks of nodes above each other: of a flow of some cells, and what it may enter below and above


def bytes_needed(
    particles: int, held: int, owners: int, nodes: int, precision: str, friction: BasalFriction | FrictionLaw | None = None
) -> int:
    """Memory [byte] of a loaded backend.

    Parameters
    ----------
    particles : int
    held, owners, nodes : int
        Blocks that hold particles, that particles may enter, and that hold nodes.
    precision : str
        "float32" or "float64".
    friction : BasalFriction or FrictionLaw, optional
        The law on the ground; without one, one that needs no areas.
    """
    rock = Material(density=2000.0, youngs_modulus=1e6)
    law = friction.example if isinstance(friction, FrictionLaw) else friction or 0.5
    scene = Scene((1.0, 1.0, 1.0), None, Raster(1, 1, (1.0, 1.0)), (rock,), (law,), precision=precision)
    full = particles // max(held, 1)
    slots = capacity(held * _spacious(full))
    of_slot = _slope(lambda n: sum(bytes_of(empty_slots(n, scene)).values()))
    of_particle = _slope(lambda n: _labels(n, scene))
    of_owner = _slope(lambda n: _blocks(0, n, n, scene))
    of_held = _slope(lambda n: _blocks(n, SAMPLE, SAMPLE, scene))
    of_node = _slope(lambda n: _blocks(0, SAMPLE, SAMPLE + n, scene)) if nodes else 0.0
    blocks = of_held * held + (of_owner - of_node) * owners + of_node * nodes
    return round(of_slot * slots + of_particle * particles + blocks)


def _slope(size: Callable[[int], int]) -> float:
    """Bytes a unit of what grows in proportion."""
    return (size(SAMPLE) - size(0)) / SAMPLE


def _labels(particles: int, scene: Scene) -> int:
    """Bytes of what belongs to a particle and not to a slot."""
    store = Store.of(particles, particles, particles, scene)
    return sum(store.memory().values()) - sum(bytes_of(empty_slots(particles, scene)).values())


def _blocks(held: int, owners: int, nodes: int, scene: Scene) -> int:
    """Bytes of the index and of what belongs to its blocks."""
    blocks = Index.of_size(owners, nodes).blocks
    blocks.bxyz[:] = 0
    blocks.bxyz[:, 0] = np.arange(nodes) // LEVELS
    blocks.held[:held] = 1
    blocks.up[:] = blocks.down[:] = 0
    schedule, domain = Schedule.of(blocks, 1, at_once=False), domain_of(scene, np.zeros(3))
    workspace = Workspace.of(blocks, schedule, scene, domain)
    return sum(workspace.memory(blocks).values())
