"""Functions in CUDA, each with its equivalent for a CPU; they are bound to the kernels by name."""

from typing import Any

import warp as wp

from runout.backends.hash import reductions, shared_memory
from runout.backends.hash.reductions import hits_before, sum_before, sum_lanes

# Neighbours in a warp mostly enter the same cell: one atomic serves them all.
COUNT_IN = """
#if defined(__CUDA_ARCH__)
    unsigned same = __match_any_sync(__activemask(), cell);
    if ((threadIdx.x & 31) == __ffs(same) - 1) atomicAdd(&count[cell], __popc(same));
#else
    wp::atomic_add(count, cell, 1);
#endif
"""
# Four at once, so that the four atomic operations overlap.
NEXT_FOUR = """
    wp::vec4i found;
#if defined(__CUDA_ARCH__)
    unsigned lane = threadIdx.x & 31, all = __activemask(), same[4];
    for (int q = 0; q < 4; ++q) same[q] = __match_any_sync(all, cells[q]);
    for (int q = 0; q < 4; ++q)
        if (cells[q] >= 0 && lane == __ffs(same[q]) - 1) found[q] = atomicAdd(&count[cells[q]], __popc(same[q]));
    for (int q = 0; q < 4; ++q)
        found[q] = __shfl_sync(all, found[q], __ffs(same[q]) - 1) + __popc(same[q] & ((1u << lane) - 1u));
#else
    for (int q = 0; q < 4; ++q)
        if (cells[q] >= 0) found[q] = wp::atomic_add(count, cells[q], 1);
#endif
    return found;
"""
# The first lane of a block takes a place and needs it later. It adds its lane number plus one, which is one: for a constant the
# assembler would sum over the lanes first, and all of them would wait.
TAKE_PLACE = """
#if defined(__CUDA_ARCH__)
    int place;
    asm volatile("{ .reg .u32 one; mov.u32 one, %%laneid; add.u32 one, one, 1; atom.relaxed.gpu.global.add.u32 %0, [%1], one; }"
                 : "=r"(place) : "l"(counts.data + i));
    return place;
#else
    return wp::atomic_add(counts, i, 1);
#endif
"""
# Neighbours mostly lie in the same block and reach the same blocks around it.
ADD_MARKS = """
#if defined(__CUDA_ARCH__)
    unsigned same = __match_any_sync(__activemask(), b);
    unsigned all = __reduce_or_sync(same, (unsigned)mark);
    if ((threadIdx.x & 31) == __ffs(same) - 1 && (all & ~*(volatile unsigned*)(marks.data + b)))
        atomicOr((unsigned*)(marks.data + b), all);
#else
    wp::atomic_or(marks, b, mark);
#endif
"""


@wp.func_native(COUNT_IN)
def count_in(count: wp.array(dtype=wp.int32), cell: int):  # type: ignore[valid-type, no-untyped-def]
    """Add one to the count of a cell."""


@wp.func_native(NEXT_FOUR)
def next_four(count: wp.array(dtype=wp.int32), cells: wp.vec4i) -> wp.vec4i:  # type: ignore[valid-type, empty-body]
    """Add one to the count of each of four cells, one after the other, unless it is negative; returns what they were before."""


# The old value is not needed: a reduction, which does not wait.
BOOK = """
#if defined(__CUDA_ARCH__)
    asm volatile("red.relaxed.gpu.global.add.f64 [%0], %1;" :: "l"(&wp::index(rows, i, j)), "d"(value) : "memory");
#else
    wp::index(rows, i, j) += value;
#endif
"""


@wp.func_native(BOOK)
def book(rows: wp.array2d(dtype=wp.float64), i: int, j: int, value: wp.float64):  # type: ignore[valid-type, no-untyped-def]
    """Add to a number that no other thread adds to."""


@wp.func_native(TAKE_PLACE)
def take_place(counts: wp.array(dtype=wp.int32), i: int) -> int:  # type: ignore[valid-type, empty-body]
    """Add one to a count, in the first lane of a warp; returns what it was before."""


@wp.func_native(ADD_MARKS)
def add_marks(marks: wp.array(dtype=wp.int32), b: int, mark: int):  # type: ignore[valid-type, no-untyped-def]
    """Set bits of the marks of a block."""


