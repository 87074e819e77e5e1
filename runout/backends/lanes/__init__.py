"""Vectors of 16 numbers inside numba functions, for code that a compiler does not vectorise by itself.

``vectors`` holds the two types :class:`Vec` and :class:`Mask` with arithmetic and comparison, ``shuffles`` moves lanes,
``memory`` loads, stores, transposes and prefetches. The element type follows the arrays: float32 fills one AVX-512
register, two of AVX2, four of SSE; float64 twice as many. LLVM splits a vector that is wider than the machine, so that
one source serves every processor, and there is no scalar copy to keep alike.

Sixteen lanes are four *groups* of four: four nodes of four numbers each, to the transfers that use this package.
Loads are not checked against the bounds of an array: pad it by one vector.
"""

from runout.backends.lanes.memory import (
    listed_record_vectors,
    load4,
    load8,
    load16,
    local_array,
    prefetch,
    record_vectors,
    row_vectors,
    store,
)
from runout.backends.lanes.shuffles import constant, looked_up, permutation, permutation_of_two
from runout.backends.lanes.vectors import (
    LANES,
    any_lane,
    in_double,
    lane_bits,
    lane_largest,
    lane_sum,
    largest,
    lowest_bit,
    select,
    whole,
)

__all__ = [
    "LANES",
    "any_lane",
    "constant",
    "in_double",
    "lane_bits",
    "lane_largest",
    "lane_sum",
    "largest",
    "listed_record_vectors",
    "load4",
    "load8",
    "load16",
    "local_array",
    "looked_up",
    "lowest_bit",
    "permutation",
    "permutation_of_two",
    "prefetch",
    "record_vectors",
    "row_vectors",
    "select",
    "store",
    "whole",
]
