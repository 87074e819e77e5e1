"""Groups of arrays: what a kernel takes as one argument.

A group has one meaning and one owner on the host, which fills it and fills it again when it makes an array anew. All groups stand
here, with shape, type and meaning of each field. ``n`` is the number of places for particles, ``blocks`` the room for blocks,
``near`` the room for blocks whose particles may touch the ground, and ``scenes`` the number of scenes of the batch.

A kernel receives the addresses and sizes of the arrays by value, in a record that is *packed*: warp's own record of an array has
56 bytes, and a launch with kilobytes of arguments takes a microsecond more. The kernel opens the record, then works with the group.
A CUDA graph keeps the addresses of the moment it was recorded, and is recorded again once an array has been made anew (see
:mod:`runout.backends.hash.graphs`).
"""

from __future__ import annotations

import linecache
from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from runout.backends.compile import warp_record
from runout.backends.hash.layout import (
    Double,
    Doubles,
    Doubles2,
    Filled,
    Floats,
    Halves,
    Int,
    Ints,
    Keys,
    Longs,
    Nodes,
    PoreRecords,
    Real,
    Reals,
    Rows,
    Shorts,
    Table,
    Table2,
    Vector,
    Vector64,
)
from runout.model.pore_pressure import FIELDS as PORE_FIELDS


class ParticleGroup:
    """Arrays by particle, in the order of memory; owned by :class:`runout.backends.hash.state.Store`."""

    rec: Rows  # (24, n) record of each particle, a column a particle: see runout.backends.hash.layout
    radius: Reals  # (n,) [m]; a particle touches the ground when its centre is this near
    release: Shorts  # (n,) int16, number of the release among those of all scenes
    number: Ints  # (n,) place among the particles as they were loaded
    forces: Nodes  # (loaded,) by that place: stamp of the step of the last contact, and the force of the ground then [N]
    key: Ints  # (n,) 64 block + cell; -2 - key for a particle that has left the domain, -1 for no particle
    order: Ints  # (n,) places of the particles, cell by cell


class BlockGroup:
    """Arrays by block of 4 x 4 x 4 cells; owned by :class:`runout.backends.hash.index.Index`."""

    coordinates: Table2  # (blocks, 3) of the block, in blocks
    former: Table2  # (blocks, 3) the same before the present sort
    member: Ints  # (blocks,) scene of the block
    around: Table2  # (blocks, 27) the block and its neighbours, -1 for none; first axis east, last axis upwards
    up: Table2  # (blocks, 8) the block and those one step up in each axis; the first is -1 if any of them is missing
    down: Table2  # (blocks, 8) the same one step down; for sums in fixed order, else (0, 8)
    cstart: Table2  # (blocks, 65) where the cells of a block start in the list of particles, and where the last ends
    ends: Ints  # (65 blocks,) the same memory in a row
    active: Ints  # (blocks,) blocks that hold particles
    homes: Table2  # (pieces, 3) pieces of the blocks that held particles at the last sort: block, start and end in memory
    sums: Ints  # (blocks + 1,) sums over the blocks before each, and over all


class KeyGroup:
    """Open-addressing table of block keys; owned by :class:`runout.backends.hash.index.Index`."""

    table: Table  # (entries,) uint64, key + 1 of an entry, 0 for a free one
    slots: Ints  # (entries,) block of the entry
    members: Keys  # (entries,) int64, the entered keys


class GridGroup:
    """Arrays by node, and what is booked by block; owned by :class:`runout.backends.hash.grid.NodeArrays`."""

    nodes: Nodes  # (64 blocks,) mass [kg] and momentum [kg m/s], later velocity [m/s]; behind them others, see NodeArrays.layers
    arenas: Nodes  # (216 blocks,) sums of each block over its tile, for sums in fixed order; else empty
    held: Ints  # (blocks,) particles of the block, for sums in fixed order; else empty
    booked: Doubles2  # (blocks, 6) dissipation [J], work of the ground [J], its impulse (3) [N s], dissipation by a second warp [J]


class GroundGroup:
    """The surface under the blocks; owned by :class:`runout.backends.hash.grid.NodeArrays`."""

    near: Ints  # (blocks,) place of a block whose particles may touch the ground, -1 for the others
    standing: Ints  # (near,) the block at each of these places, -1 if it is free
    grounded: Ints  # (blocks,) slot of a block whose nodes such particles reach, -1 for the others
    near_up: Table2  # (near, 8) where the numbers of the eight blocks of its tile begin in ``shares``
    tiles: Rows  # (near, 36) coefficients of the surface on 6 x 6 nodes, relative to the lowest node of the block [cells]
    bounds: Halves  # (near, 32) float16, for 16 columns of cells: highest ground [cells], least upward part of its normal
    slopes: Nodes  # (blocks,) slopes of the ground around: middle east and north, then how far any lies from it