# Four sums at once: one reduction of 16 bytes, which chips before sm_90 lack.
ADD_NODE = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    asm volatile("red.relaxed.gpu.global.add.v4.f32 [%0], {%1, %2, %3, %4};"
                 :: "l"(&nodes.data[i]), "f"(g[0]), "f"(g[1]), "f"(g[2]), "f"(g[3]) : "memory");
#else
    wp::atomic_add(nodes, i, g);
#endif
"""


@wp.func_native(ADD_NODE)
def add_node32(nodes: wp.array(dtype=wp.vec4f), i: int, g: wp.vec4f):  # type: ignore[valid-type, no-untyped-def]
    """Add four numbers to a node."""


@wp.func
def add_node64(nodes: wp.array(dtype=wp.vec4d), i: int, g: wp.vec4d):  # type: ignore[valid-type, no-untyped-def]
    """Add four numbers to a node."""
    wp.atomic_add(nodes, i, g)


# Four numbers of a node by one load or store of 16 bytes; the compiler does not know that they are aligned.
NODE_AT = """
#if defined(__CUDA_ARCH__)
    float4 g = *(const float4*)(nodes.data + i);
    return wp::vec4f(g.x, g.y, g.z, g.w);
#else
    return nodes.data[i];
#endif
"""
PUT_NODE = """
#if defined(__CUDA_ARCH__)
    *(float4*)(nodes.data + i) = make_float4(g[0], g[1], g[2], g[3]);
#else
    nodes.data[i] = g;
#endif
"""


@wp.func_native(NODE_AT)
def node_at32(nodes: wp.array(dtype=wp.vec4f), i: int) -> wp.vec4f:  # type: ignore[valid-type, empty-body]
    """Four numbers of a node."""


@wp.func
def node_at64(nodes: wp.array(dtype=wp.vec4d), i: int) -> wp.vec4d:  # type: ignore[valid-type]
    """Four numbers of a node."""
    return nodes[i]


@wp.func_native(PUT_NODE)
def put_node32(nodes: wp.array(dtype=wp.vec4f), i: int, g: wp.vec4f):  # type: ignore[valid-type, no-untyped-def]
    """Put four numbers in the place of those of a node."""


@wp.func
def put_node64(nodes: wp.array(dtype=wp.vec4d), i: int, g: wp.vec4d):  # type: ignore[valid-type, no-untyped-def]
    """Put four numbers in the place of those of a node."""
    nodes[i] = g


# Two numbers beside each other, by one reduction or load.
ADD_PAIR = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    asm volatile("red.relaxed.gpu.global.add.v2.f32 [%0], {%1, %2};" :: "l"(numbers.data + i), "f"(x), "f"(y) : "memory");
#else
    wp::atomic_add(numbers, i, x);
    wp::atomic_add(numbers, i + 1, y);
#endif
"""
PAIR_AT = """
#if defined(__CUDA_ARCH__)
    float2 g = *(const float2*)(numbers.data + i);
    return wp::vec2f(g.x, g.y);
#else
    return wp::vec2f(numbers.data[i], numbers.data[i + 1]);
#endif
"""


@wp.func_native(ADD_PAIR)
def add_pair32(numbers: wp.array(dtype=wp.float32), i: int, x: wp.float32, y: wp.float32):  # type: ignore[valid-type, no-untyped-def]
    """Add to two numbers that lie beside each other."""


@wp.func
def add_pair64(numbers: wp.array(dtype=wp.float64), i: int, x: wp.float64, y: wp.float64):  # type: ignore[valid-type, no-untyped-def]
    """Add to two numbers that lie beside each other."""
    wp.atomic_add(numbers, i, x)
    wp.atomic_add(numbers, i + 1, y)


@wp.func_native(PAIR_AT)
def pair_at32(numbers: wp.array(dtype=wp.float32), i: int) -> wp.vec2f:  # type: ignore[valid-type, empty-body]
    """Two numbers that lie beside each other."""


@wp.func
def pair_at64(numbers: wp.array(dtype=wp.float64), i: int) -> wp.vec2d:  # type: ignore[valid-type]
    """Two numbers that lie beside each other."""
    return wp.vec2d(numbers[i], numbers[i + 1])


