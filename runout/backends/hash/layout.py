"""What the kernels share: stand-ins for the types of their arguments, rows of the particle matrix, numbers the device counts.

Rows of the particle matrix, one column a particle; f is the offset from the cell's first node [cells]:

    0 m | 1-3 m v | 4-6 f | 7-15 A, column by column | 16-21 B = b_e - I | 22 history | 23 stress-free volume

with A = h_j (m C - dt 4/h_j^2 V0 tau), so that the momentum at node x is m v + A (x - f) with x in cells
(Hu et al. 2018, ACM TOG 37:150, eq. 18). A tile holds the 6 x 6 x 6 nodes that the particles of one block reach.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import warp as wp

wp.config.log_level = max(wp.config.log_level, wp.LOG_ERROR)  # no banner, and no warning where a machine has no GPU

# types of kernel arguments; the binding puts the compiler's in their place
Rows: TypeAlias = Any
Reals: TypeAlias = Any
Real: TypeAlias = Any
Nodes: TypeAlias = Any
Int: TypeAlias = Any
Vector: TypeAlias = Any
Vector64: TypeAlias = Any
Table: TypeAlias = Any
Keys: TypeAlias = Any
Ints: TypeAlias = Any
Table2: TypeAlias = Any
Shorts: TypeAlias = Any
Halves: TypeAlias = Any
Double: TypeAlias = Any
Doubles: TypeAlias = Any
Doubles2: TypeAlias = Any
Floats: TypeAlias = Any
Longs: TypeAlias = Any
Materials: TypeAlias = Any
Frictions: TypeAlias = Any
Surface: TypeAlias = Any
PoreRecords: TypeAlias = Any
Tile: TypeAlias = Any

# vectors and matrices of the compiler that the binding puts in their place: numbers of a node; of 9 or 27 nodes, so many each
node4: Any = None
sums4: Any = None
sums9: Any = None
double7: Any = None
add_node: Any = None  # adds four numbers to a node
node_at: Any = None  # the four numbers of a node, by one load
lane_count: Any = None  # lanes of a block, known when a kernel is compiled: loops over them have a known length
own_block: Any = None  # block and lane of a thread, as the chip knows them
own_lane: Any = None
put_node: Any = None  # puts four others in their place, by one store

ORDERED = False  # sums in fixed order; the binding decides
ZONED = False  # friction zones on the ground; the binding decides
DRAGS_COLUMN = False  # drag slows whole columns of nodes; the binding decides
AREAS = False  # the law of friction uses the ground area of a contact; the binding decides
AREAS_AT_ONCE, DRAGS_AT_ONCE = False, False  # the same two where sums over columns of nodes need no fixed order, likewise
STARTS_DIFFER = False  # by release; the binding decides
LIMITS_START = False  # fast contacts start from no force of the step before; the binding decides
STRUCTURED = False  # the surface of contact is that of structures, else the ground; the binding decides
GIVES_MASS = True  # particles give mass and momentum to the nodes, else impulses alone; the binding decides
WET = False  # a mass has pore pressure; the binding decides
SUBSTEPPED = False  # further substeps of a transfer, and its end; the binding decides
VELOCITIES, WAYS = 0, 1  # layers of the nodes; the first is behind the ways where SUBSTEPPED is set, the binding decides
LASTING, SUBSTEPS, CLOCK = 5, 6, 7  # of a row of the clock: length [s] of a transfer, and its substeps; numbers in all
FIRST = 2  # the first of the further substeps
MASS, MOMENTUM, OFFSET, AFFINE, STRAIN, HISTORY, VOLUME, ROWS = 0, 1, 4, 7, 16, 22, 23, 24
TILE = 216
BASES = 12  # of a tile: where its eight blocks begin in the grid, and its four columns of blocks in the plan
SECOND, HALVES = 72, 288  # nodes before the tile of the second half of a block, which is 144 nodes behind; nodes of both tiles
PUSHES, PUSHES_UP, SLOT = 64, 192, 256  # of what lies near the ground in a block: where impulses begin; numbers in all
PIECE = 32  # nodes of a tile that lie in one of its blocks, or in two; a tile has seven pieces
STAMPS = 2**23 - 1  # numbers of steps wrap here: single precision holds them exactly
NO_STEP = -1.0  # stamp of no step: no impulse is given from before
PADDED = 256  # trips of a loop that every lane of a block runs alike
WIDE, WIDE_PLAN, WIDE_X, WIDE_Y, WIDE_TILE = 512, 64, 74, 9, 592  # 8 x 8 x 8 nodes around a block: places apart without conflicts
NOT_NEGATIVE = 2**31 - 1  # an index of which the compiler knows its sign needs no wrap, and addresses become constant distances
PLACES = 1023  # of a tile, likewise
# flags on the device: why it stands still, why it will, steps done, member that failed
HALT, PENDING, STEPS, FAILED, FLAGS = range(5)
# counts of a step: places listed so far, blocks with particles in the next step (one number of 64 bits with the first), blocks,
# those with particles in this step, those with contact, and particles that have left the domain since the last sort; pieces of the
# blocks that held particles then. What a kernel adds to lies in a line of the cache of its own: who reads the others does not
# wait for sums
APART = 64
CURSOR, NEXT = 0, 1
BLOCKS, ACTIVE, HOMES = APART, APART + 1, APART + 2
TOUCHED, GONE, TALLY = 2 * APART, 3 * APART, 4 * APART
# counts of a sort: blocks entered in the index, of these those that may hold particles, blocks that may touch the ground, blocks of
# the nodes that these reach, particles that are left; blocks that may touch structures, and blocks of the nodes that these reach
ENTERED, OWNERS, NEAR, GROUNDED, LEFT, BESIDE, REACHED, COUNTS = range(8)
NODE, RELEASE, SCENE = 0, 3, 4  # rows of the table of joining particles: first node (3), release, 64 times the scene
LEFT_INDEX, UNSTABLE, GROW = 1, 2, 3  # why a batch halts; the last: a sort found too little room and changed no particle
CELL_LANES, PARTICLE_LANES = 64, 128  # threads of a block that steps a block of cells, and of any other
STARTS = CELL_LANES + 1  # where the cells of a block start and the last ends
WARP = 32  # threads of a block where those of 64 would wait for each other: contact and lists
SECTOR = 32  # numbers of a line of the cache: where a block of threads begins
SPARE, FEW = ROWS + 1, 2**20  # free rows of the matrix, so that a sort moves all at once; where there are fewer particles than this
SUMMED, COUNTED = 1, 2  # what a list of cells finds of each block: the sum of the particles in those before, or its own
MANY = 512  # particles of a block whose impulses a further substep holds at once
PITCH = MANY + MANY // WARP  # between two numbers of such a particle: the particles of 32 cells with 8 each lie in different banks
PARTS = 2  # threads that share the particles of a cell there
AT_ONCE = 4  # numbers that a thread of a sort loads at once
AMPLE = 2**12  # blocks, about 12 MB, that arrays get beyond what is needed
ALL_AT_WORK = 1500  # pieces from which on every multiprocessor of a large GPU has work: fewer particles are cut into smaller ones
SHARED_BLOCKS = 2**14  # blocks of threads that take turns with blocks of cells, where these are little work or few


def layers_of(substepped: bool) -> int:
    """Layers of numbers by node: nodes; with substeps ways and velocities too."""
    return 1 + 2 * substepped


class Filled:
    """A group on the host: its arrays and numbers by name, and the ``record`` that a kernel takes."""

    record: Any

    def __init__(self, struct: Any):
        vars(self)["record"] = struct()

    def __setattr__(self, name: str, value: Any) -> None:
        vars(self)[name] = value
        if not isinstance(value, wp.array):
            setattr(self.record, name, value)
            return
        item = wp.types.type_size_in_bytes(value.dtype)
        if value.strides[-1] != item:
            raise ValueError(f"{name}: neighbours lie {value.strides[-1]} bytes apart in place of {item}")
        setattr(self.record, name, value.ptr or 0)
        sizes = value.shape if value.ndim == 1 else (value.shape[0], value.strides[0] // item)  # of a part: from row to row
        for axis, size in enumerate(sizes):
            setattr(self.record, f"{name}_size{axis}", size)


def _taken(arguments: tuple[Any, ...]) -> list[Any]:
    """What a kernel takes of its arguments: of groups their records."""
    return [a.record if isinstance(a, Filled) else a for a in arguments]


def run(kernel: Any, dim: int | tuple[int, int], *arguments: Any) -> None:
    """Launch a kernel on the device of the scope, if there is anything to do."""
    if dim:
        wp.launch(kernel, dim=dim, inputs=_taken(arguments), block_dim=PARTICLE_LANES)


def run_each(kernel: Any, blocks: int, lanes: int, *arguments: Any) -> None:
    """Launch a kernel with ``lanes`` threads for each block on the device of the scope."""
    if blocks:
        wp.launch_tiled(kernel, dim=blocks, inputs=_taken(arguments), block_dim=lanes)


def run_blocks(kernel: Any, blocks: int, lanes: int, *arguments: Any) -> None:
    """Launch a kernel with ``lanes`` threads for each block; its last argument is the number of blocks."""
    run_each(kernel, blocks, lanes, *arguments, blocks)


def room_for(blocks: int) -> int:
    """Blocks that arrays get room for when ``blocks`` are needed: twice as many where they are few.

    A flow spreads, and all graphs are recorded anew whenever arrays grow.
    """
    return blocks + max(blocks // 16, min(blocks, AMPLE)) + 8 * (blocks > 0)


def more_room_for(blocks: int) -> int:
    """The same once a sort has found too little: each such find costs a sort and the steps behind it."""
    return room_for(blocks + blocks // 16 + 64 * (blocks > 0))


def bytes_of(*holders: Any) -> int:
    """Size [byte] of the device arrays that objects hold; parts of another, which own no memory, do not count."""
    arrays = [a for holder in holders for a in vars(holder).values() if isinstance(a, wp.array)]
    return sum(a.capacity for a in arrays if a.deleter is not None)
