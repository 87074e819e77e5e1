"""The kernels for a law and a number type, bound to the formulas of :mod:`runout.physics` and compiled by warp."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from runout.backends.compile import law_record, warp_binding, warp_kernels
from runout.backends.hash import (
    block_numbers,
    column_drag,
    contact_area,
    contact_detection,
    contact_solution,
    deform,
    forces,
    gradients,
    grid_to_particles,
    ground,
    index,
    natives,
    nodes,
    observe,
    particles_to_grid,
    stencil,
    structure_detection,
    structure_distance,
    structure_entry,
    structure_solution,
    unknown,
    zones,
)
from runout.backends.hash import cells as cell_lists
from runout.backends.hash.groups import argument_types, groups_of
from runout.backends.hash.layout import CELL_LANES, PARTICLE_LANES, WARP
from runout.backends.hash.structures import FRICTION
from runout.model.friction_laws import FrictionLaw
from runout.model.laws import Law

CELL_KERNELS = ("particles_to_grid", "grid_to_particles")
WARP_KERNELS = ("find_contacts", "solve_contacts", "slow_columns", "list_cells", "renumber", "rank_blocks")
# kernels of gradient transfers: those that differ from the packed form's, and further ones
GRADIENT_CELL_KERNELS = ("grid_to_particles", "add_forces", "spread_dilatation")
STRUCTURE_WARP_KERNELS = ("find_structure_contacts", "solve_structure_contacts", "find_entering", "stop_entering")
STRUCTURE_KERNELS = ("note_beside", "require_beside", "carry_sums", "settle_impulses")
GRADIENT_KERNELS = ("update_nodes", "note_given", "take_stresses", "add_nodes", "average_dilatation", "count_anew")

NAME = "runout.hash"
OPTIONS = {"enable_backward": False, "max_unroll": 3}  # of the compiler
# threads of a block and blocks that share a multiprocessor, which bounds the registers of each thread
FLOAT32_BLOCKS = {
    "grid_to_particles": (CELL_LANES, 8), "particles_to_grid": (CELL_LANES, 6),
    "find_contacts": (WARP, 24), "solve_contacts": (WARP, 20), "sum_blocks": (PARTICLE_LANES, 6), "cut_tiles": (PARTICLE_LANES, 4),
    "sum_gone": (PARTICLE_LANES, 8),
}  # fmt: skip
FLOAT64_BLOCKS = {"cut_tiles": (PARTICLE_LANES, 4)}
STRUCTURE_BLOCKS = dict.fromkeys(STRUCTURE_WARP_KERNELS, (WARP, 20)) | {"find_entering": (WARP, 16)}
GRADIENT_BLOCKS = {"grid_to_particles": (CELL_LANES, 6), "add_forces": (CELL_LANES, 6)}


def _local_types(real: Any) -> dict[str, Any]:
    """What the names of vectors and matrices in the kernels stand for."""
    return {
        "node4": wp.types.vector(length=4, dtype=real), "sums4": wp.types.matrix(shape=(27, 4), dtype=real),
        "sums9": wp.types.matrix(shape=(9, 4), dtype=real),
        "double7": wp.types.vector(length=7, dtype=wp.float64), "whole5": natives.Whole5,
    }  # fmt: skip


_physics = cache(warp_binding)


def _number(precision: str) -> Any:
    return wp.float32 if precision == "float32" else wp.float64


def _common_names(friction: FrictionLaw, precision: str, ordered: bool) -> dict[str, Any]:
    """What names in all kernels stand for: order of sums, types, functions in CUDA, and contact with a law of friction."""
    real = _number(precision)
    names: dict[str, Any] = {"Frictions": wp.array(dtype=law_record(friction, real)), "AREAS": friction.uses_area}
    of_contact = _physics(real).friction(friction)
    names |= {name: getattr(of_contact, name) for name in ("impulse", "column_drag", "free_column_drag")}
    names |= {"ORDERED": ordered, "DRAGS_COLUMN": friction.drags_column}
    names |= {"AREAS_AT_ONCE": friction.uses_area and not ordered, "DRAGS_AT_ONCE": friction.drags_column and not ordered}
    names["HELD_REST"] = contact_solution.HELD_REST + contact_solution.HELD * friction.drags_column
    return names | argument_types(real) | _local_types(real) | natives.of(precision)


def _bound(
    law: Law, friction: FrictionLaw, precision: str, ordered: bool, sources: tuple[Any, ...], module_of: Any, **flags: bool
) -> SimpleNamespace:
    """Kernels of source modules for laws of material and friction and a number type."""
    real = _number(precision)
    physics, wide = _physics(real), _physics(wp.float64)
    record, friction_record = law_record(law, real), law_record(friction, real)
    kernels = warp_kernels(
        physics, sources, module_of, Materials=wp.array(dtype=record), law_update=physics.law(law).step, **flags,
        **_common_names(friction, precision, ordered),
        first_node64=wide.bspline.first_node, tens64=wide.names["tens"], surface_at64=wide.heightfield.surface_at,
        bend_smoothness64=wide.heightfield.bend_smoothness, resampled_coefficient64=wide.heightfield.resampled_coefficient,
        gradient_column64=wide.moments.gradient_column,
        kinetic_energy64=wide.moments.kinetic_energy, potential_energy64=wide.moments.potential_energy,
    )  # fmt: skip
    kernels.record, kernels.friction_record, kernels.groups = record, friction_record, groups_of(real)
    return kernels


def _module(name: str, lanes: int) -> Any:
    module = wp.get_module(name)
    module.options.update(OPTIONS, block_dim=lanes)
    return module


def _share_multiprocessor(kernels: SimpleNamespace, blocks: dict[str, tuple[int, int]]) -> None:
    """Bound the registers of kernels, so that so many blocks of threads fit."""
    for kernel, bounds in blocks.items():
        getattr(kernels, kernel).options["launch_bounds"] = bounds


@cache
def compiled_kernels(
    law: Law, friction: FrictionLaw, precision: str, ordered: bool, zoned: bool = False, gradient_transfer: bool = False,
    structured: bool = False,
) -> SimpleNamespace:  # fmt: skip
    """Kernels for laws of material and ``friction`` and a number type.

    ``ordered``: sums over particles in a fixed order, ``zoned``: zones of friction, ``gradient_transfer``: a transfer other than
    the packed one, or F-bar, ``structured``: contact with structures. ``modules`` are the warp modules with their lanes a block:
    kernels that own cells are compiled apart from the others, because warp compiles a module for every number of lanes.
    """
    if structured:
        plain = compiled_kernels(law, friction, precision, ordered, zoned, gradient_transfer)
        return _with(plain, _structure_kernels(precision, ordered))
    if gradient_transfer:
        plain = compiled_kernels(law, friction, precision, ordered, zoned)
        return _with(plain, _gradient_kernels(law, friction, precision, ordered, zoned and friction.drags_column))
    name = f"{NAME}.{law.name}.{friction.name}.{precision}" + ".ordered" * ordered + ".zoned" * zoned
    cells, warps, others = _module(f"{name}.cells", CELL_LANES), _module(f"{name}.warps", WARP), _module(name, PARTICLE_LANES)
    for module in (cells, warps):
        module.options["fast_math"] = True  # divisions and roots to the last bit but one: a fifth of the time of contact
    kernels = _bound(
        law, friction, precision, ordered, (stencil, index, block_numbers, contact_area, cell_lists, zones, column_drag, nodes,
        contact_solution, contact_detection, particles_to_grid, deform, grid_to_particles, ground, observe, unknown),
        lambda kernel: cells if kernel in CELL_KERNELS else warps if kernel in WARP_KERNELS else others,
        ZONED=zoned,
    )  # fmt: skip
    _share_multiprocessor(kernels, FLOAT32_BLOCKS if precision == "float32" else FLOAT64_BLOCKS)
    kernels.modules = ((cells, CELL_LANES), (warps, WARP), (others, PARTICLE_LANES))
    return kernels


def _with(plain: SimpleNamespace, own: SimpleNamespace) -> SimpleNamespace:
    """Kernels and modules of both; ``own`` ones instead of ``plain`` ones of the same name."""
    return SimpleNamespace(**(vars(plain) | vars(own) | {"modules": (*plain.modules, *own.modules)}))


@cache
def _structure_kernels(precision: str, ordered: bool) -> SimpleNamespace:
    """Kernels of contact with structures: they depend neither on the law of the material nor on that of the ground's friction."""
    name = f"{NAME}.structures.{precision}" + ".ordered" * ordered
    warps, others, unused = _module(f"{name}.warps", WARP), _module(name, PARTICLE_LANES), _module(f"{name}.unused", WARP)
    warps.options["fast_math"] = True  # as for contact with the ground
    kernels = warp_kernels(
        _physics(_number(precision)), (stencil, zones, contact_area, contact_solution, contact_detection, structure_distance,
        structure_detection, structure_solution, structure_entry),
        lambda kernel: warps if kernel in STRUCTURE_WARP_KERNELS else others if kernel in STRUCTURE_KERNELS else unused,
        **_common_names(FRICTION, precision, ordered),
    )  # fmt: skip
    if precision == "float32":
        _share_multiprocessor(kernels, STRUCTURE_BLOCKS)
    own = {kernel: getattr(kernels, kernel) for kernel in (*STRUCTURE_WARP_KERNELS, *STRUCTURE_KERNELS)}
    record = law_record(FRICTION, _number(precision))
    return SimpleNamespace(**own, structure_friction=record, modules=((warps, WARP), (others, PARTICLE_LANES)))


