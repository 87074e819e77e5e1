"""The compiled kernels of a scene."""

from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

from runout.backends import resting_loops
from runout.backends.compile import PHYSICS, NumbaBinding, numba_binding
from runout.backends.lanes import memory, shuffles, vectors
from runout.backends.scan import (
    column_drag,
    contact_area,
    contact_detection,
    contact_solution,
    domain,
    grid_to_particles,
    ground,
    groups,
    index,
    node_columns,
    observe,
    particles_to_grid,
    pore_pressure,
    precompile,
    raster_sums,
    records,
    slots,
    sort,
    stencil,
    structure_detection,
    structure_groups,
    structure_solution,
    substep,
    tile,
    workspace,
    zones,
)
from runout.model.friction_laws import FrictionLaw, numbers_of
from runout.model.laws import Law
from runout.model.scene import Scene

COMMON = (
    groups,
    node_columns,
    stencil,
    workspace,
    ground,
    index,
    particles_to_grid,
    contact_detection,
    contact_area,
    column_drag,
    slots,
    sort,
    observe,
    raster_sums,
    zones,
)  # know no law
# follow a law of friction
CONTACT = (
    groups,
    node_columns,
    stencil,
    ground,
    particles_to_grid,
    contact_detection,
    contact_area,
    column_drag,
    pore_pressure,
    contact_solution,
)
MOTION = (groups, node_columns, stencil, column_drag, domain, tile, pore_pressure, grid_to_particles)  # follow a law of materials
BY_SUBSTEPS = (
    groups,
    node_columns,
    stencil,
    particles_to_grid,
    tile,
    pore_pressure,
    grid_to_particles,
    substep,
)  # for all substeps but the last
# kernels of contact that follow the law: the second for laws that sum columns of nodes, the third for those that slow them
OF_FRICTION = ("solve_contacts", "particles_to_nodes_over_ground", "slow_columns")
LANES = (vectors, shuffles, memory)
BY_PORES = (groups, stencil, particles_to_grid, tile, pore_pressure)
BY_STRUCTURES = (structure_groups, structure_detection, structure_solution)
BY_LAWS = (contact_solution, domain, tile, pore_pressure, grid_to_particles, substep)
SOURCES = (*PHYSICS, *COMMON, *BY_LAWS, *LANES, precompile, resting_loops, records)
BY_TYPES = ("cut_tiles",)  # take arrays of the scene, whose types are looked up in each call
_MADE: dict[tuple[str, Law, FrictionLaw, bool, str], SimpleNamespace] = {}


class Entry:
    """A kernel whose argument types are looked up once: numba takes 10 to 30 us a call for fifty arrays, the call itself 2 us.

    Parameters
    ----------
    kernel : callable
        Compiled by numba. All calls have arguments of the same types.
    """

    def __init__(self, kernel: Any):
        self.kernel = kernel
        self.compiled: Callable[..., Any] | None = None

    @property
    def stats(self) -> Any:
        """What numba has compiled, and taken from its cache."""
        return self.kernel.stats

    def __call__(self, *arguments: Any) -> Any:
        """What the kernel returns."""
        if self.compiled is None:
            result = self.kernel(*arguments)
            types = tuple(self.kernel.typeof_pyval(argument) for argument in arguments)
            self.compiled = self.kernel.overloads[types].entry_point
            return result
        return self.compiled(*arguments)


def entries_for(scene: Scene) -> SimpleNamespace:
    """Kernels for one load of a scene: arrays that the backend makes for it have the same types in every call."""
    made = vars(kernels_for(scene))
    return SimpleNamespace(**{name: kernel if name in BY_TYPES else Entry(kernel) for name, kernel in made.items()})


def kernels_for(scene: Scene) -> SimpleNamespace:
    """Kernels for the number type and the laws of a scene, made once a process and taken from the cache of compiled code."""
    key = (scene.precision, scene.law, scene.basal.law, len(scene.materials) == 1, precompile.variant(scene))
    if key not in _MADE:
        precompile.ensure_compiled(scene, sources_of(scene))
        _MADE[key] = _bound(scene)
    return _MADE[key]


def sources_of(scene: Scene) -> tuple[ModuleType, ...]:
    """Modules whose change makes the compiled kernels of a scene stale."""
    return (*SOURCES, *BY_STRUCTURES) if scene.structures else SOURCES


def reads_nodes(scene: Scene) -> bool:
    """Whether kernels read the velocities of nodes after the ground has acted and before particles gather them."""
    return scene.structures is not None or scene.substeps > 1


def _bound(scene: Scene) -> SimpleNamespace:
    binding = numba_binding(scene.dtype)
    common = binding.kernels(*COMMON, sources=(*LANES, domain, tile, grid_to_particles))
    law, friction = binding.law(scene.law), binding.friction(scene.basal.law)
    of_contact = {
        "impulse": friction.impulse,
        "effective_impulse": friction.effective_impulse,
        "WET": scene.is_wet,
        "column_drag": friction.column_drag,
        "free_column_drag": friction.free_column_drag,
        "record": friction.record,
        "ONE_NUMBER": len(scene.basal.law.fields) == 1,
        "USES_AREA": scene.basal.law.uses_area,
        "DRAGS_COLUMN": scene.basal.law.drags_column,
    }
    if scene.basal.law.starts_differ:
        of_contact["STARTS_DIFFER"] = True
    contact = vars(binding.kernels(*CONTACT, sources=LANES, **of_contact))
    used = 1 + scene.basal.law.uses_area + scene.basal.law.drags_column
    own_of_contact = {name: contact[name] for name in OF_FRICTION[:used]}
    names = {
        "law_update": law.effective_step if scene.is_wet else law.step,
        "law_update_small": law.effective_step_small if scene.is_wet else law.step_small,
        "WET": scene.is_wet,
        "ONE_MATERIAL": len(scene.materials) == 1,
        "CHANGES": scene.basal.law.drags_column and not reads_nodes(scene),
    }
    if scene.substeps > 1:
        names["SEVERAL"] = True
    own = binding.kernels(*MOTION, sources=LANES, **names)
    structures = _of_structures(binding) if scene.structures else SimpleNamespace()
    wet = binding.kernels(*BY_PORES, sources=LANES) if scene.is_wet else SimpleNamespace()
    if scene.substeps > 1:
        drags = {"DRAGS_COLUMN": of_contact["DRAGS_COLUMN"]}
        own.substep = binding.kernels(*BY_SUBSTEPS, sources=LANES, **names, **drags, LASTS=True).substep
    return SimpleNamespace(**(vars(own) | vars(common) | vars(structures) | vars(wet) | own_of_contact))


def _of_structures(binding: NumbaBinding) -> SimpleNamespace:
    """Kernels of contact with structures; their friction is a coefficient, whatever the law on the ground."""
    friction = binding.friction(numbers_of(0.0)[0])
    return binding.kernels(*BY_STRUCTURES, impulse=friction.impulse, record=friction.record)