@wp.func_native("return WP_TILE_BLOCK_DIM;")
def lane_count() -> int:  # type: ignore[empty-body]
    """Lanes of a block; those of warp's own function are not known when a kernel is compiled for a GPU."""


# From the hardware registers; warp would compute them by divisions.
OWN_BLOCK = """
#if defined(__CUDA_ARCH__)
    return blockIdx.x;
#else
    return block;
#endif
"""
OWN_LANE = """
#if defined(__CUDA_ARCH__)
    return threadIdx.x & (WP_TILE_BLOCK_DIM - 1);
#else
    return lane;
#endif
"""


@wp.func_native(OWN_BLOCK)
def own_block(block: int) -> int:  # type: ignore[empty-body]
    """The block of this thread, where a launch has one block of threads for each."""


@wp.func_native(OWN_LANE)
def own_lane(lane: int) -> int:  # type: ignore[empty-body]
    """The lane of this thread in its block."""


# The compiler moves a load to where its value is needed; loads that could start together would then follow each other. The empty
# statement needs the value, and costs nothing.
LOADED_HERE = """
    int here = n;
#if defined(__CUDA_ARCH__)
    asm volatile("" : "+r"(here));
#endif
    return here;
"""


@wp.func_native(LOADED_HERE)
def loaded_here(n: int) -> int:  # type: ignore[empty-body]
    """A number whose load starts here, before it is known whether it is needed."""


WARP_LANES = """
#if defined(__CUDA_ARCH__)
    return 32;
#else
    return 1;
#endif
"""


@wp.func_native(WARP_LANES)
def warp_lanes() -> int:  # type: ignore[empty-body]
    """Threads that go together: a warp of a GPU; on a CPU each goes alone."""


# Lanes of a warp that add to the same place, mostly those of one column of cells, add up first: one atomic operation serves them
# all. This takes as long as a few atomic operations, so that fewer lanes than these add one by one. Whole numbers are added by
# parts of 22, 22 and 20 bits, whose sums over a warp fit into 32.
FEWEST_TOGETHER = 4  # with 2 a look at 4.6 million particles takes 2.5 ms, with 3, 4, 5 and 8: 2.0, 1.7, 2.0 and 3.0 ms (H200)
ADD_WHOLES = f"""
#if defined(__CUDA_ARCH__)
    unsigned same = __match_any_sync(__activemask(), place);
    bool together = __popc(same) >= {FEWEST_TOGETHER}, adds = !together || (threadIdx.x & 31) == __ffs(same) - 1;
    for (int d = 0; d < 5; ++d) {{
        unsigned long long n = (unsigned long long)values[d];
        if (together)
            n = (unsigned long long)__reduce_add_sync(same, (unsigned)n & 0x3fffffu)
                + ((unsigned long long)__reduce_add_sync(same, (unsigned)(n >> 22) & 0x3fffffu) << 22)
                + ((unsigned long long)__reduce_add_sync(same, (unsigned)(n >> 44)) << 44);
        if (adds) atomicAdd((unsigned long long*)(sums.data + place + d), n);
    }}
#else
    for (int d = 0; d < 5; ++d) wp::atomic_add(sums, place + d, (wp::int64)values[d]);
#endif
"""
Whole5 = wp.types.vector(length=5, dtype=wp.int64)


@wp.func_native(ADD_WHOLES)
def add_wholes(sums: wp.array(dtype=wp.int64), place: int, values: Whole5):  # type: ignore[valid-type, no-untyped-def]
    """Add five whole numbers to those that lie at a place and behind it."""


def of(precision: str) -> dict[str, Any]:
    """The functions for a number type, by the name that kernels give them."""
    names = (
        "add_node", "node_at", "add_pair", "pair_at", "put_node", "raise_peak", "book_four", "max_lanes", "note_largest",
    )  # fmt: skip
    known = vars(reductions) | vars(shared_memory) | globals()
    by_type = {name: known[f"{name}{precision[-2:]}"] for name in names}
    plain: tuple[Any, ...] = (count_in, next_four, take_place, book, add_marks, lane_count, own_block, own_lane, loaded_here)
    plain += (warp_lanes, sum_before, hits_before, sum_lanes, add_wholes)
    return by_type | {function.key: function for function in (*plain, *shared_memory.PLAIN)}
