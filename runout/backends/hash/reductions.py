"""Sums and maxima over the lanes of a warp in CUDA, each with its equivalent for a CPU.

Functions for a number type end in 32 or 64.
"""

import warp as wp

BEFORE_ON_CPU = """
#else
    auto lanes = wp::tile<wp::int32>(n);
    auto before = wp::tile_scan_exclusive(lanes);
    auto sum = wp::tile_sum(lanes);
    return wp::vec2i(wp::untile(before), wp::tile_extract(sum, 0));
#endif
"""
# Sums over the 32 lanes of a block of one warp: a tenth of the instructions of sums over any block, which meet in shared memory.
SUM_BEFORE = (
    """
#if defined(__CUDA_ARCH__)
    int sum = n;
    for (int d = 1; d < 32; d <<= 1) {
        int other = __shfl_up_sync(0xffffffffu, sum, d);
        if ((threadIdx.x & 31) >= d) sum += other;
    }
    return wp::vec2i(sum - n, __shfl_sync(0xffffffffu, sum, 31));"""
    + BEFORE_ON_CPU
)
HITS_BEFORE = (
    """
#if defined(__CUDA_ARCH__)
    unsigned hits = __ballot_sync(0xffffffffu, n);
    return wp::vec2i(__popc(hits & ((1u << (threadIdx.x & 31)) - 1u)), __popc(hits));"""
    + BEFORE_ON_CPU
)
SUM_LANES = """
#if defined(__CUDA_ARCH__)
    for (int d = 16; d > 0; d >>= 1) value += __shfl_xor_sync(0xffffffffu, value, d);
    return value;
#else
    auto lanes = wp::tile<wp::float64>(value);
    auto sum = wp::tile_sum(lanes);
    auto total = wp::tile_extract(sum, 0);  // all lanes meet here
    return WP_TILE_THREAD_IDX == 0 ? total : 0.0;
#endif
"""


@wp.func_native(SUM_BEFORE)
def sum_before(n: int) -> wp.vec2i:  # type: ignore[empty-body]
    """Sums over the lanes before this one, and over all, of a block of one warp."""


@wp.func_native(HITS_BEFORE)
def hits_before(n: bool) -> wp.vec2i:  # type: ignore[empty-body]
    """For how many of the lanes before this one ``n`` is true, and of all, of a block of one warp."""


@wp.func_native(SUM_LANES)
def sum_lanes(value: wp.float64) -> wp.float64:  # type: ignore[valid-type, empty-body]
    """Sum over the 32 lanes of a warp, for the first of them; on a CPU all lanes of a block are one warp."""


MAX_ON_CPU = """
#else
    auto lanes = wp::tile<wp::float32>(value);
    auto top = wp::tile_max(lanes);
    return wp::tile_extract(top, 0);  // all lanes meet here
#endif
"""
MAX_LANES32 = (
    """
#if defined(__CUDA_ARCH__)
    return __int_as_float(__reduce_max_sync(0xffffffffu, __float_as_int(value)));"""
    + MAX_ON_CPU
)
MAX_LANES64 = """
#if defined(__CUDA_ARCH__)
    for (int d = 16; d > 0; d >>= 1) value = fmax(value, __shfl_xor_sync(0xffffffffu, value, d));
    return value;""" + MAX_ON_CPU.replace("float32", "float64")


@wp.func_native(MAX_LANES32)
def max_lanes32(value: wp.float32) -> wp.float32:  # type: ignore[valid-type, empty-body]
    """The largest of numbers that are not negative over the 32 lanes of a warp; on a CPU over all lanes of a block."""


@wp.func_native(MAX_LANES64)
def max_lanes64(value: wp.float64) -> wp.float64:  # type: ignore[valid-type, empty-body]
    """The same."""


