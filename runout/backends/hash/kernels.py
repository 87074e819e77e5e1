"""The kernels for a law and a number type, bound to the formulas of :mod:`runout.physics` and compiled by warp.

They are compiled in sets by what they depend on beside the number type, so that another law compiles anew only what names it:

    common                 nothing else: the index, the ground, what is moved and copied
    sums                   order of sums, ground area of contacts, drag on columns of nodes
    law                    law of the material
    friction               law of friction of the ground, its zones, and order of sums
    structures             order of sums
    substeps.*             the same for transfers of several substeps: what differs from those of one
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from types import ModuleType, SimpleNamespace
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
    grid_to_particles,
    ground,
    index,
    natives,
    nodes,
    observe,
    particles_to_grid,
    pore_pressure,
    spreading,
    stencil,
    structure_contact,
    structure_surface,
    substeps,
    unknown,
    zones,
)
from runout.backends.hash import cells as cell_lists
from runout.backends.hash.groups import argument_types, groups_of, packing_of
from runout.backends.hash.layout import CELL_LANES, PARTICLE_LANES, WARP
from runout.backends.hash.structures import FRICTION
from runout.model.friction_laws import FrictionLaw
from runout.model.laws import Law

NAME = "runout.hash"
OPTIONS = {"enable_backward": False, "max_unroll": 3}  # of the compiler
LAW_KERNELS = ("grid_to_particles", "change_step", "unpack", "sum_blocks", "sum_gone", "measure_layers")
FRICTION_KERNELS = ("solve_contacts", "slow_columns", "update_nodes", "slow_nodes")
SUM_KERNELS = ("particles_to_grid", "find_contacts", "list_cells", "note_up", "sum_columns")
STRUCTURE_KERNELS = (
    "find_structure_contacts", "solve_contacts", "note_beside", "carry_sums", "settle_impulses",
)  # fmt: skip
LANES = {  # of a block; other kernels have PARTICLE_LANES
    **dict.fromkeys(("particles_to_grid", "grid_to_particles"), CELL_LANES),
    **dict.fromkeys(("find_contacts", "solve_contacts", "slow_columns", "list_cells", "renumber", "rank_blocks"), WARP),
    **dict.fromkeys(("find_structure_contacts", "number_marked"), WARP),
}
# threads of a block and blocks that share a multiprocessor, which bounds the registers of each thread
FLOAT32_BLOCKS = {
    "grid_to_particles": (CELL_LANES, 8), "particles_to_grid": (CELL_LANES, 6),
    "find_contacts": (WARP, 24), "solve_contacts": (WARP, 20), "sum_blocks": (PARTICLE_LANES, 6), "cut_tiles": (PARTICLE_LANES, 4),
    "sum_gone": (PARTICLE_LANES, 8), "strain_in_place": (PARTICLE_LANES, 4), "end_substep": (PARTICLE_LANES, 12),
}  # fmt: skip
FLOAT64_BLOCKS = {"cut_tiles": (PARTICLE_LANES, 4)}
DRAG_BLOCKS = dict.fromkeys(("update_nodes", "end_substep"), (PARTICLE_LANES, 8))  # where drag slows columns of nodes
STRUCTURE_BLOCKS = {"find_structure_contacts": (WARP, 16), "solve_contacts": (WARP, 20)}


@dataclass(frozen=True)
class Kind:
    """A set of kernels."""

    sources: tuple[ModuleType, ...]  # the modules that hold the kernels, each behind what it calls
    wanted: Callable[[str], bool]  # whether a kernel of the sources belongs to the set
    # threads of a block, and blocks that share a multiprocessor, of kernels in single precision
    blocks: dict[str, tuple[int, int]] = field(default_factory=dict)
    # kernels with these numbers of lanes divide and take roots to the last bit but one: a fifth of the time of contact
    fast: tuple[int, ...] = (CELL_LANES, WARP)
    substepped: bool = False  # the set is for transfers of several substeps
    structured: bool = False  # contact is that with structures


def _substeps(*kernels: str, fast: tuple[int, ...] = (CELL_LANES, WARP), structured: bool = False) -> Kind:
    """A set of kernels of transfers of several substeps."""
    sources = (
        stencil, zones, contact_area, column_drag, nodes, structure_surface, pore_pressure, contact_solution, contact_detection,
        structure_contact, deform, grid_to_particles, particles_to_grid, substeps,
    )  # fmt: skip
    return Kind(sources, kernels.__contains__, FLOAT32_BLOCKS | STRUCTURE_BLOCKS, fast, substepped=True, structured=structured)


KINDS = {
    "common": Kind(
        (stencil, index, block_numbers, contact_area, cell_lists, zones, column_drag, pore_pressure, contact_solution, deform,
        ground, observe, spreading, unknown),
        lambda name: name not in {*LAW_KERNELS, *FRICTION_KERNELS, *SUM_KERNELS}, FLOAT32_BLOCKS,
    ),
    "sums": Kind(
        (stencil, index, block_numbers, contact_area, cell_lists, zones, pore_pressure, contact_solution, contact_detection,
        particles_to_grid), SUM_KERNELS.__contains__, FLOAT32_BLOCKS,
    ),
    "law": Kind((stencil, pore_pressure, deform, grid_to_particles, observe), LAW_KERNELS.__contains__, FLOAT32_BLOCKS),
    "friction": Kind(
        (stencil, contact_area, zones, column_drag, nodes, pore_pressure, contact_solution), FRICTION_KERNELS.__contains__,
        FLOAT32_BLOCKS, (WARP, PARTICLE_LANES),
    ),
    "structures": Kind(
        (stencil, zones, contact_area, structure_surface, pore_pressure, contact_solution, contact_detection, structure_contact),
        STRUCTURE_KERNELS.__contains__, STRUCTURE_BLOCKS, (WARP,), structured=True,
    ),
    "substeps.sums": _substeps("resume_nodes"),
    "substeps.law": _substeps("grid_to_particles", "strain_in_place", fast=(CELL_LANES, PARTICLE_LANES)),
    "substeps.friction": _substeps("solve_contacts", "end_substep", fast=(WARP, PARTICLE_LANES)),
    "substeps.structures": _substeps("find_structure_contacts", "solve_contacts", structured=True),
}  # fmt: skip


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


@cache
def _common_names(precision: str) -> dict[str, Any]:
    """What names in all kernels stand for: types, functions in CUDA, and formulas that are always in double precision."""
    real, wide = _number(precision), _physics(wp.float64)
    names = {
        "first_node64": wide.bspline.first_node, "tens64": wide.names["tens"], "surface_at64": wide.heightfield.surface_at,
        "normal_z64": wide.heightfield.normal_z, "sunk64": wide.bed.sunk, "chance_at64": wide.bed.chance_at,
        "bend_smoothness64": wide.heightfield.bend_smoothness, "resampled_coefficient64": wide.heightfield.resampled_coefficient,
        "gradient_column64": wide.moments.gradient_column, "kinetic_energy64": wide.moments.kinetic_energy,
        "potential_energy64": wide.moments.potential_energy,
    }  # fmt: skip
    scales = ("covered_part", "flowing_part", "extent_count", "extent_parts", "depth_count", "depth_scales")
    names |= {f"{name}64": getattr(wide.numerical_scales, name) for name in scales}
    return argument_types(real) | _local_types(real) | natives.of(precision) | names


def _law_names(law: Law, precision: str, wet: bool) -> dict[str, Any]:
    real = _number(precision)
    return {
        "Materials": wp.array(dtype=law_record(law, real)),
        "law_update": getattr(_physics(real).law(law), "effective_step" if wet else "step"),
    }


def _friction_names(friction: FrictionLaw, precision: str) -> dict[str, Any]:
    real = _number(precision)
    of_contact = _physics(real).friction(friction)
    names = {name: getattr(of_contact, name) for name in ("impulse", "effective_impulse", "column_drag", "free_column_drag")}
    return names | {"Frictions": wp.array(dtype=law_record(friction, real))}


def _constants(ordered: bool, area: bool, drags: bool, starts_differ: bool) -> dict[str, Any]:
    """What is known when kernels are compiled: order of sums, ground area of contacts, drag on columns of nodes."""
    names: dict[str, Any] = {"ORDERED": ordered, "AREAS": area, "DRAGS_COLUMN": drags, "STARTS_DIFFER": starts_differ}
    names |= {"AREAS_AT_ONCE": area and not ordered, "DRAGS_AT_ONCE": drags and not ordered}
    return names | {"HELD_REST": contact_solution.HELD_REST + contact_solution.HELD * drags}


def _module(name: str, lanes: int, fast: bool) -> Any:
    module = wp.get_module(name)
    module.options.update(OPTIONS, block_dim=lanes, fast_math=fast)
    return module


@cache
def _kernels_of(
    kind: str, precision: str, law: Law | None = None, friction: FrictionLaw | None = None, ordered: bool = False,
    area: bool = False, drags: bool = False, starts_differ: bool = False, zoned: bool = False, wet: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Kernels of a set by name, for what it depends on: one warp module for each number of lanes a block."""
    what = KINDS[kind]
    chosen = ".ordered" * ordered + ".area" * area + ".drags" * drags + ".starts" * starts_differ + ".zoned" * zoned + ".wet" * wet
    label = ".".join([NAME, kind, *(given.name for given in (law, friction) if given), precision]) + chosen
    modules = {n: _module(f"{label}.{n}", n, n in what.fast) for n in (CELL_LANES, WARP, PARTICLE_LANES)}
    names = _common_names(precision) | _constants(ordered, area, drags, starts_differ) | {"ZONED": zoned, "WET": wet}
    names |= {"SUBSTEPPED": what.substepped, "STRUCTURED": what.structured, "GIVES_MASS": not what.substepped}
    names["Surface"] = names["StructureGroup" if what.structured else "GroundGroup"]
    names |= {"VELOCITIES": 2 * what.substepped, "LIMITS_START": area and not what.substepped}
    names |= (_law_names(law, precision, wet) if law else {}) | (_friction_names(friction, precision) if friction else {})

    needed = {"measure_layers": wet, "slow_nodes": drags, "slow_columns": drags and ordered, "resume_nodes": ordered}

    def module_of(name: str) -> Any:
        wanted = what.wanted(name) and needed.get(name, True)
        return modules[LANES.get(name, PARTICLE_LANES)] if wanted or name.startswith("_") else None

    real = _number(precision)
    found = vars(warp_kernels(_physics(real), what.sources, module_of, packing_of(real), **names))
    blocks = what.blocks | (DRAG_BLOCKS if drags else {}) if precision == "float32" else FLOAT64_BLOCKS
    for name in blocks.keys() & found.keys():
        found[name].options["launch_bounds"] = blocks[name]
    return found