class ContactGroup:
    """Contact of a step; owned by :class:`runout.backends.hash.grid.NodeArrays`."""

    shares: Reals  # (256 slots,) by slot 64 sums of contact weights, 64 pairs of impulses east and north, 64 upwards [N s]
    memory: Nodes  # (64 slots,) the same memory by four numbers, to clear it; where transfers may have several substeps, behind it
    # (64 slots,) impulses [N s] from which the contacts of a substep start
    pressed: Ints  # (n,) particles in contact, cell by cell
    pressed_start: Table2  # (blocks, 65) where the cells of a block start in that list, and where the last ends
    touched: Table2  # (blocks, 2) blocks with particles in contact, and their places near the ground
    touching: Ints  # (blocks,) how many such particles a block has
    columns: Table2  # (blocks, 5) where the law of friction uses ground areas, else empty: first block of the column of a block,
    # then where the four columns of blocks that its tile overlaps begin in ``plan``
    plan: Reals  # (16 blocks,) sums of contact weights in the columns of nodes, by the first block of a column; likewise
    column_pushes: Nodes  # (16 blocks,) drag [kg/m] and impulse [N s] of the contacts on columns of nodes, (36 blocks,) for sums in
    # fixed order; empty where drag does not slow columns
    approach_speeds: Reals  # (2 blocks,) largest speed [m/s] of the nodes of each half of a block towards the ground


class ColumnGroup:
    """Columns of nodes that drag slows, else empty; owned by :class:`runout.backends.hash.grid.NodeArrays`."""

    beside: Table2  # (blocks, 9) of a first block of a column: those of the columns around, -1 for none; first axis east
    moving: Nodes  # (16 blocks,) by the first block: mass [kg] and momentum [kg m/s] of a column of nodes, before gravity
    change: Nodes  # (16 blocks,) likewise: work of drag on it [J] and change of its velocity [m/s], in fixed order; else empty
    masses: Reals  # (36 releases blocks,) mass of each release on 6 x 6 columns of nodes [kg], where friction differs; else empty


class PoreGroup:
    """Pore pressure; empty in dry batches; owned by :class:`runout.backends.hash.grid.NodeArrays`, but arrays by particle."""

    left: Reals  # (loaded,) by place as loaded: the part of the excess pressure that remains [1]
    excess: Reals  # (loaded,) likewise: ratio at the start over the one that stays [1]
    layers: Reals  # (16 blocks,) mass by area of ground of the layer at each column of the cells of a block [kg/m2]
    records: PoreRecords  # (releases,) numbers of each release
    density: Reals  # (releases,) [kg/m3]


class StatusGroup:
    """Numbers that the host reads; owned by :class:`runout.backends.hash.device_status.DeviceStatus`."""

    tally: Ints  # (TALLY,) numbers of a step: see runout.backends.hash.layout
    both: Longs  # (1,) int64, the first two of them in one number
    flags: Ints  # (FLAGS,) why the device stands still
    counts: Ints  # (COUNTS,) numbers of a sort
    contacts: Ints  # (scenes,) particles in contact
    peaks: Reals  # (scenes + 1,) largest squared speed [m2/s2] by scene, then cells that a particle of an unstable scene moved


class SceneGroup:
    """Arrays by scene; owned by :class:`runout.backends.hash.scenes.SceneArrays`."""

    clock: Rows  # (scenes, 7) time step [s], g dt (3) [m/s], reach of contact [m], length of the transfer [s], and its substeps
    left: Ints  # (scenes,) steps that are left
    steps: Reals  # (scenes,) time step while steps are left [s]
    step_counts: Ints  # (scenes,) steps so far
    packed: Reals  # (scenes,) time step for which the records hold the stress [s]
    shift: Ints  # (scenes,) nodes from the origin of the index north to that of the scene
    limits: Doubles2  # (scenes, 2) extent of the domain east and north [cells]
    density: Doubles  # (releases,) [kg/m3]
    of_friction: Table2  # (releases, 2) first record of friction of a release; 1 if its fast contacts start from no force, else 0
    zones: Table2  # (scenes, cells) kind of ground by cell of the raster
    lattice: Doubles2  # (scenes, 4) cells of the raster east and north, and their sizes [cells of the grid]