# On a CPU threads take turns in the order of their numbers.
LARGEST32 = """
#if defined(__CUDA_ARCH__)
    int bits = __reduce_max_sync(0xffffffffu, __float_as_int(value));
    if ((t & 31) == 0) numbers.data[t >> 5] = __int_as_float(bits);
#else
    wp::float32& largest = wp::index(numbers, t >> 5);
    if ((t & 31) == 0 || value > largest) largest = value;
#endif
"""
LARGEST64 = LARGEST32.replace("float32", "float64").replace(
    """int bits = __reduce_max_sync(0xffffffffu, __float_as_int(value));
    if ((t & 31) == 0) numbers.data[t >> 5] = __int_as_float(bits);""",
    """for (int d = 16; d > 0; d >>= 1) value = fmax(value, __shfl_xor_sync(0xffffffffu, value, d));
    if ((t & 31) == 0) numbers.data[t >> 5] = value;""",
)


@wp.func_native(LARGEST32)
def note_largest32(numbers: wp.array(dtype=wp.float32), t: int, value: wp.float32):  # type: ignore[valid-type, no-untyped-def]
    """The largest of the numbers of 32 threads ``t`` that follow each other, none negative, to the place ``t / 32``."""


@wp.func_native(LARGEST64)
def note_largest64(numbers: wp.array(dtype=wp.float64), t: int, value: wp.float64):  # type: ignore[valid-type, no-untyped-def]
    """The same."""


# Each lane hands half of what it has to another that wants it: six exchanges for four sums, and they end in four lanes.
BOOK_FOUR = """
#if defined(__CUDA_ARCH__)
    unsigned lane = threadIdx.x & 31;
    bool upper = lane & 16, odd = lane & 8;
    wp::float32 a = upper ? values[2] : values[0], c = upper ? values[3] : values[1];
    a += __shfl_xor_sync(0xffffffffu, upper ? values[0] : values[2], 16);
    c += __shfl_xor_sync(0xffffffffu, upper ? values[1] : values[3], 16);
    wp::float32 sum = (odd ? c : a) + __shfl_xor_sync(0xffffffffu, odd ? a : c, 8);
    for (int d = 4; d > 0; d >>= 1) sum += __shfl_xor_sync(0xffffffffu, sum, d);
    if ((lane & 7) == 0)
        asm volatile("red.relaxed.gpu.global.add.f64 [%0], %1;"
                     :: "l"(&wp::index(rows, i, j + (int)(lane >> 3))), "d"((double)sum) : "memory");
#else
    for (int d = 0; d < 4; ++d) {
        auto lanes = wp::tile<wp::float32>(values[d]);
        auto sum = wp::tile_sum(lanes);
        auto total = wp::tile_extract(sum, 0);  // all lanes meet here
        if (WP_TILE_THREAD_IDX == 0) wp::index(rows, i, j + d) += wp::float64(total);
    }
#endif
"""


@wp.func_native(BOOK_FOUR)
def book_four32(rows: wp.array2d(dtype=wp.float64), i: int, j: int, values: wp.vec4f):  # type: ignore[valid-type, no-untyped-def]
    """Add the sums of four numbers over the lanes of a warp to numbers beside each other that no other thread adds to."""


@wp.func_native(BOOK_FOUR.replace("float32", "float64"))
def book_four64(rows: wp.array2d(dtype=wp.float64), i: int, j: int, values: wp.vec4d):  # type: ignore[valid-type, no-untyped-def]
    """The same."""


# The first lane alone; numbers that are not negative have the order of their bits.
PEAK32 = """
#if defined(__CUDA_ARCH__)
    int bits = __float_as_int(value);
    if ((threadIdx.x & 31) == 0 && bits > *(volatile int*)(peaks.data + i)) atomicMax((int*)(peaks.data + i), bits);
#else
    wp::atomic_max(peaks, i, value);
#endif
"""
PEAK64 = PEAK32.replace("int bits", "long long bits").replace("float_as_int", "double_as_longlong").replace("int*", "long long*")


@wp.func_native(PEAK32)
def raise_peak32(peaks: wp.array(dtype=wp.float32), i: int, value: wp.float32):  # type: ignore[valid-type, no-untyped-def]
    """Bring a largest value up to one of a warp."""


@wp.func_native(PEAK64)
def raise_peak64(peaks: wp.array(dtype=wp.float64), i: int, value: wp.float64):  # type: ignore[valid-type, no-untyped-def]
    """Bring a largest value up to one of a warp."""