def _structure_kernels(kind: str, precision: str, ordered: bool) -> dict[str, Any]:
    """Kernels of a set for structures; the contact solution, which is that of the ground for another surface, is renamed."""
    found = dict(_kernels_of(kind, precision, friction=FRICTION, ordered=ordered))
    return found | {"solve_structure_contacts": found.pop("solve_contacts")}


@cache
def compiled_kernels(
    law: Law, friction: FrictionLaw, precision: str, ordered: bool, zoned: bool = False, structured: bool = False,
    substepped: bool = False, wet: bool = False,
) -> SimpleNamespace:  # fmt: skip
    """Kernels for laws of material and ``friction`` and a number type.

    ``ordered``: sums over particles in a fixed order, ``zoned``: zones of friction, ``structured``: contact with structures,
    ``wet``: a mass has pore pressure, ``substepped``: transfers of several substeps, for which ``later`` holds all kernels.
    ``modules`` are the warp modules.
    """
    real, drags = _number(precision), friction.drags_column
    of_sums = {"ordered": ordered, "area": friction.uses_area, "drags": drags, "starts_differ": friction.starts_differ}
    of_friction: dict[str, Any] = of_sums | {"friction": friction, "zoned": zoned, "wet": wet}
    found = _kernels_of("common", precision) | _kernels_of("sums", precision, **of_sums)
    found |= _kernels_of("law", precision, law, wet=wet) | _kernels_of("friction", precision, **of_friction)
    kernels = SimpleNamespace(**found, record=law_record(law, real), friction_record=law_record(friction, real))
    if structured:
        vars(kernels).update(_structure_kernels("structures", precision, ordered))
        kernels.structure_friction = law_record(FRICTION, real)
    if substepped:
        later = _kernels_of("substeps.sums", precision, **of_sums) | _kernels_of(
            "substeps.law", precision, law, ordered=ordered, wet=wet
        )
        later |= _kernels_of("substeps.friction", precision, **of_friction)
        if structured:
            later |= _structure_kernels("substeps.structures", precision, ordered)
        kernels.later = SimpleNamespace(**(vars(kernels) | later))
    held = [*vars(kernels).values(), *vars(kernels.later).values()] if substepped else vars(kernels).values()
    kernels.modules = tuple(dict.fromkeys(k.module for k in held if isinstance(k, wp.Kernel)))
    kernels.groups = groups_of(real)
    return kernels