class SurfaceGroup:
    """The sliding surfaces of the scenes; owned by :class:`runout.backends.hash.ground.Ground`."""

    coefficients: Doubles  # spline coefficients [m] of the surfaces, one behind the other
    changes: Doubles  # changes of the coefficients on the nodes of the grid [m], likewise
    shapes: Table2  # (scenes, 8) start and size of the coefficients; start, first node and size of the changes
    lattices: Doubles2  # (scenes, 4) origin and spacing of the coefficients, east and north [m]
    spacing: Doubles  # (3,) of the grid [m]


class StructureGroup:
    """Fields of the structures of the scenes; owned by :class:`runout.backends.hash.structures.Structures`."""

    fields: Table2  # (scenes, 7) of each field: see runout.backends.hash.structure_surface; 0 without one
    lattices: Doubles2  # (scenes, 7) local position of the first node of the field [m], its spacing [m], that of the grid (3) [m]
    planes: Doubles2  # (patches, 6) centre of each patch of the fields [lattice cells], and its normal
    rows: Ints  # row of each block of the fields, -1 for none within reach, one field behind the other
    distance: Floats  # (729 rows,) float32, distance [m] at the nodes of a row
    patch: Ints  # (729 rows,) nearest patch of its field
    first_friction: Ints  # (releases,) record of friction of a release on the first patch of its scene
    upper: Longs  # (3 patches + scenes,) impulse on each patch and energy taken in a scene, in whole units of the scene
    lower: Longs  # (3 patches + scenes,) what is left of them, in units of which PARTED make one of those
    units: Doubles  # (scenes,) units in a newton second, or a joule
    forces: Nodes  # (loaded,) as ParticleGroup.forces, of the structures


class SumGroup:
    """Sums for the ledger; owned by :class:`runout.backends.hash.readback.Report`. A scene has a row for each of its parts."""

    booked: Doubles2  # (scenes parts, 6) what is booked by block, see GridGroup
    here: Doubles2  # (scenes parts, 7) sums over the particles, see runout.backends.hash.observe
    gone: Doubles2  # (scenes threads, 7) the same over those that have left the domain since the last sort
    kept: Doubles2  # (scenes, 13) booked, and lost with particles that have left, up to the last sort
    bounds: Table2  # (scenes, 7) blocks with particles, their lowest and their highest coordinates
    ledger: Doubles2  # (scenes, 27) all that is known of a scene


class AroundGroup:
    """A window of nodes of the plan of a scene and sums around them; owned by :mod:`runout.backends.hash.node_columns`."""

    scene: Int
    turn: Int  # row of the bounds; the other one is made ready for the next launch
    east: Int  # first node
    north: Int
    columns: Int  # nodes east
    rows: Int  # nodes north
    cells_east: Int  # half cells of the raster
    cells_north: Int
    volume: Double  # whole numbers for a unit of volume [1/m3], mass [1/kg] and momentum [1/(kg m/s)]
    mass: Double
    momentum: Double
    sums: Longs  # (nodes, 5) volume, mass, momentum (3) as whole numbers; 0 between two launches
    bounds: Table2  # (2, 7) blocks of the scene with particles, their lowest and their highest coordinates
    found: Doubles  # (7 + 5 nodes,) row of the bounds; volume, momentum (3) and mass of the nodes that hold the mass, in SI


class Constants:
    """Numbers that all scenes of a batch share; owned by :class:`runout.backends.hash.scenes.SceneArrays`."""

    h: Vector  # spacing of the grid [m]
    band: Real  # a particle nearer to the ground than this is in contact [m]
    largest: Real  # largest radius of a particle [m]
    gravity: Vector64  # [m/s2]
    only: Int  # the one release that has particles, -1 if there are several


class Home:
    """Block in which the particles of a piece were at the last sort; made by the kernel, not by the host."""

    block: Int
    scene: Int
    x: Int  # of the block, in blocks
    y: Int
    z: Int
    shift: Int  # nodes from the origin of the index north to that of the scene
    limit_x: Double  # extent of the domain east and north [cells]
    limit_y: Double


class Search:
    """Block of cells in which a block of threads searches contacts; made by the kernel, not by the host."""

    place: Int  # of the block among those near the ground
    first: Int  # place of its first particle in the list
    lane: Int  # of this thread
    lasting: Real  # length of the transfer [s]
    far: Real  # distance beyond which no particle is in contact [m]


GROUPS = (
    ParticleGroup, BlockGroup, KeyGroup, GridGroup, GroundGroup, ContactGroup, ColumnGroup, PoreGroup, StatusGroup, SceneGroup,
    SurfaceGroup, StructureGroup, SumGroup, AroundGroup, Constants,
)  # fmt: skip