@cache
def _gradient_kernels(law: Law, friction: FrictionLaw, precision: str, ordered: bool, zoned: bool) -> SimpleNamespace:
    """Kernels of gradient transfers that the packed form lacks or has otherwise; the others are not compiled again."""
    name = f"{NAME}.{law.name}.{friction.name}.{precision}" + ".ordered" * ordered + ".zoned" * zoned + ".general"
    cells, others, unused = _module(f"{name}.cells", CELL_LANES), _module(name, PARTICLE_LANES), _module(f"{name}.unused", WARP)
    kernels = _bound(
        law, friction, precision, ordered, (stencil, zones, contact_area, column_drag, nodes, contact_solution, deform, gradients,
        forces, grid_to_particles),
        lambda kernel: cells if kernel in GRADIENT_CELL_KERNELS else others if kernel in GRADIENT_KERNELS else unused,
        ZONED=zoned, GRADIENT_TRANSFER=True, COUNTED_AT_ONCE=False,
    )  # fmt: skip
    if precision == "float32":
        _share_multiprocessor(kernels, GRADIENT_BLOCKS)
    own = {kernel: getattr(kernels, kernel) for kernel in (*GRADIENT_CELL_KERNELS, *GRADIENT_KERNELS)}
    return SimpleNamespace(**own, modules=((cells, CELL_LANES), (others, PARTICLE_LANES)))