def pore_record(real: Any) -> Any:
    """Type of the numbers of a release with pore pressure."""
    return warp_record("pores", PORE_FIELDS, real)


@cache
def argument_types(real: Any) -> dict[str, Any]:
    """Types of kernel arguments for ``warp.float32`` or ``warp.float64`` by the names that the sources give them."""
    types: dict[str, Any] = {
        "Real": real, "Double": wp.float64, "Int": wp.int32, "Vector": wp.types.vector(length=3, dtype=real), "Vector64": wp.vec3d,
        "Rows": wp.array2d(dtype=real), "Reals": wp.array(dtype=real),
        "Nodes": wp.array(dtype=wp.types.vector(length=4, dtype=real)), "Halves": wp.array2d(dtype=wp.float16),
        "Table": wp.array(dtype=wp.uint64), "Keys": wp.array(dtype=wp.int64), "Longs": wp.array(dtype=wp.int64),
        "Ints": wp.array(dtype=wp.int32), "Table2": wp.array2d(dtype=wp.int32), "Shorts": wp.array(dtype=wp.int16),
        "Floats": wp.array(dtype=wp.float32), "Doubles": wp.array(dtype=wp.float64), "Doubles2": wp.array2d(dtype=wp.float64),
    }  # fmt: skip
    types["PoreRecords"] = wp.array(dtype=pore_record(real))
    return types | {group.__name__: _struct(group, real, types) for group in (*GROUPS, Home, Search)}


def _struct(group: type, real: Any, types: dict[str, Any]) -> Any:
    """Warp struct of a group for a number type. Its name and fields are part of the key of compiled code."""
    fields = {name: types[kind] for name, kind in group.__annotations__.items()}
    return wp.struct(type(f"{group.__name__}_{real.__name__}", (), {"__annotations__": fields}))


@cache
def packing_of(real: Any) -> dict[Any, tuple[Any, Any]]:
    """The packed record of each group that has arrays, and the function that opens it in a kernel, for a number type."""
    types = argument_types(real)
    structs = {group: types[group.__name__] for group in GROUPS if group is not Constants}
    return {struct: _packing(group, struct, real) for group, struct in structs.items()}


def _packing(group: type, struct: Any, real: Any) -> tuple[Any, Any]:
    kinds = {field: var.type for field, var in struct.vars.items()}
    arrays = {field: kind for field, kind in kinds.items() if isinstance(kind, wp.array)}
    sizes = {field: [f"{field}_size{axis}" for axis in range(kind.ndim)] for field, kind in arrays.items()}
    fields = {field: wp.uint64 if field in arrays else kind for field, kind in kinds.items()}
    fields |= {size: wp.int32 for some in sizes.values() for size in some}  # behind the addresses: no gaps
    packed = wp.struct(type(f"Packed{struct.key}", (), {"__annotations__": fields}))
    types = f'    """{real.__name__}: {group.__annotations__}"""'  # part of the key of compiled code
    lines = [f"def open_{group.__name__}(packed: Packed):", types, "    group = Group()"]
    for field in kinds:
        shape = "".join(f"packed.{size}, " for size in sizes.get(field, ()))
        array = f"wp.array(ptr=packed.{field}, shape=({shape}), dtype=of_{field})"
        lines.append(f"    group.{field} = {array if field in arrays else f'packed.{field}'}")
    source, place = "\n".join([*lines, "    return group", ""]), f"<{packed.key}>"
    linecache.cache[place] = len(source), None, source.splitlines(True), place  # where warp reads the source
    scope = {"wp": wp, "Packed": packed, "Group": struct} | {f"of_{field}": kind.dtype for field, kind in arrays.items()}
    exec(compile(source, place, "exec"), scope)
    return packed, wp.func(module=wp.get_module(f"runout.hash.groups.{real.__name__}"))(scope[f"open_{group.__name__}"])


@cache
def groups_of(real: Any) -> SimpleNamespace:
    """What kernels take of the groups for a number type, by their names."""
    types, packing = argument_types(real), packing_of(real)
    structs = {group.__name__: types[group.__name__] for group in GROUPS}
    return SimpleNamespace(**{name: packing.get(struct, (struct,))[0] for name, struct in structs.items()})


def filled(struct: Any, owner: Any, **fields: Any) -> Any:
    """A group whose fields are the attributes of the same names of its owner, or those that are given."""
    group = Filled(struct)
    for name in struct.vars:
        if "_size" not in name:
            setattr(group, name, fields[name] if name in fields else getattr(owner, name))
    return group
